"""Speeds before and after the first impact of a recording, from fits to the whole flights."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from cradle_env.cradle import Cradle
from cradle_env.release import InitialState
from cradle_env.simulation import simulate
from identification.experiment.recording import Recording
from identification.storage.files import ExperimentError

#: Share of the largest angle by which a bob has come to move, and to which its flight is used after an impact.
_MOVES, _USED = 0.1, 0.15
#: Readings of a flight at least, and those next to the impact that are left out: an exposure may hold both sides.
_LEAST, _GUARD = 5, 1
#: Instants per second at which a flight is followed to its lowest point.
_FINE = 2000.0


def speeds_of(recording: Recording, cradle: Cradle) -> tuple[float, float, float, float]:
    """(speed of the striking bob, its standard deviation, of the last bob, its standard deviation) [m/s].

    The striking bob is the end bob that is lifted; the others rest until it hits them at its lowest point. Both flights
    are those of a pendulum with the cradle's drag. Speeds are tangential, those at the lowest point.
    """
    theta = recording.displacements()
    if recording.quantity == "x":
        theta = np.arcsin(np.clip(theta / cradle.length, -1.0, 1.0))
    bobs = theta.shape[1]
    if bobs < 2:
        raise ExperimentError(f"{recording.name}: one bob; an impact needs the columns of two or more")
    if np.isnan(theta[:, [0, -1]]).all(axis=0).any():
        raise ExperimentError(f"{recording.name}: no reading of bob {1 if np.isnan(theta[:, 0]).all() else bobs}")
    first = theta[: max(1, len(theta) // 100)]
    lifted = np.nanmean(first, axis=0)
    if abs(lifted[0]) < abs(lifted[-1]):  # seen from the other side
        theta, lifted = -theta[:, ::-1], -lifted[::-1]
    if not lifted[0] < 0.0 or abs(lifted[-1]) > _MOVES * abs(lifted[0]):
        raise ExperimentError(
            f"{recording.name}: no end bob is lifted away from the others, which rest, at the start; cut the recording"
            " so that it begins with the release"
        )
    bob = _swinging(cradle)
    before, before_sd = _arriving(recording, bob, theta[:, 0])
    after, after_sd = _leaving(recording, bob, theta[:, 0], theta[:, -1])
    return before, before_sd, after, after_sd


def _swinging(cradle: Cradle) -> Cradle:
    """One bob as long as its strings are when it hangs."""
    sag = cradle.mass * cradle.gravity / cradle.radial_stiffness if cradle.has("radial_elasticity") else 0.0
    return Cradle(
        bobs=1, model="pendulum", length=cradle.length + sag, mass=cradle.mass, gravity=cradle.gravity, b=cradle.b
    )


def _impact_row(theta: np.ndarray) -> int:
    """The first row at which the striking bob has come to its lowest point."""
    passed = np.flatnonzero(theta >= 0.0)
    still = np.flatnonzero(np.abs(theta) < 0.05 * np.nanmax(np.abs(theta)))
    rows = [rows[0] for rows in (passed, still) if len(rows)]
    return int(min(rows)) if rows else len(theta)


def _arriving(recording: Recording, bob: Cradle, theta: np.ndarray) -> tuple[float, float]:
    rows = np.arange(max(0, _impact_row(theta) - _GUARD))
    # At rest before the release: only what has begun to move tells the flight.
    held = np.abs(theta[rows] - theta[0]) < 0.02 * abs(theta[0])
    start = int(np.flatnonzero(held)[-1]) if held.any() else 0
    rows = rows[start:][~np.isnan(theta[rows[start:]])]
    _check_flight(recording, rows, "before")
    times, angles = recording.times[rows], theta[rows]
    end = times[-1] + bob.period / 4.0

    def flight(p: np.ndarray, at: np.ndarray):
        return simulate(bob, InitialState(p[:1], p[1:]), times=at - times[0], ledger=False)

    guess = np.array([angles[0], (angles[1] - angles[0]) / (times[1] - times[0])])
    found = least_squares(lambda p: flight(p, times).theta[:, 0] - angles, guess, x_scale=(0.1, 1.0), diff_step=1e-5)

    def speed(p: np.ndarray) -> float:
        fine = np.arange(times[0], end, 1.0 / _FINE)
        run = flight(p, fine)
        low = int(np.argmax(run.theta[:, 0] >= 0.0))
        share = -run.theta[low - 1, 0] / (run.theta[low, 0] - run.theta[low - 1, 0])
        return bob.length * float(run.theta_dot[low - 1, 0] * (1 - share) + run.theta_dot[low, 0] * share)

    slopes = np.array([(speed(found.x + step) - speed(found.x - step)) / 2e-4 for step in 1e-4 * np.eye(2)])
    return speed(found.x), float(np.sqrt(slopes @ _covariance(found) @ slopes))


def _leaving(recording: Recording, bob: Cradle, striking: np.ndarray, theta: np.ndarray) -> tuple[float, float]:
    start = _impact_row(striking)
    top = start + int(np.nanargmax(theta[start : start + np.searchsorted(recording.times, bob.period)]))
    back = np.flatnonzero(theta[top:] < _USED * theta[top])
    rows = np.arange(start + _GUARD, top + (int(back[0]) if len(back) else len(theta) - top))
    rows = rows[~np.isnan(theta[rows])]
    _check_flight(recording, rows, "after")
    times, angles = recording.times[rows], theta[rows]
    hit = recording.times[start]

    def flight(p: np.ndarray) -> np.ndarray:
        at = np.maximum(times - p[0], 0.0)
        state = InitialState(np.zeros(1), np.array([p[1] / bob.length]))
        return simulate(bob, state, times=at, ledger=False).theta[:, 0]

    guess = np.array([hit - 1.0 / _FINE, angles.max() * np.sqrt(bob.length * bob.gravity)])
    found = least_squares(lambda p: flight(p) - angles, guess, x_scale=(1e-3, 0.1), diff_step=1e-5)
    return float(found.x[1]), float(np.sqrt(_covariance(found)[1, 1]))


def _check_flight(recording: Recording, rows: np.ndarray, when: str) -> None:
    if len(rows) < _LEAST:
        raise ExperimentError(
            f"{recording.name}: {len(rows)} readings of the flight {when} the impact; at least {_LEAST} are needed:"
            " film with more frames a second, or from the release on"
        )


def _covariance(found) -> np.ndarray:
    variance = float(found.fun @ found.fun) / max(len(found.fun) - len(found.x), 1)
    return np.linalg.inv(found.jac.T @ found.jac) * variance
