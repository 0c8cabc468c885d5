"""Runs of a cradle: objects in, kernels, objects out."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from cradle_env.cost import MOST_STEPS, check_cost, steps_of
from cradle_env.cradle import Cradle
from cradle_env.errors import check_range
from cradle_env.kernel_records import TOLERANCE, records
from cradle_env.mechanics import event_loop, initial_state, restitution
from cradle_env.mechanics import layout as p
from cradle_env.release import InitialState, Release
from cradle_env.threads import check_stop, in_threads
from cradle_env.trajectory import IMPACT, Trajectory

# What a tolerance may be.
_TOLERANCES = (1e-24, 1e-6)
#: Samples of one run at most, and of single bobs in it: 1.6 GB, and as much again and more for the ledger.
_MOST_SAMPLES, _MOST_BOB_SAMPLES = 1e7, 5e7
#: What a status other than DONE means.
EXHAUSTED = {
    event_loop.STALLED: "more impacts at one instant than can be resolved",
    event_loop.NOT_FINITE: "the motion left the range of numbers: a force is too steep for the steps; weaken the "
    "effects, or lower b",
    event_loop.NO_REST: "no common rest was found of bobs that press so hard on each other, or hang in a force as "
    "steep; take fewer, or delta nearer 0",
    event_loop.PAUSED: "it takes more steps than are allowed; shorten it, or take a cradle that moves more slowly",
}


class SimulationError(RuntimeError):
    """A run could not be carried to its end."""


def simulate(
    cradle: Cradle,
    release: Release | InitialState,
    duration: float = 60.0,
    sample_rate: float = 240.0,
    *,
    times: np.ndarray | None = None,
    ledger: bool = True,
    tolerance: float = TOLERANCE,
    sensitivities: Sequence[str] = (),
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Simulate one run of a cradle (eqs. 1 to 6, as far as the model has them).

    The trajectory is the true motion: effects that act on a measurement change readings alone.

    Parameters
    ----------
    cradle : Cradle
        With its model.
    release : Release or InitialState
        How the run begins.
    duration : float
        Length of the run [s].
    sample_rate : float
        Samples per second [1/s], the first at t = 0.
    times : ndarray, shape (T,), optional
        Instants of the samples [s], ascending, not negative, instead of duration and sample_rate.
    ledger : bool
        Whether to keep the energy ledger, which `Trajectory.energy` reads.
    tolerance : float
        What one segment of flight may leave out of the motion, in lengths of the strings: 1e-24 to 1e-6, below 1e-16
        far less than rounding. Over 10 s θ errs by some hundred times as much.
        Contacts that are followed in time keep errors of 1e-6 to 1e-5 rad at any step.
    sensitivities : sequence of str
        Parameters by which to differentiate θ, r and the instants of the impacts, exactly: fields of `Cradle`,
        "delta[i]" of gap i, "alpha" and "n" of its power law, "effect.key" or "effect.key[i]" of its effects,
        "release_angle" (of bob i, where `angles` are given: "release_angle[i]"), "theta[i]" and the like of an
        `InitialState`. See `Trajectory.d_theta`. The run is bit for bit the same without them.
    progress : callable, optional
        Called about twice a second with the fraction of the run that is done.

    Returns
    -------
    Trajectory

    Raises
    ------
    ValueError
        For impossible input, and for a run of more than 1e9 steps of single bobs. For sensitivities of a cradle on
        rigid strings, with forces of effects, or with contacts that are followed in time.
    SimulationError
        If the run cannot reach its end.

    References
    ----------
    Lee & Hong, arXiv:2401.16693. Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, II.5.

    Examples
    --------
    >>> run = simulate(Cradle(bobs=2), Release(angle=0.1), duration=1.0, sample_rate=100.0)
    >>> run.theta.shape, run.impacts["pair"][0].item(), round(float(run.impacts["time"][0]), 2)
    ((101, 2), 1, 0.28)
    """
    wanted = sample_times(duration, sample_rate) if times is None else _checked_times(times)
    check_range("tolerance", tolerance, "", *_TOLERANCES)
    return _run(cradle, release, wanted, ledger, tolerance, progress, tuple(sensitivities))


