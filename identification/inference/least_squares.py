"""Nonlinear least squares on a likelihood: bounds, difference steps, derivatives, descent."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np
from scipy.optimize import least_squares

from cradle_env.cradle import Cradle
from cradle_env.threads import each_in_threads, in_threads
from identification.experiment.experiment import Experiment
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.search_options import DEFAULT, SearchOptions
from identification.inference.unknowns import Unknown

#: Residual [sigma] of every reading at an impossible point: no descent accepts a step there.
_IMPOSSIBLE_RESIDUAL = 1e4
#: Difference step of an unknown that is sampled as its logarithm: 0.01 %.
_LOG_STEP = 1e-4
#: Difference step of an unknown with a normal prior, in its standard deviations.
_PRIOR_STEP = 1e-2
#: Difference step of any other unknown, in the half width of its search box.
_SEARCH_STEP = 1e-3
#: Difference step of an unknown that is not searched [its unit].
_PLAIN_STEP = 1e-5
#: Status of a descent (SciPy) that ends since its steps have become tiny: none of them lowered χ² enough.
_NO_STEP = 3


class Misfit(Protocol):
    """The residuals that least squares minimizes: those of a likelihood, or of one with an unknown held."""

    experiment: Experiment
    unknowns: tuple[Unknown, ...]
    workers: int | None

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Residuals (R + P,) at a point (D,); ImpossibleModelError if no motion is possible."""
        ...


def has_impact_order(cradle: Cradle) -> bool:
    """Whether the order of two impacts can change, so that predicted readings jump: with three bobs or more."""
    return cradle.bobs >= 3


def bounds(likelihood: Misfit) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest sampled coordinates of a search, both (D,): just inside the bounds of the unknowns."""
    low = np.array([math.log(u.low) if u.log else u.low for u in likelihood.unknowns])
    high = np.array([math.log(u.high) if u.log else u.high for u in likelihood.unknowns])
    inset = np.where(np.isfinite(high - low), 1e-9 * (high - low), 0.0)
    return low + inset, high - inset


def residuals_or_penalty(likelihood: Misfit, point: np.ndarray, length: int) -> np.ndarray:
    """Residuals (R + P,) at a point; `length` huge ones where the point is impossible."""
    try:
        return likelihood.residuals(point)
    except ImpossibleModelError:
        return np.full(length, _IMPOSSIBLE_RESIDUAL)


def cost(likelihood: Misfit, point: np.ndarray) -> float:
    """Sum of squared residuals at a point; infinite where the point is impossible."""
    try:
        chi2 = float(np.sum(likelihood.residuals(point) ** 2))
    except ImpossibleModelError:
        return math.inf
    return math.inf if math.isnan(chi2) else chi2


def chi2_scale(chi2: float, readings: int) -> float:
    """The scale factor of differences in χ²: the reduced χ², at least 1.

    A model that misses the data by far more than the noise is wrong. Differences of χ² far below its reduced χ² then
    carry no evidence.
    """
    return max(1.0, chi2 / max(readings, 1))


def difference_steps(likelihood: Misfit) -> np.ndarray:
    """Finite-difference steps of the coordinates, (D,): small against the uncertainty of each unknown."""
    steps = []
    for u in likelihood.unknowns:
        if u.log:
            steps.append(_LOG_STEP)
        elif not math.isnan(u.sd):
            steps.append(_PRIOR_STEP * u.sd)
        else:
            steps.append(_SEARCH_STEP * u.search if u.search > 0.0 else _PLAIN_STEP)
    return np.array(steps)


def difference_jacobian(likelihood: Misfit, point: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Derivatives of the residuals (R, D), by one-sided differences within the bounds; base: residuals at the point."""
    high = bounds(likelihood)[1]
    steps = difference_steps(likelihood)
    steps = np.where(point + steps > high, -steps, steps)
    moved = point + np.diag(steps)
    columns = in_threads(lambda z: residuals_or_penalty(likelihood, z, len(base)), list(moved), likelihood.workers)
    return (np.array(columns) - base).T / steps


