"""Horizon continuation: modes of a likelihood, followed from the first swings of the data to all of them.

Over a few swings the misfit has few local minima; over the whole run it has many. Those in κ lie Δ ln κ = 2β/n apart
after n small-angle periods: one turn of the radial oscillation more or less. So each minimum over n periods is refined
over 2n periods, and its neighbours in κ start beside it where the data do not exclude them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from identification.inference.least_squares import Misfit, bounds, chi2_scale, cost, difference_jacobian, refine_each
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import early_rows

#: Small-angle periods of the first horizon; each further one is twice as long.
FIRST_PERIODS = 2.0
#: Share of the run from which on a horizon is replaced by all data: refining twice over nearly the same data is waste.
LAST_SHARE = 0.75
#: Modes followed at most: bounds the cost of a horizon.
MAX_MODES = 3
#: Distance from the best mode within which others are followed [units of χ²]: early data rank modes by chance.
MAX_DISTANCE = 60.0
#: Evaluations of least squares over each horizon, and over all data.
EVALUATIONS, FINAL_EVALUATIONS = 6, 30
#: Standard deviations of ln k_f, ln κ and ln b about their stated values while the data are short. Short data hardly
#: constrain one of them, and least squares would drift along that ridge.
EARLY_PRIORS = {"k_f": 0.3, "kappa": 0.2, "b": 0.7}
#: Factor to which χ² must be what the parabola about a mode predicts for a point to be of the same basin.
SAME_BASIN = 2.0
#: Standard deviations of ln κ that must reach half way to the next mode for it to be tried: 2 are 95 %.
OPEN_SD = 2.0
#: Modes whose neighbours in κ are tried at each horizon: the best ones.
WITH_NEIGHBOURS = 1


@dataclass(frozen=True, eq=False)
class Minimum:
    """A minimum of χ²: point (D,) in sampled coordinates, and χ² there."""

    point: np.ndarray
    chi2: float


class EarlyMisfit:
    """The residuals of the first periods of the data, with weak priors on k_f, κ and b."""

    def __init__(self, likelihood: Likelihood, periods: float):
        rows = early_rows(likelihood, periods)
        self._of = Likelihood(likelihood.experiment, rows, likelihood.workers, likelihood.parameters)
        self.experiment, self.unknowns, self.workers = likelihood.experiment, likelihood.unknowns, likelihood.workers
        self._priors = [
            (i, u.coordinate(u.start), EARLY_PRIORS[u.name])
            for i, u in enumerate(self.unknowns)
            if u.name in EARLY_PRIORS and math.isnan(u.sd)
        ]

    @property
    def readings(self) -> int:
        """Number of readings that count."""
        return self._of.reading_slices()[-1].stop

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Residuals at a point (D,), those of the weak priors last."""
        prior = [(point[i] - mean) / sd for i, mean, sd in self._priors]
        return np.concatenate([self._of.residuals(point), prior])


def horizons(likelihood: Likelihood) -> list[float]:
    """Numbers of small-angle periods, doubling, as long as they leave out part of the data."""
    period, found, periods = likelihood.experiment.cradle.period, [], FIRST_PERIODS
    longest = max(
        (run.times[rows][-1] - run.fit_from) / period
        for run, rows in zip(likelihood.experiment.runs, likelihood.rows, strict=True)
        if rows.any()
    )
    while periods < LAST_SHARE * longest:
        found.append(periods)
        periods *= 2.0
    return found


