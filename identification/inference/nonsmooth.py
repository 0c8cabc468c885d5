"""Derivatives of a rough misfit, and descent over it.

With three bobs and more the order of impacts flips at certain values of the unknowns, and readings jump there by part
of a noise. Derivatives over less than the distance of such jumps say neither where a better mode lies nor how well an
unknown is known; those over the width of what the readings tell apart say both.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from cradle_env.threads import in_threads
from identification.inference.least_squares import (
    MIN_BOBS_WITH_IMPACT_ORDER,
    Misfit,
    bounds,
    chi2_scale,
    cost,
    difference_steps,
    residuals_or_penalty,
)
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import search_close_kappa_modes

#: How far apart, in noises over all readings (or in what a reading leaves, where that is more), the ends of a
#: difference in one unknown are at least; attempts at such a step, the first in steps of a smooth misfit; half the
#: difference in directions that are known independently of each other, in standard deviations.
_APART, _ATTEMPTS, _WIDEST, _SPREAD = 5.0, 8, 1e3, 2.0
#: Damping, relative to what the readings say of an unknown, and lengths of the steps tried; rounds at most, and the
#: gain in χ², over what a reading leaves, from which another is worth it.
_DAMPINGS, _LENGTHS, DESCENT_ROUNDS, _GAIN = (0.0, 1e-2, 1e-1), (1.0, 0.5, 0.2), 8, 0.5
#: Steps along single principal directions that are tried besides, in standard deviations.
_STRIDES = (3.0, 10.0, 30.0)
#: Where the shortest of them leave a χ² so far from what the derivatives foretell, over what a reading leaves, random
#: steps are tried: so many at a time, of up to so many standard deviations each way, until so many times in a row gain
#: less than that.
_ROUGH, _SCATTERED, _FARTHEST, _MISSES = 10.0, 48, 100.0, 4
#: What a reading leaves, over the variance of the noise, from which on a model is far from the data; the share of χ²
#: that another round must then have gained for the next.
MISSPECIFIED_CHI2_SCALE, _FAST = 4.0, 0.1
#: What the readings say of a principal direction, of all they could, below which it counts as not seen.
_SEEN = 1e-9


def widest_steps(likelihood: Misfit) -> np.ndarray:
    """Steps of the unknowns, (D,), at which the search for such as fit begins."""
    return _WIDEST * difference_steps(likelihood)


def wide_difference_jacobian(
    likelihood: Misfit, point: np.ndarray, residuals: np.ndarray, widths: np.ndarray | None = None
) -> np.ndarray:
    """Derivatives of the residuals (R, D), by differences to both sides as wide as the readings tell them apart well:
    first in each unknown alone, then along the principal directions that those show. residuals: those at the point,
    (R,); widths: steps (D,) at which the search for such begins, `widest_steps` unless told, and where those found
    are left.
    """
    length, sigma = len(residuals), math.sqrt(chi2_scale(float(np.sum(residuals**2)), len(residuals)))
    widths = widest_steps(likelihood) if widths is None else widths
    first = np.array(in_threads(
        lambda i: _wide_difference(likelihood, point, i, length, sigma, widths), list(range(len(point))),
        likelihood.workers,
    )).T  # fmt: skip
    lengths = np.linalg.norm(first, axis=0)
    seen = lengths > 0.0
    s, Vt = np.linalg.svd(first[:, seen] / lengths[seen], full_matrices=False)[1:]
    if len(s) == 0 or s[-1] < 1e-7 * s[0]:
        return first  # along what no reading holds, there is nothing to follow
    directions = np.zeros((len(s), len(point)))
    directions[:, seen] = Vt / lengths[seen] / s[:, None] * (_SPREAD * sigma)
    changes = in_threads(lambda v: _central_change(likelihood, point, v, length), list(directions), likelihood.workers)
    first[:, seen] = np.linalg.solve(directions[:, seen], np.array(changes)).T
    return first


def _wide_difference(
    likelihood: Misfit, point: np.ndarray, i: int, length: int, sigma: float, widths: np.ndarray
) -> np.ndarray:
    """Derivative with respect to one unknown, (R,): from a step that is far too wide down to one that fits, past the
    single values at which a run comes out quite different."""
    direction = np.eye(len(point))[i]
    derivative = np.zeros(length)
    for _ in range(_ATTEMPTS):
        change = _central_change(likelihood, point, widths[i] * direction, length)
        derivative, apart = change / widths[i], 2.0 * float(np.linalg.norm(change)) / sigma
        if _APART < apart < 4.0 * _APART:
            break
        widths[i] *= float(np.clip(2.0 * _APART / max(apart, 1e-300), 0.1, 10.0))
    return derivative


def _central_change(likelihood: Misfit, point: np.ndarray, step: np.ndarray, length: int) -> np.ndarray:
    """Change of the residuals per step, (R,), from one step below the point to one above; as far as bounds allow."""
    low, high = bounds(likelihood)
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(step > 0.0, (high - point) / step, (low - point) / step)
        back = np.where(step > 0.0, (point - low) / step, (point - high) / step)
    above, below = (min(1.0, float(np.nanmin(np.where(step == 0.0, np.inf, r)))) for r in (room, back))
    above, below = max(above, 0.0), max(below, 0.0)
    change = residuals_or_penalty(likelihood, point + above * step, length)
    return (change - residuals_or_penalty(likelihood, point - below * step, length)) / max(above + below, 1e-12)


def descend(
    likelihood: Misfit, point: np.ndarray, rounds: int = DESCENT_ROUNDS, thorough: bool = False,
    widths: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Where steps by the broad derivatives lead from a point, on and on while χ² falls; (D,). Far above the noise,
    where jumps are the least of what a model lacks, while it falls fast, and not at all with fewer than three bobs,
    unless asked to be thorough. widths: see `wide_difference_jacobian`."""
    if likelihood.experiment.cradle.bobs < MIN_BOBS_WITH_IMPACT_ORDER and not thorough:
        return point
    widths, last = widest_steps(likelihood) if widths is None else widths.copy(), math.inf
    for _ in range(rounds):
        residuals = likelihood.residuals(point)
        least = float(np.sum(residuals**2))
        worth = chi2_scale(least, len(residuals))
        if worth > MISSPECIFIED_CHI2_SCALE and not thorough and least > (1.0 - _FAST) * last:
            break
        last = least
        J = wide_difference_jacobian(likelihood, point, residuals, widths)
        deviations = _principal_deviations(J, math.sqrt(worth))
        enough = least - _GAIN * worth
        moved, reached, _ = best_move(likelihood, point, gauss_newton_steps(J, residuals))
        if not reached < enough and len(deviations):
            strides = [sign * stride * one for stride in _STRIDES for one in deviations for sign in (1.0, -1.0)]
            moved, reached, costs = best_move(likelihood, point, strides)
            short = 2 * len(deviations)
            foretold = [float(np.sum((residuals + J @ stride) ** 2)) for stride in strides[:short]]
            unforeseen = float(np.median(np.abs(costs[:short] - foretold)))
            if not reached < enough and worth < MISSPECIFIED_CHI2_SCALE and unforeseen > _ROUGH * worth:
                moved, reached = _search_at_random(likelihood, point, least, deviations, worth)
        if not reached < enough:
            break
        point = moved
    return point


