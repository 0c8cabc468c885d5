"""Horizon continuation: modes of a likelihood, followed from the first swings of the data to all of them.

Over a few swings the misfit has few local minima; over the whole run it has many. Those in κ lie Δ ln κ = 2β/n apart
after n small-angle periods: one turn of the radial oscillation more or less. So each minimum over n periods is refined
over more periods, and its neighbours in κ start beside it where the data do not exclude them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.criteria import (
    EARLY_PRIORS,
    EVALUATIONS,
    FIRST_PERIODS,
    HORIZON_GROWTH,
    LAST_SHARE,
    MAX_BASINS,
    MAX_DISTANCE,
    NONSMOOTH_EVALUATIONS,
    OPEN_SD,
    SAME_BASIN,
)
from identification.diagnosis.selection.evidence import has_early_prior
from identification.inference.least_squares import (
    Misfit,
    bounds,
    chi2_scale,
    cost,
    difference_jacobian,
    has_impact_order,
    refine_each,
)
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import early_rows, longest_run
from identification.inference.search_options import DEFAULT


@dataclass(frozen=True, eq=False)
class Minimum:
    """A minimum of χ²: point (D,) in sampled coordinates, and χ² there."""

    point: np.ndarray
    chi2: float


class EarlyMisfit:
    """The residuals of the first periods of the data, with weak priors on k_f, κ and b.

    likelihood: of these data, without the weak priors.
    """

    def __init__(self, likelihood: Likelihood, periods: float):
        rows = early_rows(likelihood, periods)
        self.likelihood = Likelihood(likelihood.experiment, rows, likelihood.workers, likelihood.parameters)
        self.experiment, self.unknowns, self.workers = likelihood.experiment, likelihood.unknowns, likelihood.workers
        self._priors = [
            (i, u.coordinate(u.start), EARLY_PRIORS[u.name]) for i, u in enumerate(self.unknowns) if has_early_prior(u)
        ]

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Residuals at a point (D,), those of the weak priors last."""
        prior = [(point[i] - mean) / sd for i, mean, sd in self._priors]
        return np.concatenate([self.likelihood.residuals(point), prior])


def _is_smooth(likelihood: Likelihood) -> bool:
    return not has_impact_order(likelihood.experiment.cradle)


def horizons(likelihood: Likelihood) -> list[float]:
    """Numbers of small-angle periods, growing by a factor, up to LAST_SHARE of the run."""
    growth = HORIZON_GROWTH if _is_smooth(likelihood) else DEFAULT.early_growth
    longest, found, periods = longest_run(likelihood), [], FIRST_PERIODS
    while periods < LAST_SHARE * longest:
        found.append(periods)
        periods *= growth
    return found


def follow_early(likelihood: Likelihood, starts: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The points (D,) that continuation reaches from several points, up to the last horizon before all data."""
    points, evaluations = list(starts), EVALUATIONS if _is_smooth(likelihood) else NONSMOOTH_EVALUATIONS
    for periods in horizons(likelihood):
        early = EarlyMisfit(likelihood, periods)
        found = refine_all(early, points, evaluations)
        unit = unit_of_chi2(early.likelihood, found[0].chi2) if found else 1.0
        basins = distinct_basins(early, found, unit)
        points = [basin.minimum.point for basin in basins]
        if basins:  # of the best alone: bounds the cost
            points += _kappa_neighbours(likelihood, basins[0], periods)
    return points


def least_early(likelihood: Likelihood, starts: Sequence[np.ndarray], count: int) -> list[np.ndarray]:
    """Of several points (D,) the `count` with the least misfit over the first horizon."""
    return least(EarlyMisfit(likelihood, FIRST_PERIODS), starts, count)


def least(misfit: Misfit, points: Sequence[np.ndarray], count: int) -> list[np.ndarray]:
    """Of several points (D,) the `count` with the least misfit."""
    costs = [cost(misfit, point) for point in points]
    return [points[i] for i in np.argsort(costs)[:count] if math.isfinite(costs[i])]


def unit_of_chi2(likelihood: Likelihood, chi2: float) -> float:
    """What one unit of χ² is worth beside this χ²: 1, or χ² per reading where that is more."""
    return chi2_scale(chi2, likelihood.reading_slices()[-1].stop)


def refine_all(misfit: Misfit, points: Sequence[np.ndarray], evaluations: int) -> list[Minimum]:
    """Where least squares leads from several points (D,), the best first; those without a motion are left out."""
    found = [Minimum(point, chi2) for point, chi2 in refine_each(misfit, points, evaluations)]
    return sorted((one for one in found if math.isfinite(one.chi2)), key=lambda one: one.chi2)


@dataclass(frozen=True, eq=False)
class Basin:
    """A minimum, the information (D, D) of its misfit there, and what a unit of χ² is worth."""

    minimum: Minimum
    information: np.ndarray
    unit: float

    def holds(self, one: Minimum) -> bool:
        """Whether χ² at a point is what the parabola predicts, to a factor of SAME_BASIN and a unit. A point with far
        less χ² than predicted lies in another basin, just as one with far more."""
        step = one.point - self.minimum.point
        predicted, rise = float(step @ self.information @ step), one.chi2 - self.minimum.chi2
        return predicted / SAME_BASIN - self.unit < rise < SAME_BASIN * predicted + self.unit

    def sd(self, i: int) -> float:
        """Standard deviation of the i-th coordinate."""
        scale = np.sqrt(np.maximum(np.diag(self.information), 1e-300))
        covariance = np.linalg.pinv(self.information / np.outer(scale, scale), hermitian=True)
        return math.sqrt(max(covariance[i, i], 0.0) * self.unit) / scale[i]


def distinct_basins(misfit: Misfit, found: Sequence[Minimum], unit: float) -> list[Basin]:
    """At most MAX_BASINS basins whose minima lie within MAX_DISTANCE of the best, each once; found: the best first."""
    kept: list[Basin] = []
    for one in found:
        if one.chi2 > found[0].chi2 + MAX_DISTANCE * unit or len(kept) == MAX_BASINS:
            break
        if not any(basin.holds(one) for basin in kept):
            J = difference_jacobian(misfit, one.point, misfit.residuals(one.point))
            kept.append(Basin(one, J.T @ J, unit))
    return kept


def _kappa_neighbours(likelihood: Likelihood, basin: Basin, periods: float) -> list[np.ndarray]:
    """Half a spacing of modes on either side in κ: twice as long a horizon has modes there. None where the data up to
    this horizon exclude them."""
    if "kappa" not in likelihood.names:
        return []
    k, point = likelihood.names.index("kappa"), basin.minimum.point
    half = likelihood.experiment.cradle.beta / periods * (1.0 if likelihood.unknowns[k].log else point[k])
    if OPEN_SD * basin.sd(k) < half:
        return []
    low, high = bounds(likelihood)
    moved = [point + side * half * (np.arange(len(point)) == k) for side in (-1.0, 1.0)]
    return [one for one in moved if low[k] < one[k] < high[k]]
