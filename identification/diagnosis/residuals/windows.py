"""The fitted model compared with the data window by window, with the state at the start of each window inferred.

A missing force changes all later motion. With inferred start states, its effect shows in the window where it acts.
The inferred states also give the energy that the data hold beyond the model.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from cradle_env.release import InitialState
from identification.inference.fit_result import FitResult, orthonormal_basis
from identification.inference.impossible_model import ImpossibleModelError, raises_impossible

#: Width of a window [small-angle periods].
_WINDOW_PERIODS = 2.0
#: Readings per unknown of its start state that a window must hold.
_READINGS_PER_UNKNOWN = 4
#: Time from an impact [s] within which readings are near it.
_NEAR_IMPACT = 0.025
#: Step of the finite differences of a start state [noise of a reading].
_DIFFERENCE = 0.3


@dataclass(frozen=True, eq=False)
class ModelMotion:
    """The fitted model at the R' readings of one run; all arrays (R',).

    rows: among the residuals. bob: from 0. time: in the file [s]. theta: θ [rad]. speed: θ̇ over the small-angle
    frequency [rad]. near_impact: whether the reading is near an impact of its bob.
    """

    rows: np.ndarray
    bob: np.ndarray
    time: np.ndarray
    theta: np.ndarray
    speed: np.ndarray
    near_impact: np.ndarray


@dataclass(frozen=True, eq=False)
class Window:
    """Readings of one run between two times.

    interval: its ends in the file [s]. rows (R',): among the residuals. absorbed (R', k): orthonormal basis of the
    changes of these residuals by another start state. energy (R',): for residuals r, `energy` @ r is the energy that
    the data hold beyond the model at the start of the window [J]. sd: its standard deviation [J].
    """

    run: int
    interval: tuple[float, float]
    rows: np.ndarray
    absorbed: np.ndarray
    energy: np.ndarray
    sd: float


def model_motions(fitted: FitResult) -> list[ModelMotion]:
    """The fitted model at the readings of each run that has readings."""
    return [_motion(fitted, int(k)) for k in np.unique(fitted.readings.run)]


def _motion(fitted: FitResult, index: int) -> ModelMotion:
    likelihood, at = fitted.likelihood, fitted.readings
    rows = np.flatnonzero(at.run == index)
    times, row = np.unique(at.time[rows], return_inverse=True)
    run, bob = likelihood.motion(fitted.values, index, times), at.bob[rows]
    cradle, instants = run.cradle, run.t
    near = np.zeros(len(row), bool)
    for i in range(cradle.bobs):
        hits = np.unique(run.impacts["time"][np.isin(run.impacts["pair"], (i, i + 1))])
        if len(hits):
            after = np.searchsorted(hits, instants)
            before_it = np.abs(instants - hits[np.maximum(after - 1, 0)])
            after_it = np.abs(instants - hits[np.minimum(after, len(hits) - 1)])
            near |= (bob == i) & (np.minimum(before_it, after_it)[row] < _NEAR_IMPACT)
    speed = run.theta_dot[row, bob] * cradle.period / (2.0 * np.pi)
    return ModelMotion(rows, bob, at.time[rows], run.theta[row, bob], speed, near)


def start_state_windows(fitted: FitResult) -> list[Window]:
    """All windows of all runs, except those with too few readings or that cannot be simulated."""
    return [window for k in np.unique(fitted.readings.run) for window in _windows_of_run(fitted, int(k))]


def window_edges(fitted: FitResult, index: int) -> np.ndarray:
    """Times in the file [s] at which the windows of a run begin, and the end of the last."""
    time = fitted.readings.time[fitted.readings.run == index]
    return equal_edges(float(time.min()), float(time.max()), _WINDOW_PERIODS * fitted.cradle.period)


def equal_edges(begin: float, end: float, width: float) -> np.ndarray:
    """Ends of equal windows of about this width between two times, all in s."""
    return np.linspace(begin, end, max(1, round((end - begin) / width)) + 1)


def _windows_of_run(fitted: FitResult, index: int) -> list[Window]:
    likelihood, at, run = fitted.likelihood, fitted.readings, fitted.experiment.runs[index]
    values, cradle = fitted.values, likelihood.cradle(fitted.values, run)
    ends, result = window_edges(fitted, index), []
    noise = likelihood.noise_model.weights[index] / (1.0 if run.quantity == "theta" else cradle.length)
    omega = 2.0 * np.pi / cradle.period
    steps = _DIFFERENCE * noise * np.array([1.0] * cradle.bobs + [omega] * cradle.bobs)
    # Energy by (θ, θ̇) of a rigid pendulum of the nominal length.
    weight, inertia = cradle.mass * cradle.gravity * cradle.length, cradle.mass * cradle.length**2
    starts = likelihood.motion(values, index, ends[:-1])
    for i, (low, high) in enumerate(itertools.pairwise(ends)):
        inside = (at.run == index) & (at.time >= low) & ((at.time < high) | (high == ends[-1]))
        rows = np.flatnonzero(inside)
        if len(rows) < _READINGS_PER_UNKNOWN * len(steps):
            continue
        times, row = np.unique(at.time[rows], return_inverse=True)
        state = np.concatenate([starts.theta[i], starts.theta_dot[i]])

        @raises_impossible
        def readings_from(moved, i=i, times=times, low=low, row=row, bob=at.bob[rows]) -> np.ndarray:
            theta, theta_dot = np.split(moved, 2)
            start = InitialState(theta, theta_dot, starts.r[i], starts.r_dot[i])
            return likelihood.simulate_readings(cradle, start, times - low, values, index)[0][row, bob]

        try:
            still = readings_from(state)
            S = np.array([readings_from(state + step) - still for step in np.diag(steps)]).T
        except ImpossibleModelError:
            continue
        S /= steps * likelihood.noise_model.weights[index]
        slope = np.concatenate([weight * np.sin(starts.theta[i]), inertia * starts.theta_dot[i]])
        energy = -slope @ np.linalg.pinv(S)
        result.append(
            Window(index, (float(low), float(high)), rows, orthonormal_basis(S), energy, float(np.linalg.norm(energy)))
        )
    return result