def descend_among_kappa_modes(likelihood: Likelihood, point: np.ndarray) -> np.ndarray:
    """The best of the modes in κ about a point, (D,); a fit may end in any of them. With many bobs they lie a few 0.1 %
    apart, each a hundred times narrower."""
    if "kappa" not in likelihood.names:
        return point
    best = search_close_kappa_modes(likelihood, point)
    return point if np.array_equal(best, point) else descend(likelihood, best)


def best_move(
    likelihood: Misfit, point: np.ndarray, moves: Sequence[np.ndarray]
) -> tuple[np.ndarray, float, np.ndarray]:  # fmt: skip
    """(point (D,), χ²) of the best of several moves, and χ² of all."""
    tried = [np.clip(point + move, *bounds(likelihood)) for move in moves]
    costs = np.array(in_threads(lambda z: cost(likelihood, z), tried, likelihood.workers))
    best = int(np.argmin(costs))
    return tried[best], float(costs[best]), costs


def _search_at_random(
    likelihood: Misfit, point: np.ndarray, least: float, deviations: np.ndarray, worth: float
) -> tuple[np.ndarray, float]:  # fmt: skip
    """(point (D,), χ²) to which random steps lead, on and on while χ² falls: over a misfit that jumps up and down by
    more than it falls on the way, no derivative leads."""
    rng, misses = np.random.default_rng(0), 0
    while misses < _MISSES:
        lengths = np.exp(rng.uniform(0.0, math.log(_FARTHEST), (_SCATTERED, 1)))
        moves = lengths * rng.standard_normal((_SCATTERED, len(deviations))) @ deviations
        moved, reached, _ = best_move(likelihood, point, list(moves))
        misses = 0 if reached < least - _ROUGH * worth else misses + 1
        if reached < least:
            point, least = moved, reached
    return point, least


def gauss_newton_steps(J: np.ndarray, residuals: np.ndarray) -> list[np.ndarray]:
    """Damped steps of Gauss and Newton, (D,) each."""
    lengths = column_norms(J)
    H, slope = (J / lengths).T @ (J / lengths), (J / lengths).T @ residuals
    moves = []
    for damping, length in itertools.product(_DAMPINGS, _LENGTHS):
        moves.append(-length * np.linalg.lstsq(H + damping * np.eye(len(H)), slope)[0] / lengths)
    return moves


def _principal_deviations(J: np.ndarray, sigma: float) -> np.ndarray:
    """Standard deviations along the principal directions that the readings see, (≤ D, D), one row each: along a ridge
    the next mode may lie some of them further, with worse between."""
    lengths = column_norms(J)
    squares, directions = np.linalg.eigh((J / lengths).T @ (J / lengths))
    seen = squares > _SEEN
    return (directions[:, seen] / np.sqrt(squares[seen]) / lengths[:, None] * sigma).T


def column_norms(J: np.ndarray) -> np.ndarray:
    """Of the columns, (D,); 1 where nothing is seen of an unknown."""
    lengths = np.linalg.norm(J, axis=0)
    return np.where(lengths > 0.0, lengths, 1.0)