def refine(
    likelihood: Misfit,
    point: np.ndarray,
    evaluations: int,
    options: SearchOptions = DEFAULT,
    jacobian: np.ndarray | None = None,
) -> tuple[np.ndarray, float]:
    """Descend by least squares (trust-region reflective, SciPy) from a point.

    jacobian (R, D): known derivatives of the residuals near the start, such as those of a similar model. They save
    simulations: the descent begins with them, and where it converges it is not repeated with new differences. If they
    lead nowhere, it begins anew without them.

    Returns (point (D,), sum of squared residuals) after at most `evaluations` evaluations; (start, inf) if the start is
    impossible.
    """
    low, high = bounds(likelihood)
    inside = np.clip(point, low, high)
    try:
        first = likelihood.residuals(inside)
    except ImpossibleModelError:
        return inside, math.inf
    gain, cost_before = options.converged_gain / max(len(first), 1), math.inf
    if not len(inside):
        return inside, cost(likelihood, inside)
    descent = _Descent(likelihood, inside, first, options.broyden_error, jacobian)
    while True:
        fit = least_squares(
            descent.padded_residuals,
            inside,
            descent.padded_derivatives,  # type: ignore[arg-type]  # SciPy's stubs do not know that this may be a function
            (low - 1e-12, high + 1e-12),
            x_scale=difference_steps(likelihood),
            max_nfev=evaluations,
            xtol=1e-8,
            ftol=gain,
        )
        inside, evaluations = fit.x, evaluations - fit.nfev
        led_on = jacobian is not None and fit.status != _NO_STEP
        converged = descent.is_exact or led_on or cost_before - fit.cost < gain * fit.cost
        if evaluations <= 0 or converged:
            return fit.x, 2.0 * float(fit.cost)
        jacobian, cost_before = None, fit.cost  # an approximate Jacobian may have ended it: repeat it with a new one
        descent = _Descent(likelihood, fit.x, descent.residuals(fit.x), options.broyden_error)


def refine_each(
    likelihood: Misfit, points: Sequence[np.ndarray], evaluations: int, options: SearchOptions = DEFAULT
) -> Iterator[tuple[np.ndarray, float]]:
    """`refine` from each of several points, one descent on each core: a descent is mostly sequential."""
    return each_in_threads(lambda point: refine(likelihood, point, evaluations, options), points, likelihood.workers)


class _Descent:
    """Residuals and their Jacobian at the points of a descent.

    The Jacobian costs a simulation for each unknown. A Broyden update replaces it while the last step's prediction
    error is below `broyden_error` of the change in residuals, unless impacts can change their order. is_exact: whether
    the last Jacobian is by differences. Source: Broyden, Math. Comp. 19, 577 (1965).

    SciPy gets D more residuals, which are 0. Their derivatives are 0 except for unknowns that no residual depends on,
    such as an unknown noise: a singular Jacobian makes its steps in all the others tiny.
    """

    def __init__(
        self,
        likelihood: Misfit,
        start: np.ndarray,
        residuals: np.ndarray,
        broyden_error: float,
        jacobian: np.ndarray | None = None,
    ):
        self.likelihood, self.broyden_error, self.is_exact = likelihood, broyden_error, True
        self.steps = difference_steps(likelihood)
        self._last, self._first = (start.copy(), residuals), jacobian
        self._linearization: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Residuals (R,) at a point; those of the last point are kept."""
        if not np.array_equal(self._last[0], point):
            self._last = point.copy(), residuals_or_penalty(self.likelihood, point, len(self._last[1]))
        return self._last[1]

    def derivatives(self, point: np.ndarray) -> np.ndarray:
        """The Jacobian (R, D) at a point."""
        value = self.residuals(point)
        J = self._first if self._linearization is None else self._broyden_update(point, value)
        self.is_exact = J is None
        if J is None:
            J = difference_jacobian(self.likelihood, point, value)
        self._linearization = point.copy(), value, J
        return J

    def padded_residuals(self, point: np.ndarray) -> np.ndarray:
        """Residuals and D zeros, (R + D,)."""
        return np.concatenate([self.residuals(point), np.zeros(len(point))])

    def padded_derivatives(self, point: np.ndarray) -> np.ndarray:
        """The Jacobian and D rows that keep unknowns without an influence where they are, (R + D, D)."""
        J = self.derivatives(point)
        sizes = np.linalg.norm(J, axis=0) * self.steps
        return np.vstack([J, np.diag(np.where(sizes == 0.0, (sizes.max() or 1.0) / self.steps, 0.0))])

    def _broyden_update(self, point: np.ndarray, value: np.ndarray) -> np.ndarray | None:
        """The last Jacobian, corrected in the direction of the step; None if its prediction error is too large."""
        assert self._linearization is not None
        if has_impact_order(self.likelihood.experiment.cradle):
            return None
        last, before, J = self._linearization
        step, change = point - last, value - before
        prediction_error = change - J @ step
        if np.linalg.norm(prediction_error) >= self.broyden_error * np.linalg.norm(change):
            return None
        scaled = step / self.steps
        return J + np.outer(prediction_error, scaled / self.steps) / (scaled @ scaled)
