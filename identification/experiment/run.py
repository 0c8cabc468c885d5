"""One measured run: its readings, its release, and priors of unknowns."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from cradle_env.cost import check_cost, steps_needed
from cradle_env.cradle import Cradle
from cradle_env.effects import CATALOGUE
from cradle_env.errors import check_range, one_line, unknown_key
from cradle_env.parameter_name import ParameterName
from cradle_env.release import Release
from cradle_env.simulation import prepare
from identification.experiment.recording import UNITS

#: Smallest noise [rad or m]: errors of a simulation, about 1e-7 over 10 s, must not count as misfit.
_LEAST_NOISE = 1e-7
#: Most steps of single bobs in one simulation of a run, about 10 s of computing: a fit makes thousands of simulations.
_MOST_STEPS = 1e7
_LATE = "count t from the release, not from 1970 as a clock in Unix time does, or keep less of the recording"


@dataclass(frozen=True)
class Prior:
    """Prior of an unknown: normal (mean and sd) or uniform (low and high).

    Parameters
    ----------
    mean, sd : float, optional
        Mean and standard deviation, in the unknown's SI unit.
    low, high : float, optional
        Bounds, in the unknown's SI unit.

    Raises
    ------
    ValueError
        If another pair of these is given, if sd is not positive, or if low is not below high.

    Examples
    --------
    >>> Prior(mean=0.3, sd=0.002).support, Prior(low=0.0, high=1.0).sd
    ((0.3,), None)
    """

    mean: float | None = None
    sd: float | None = None
    low: float | None = None
    high: float | None = None

    def __post_init__(self) -> None:
        given = tuple(name for name in ("mean", "sd", "low", "high") if getattr(self, name) is not None)
        if given not in (("mean", "sd"), ("low", "high")):
            raise ValueError(f"a prior has mean and sd, or low and high; given: {', '.join(given) or 'nothing'}")
        for name in given:
            value = check_range(name, getattr(self, name), "", 0.0 if name == "sd" else -math.inf, above=name == "sd")
            object.__setattr__(self, name, value)
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low is {self.low:g} and high is {self.high:g}; low must be less than high")

    @property
    def support(self) -> tuple[float, ...]:
        """Values that must be possible: the mean, or both bounds moved inwards by 1e-9 of the width."""
        if self.low is None or self.high is None:
            return (float(self.mean or 0.0),)
        inset = 1e-9 * (self.high - self.low)
        return self.low + inset, self.high - inset


def check_noise(noise: float, unit: str, scale: float = 1.0) -> float:
    """Check the standard deviation of a reading, in a unit of `scale` rad or m; ValueError if it is too small."""
    remedy = "state the scatter of a single reading, or leave noise out to have it inferred"
    return check_range("noise", noise, unit, _LEAST_NOISE / scale, remedy=remedy)


@dataclass(frozen=True)
class ReleaseInfo:
    """How a run was released, and how well that is known.

    Parameters
    ----------
    release : Release
        The release; angles are true angles [rad].
    angle_sd : float
        Standard deviation of the release angle [rad]; 0 if it is known exactly.
    time_sd : float
        Standard deviation of the instant of release [s]; 0 if it is known exactly.

    Raises
    ------
    ValueError
        If a standard deviation is negative or not finite.
    """

    release: Release
    angle_sd: float = 0.0
    time_sd: float = 0.0

    def __post_init__(self) -> None:
        for name, unit in (("angle_sd", "rad"), ("time_sd", "s")):
            object.__setattr__(self, name, check_range(name, getattr(self, name), unit, 0.0))


@dataclass(frozen=True)
class Tracking:
    """Errors of readings that repeat where a bob passes the same place as fast; see `TrackingNoise`.

    Parameters
    ----------
    ratio : float
        Their standard deviation over the noise of a reading.
    place : float
        Distance over which they are alike [rad or m].
    speed : float
        Difference of speed over which they are alike [rad/s or m/s].

    Raises
    ------
    ValueError
        If one of them is not positive and finite.
    """

    ratio: float
    place: float
    speed: float

    def __post_init__(self) -> None:
        for name in ("ratio", "place", "speed"):
            object.__setattr__(self, name, check_range(f"tracking.{name}", getattr(self, name), "", 0.0, above=True))


@dataclass(frozen=True, eq=False)
class Run:
    """One measured run, in SI units.

    Parameters
    ----------
    times : ndarray of shape (T,)
        Times [s], ascending, 0 at the release if there is one. Of impacts, the instants of clicks from the beginning of
        the recording.
    readings : ndarray of shape (T, N)
        Angles [rad], or displacements from each bob's rest position [m]; nan where missing. Of impacts, the times [s]
        in the column of bob 1.
    quantity : {"theta", "x", "impacts"}
        Angles, displacements, or instants of clicks.
    release : ReleaseInfo, optional
        How the run began; required with state="release".
    delta : float or tuple of float, optional
        δ, one number or one per gap; in an `Experiment`, that of the cradle if omitted.
    noise : float, optional
        Standard deviation of one reading [rad, m or s]; inferred if omitted.
    tracking : Tracking, optional
        Errors of readings that repeat; none if omitted.
    fit_from : float, optional
        Earlier readings are not used [s]; the first reading if omitted.
    fit_to : float, optional
        Later readings are held out: never fitted, only predicted [s].
    state : {"release", "free"}
        "release": the run starts from rest as `release` states. "free": the state at `fit_from` is inferred.
    rest : {"known", "free"}
        "free": an offset of each bob's readings is inferred.
    file : str
        Name of the data file.
    unit : str
        Unit of the readings in the file.
    scale : float
        SI value of that unit.
    lines : ndarray of int, shape (T, N), optional
        Line of each reading in the file; 0 if it has none.

    Raises
    ------
    ValueError
        If arrays do not match, times do not ascend, or no reading can be fitted.
    """

    times: np.ndarray
    readings: np.ndarray
    quantity: str = "theta"
    release: ReleaseInfo | None = None
    delta: float | tuple[float, ...] = None  # type: ignore[assignment]  # filled in by Experiment
    noise: float | None = None
    tracking: Tracking | None = None
    fit_from: float = None  # type: ignore[assignment]  # filled in below
    fit_to: float | None = None
    state: str = "release"
    rest: str = "known"
    file: str = "run1.csv"
    unit: str = "rad"
    scale: float = 1.0
    lines: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name, choices in (
            ("quantity", ("theta", "x", "impacts")),
            ("state", ("release", "free")),
            ("rest", ("known", "free")),
            ("unit", UNITS.get(self.quantity, ())),
        ):
            if getattr(self, name) not in choices:
                raise ValueError(
                    f"{name} is {one_line(getattr(self, name))}; it must be {' or '.join(map(repr, choices))}"
                )
        self._check_arrays()
        if self.state == "release" and self.release is None:
            raise ValueError(
                'state is "release", but no release is stated;'
                ' add release = { bobs = 1, angle = ... }, or write state = "free"'
            )
        if self.noise is not None:
            object.__setattr__(self, "noise", check_noise(self.noise, self.si_unit))
        if self.of_impacts and (self.state, self.rest) != ("release", "known"):
            raise ValueError('state and rest of a run of impacts stay "release" and "known": a click shows no position')
        if self.of_impacts and self.tracking is not None:
            raise ValueError("tracking does not go with a run of impacts, which no camera follows; leave it out")
        if self.of_impacts and self.release is not None and self.release.time_sd > 0.0:
            raise ValueError("time_sd must be 0 in a run of impacts, whose clock is inferred; leave it out")
        self._check_window()

    def _check_arrays(self) -> None:
        times, readings = (np.ascontiguousarray(a, dtype=float) for a in (self.times, self.readings))
        if times.ndim != 1 or readings.ndim != 2 or len(times) != len(readings):
            raise ValueError(
                f"times {times.shape} and readings {readings.shape} do not match; give times (T,) and readings (T, N)"
            )
        if not np.isfinite(times).all() or (times[1:] <= times[:-1]).any():
            raise ValueError("times must be finite seconds, each later than the one before")
        if np.isinf(readings).any():
            raise ValueError("readings hold an infinite value; write nan where one is missing")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "readings", readings)

    def _check_window(self) -> None:
        seen = self.times[~np.isnan(self.readings).all(axis=1)]
        if len(seen) == 0:
            raise ValueError(f"no usable rows: {self.file} holds no reading at all; each row needs a value or more")
        earliest = 0.0 if self.state == "release" else -math.inf
        start = max(float(self.times[0]), earliest) if self.fit_from is None else self.fit_from
        start = check_range(
            "fit_from", start, "s", earliest, remedy='the release is at t = 0; for earlier data write state = "free"'
        )
        object.__setattr__(self, "fit_from", start)
        end = math.inf
        if self.fit_to is not None:
            end = check_range("fit_to", self.fit_to, "s")
            object.__setattr__(self, "fit_to", end)
        if end <= start:
            raise ValueError(f"fit_to is {end:g} s, not after fit_from, {start:g} s; give a later one")
        if not ((seen >= start) & (seen <= end)).any():
            window = f"fit_from {start:g} s" + (f" and fit_to {end:g} s" if end < math.inf else "")
            raise ValueError(
                f"{window} leaves no usable rows:"
                f" the readings of {self.file} lie between {seen[0]:g} and {seen[-1]:g} s; widen the window"
            )
        object.__setattr__(self, "fit_from", max(start, float(seen[0])))  # the first reading that can be fitted

    @property
    def of_impacts(self) -> bool:
        """Whether its readings are the instants of clicks."""
        return self.quantity == "impacts"

    @property
    def si_unit(self) -> str:
        """The SI unit of its readings."""
        return next(iter(UNITS[self.quantity]))

    @property
    def duration(self) -> float:
        """Time from the start of a simulation of the run to its last reading [s]."""
        return max(float(self.times[-1]) - (self.fit_from if self.state == "free" else 0.0), 0.0)

    @property
    def fitted(self) -> np.ndarray:
        """Rows that may be fitted, (T,) of bool: from `fit_from` to `fit_to`, with at least one reading."""
        end = math.inf if self.fit_to is None else self.fit_to
        return (self.times >= self.fit_from) & (self.times <= end) & ~np.isnan(self.readings).all(axis=1)

    @property
    def held_out(self) -> np.ndarray:
        """Rows after `fit_to` with at least one reading, (T,) of bool; none if `fit_to` is omitted."""
        end = math.inf if self.fit_to is None else self.fit_to
        return (self.times > end) & ~np.isnan(self.readings).all(axis=1)

    def place(self, row: int, bob: int) -> str:
        """Line of a bob's reading in the file as text, that of another bob in the row if it has none; else the row."""
        if self.lines is None:
            return f"row {row + 1}"
        return f"line {self.lines[row, bob] or self.lines[row].max()}"

    def angles(self, cradle: Cradle) -> np.ndarray:
        """Readings as angles [rad], (T, N); displacements beyond the length of strings become ±π/2; nan of impacts."""
        if self.of_impacts:
            return np.full(self.readings.shape, np.nan)
        return self.readings if self.quantity == "theta" else np.arcsin(np.clip(self.readings / cradle.length, -1, 1))

    @property
    def bobs_seen(self) -> tuple[int, ...]:
        """Numbers of the bobs that have at least one reading to fit or to hold out."""
        used = self.readings[self.fitted | self.held_out]
        return tuple(int(i) + 1 for i in np.flatnonzero(~np.isnan(used).all(axis=0)))


