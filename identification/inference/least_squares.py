"""Nonlinear least squares on a likelihood: bounds, difference_steps, derivatives, descent."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np
from scipy.optimize import least_squares

from cradle_env.threads import each_in_threads, in_threads
from identification.experiment.experiment import Experiment
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.unknowns import Unknown

#: The residual [sigma] of every reading at an impossible point.
_IMPOSSIBLE_RESIDUAL = 1e4
#: Gain in χ², over what a reading leaves, at which least squares ends.
_CONVERGED_GAIN = 1e-3
#: The number of bobs from which on their impacts have an order that may flip, so that readings jump.
MIN_BOBS_WITH_IMPACT_ORDER = 3
#: A step that changes the residuals otherwise than foretold by less than this part of the change leaves derivatives
#: good enough to be corrected by it alone.
_BROYDEN_ERROR = 0.3


class Misfit(Protocol):
    """What least squares minimizes the residuals of: a likelihood, or one with an unknown held."""

    experiment: Experiment
    unknowns: tuple[Unknown, ...]
    workers: int | None

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Residuals (R + P,) at a point (D,); ImpossibleModelError where there is no motion."""
        ...


def bounds(likelihood: Misfit) -> tuple[np.ndarray, np.ndarray]:
    """Sampled coordinates between which the search stays; both (D,)."""
    low = np.array([math.log(u.low) if u.log else u.low for u in likelihood.unknowns])
    high = np.array([math.log(u.high) if u.log else u.high for u in likelihood.unknowns])
    inset = np.where(np.isfinite(high - low), 1e-9 * (high - low), 0.0)
    return low + inset, high - inset


def residuals_or_penalty(likelihood: Misfit, point: np.ndarray, length: int | None = None) -> np.ndarray:
    """Residuals, or huge ones where the point is impossible."""
    try:
        return likelihood.residuals(point)
    except ImpossibleModelError:
        if length is None:
            raise
        return np.full(length, _IMPOSSIBLE_RESIDUAL)


def cost(likelihood: Misfit, point: np.ndarray) -> float:
    """Sum of squared residuals at a point; infinite where it is impossible."""
    try:
        found = float(np.sum(likelihood.residuals(point) ** 2))
    except ImpossibleModelError:
        return math.inf
    return math.inf if math.isnan(found) else found


def chi2_scale(chi2: float, readings: int) -> float:
    """What one unit of χ² is worth: 1, or the χ² that each reading leaves where that is more. Differences far below
    what a model leaves say nothing about it."""
    return max(1.0, chi2 / max(readings, 1))


def difference_steps(likelihood: Misfit) -> np.ndarray:
    """Finite-difference steps of the coordinates, (D,): small against what is known of each."""
    found = []
    for u in likelihood.unknowns:
        if u.log:
            found.append(1e-4)
        elif not math.isnan(u.sd):
            found.append(1e-2 * u.sd)
        else:
            found.append(1e-3 * u.search if u.search > 0.0 else 1e-5)
    return np.array(found)


def difference_jacobian(likelihood: Misfit, point: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Derivatives of the residuals (R, D), by one-sided differences that stay within the bounds."""
    high = bounds(likelihood)[1]
    width = difference_steps(likelihood)
    width = np.where(point + width > high, -width, width)
    moved = point + np.diag(width)
    columns = in_threads(lambda z: residuals_or_penalty(likelihood, z, len(base)), list(moved), likelihood.workers)
    return (np.array(columns) - base).T / width


def refine(likelihood: Misfit, point: np.ndarray, evaluations: int) -> tuple[np.ndarray, float]:
    """(point, sum of squared residuals) that least squares reaches in at most so many evaluations; (start, inf) where
    it cannot begin."""
    low, high = bounds(likelihood)
    inside = np.clip(point, low, high)
    try:
        first = likelihood.residuals(inside)
    except ImpossibleModelError:
        return inside, math.inf
    length, cost_before = len(first), math.inf
    if not len(inside):
        return inside, cost(likelihood, inside)
    descent = _Descent(likelihood, inside, first)
    while True:
        found = least_squares(
            descent.residuals,
            inside,
            descent.derivatives,  # type: ignore[arg-type]  # a function, which SciPy's stubs do not know of
            (low - 1e-12, high + 1e-12),
            x_scale=difference_steps(likelihood),
            max_nfev=evaluations,
            xtol=1e-8,
            ftol=_CONVERGED_GAIN / max(length, 1),
        )
        inside, evaluations = found.x, evaluations - found.nfev
        if (
            evaluations <= 0
            or descent.fresh
            or cost_before - found.cost < _CONVERGED_GAIN / max(length, 1) * found.cost
        ):
            return found.x, 2.0 * float(found.cost)
        cost_before = found.cost  # corrected derivatives may have ended it: once more, with new ones
        descent = _Descent(likelihood, found.x, found.fun)


def refine_each(
    likelihood: Misfit, points: Sequence[np.ndarray], evaluations: int
) -> Iterator[tuple[np.ndarray, float]]:  # fmt: skip
    """What `refine` reaches from each of several points, side by side: much of a descent is one simulation after
    another."""
    return each_in_threads(lambda point: refine(likelihood, point, evaluations), points, likelihood.workers)


class _Descent:
    """Residuals and their derivatives at the points of a descent. Derivatives are taken by differences, a simulation
    for each unknown, only where readings may jump or the last step did not do about what they foretold; else that step
    corrects them (Broyden 1965). fresh: whether the last are by differences."""

    def __init__(self, likelihood: Misfit, start: np.ndarray, residuals: np.ndarray):
        self.likelihood, self.fresh = likelihood, True
        self.width = difference_steps(likelihood)
        self._seen = start.copy(), residuals
        self._at: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Those at a point, (R,); where they were asked for last, at once."""
        if not np.array_equal(self._seen[0], point):
            self._seen = point.copy(), residuals_or_penalty(self.likelihood, point, len(self._seen[1]))
        return self._seen[1]

    def derivatives(self, point: np.ndarray) -> np.ndarray:
        """Those at a point, (R, D)."""
        value = self.residuals(point)
        J = self._corrected(point, value)
        self.fresh = J is None
        if J is None:
            J = difference_jacobian(self.likelihood, point, value)
        self._at = point.copy(), value, J
        return J

    def _corrected(self, point: np.ndarray, value: np.ndarray) -> np.ndarray | None:
        """The last derivatives, corrected in the direction of the step since; None where that went astray."""
        if self._at is None or self.likelihood.experiment.cradle.bobs >= MIN_BOBS_WITH_IMPACT_ORDER:
            return None
        last, before, J = self._at
        step, change = point - last, value - before
        unforeseen = change - J @ step
        if np.linalg.norm(unforeseen) >= _BROYDEN_ERROR * np.linalg.norm(change):
            return None
        scaled = step / self.width
        return J + np.outer(unforeseen, scaled / self.width) / (scaled @ scaled)
