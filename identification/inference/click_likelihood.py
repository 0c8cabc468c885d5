"""How probable the clicks of a recording are, for the impacts that a model predicts.

Each predicted click is missed with a probability m, or heard with a Gaussian error σ; false clicks come at random with
a rate ρ. Over all ways to match, the density of clicks t_j for predicted instants τ_i is

    ρ^n exp(−ρ T) ∏_i [ m + (1 − m)/ρ Σ_j N(t_j − τ_i; σ) ],

as long as σ is far below the time between clicks, so that no click is near two predicted ones. It is that of data
association in tracking (Bar-Shalom and Li, Multitarget-Multisensor Tracking, 1995, section 3.4), a Poisson process of
false ones included.
"""

from __future__ import annotations

import math

import numpy as np

from cradle_env.constitutive import contact_times
from cradle_env.cradle import Cradle
from cradle_env.release import InitialState, Release
from cradle_env.simulation import simulate
from identification.experiment.click_groups import click_impacts
from identification.experiment.run import Run

#: A click farther from any predicted one is false [s]: far beyond errors of timing, a tenth of a half swing.
GATE = 0.02
#: Residuals of least squares are bent towards this many weights, so that false clicks pull little.
_BEND = 4.0
#: Weight of a click while the search looks for the mode [s]: what is left of the model's error then.
SEARCH_WEIGHT = 1e-3
#: Where the noise of clicks is searched from, and the least weight of least squares [s]: clicks of a phone scatter by 3
#: to 50 µs.
NOISE, LEAST_WEIGHT = 3e-5, 1e-6
#: Clicks among which the first impact is looked for, and predicted ones that must follow.
_FIRST_CLICKS, _FOLLOWING = 20, 10
#: Part of the most predicted clicks that must follow the first impact: others are missed.
_FOLLOWED = 0.6
_NONE = np.empty(0)


def simulate_clicks(
    cradle: Cradle,
    initial: Release | InitialState,
    until: float,
    lag: float = 0.0,
    more: np.ndarray = _NONE,
    tolerance: float = 1e-10,
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate the clicks up to a time [s].

    lag: part of the contact's duration by which a click follows the touch. Slow contacts last longer, so clicks come
    ever later as the cradle slows down.

    Returns (instants (K,) [s] after the release, in order; θ (M, N) [rad] at the times `more` (M,)).
    """
    before = int(np.searchsorted(more, until))
    motion = simulate(cradle, initial, times=np.insert(more, before, until), ledger=False, tolerance=tolerance)
    impacts = motion.impacts[motion.impacts["time"] <= until]
    order = np.argsort(impacts["time"], kind="stable")
    impacts = impacts[order[click_impacts(impacts["time"][order], impacts["speed"][order])]]
    instants = impacts["time"] + lag * contact_times(cradle, impacts["speed"]) if len(impacts) else impacts["time"]
    return instants, np.delete(motion.theta, before, axis=0)


def as_readings(instants: np.ndarray, predicted: np.ndarray, bobs: int) -> np.ndarray:
    """The predicted instant [s] nearest to each click (T,), as readings (T, N) have it; nan where none is near."""
    readings, near = np.full((len(instants), bobs), np.nan), nearest(instants, predicted)
    readings[:, 0] = np.where(np.abs(near - instants) < GATE, near, np.nan)
    return readings


def residuals(instants: np.ndarray, predicted: np.ndarray, weight: float) -> np.ndarray:
    """Distances (T,) of clicks from predicted ones over their weight [s], bent towards a largest size."""
    scaled = np.clip((nearest(instants, predicted) - instants) / weight, -1e6, 1e6)
    return scaled / np.sqrt(1.0 + (scaled / _BEND) ** 2)


def nearest(instants: np.ndarray, predicted: np.ndarray) -> np.ndarray:
    """The predicted instant nearest to each click (T,)."""
    if not len(predicted):
        return np.full(len(instants), -math.inf)
    after = np.clip(np.searchsorted(predicted, instants), 1, max(len(predicted) - 1, 1))
    near, far = predicted[after - 1], predicted[np.minimum(after, len(predicted) - 1)]
    return np.where(np.abs(instants - near) <= np.abs(far - instants), near, far)


def log_density(instants: np.ndarray, predicted: np.ndarray, noise: float, missed: float, false_rate: float) -> float:
    """Log density of clicks (T,) [s] between the first and the last of them, for predicted instants (M,) [s]."""
    begin, end = instants[0] - GATE, instants[-1] + GATE
    predicted = predicted[(predicted >= begin) & (predicted <= end)]
    total = len(instants) * math.log(false_rate) - false_rate * (end - begin)
    if not len(predicted):
        return total
    owner = np.searchsorted(0.5 * (predicted[1:] + predicted[:-1]), instants)
    density = np.exp(-0.5 * ((instants - predicted[owner]) / noise) ** 2) / (math.sqrt(2.0 * math.pi) * noise)
    heard = np.bincount(owner, density, minlength=len(predicted))
    return total + float(np.sum(np.log(missed + (1.0 - missed) / false_rate * heard)))


def release_instant(cradle: Cradle, run: Run) -> float:
    """The instant [s] of the release in the recording, by which click follows the pattern that the model predicts."""
    assert run.release is not None
    clicks = run.times[run.fitted]
    span = (_FOLLOWING + 2) * 0.5 * cradle.period
    predicted = simulate_clicks(cradle, run.release.release, span)[0][: _FOLLOWING + 1]
    if not len(predicted):
        return float(clicks[0])
    scores = []
    for first in clicks[:_FIRST_CLICKS]:
        off = np.abs(nearest(predicted - predicted[0] + first, clicks) - (predicted - predicted[0] + first))
        scores.append(int((off < GATE).sum()))
    first = int(np.flatnonzero(np.array(scores) >= _FOLLOWED * max(scores))[0])
    return float(clicks[first] - predicted[0])