def simulate_batch(
    cradles: Cradle | Sequence[Cradle],
    releases: Release | InitialState | Sequence[Release | InitialState],
    duration: float = 60.0,
    sample_rate: float = 240.0,
    *,
    times: np.ndarray | None = None,
    ledger: bool = False,
    tolerance: float = TOLERANCE,
    workers: int | None = None,
) -> list[Trajectory]:
    """Simulate many runs on several threads; cradles and releases may differ in everything.

    Each result is bit for bit that of `simulate`, whatever the number of threads.

    Parameters
    ----------
    cradles : Cradle or sequence of Cradle
        A single one serves all runs.
    releases : Release or InitialState, or a sequence of them
        A single one serves all runs.
    duration, sample_rate, times, ledger, tolerance
        As for `simulate`, the same for all runs.
    workers : int, optional
        Threads; all cores by default.

    Returns
    -------
    list of Trajectory
        In the order of the cradles and releases.

    Raises
    ------
    ValueError
        If two sequences differ in length, and as `simulate`.
    SimulationError
        If a run cannot reach its end.

    Examples
    --------
    >>> runs = simulate_batch([Cradle(bobs=2), Cradle(bobs=3)], Release(angle=0.1), duration=0.5, sample_rate=100.0)
    >>> [run.theta.shape for run in runs]
    [(51, 2), (51, 3)]
    """
    several = [len(x) for x in (cradles, releases) if not isinstance(x, Cradle | Release | InitialState)]
    count = max(several, default=1)
    many = [cradles] * count if isinstance(cradles, Cradle) else list(cradles)
    starts = [releases] * count if isinstance(releases, Release | InitialState) else list(releases)
    if len(many) != len(starts):
        raise ValueError(f"{len(many)} cradles and {len(starts)} releases; give as many, or one of either")
    check_range("tolerance", tolerance, "", *_TOLERANCES)
    wanted = sample_times(duration, sample_rate) if times is None else _checked_times(times)
    pairs = list(zip(many, starts, strict=True))
    return in_threads(lambda pair: _run(pair[0], pair[1], wanted, ledger, tolerance), pairs, workers)


def sample_times(duration: float, sample_rate: float) -> np.ndarray:
    """Instants [s] of the samples of a run; ValueError where they are too many."""
    check_range("duration", duration, "s", 0.0, above=True)
    check_range("sample_rate", sample_rate, "1/s", 0.0, above=True)
    samples = check_range(
        "duration times sample_rate", duration * sample_rate, "", high=_MOST_SAMPLES, remedy="a run is held in memory"
    )
    return np.arange(int(np.floor(samples + 1e-9)) + 1) / sample_rate


def _checked_times(times: np.ndarray) -> np.ndarray:
    times = np.ascontiguousarray(times, dtype=float)
    if times.ndim != 1 or len(times) == 0 or not np.all(np.isfinite(times)):
        raise ValueError("times must be a one-dimensional array of finite seconds, not empty")
    if times[0] < 0.0 or np.any(np.diff(times) < 0.0):
        raise ValueError("times must be ascending, from 0 s on (the release)")
    return times


def prepare(cradle: Cradle, release: Release | InitialState, tolerance: float = TOLERANCE):
    """Records and state at t = 0, ready for the kernels: (cradle record, bobs, state, scratch)."""
    c, bobs = records(cradle, tolerance)
    return c, bobs, *_begin(c, bobs, cradle, release)


def _begin(c: np.ndarray, bobs: np.ndarray, cradle: Cradle, release: Release | InitialState):
    """State at t = 0, and scratch, of a cradle with these records."""
    S, W = np.zeros((cradle.bobs, p.COLUMNS)), np.zeros((cradle.bobs, p.SCRATCH))
    if isinstance(release, Release):
        overlap = initial_state.at_rest(c[0], bobs, release.angles_of(cradle), release.start == "hanging", S, W)
        check_rest(cradle, overlap)
        remedy = "lift the end bobs, outwards (angles are positive towards the last bob), or increase delta"
    else:
        theta, theta_dot, r, r_dot, ratio = _initial_arrays(cradle, release)
        overlap = initial_state.moving(c[0], bobs, theta, theta_dot, r, r_dot, ratio, S, W)
        remedy = "give angles at which they hang side by side"
    if overlap > 1e-6:
        raise ValueError(f"bobs overlap by {overlap:.2g} m at the release; {remedy}")
    return S, W


# What an initial state can be: nothing is nearer its pivot, and no string pulls more than on its virgin line, but for
# rounding.
_POSSIBLE = {"r": (1e-9, np.inf), "tension_ratio": (0.0, 1.0 + 1e-9)}


def _initial_arrays(cradle: Cradle, state: InitialState) -> list[np.ndarray]:
    """theta, theta_dot, r (nan: hanging), r_dot, tension ratio, each (N,)."""
    defaults = (None, None, np.nan, 0.0, 1.0)
    given = (state.theta, state.theta_dot, state.r, state.r_dot, state.tension_ratio)
    arrays = []
    for name, value, default in zip(
        ("theta", "theta_dot", "r", "r_dot", "tension_ratio"), given, defaults, strict=True
    ):
        array = np.asarray(default if value is None else value, dtype=float)
        if (value is not None or default is None) and (array.shape != (cradle.bobs,) or not np.all(np.isfinite(array))):
            raise ValueError(f"initial {name} must be {cradle.bobs} finite numbers, one per bob")
        low, high = _POSSIBLE.get(name, (-np.inf, np.inf))
        for number in () if value is None else array:
            check_range(f"initial {name}", number, "m" if name == "r" else "", low, high)
        arrays.append(np.ascontiguousarray(np.broadcast_to(array, cradle.bobs)))
    return arrays


