"""Derivatives of a nonsmooth misfit, and descent over it.

With three or more bobs, the order of impacts changes at certain values of the unknowns, and predicted readings jump
there by part of the noise. Derivatives over less than the distance of such jumps show neither where a better mode lies
nor how well an unknown is known. Derivatives over the width within which readings change by a few standard deviations
show both.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from cradle_env.threads import in_threads
from identification.inference.least_squares import (
    Misfit,
    bounds,
    chi2_scale,
    cost,
    difference_jacobian,
    difference_steps,
    has_impact_order,
    residuals_or_penalty,
)
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import search_close_kappa_modes
from identification.inference.search_options import DEFAULT, SearchOptions

#: Least distance of the ends of a difference in one unknown: the norm of the change in residuals [sigma, or the root of
#: the reduced χ² if that is more]. Below 5 the noise hides which end is better.
_DISTANCE = 5.0
#: Attempts to find a step of this distance.
_ATTEMPTS = 8
#: The first of them, in difference steps of a smooth misfit.
_WIDEST = 1e3
#: Half the difference along a principal direction [standard deviations].
_HALF_WIDTH = 2.0
#: Ratio of singular values from which on no direction is followed: no reading constrains it.
_LEAST_RATIO = 1e-7
#: Damping of the Gauss-Newton steps that are tried, relative to the information on an unknown.
_DAMPINGS = (0.0, 1e-2, 1e-1)
#: Fractions of these steps that are tried.
_FRACTIONS = (1.0, 0.5, 0.2)
#: Steps along single principal directions that are tried besides [standard deviations].
_STRIDES = (3.0, 10.0, 30.0)
#: Prediction error of χ² over the shortest strides, in units of the reduced χ², from which on random steps are tried.
_NONSMOOTH_ERROR = 10.0
#: Longest random step [standard deviations].
_LONGEST_RANDOM_STEP = 100.0
#: Reduced χ² from which on a model counts as misspecified: twice the noise. Jumps are then a small part of the misfit.
MISSPECIFIED_CHI2_SCALE = 4.0
#: Relative gain in χ² of a round from which on a descent of a misspecified model goes on.
_FAST_GAIN = 0.1
#: Squared singular value of a principal direction, of columns of unit length, below which no reading constrains it.
_LEAST_INFORMATION = 1e-9


def widest_steps(likelihood: Misfit) -> np.ndarray:
    """Steps of the unknowns, (D,), from which the search for wide difference steps begins."""
    return _WIDEST * difference_steps(likelihood)


def wide_difference_jacobian(
    likelihood: Misfit, point: np.ndarray, residuals: np.ndarray, widths: np.ndarray | None = None
) -> np.ndarray:
    """Derivatives of the residuals (R, D), by central differences as wide as the readings tell their ends apart.

    First in each unknown alone, then along the principal directions of these derivatives. residuals (R,): those at the
    point. widths (D,): steps from which the search for wide enough ones begins, `widest_steps` if omitted; the steps
    that were found are left in them.
    """
    length, sigma = len(residuals), math.sqrt(chi2_scale(float(np.sum(residuals**2)), len(residuals)))
    widths = widest_steps(likelihood) if widths is None else widths
    J = np.array(in_threads(
        lambda i: _wide_difference(likelihood, point, i, length, sigma, widths), list(range(len(point))),
        likelihood.workers,
    )).T  # fmt: skip
    norms = np.linalg.norm(J, axis=0)
    seen = norms > 0.0
    s, Vt = np.linalg.svd(J[:, seen] / norms[seen], full_matrices=False)[1:]
    if len(s) == 0 or s[-1] < _LEAST_RATIO * s[0]:
        return J
    directions = np.zeros((len(s), len(point)))
    directions[:, seen] = Vt / norms[seen] / s[:, None] * (_HALF_WIDTH * sigma)
    changes = in_threads(lambda v: _central_change(likelihood, point, v, length), list(directions), likelihood.workers)
    J[:, seen] = np.linalg.solve(directions[:, seen], np.array(changes)).T
    return J


def jacobian_at_mode(likelihood: Misfit, point: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """Derivatives of the residuals (R, D) at a mode: by wide differences where readings jump."""
    is_nonsmooth = has_impact_order(likelihood.experiment.cradle)
    return (wide_difference_jacobian if is_nonsmooth else difference_jacobian)(likelihood, point, residuals)


def _wide_difference(
    likelihood: Misfit, point: np.ndarray, i: int, length: int, sigma: float, widths: np.ndarray
) -> np.ndarray:
    """Derivative with respect to unknown i, (R,): from a step that is far too wide down to one that fits.

    Starting wide passes over single values at which a run comes out quite different.
    """
    direction = np.eye(len(point))[i]
    derivative = np.zeros(length)
    for _ in range(_ATTEMPTS):
        change = _central_change(likelihood, point, widths[i] * direction, length)
        derivative, distance = change / widths[i], 2.0 * float(np.linalg.norm(change)) / sigma
        if _DISTANCE < distance < 4.0 * _DISTANCE:
            break
        widths[i] *= float(np.clip(2.0 * _DISTANCE / max(distance, 1e-300), 0.1, 10.0))
    return derivative


def _central_change(likelihood: Misfit, point: np.ndarray, step: np.ndarray, length: int) -> np.ndarray:
    """Change of the residuals per step, (R,), from one step below the point to one above, as far as bounds allow."""
    low, high = bounds(likelihood)
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(step > 0.0, (high - point) / step, (low - point) / step)
        back = np.where(step > 0.0, (point - low) / step, (point - high) / step)
    above, below = (min(1.0, float(np.nanmin(np.where(step == 0.0, np.inf, r)))) for r in (room, back))
    above, below = max(above, 0.0), max(below, 0.0)
    change = residuals_or_penalty(likelihood, point + above * step, length)
    return (change - residuals_or_penalty(likelihood, point - below * step, length)) / max(above + below, 1e-12)


def descend(
    likelihood: Misfit,
    point: np.ndarray,
    rounds: int | None = None,
    thorough: bool = False,
    widths: np.ndarray | None = None,
    options: SearchOptions = DEFAULT,
) -> np.ndarray:
    """Descend from a point (D,) by wide-difference derivatives while χ² falls; the point reached, (D,).

    Each round tries damped Gauss-Newton steps, then steps along principal directions, then random steps. A misspecified
    model is descended only while χ² falls fast. With fewer than three bobs the misfit is smooth, and the point stays;
    `thorough` drops both rules. rounds: at most, those of `options` if omitted. widths: see `wide_difference_jacobian`.
    """
    if not has_impact_order(likelihood.experiment.cradle) and not thorough:
        return point
    widths, last = widest_steps(likelihood) if widths is None else widths.copy(), math.inf
    for _ in range(options.descent_rounds if rounds is None else rounds):
        residuals = likelihood.residuals(point)
        least = float(np.sum(residuals**2))
        scale = chi2_scale(least, len(residuals))
        if scale > MISSPECIFIED_CHI2_SCALE and not thorough and least > (1.0 - _FAST_GAIN) * last:
            break
        last = least
        J = wide_difference_jacobian(likelihood, point, residuals, widths)
        deviations = _principal_deviations(J, math.sqrt(scale))
        enough = least - options.descent_gain * scale
        moved, reached, _ = best_move(likelihood, point, gauss_newton_steps(J, residuals))
        if not reached < enough and len(deviations):
            strides = [sign * stride * one for stride in _STRIDES for one in deviations for sign in (1.0, -1.0)]
            moved, reached, costs = best_move(likelihood, point, strides)
            short = 2 * len(deviations)
            predicted = [float(np.sum((residuals + J @ stride) ** 2)) for stride in strides[:short]]
            error = float(np.median(np.abs(costs[:short] - predicted)))
            if not reached < enough and scale < MISSPECIFIED_CHI2_SCALE and error > _NONSMOOTH_ERROR * scale:
                moved, reached = _search_at_random(likelihood, point, least, deviations, scale, options)
        if not reached < enough:
            break
        point = moved
    return point


def descend_among_kappa_modes(
    likelihood: Likelihood, point: np.ndarray, options: SearchOptions = DEFAULT
) -> np.ndarray:
    """The best of the modes of κ near a point, (D,).

    With many bobs these modes lie a few 0.1 % apart, each a hundred times narrower, and a fit may end in any of them.
    """
    if "kappa" not in likelihood.names:
        return point
    best = search_close_kappa_modes(likelihood, point, options)
    return point if np.array_equal(best, point) else descend(likelihood, best, options=options)


def best_move(
    likelihood: Misfit, point: np.ndarray, moves: Sequence[np.ndarray]
) -> tuple[np.ndarray, float, np.ndarray]:
    """(point (D,), χ²) of the best of several moves (D,) from a point, and χ² of all of them."""
    tried = [np.clip(point + move, *bounds(likelihood)) for move in moves]
    costs = np.array(in_threads(lambda z: cost(likelihood, z), tried, likelihood.workers))
    best = int(np.argmin(costs))
    return tried[best], float(costs[best]), costs


def _search_at_random(
    likelihood: Misfit, point: np.ndarray, least: float, deviations: np.ndarray, scale: float, options: SearchOptions
) -> tuple[np.ndarray, float]:
    """(point (D,), χ²) after random steps while χ² falls: no derivative leads where χ² jumps by more than it falls."""
    rng, failures = np.random.default_rng(0), 0
    shape = options.random_steps, len(deviations)
    while failures < options.random_failures:
        lengths = np.exp(rng.uniform(0.0, math.log(_LONGEST_RANDOM_STEP), (options.random_steps, 1)))
        moves = lengths * rng.standard_normal(shape) @ deviations
        moved, reached, _ = best_move(likelihood, point, list(moves))
        failures = 0 if reached < least - _NONSMOOTH_ERROR * scale else failures + 1
        if reached < least:
            point, least = moved, reached
    return point, least


def gauss_newton_steps(J: np.ndarray, residuals: np.ndarray) -> list[np.ndarray]:
    """Damped Gauss-Newton steps (Levenberg-Marquardt) from the Jacobian J (R, D), and fractions of them; (D,) each."""
    norms = column_norms(J)
    H, slope = (J / norms).T @ (J / norms), (J / norms).T @ residuals
    moves = []
    for damping, fraction in itertools.product(_DAMPINGS, _FRACTIONS):
        moves.append(-fraction * np.linalg.lstsq(H + damping * np.eye(len(H)), slope)[0] / norms)
    return moves


def _principal_deviations(J: np.ndarray, sigma: float) -> np.ndarray:
    """Standard deviations along the principal directions that readings constrain, (≤ D, D), one row each.

    Along a ridge the next mode may lie several standard deviations away, with larger χ² between.
    """
    norms = column_norms(J)
    squares, directions = np.linalg.eigh((J / norms).T @ (J / norms))
    seen = squares > _LEAST_INFORMATION
    return (directions[:, seen] / np.sqrt(squares[seen]) / norms[:, None] * sigma).T


def column_norms(J: np.ndarray) -> np.ndarray:
    """Norms of the columns of J, (D,); 1 for a column of zeros."""
    norms = np.linalg.norm(J, axis=0)
    return np.where(norms > 0.0, norms, 1.0)