#: Fields of Cradle that can be inferred.
INFERABLE = (
    "length pivot_half_spacing mass radius youngs_modulus poisson_ratio k_f kappa b delta gravity restitution".split()
)


def check_run(cradle: Cradle, run: Run) -> Run:
    """Return the run with its δ filled in.

    Raises ValueError if it does not fit the cradle, if it cannot start as stated, or if one simulation costs too much.
    """
    if run.readings.shape[1] != cradle.bobs:
        raise ValueError(f"readings of {run.readings.shape[1]} bobs; the cradle has {cradle.bobs} bobs")
    of_run = cradle if run.delta is None else cradle.replace(delta=run.delta)
    if run.release is not None:
        prepare(of_run, run.release.release)
    check_cost(of_run, run.duration, steps_needed(of_run, run.duration), _MOST_STEPS, _LATE)
    return dataclasses.replace(run, delta=of_run.delta)


def check_prior(cradle: Cradle, name: str, prior: Prior) -> None:
    """Raise ValueError for a prior of a name that cannot be inferred, or one that allows impossible values."""
    parameters = {f"{e.name}.{p.key}": p for e in cradle.composition for p in e.parameters}
    if name not in INFERABLE and name not in parameters:
        stated = ParameterName.parse(name)
        absent = stated.effect or stated.key
        if absent in (e.name for e in CATALOGUE) and not cradle.has(absent):
            raise ValueError(
                f"{name} is of an effect that is not in the model; add {absent!r} to effects under [model]"
            )
        raise ValueError(unknown_key("name to infer", name, [*INFERABLE, *parameters]))
    for value in prior.support:
        if name in INFERABLE:
            cradle.replace(**{name: value})
        else:
            p = parameters[name]
            check_range(name, value, p.unit, p.low, p.high)