def follow_early(likelihood: Likelihood, starts: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The points (D,) that continuation reaches from several points, up to the last horizon before all data."""
    points = list(starts)
    for periods in horizons(likelihood):
        early = EarlyMisfit(likelihood, periods)
        basins = distinct_basins(early, _refine(early, points, EVALUATIONS), unit_of_chi2(likelihood))
        points = [basin.minimum.point for basin in basins]
        for basin in basins[:WITH_NEIGHBOURS]:
            points += _kappa_neighbours(likelihood, basin, periods)
    return points


def early_chi2(likelihood: Likelihood, point: np.ndarray) -> float:
    """χ² at a point (D,) over the last horizon before all data; 0 where there is none."""
    early = _last_horizon(likelihood)
    return 0.0 if early is None else cost(early, point)


def early_unit(likelihood: Likelihood, chi2: float) -> float:
    """What one unit of χ² is worth beside a χ² over that horizon."""
    early = _last_horizon(likelihood)
    return 1.0 if early is None else chi2_scale(chi2, early.readings)


def _last_horizon(likelihood: Likelihood) -> EarlyMisfit | None:
    periods = horizons(likelihood)
    return EarlyMisfit(likelihood, periods[-1]) if periods else None


def approach_modes(likelihood: Likelihood, points: Sequence[np.ndarray]) -> list[Minimum]:
    """Points near the modes over all data about several points (D,), the best first; none where there is no motion."""
    basins = distinct_basins(likelihood, _refine(likelihood, points, EVALUATIONS), unit_of_chi2(likelihood))
    return [basin.minimum for basin in basins]


def finish_modes(likelihood: Likelihood, near: Sequence[Minimum]) -> list[Minimum]:
    """The modes over all data that points of `approach_modes` lead to, the best first."""
    ends = _refine(likelihood, [one.point for one in near], FINAL_EVALUATIONS)
    return sorted(ends, key=lambda one: one.chi2)


def screen_starts(likelihood: Likelihood, starts: Sequence[np.ndarray], count: int) -> list[np.ndarray]:
    """Of several points (D,) the `count` with the least misfit over the first horizon."""
    early = EarlyMisfit(likelihood, FIRST_PERIODS)
    costs = [cost(early, point) for point in starts]
    return [starts[i] for i in np.argsort(costs)[:count] if math.isfinite(costs[i])]


def unit_of_chi2(likelihood: Likelihood) -> Callable[[float], float]:
    """What one unit of χ² is worth beside a χ²: 1, or χ² per reading where that is more."""
    readings = likelihood.reading_slices()[-1].stop
    return lambda chi2: chi2_scale(chi2, readings)


@dataclass(frozen=True, eq=False)
class Basin:
    """A minimum, the information (D, D) of its misfit there, and what a unit of χ² is worth."""

    minimum: Minimum
    information: np.ndarray
    unit: float

    @classmethod
    def of(cls, misfit: Misfit, minimum: Minimum, unit: float) -> Basin:
        """That of a minimum, by finite differences."""
        J = difference_jacobian(misfit, minimum.point, misfit.residuals(minimum.point))
        return cls(minimum, J.T @ J, unit)

    def holds(self, point: np.ndarray, chi2: float) -> bool:
        """Whether χ² at a point (D,) is what the parabola predicts, to a factor of SAME_BASIN and a unit. A point with
        far less χ² than predicted lies in another basin, just as one with far more."""
        step = point - self.minimum.point
        predicted, rise = float(step @ self.information @ step), chi2 - self.minimum.chi2
        return predicted / SAME_BASIN - self.unit < rise < SAME_BASIN * predicted + self.unit

    def sd(self, i: int) -> float:
        """Standard deviation of the i-th coordinate."""
        scale = np.sqrt(np.maximum(np.diag(self.information), 1e-300))
        covariance = np.linalg.pinv(self.information / np.outer(scale, scale), hermitian=True)
        return math.sqrt(max(covariance[i, i], 0.0) * self.unit) / scale[i]


def distinct_basins(misfit: Misfit, found: list[Minimum], unit_of: Callable[[float], float]) -> list[Basin]:
    """At most MAX_MODES basins whose minima lie within MAX_DISTANCE of the best, the best first, each once."""
    if not found:
        return []
    found = sorted(found, key=lambda one: one.chi2)
    unit = unit_of(found[0].chi2)
    kept: list[Basin] = []
    for one in found:
        if one.chi2 > found[0].chi2 + MAX_DISTANCE * unit or len(kept) == MAX_MODES:
            break
        if not any(basin.holds(one.point, one.chi2) for basin in kept):
            kept.append(Basin.of(misfit, one, unit))
    return kept


def _refine(misfit: Misfit, points: Sequence[np.ndarray], evaluations: int) -> list[Minimum]:
    found = [Minimum(point, chi2) for point, chi2 in refine_each(misfit, points, evaluations)]
    return [one for one in found if math.isfinite(one.chi2)]


def _kappa_neighbours(likelihood: Likelihood, basin: Basin, periods: float) -> list[np.ndarray]:
    """Half a spacing of modes on either side in κ, where the next horizon has modes of its own; none where the data up
    to this horizon exclude them."""
    if "kappa" not in likelihood.names:
        return []
    k, point = likelihood.names.index("kappa"), basin.minimum.point
    half = likelihood.experiment.cradle.beta / periods * (1.0 if likelihood.unknowns[k].log else point[k])
    if OPEN_SD * basin.sd(k) < half:
        return []
    low, high = bounds(likelihood)
    moved = [point + side * half * (np.arange(len(point)) == k) for side in (-1.0, 1.0)]
    return [one for one in moved if low[k] < one[k] < high[k]]