def _run(
    cradle: Cradle,
    release: Release | InitialState,
    times: np.ndarray,
    ledger: bool,
    tolerance: float,
    progress: Callable[[float], None] | None = None,
    names: tuple[str, ...] = (),
) -> Trajectory:
    check_stop()
    c, bobs, S, W = prepare(cradle, release, tolerance)
    n, table, end, flown = cradle.bobs, restitution.universal_curves(), float(times[-1]), 0.0
    check_cost(cradle, end, steps_of(c, cradle, end), MOST_STEPS, "shorten it, or take a cradle that moves more slowly")
    check_range("samples times bobs", len(times) * n, "", high=_MOST_BOB_SAMPLES, remedy="a run is held in memory")
    motion = np.empty((len(times), n, 4))
    energy = np.empty((len(times) if ledger else 0, n, 7))
    impacts, count = np.empty((max(256, 64 * n), p.LOGGED if names else 4)), 0
    begun = None
    if names:  # the contacts that persist from the start show in the state once the run has begun
        event_loop.run(c[0], bobs, table, S, W, -1.0, times, motion, energy, impacts, count)
        begun = c, bobs, S.copy()
    while True:
        status, count = event_loop.run(c[0], bobs, table, S, W, end, times, motion, energy, impacts, count)
        if status == event_loop.FULL:
            impacts = np.concatenate([impacts, np.empty_like(impacts)])
        elif status == event_loop.PAUSED and flown < MOST_STEPS:
            check_stop()
            flown += S[0, p.FLOWN]
            S[0, p.FLOWN] = 0.0
            if progress is not None:
                progress(float(S[:, p.T0].min() / end))
        else:
            break
    if status != event_loop.DONE:
        raise SimulationError(f"the run stopped at {S[:, p.T0].min():g} s of {end:g} s: {EXHAUSTED[status]}")
    rows = impact_rows(impacts[:count])
    theta, r, theta_dot, r_dot = np.moveaxis(motion, -1, 0)
    run = Trajectory(cradle, release, times, theta, r, theta_dot, r_dot, rows, energy if ledger else None)
    if begun is None:
        return run
    from cradle_env.sensitivities import differentiate  # its kernel compiles when first used

    found = differentiate(names, cradle, release, _begin, begun, table, impacts[:count], times)
    d_theta, d_r, d_impact_times = (dict(zip(names, derivative, strict=True)) for derivative in found)
    return dataclasses.replace(run, d_theta=d_theta, d_r=d_r, d_impact_times=d_impact_times)


def impact_rows(impacts: np.ndarray) -> np.ndarray:
    """What a kernel has written of impacts, (M, 4), as rows of IMPACT."""
    rows = np.empty(len(impacts), IMPACT)
    for k, name in enumerate(("time", "pair", "speed", "loss")):
        rows[name] = impacts[:, k]
    rows["pair"] += 1
    return rows


def check_rest(cradle: Cradle, found: float) -> None:
    """ValueError unless what the search for the bobs' rest has returned is finite."""
    if not np.isfinite(found):
        raise ValueError(f"bobs is {cradle.bobs} at delta {np.min(cradle.delta):g}: {EXHAUSTED[event_loop.NO_REST]}")


def raised(cradle: Cradle, release: Release) -> Release:
    """The release of the last bobs at its angle, or at the least beyond it where they clear those that hang."""
    c, bobs = records(cradle)
    S, W = np.zeros((cradle.bobs, p.COLUMNS)), np.zeros((cradle.bobs, p.SCRATCH))
    scratch = np.zeros(cradle.bobs)
    angle = initial_state.lift(c[0], bobs, release.bobs, release.angle, release.start == "hanging", S, W, scratch)
    check_rest(cradle, angle)
    return dataclasses.replace(release, angle=angle)


def equilibrium(cradle: Cradle) -> tuple[np.ndarray, np.ndarray]:
    """(theta [rad], r [m]) of each bob at rest, none lifted, its strings on the virgin loading line; both (N,)."""
    c, bobs = records(cradle)
    S, W = np.zeros((cradle.bobs, p.COLUMNS)), np.zeros((cradle.bobs, p.SCRATCH))
    check_rest(cradle, initial_state.at_rest(c[0], bobs, np.full(cradle.bobs, np.nan), False, S, W))
    x, z = S[:, p.START] - bobs["pivot"], S[:, p.START + 1]
    if not c["elastic"][0]:
        return S[:, p.START].copy(), bobs["length"].copy()
    return np.arctan2(x, -z), np.hypot(x, z)
