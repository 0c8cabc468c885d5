"""Derivatives of a rough misfit, descent over it, and what its jumps leave open.

With three bobs and more the order of impacts flips at certain values of the unknowns, and readings jump there by part
of a noise. Derivatives over less than the distance of such jumps say neither where a better mode lies nor how well an
unknown is known; those over the width of what the readings tell apart say both.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from cradle_env.simulation import in_threads
from identification.fit import Mode, bounds, cost, mode_at, safe_residuals, steps, unit, well_conditioned
from identification.likelihood import Jumps, Likelihood

#: How far apart, in noises over all readings (or in what a reading leaves, where that is more), the ends of a
#: difference in one unknown are at least; attempts at such a step, the first in steps of a smooth misfit; half the
#: difference in directions that are known independently of each other, in standard deviations.
_APART, _ATTEMPTS, _WIDEST, _SPREAD = 5.0, 8, 1e3, 2.0
#: Damping, relative to what the readings say of an unknown, and lengths of the steps tried; rounds at most, and the
#: gain in χ², over what a reading leaves, from which another is worth it.
_DAMPINGS, _LENGTHS, _ROUNDS, _GAIN = (0.0, 1e-2, 1e-1), (1.0, 0.5, 0.2), 8, 0.5
#: Steps along single principal directions that are tried besides, in standard deviations.
_STRIDES = (3.0, 10.0, 30.0)
#: Pairs of points about a mode from which the size of jumps is learned, and how often, each time as far out as they
#: then allow; and those from which their directions are.
_DRAWN, _WIDENED, _LEARNED = 16, 3, 64
#: How much larger jumps count than they were, for those that were not drawn: unknowns are known by what lies across
#: all jumps, and get less than a tenth less certain, while the density they are sampled from gets far smoother; steps
#: to its mode; the share of the largest jump below which one counts as none.
_GENEROUS, _STEPS, _SMALL = 10.0, 2, 1e-3


def broad_jacobian(
    likelihood: Likelihood, point: np.ndarray, residuals: np.ndarray, widths: np.ndarray | None = None
) -> np.ndarray:
    """Derivatives of the residuals (R, D), by differences to both sides as wide as the readings tell them apart well:
    first in each unknown alone, then along the principal directions that those show. residuals: those at the point,
    (R,); widths: steps (D,) at which the search for such begins, and where those found are left."""
    length, sigma = len(residuals), math.sqrt(unit(float(np.sum(residuals**2)), len(residuals)))
    widths = _WIDEST * steps(likelihood) if widths is None else widths
    first = np.array(in_threads(
        lambda i: _column(likelihood, point, i, length, sigma, widths), list(range(len(point))), likelihood.workers
    )).T  # fmt: skip
    lengths = np.linalg.norm(first, axis=0)
    seen = lengths > 0.0
    s, Vt = np.linalg.svd(first[:, seen] / lengths[seen], full_matrices=False)[1:]
    if s[-1] < 1e-7 * s[0]:
        return first  # along what no reading holds, there is nothing to follow
    directions = np.zeros((len(s), len(point)))
    directions[:, seen] = Vt / lengths[seen] / s[:, None] * (_SPREAD * sigma)
    changes = in_threads(lambda v: _between(likelihood, point, v, length), list(directions), likelihood.workers)
    first[:, seen] = np.linalg.solve(directions[:, seen], np.array(changes)).T
    return first


def _column(
    likelihood: Likelihood, point: np.ndarray, i: int, length: int, sigma: float, widths: np.ndarray
) -> np.ndarray:
    """Derivative with respect to one unknown, (R,): from a step that is far too wide down to one that fits, past the
    single values at which a run comes out quite different."""
    direction = np.eye(len(point))[i]
    derivative = np.zeros(length)
    for _ in range(_ATTEMPTS):
        change = _between(likelihood, point, widths[i] * direction, length)
        derivative, apart = change / widths[i], 2.0 * float(np.linalg.norm(change)) / sigma
        if _APART < apart < 4.0 * _APART:
            break
        widths[i] *= float(np.clip(2.0 * _APART / max(apart, 1e-300), 0.1, 10.0))
    return derivative


def _between(likelihood: Likelihood, point: np.ndarray, step: np.ndarray, length: int) -> np.ndarray:
    """Change of the residuals per step, (R,), from one step below the point to one above; as far as bounds allow."""
    low, high = bounds(likelihood)
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(step > 0.0, (high - point) / step, (low - point) / step)
        back = np.where(step > 0.0, (point - low) / step, (point - high) / step)
    above, below = (min(1.0, float(np.nanmin(np.where(step == 0.0, np.inf, r)))) for r in (room, back))
    above, below = max(above, 0.0), max(below, 0.0)
    change = safe_residuals(likelihood, point + above * step, length)
    return (change - safe_residuals(likelihood, point - below * step, length)) / max(above + below, 1e-12)


def of_jumps(likelihood: Likelihood, point: np.ndarray, J: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """What jumps of the readings add to the covariance of a mode, (D, D).

    Where the order of impacts hangs on differences far below what the data resolve, neither data nor model can be had
    twice: each is one of the ways in which the bobs may have gone. What such a jump d does to a fit is J⁺ d, J being
    the derivatives. Where readings are smooth, nothing is added.
    """
    lengths = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    absorb = np.linalg.pinv(J / lengths) / lengths[:, None]
    added = np.zeros_like(covariance)
    for i in range(_WIDENED):
        moves = absorb @ _jumps(likelihood, point, J, covariance + added, _DRAWN, i)
        added = moves @ moves.T / _DRAWN
    return added


def _jumps(
    likelihood: Likelihood, point: np.ndarray, J: np.ndarray, covariance: np.ndarray, count: int, seed: int
) -> np.ndarray:
    """What the derivatives do not foretell of the changes between points about a mode, (R, count): of pairs as far
    from it as the truth may lie, to both sides, so that what bends smoothly cancels."""
    normal = np.random.default_rng(seed).standard_normal((len(point), count))
    drawn = np.linalg.cholesky(well_conditioned(covariance)) @ normal
    furthest = _WIDEST * steps(likelihood)[:, None]
    drawn *= np.minimum(1.0, np.min(furthest / np.maximum(np.abs(drawn), 1e-300), axis=0))
    changes = in_threads(lambda v: _between(likelihood, point, v, len(J)), list(drawn.T), likelihood.workers)
    return 2.0 * (np.array(changes).T - J @ drawn)


def with_jumps(likelihood: Likelihood, mode: Mode) -> tuple[Likelihood, Mode]:
    """The likelihood of readings that scatter by jumps as they do about its mode, and the mode of that. With less than
    three bobs no order can flip, and both stay as they are.

    Noise and jumps together have the covariance σ² I + Σ dᵢ dᵢᵀ/K, of K jumps dᵢ: along the few directions in which
    readings jump, residuals count for less.
    """
    if likelihood.experiment.cradle.bobs < 3:
        return likelihood, mode
    point = polish(likelihood, mode.point)
    J = broad_jacobian(likelihood, point, likelihood.residuals(point))
    covariance = mode_at(likelihood, point, J).covariance
    covariance = covariance + of_jumps(likelihood, point, J, covariance)
    scatter = _GENEROUS * _jumps(likelihood, point, J, covariance, _LEARNED, 0) / math.sqrt(_LEARNED)
    of_runs = zip(likelihood.parts(), likelihood.weighing, strict=True)
    known = likelihood.with_jumps([_of_run(scatter[part] * weight) for part, weight in of_runs])
    for _ in range(_STEPS):
        moves = _descents(known.counted(J), known.residuals(point))
        tried = [point, *(np.clip(point + move, *bounds(likelihood)) for move in moves)]
        point = tried[int(np.argmin(in_threads(lambda z: cost(known, z), tried, likelihood.workers)))]
    return known, mode_at(known, point, known.counted(J))


def _of_run(scatter: np.ndarray) -> Jumps:
    """Directions and sizes of jumps that scatter so, (R, K) [rad or m]; all but the smallest."""
    directions, sizes, _ = np.linalg.svd(scatter, full_matrices=False)
    large = sizes > _SMALL * sizes[:1]
    return Jumps(directions[:, large], sizes[large])


def polish(likelihood: Likelihood, point: np.ndarray, rounds: int = _ROUNDS) -> np.ndarray:
    """Where steps by the broad derivatives lead from a point, on and on while χ² falls; (D,)."""
    widths = _WIDEST * steps(likelihood)
    for _ in range(rounds):
        residuals = likelihood.residuals(point)
        least = float(np.sum(residuals**2))
        worth = unit(least, len(residuals))
        J = broad_jacobian(likelihood, point, residuals, widths)
        for moves in (_descents(J, residuals), _strides(J, math.sqrt(worth))):
            tried = [np.clip(point + move, *bounds(likelihood)) for move in moves]
            costs = in_threads(lambda z: cost(likelihood, z), tried, likelihood.workers)
            best = int(np.argmin(costs))
            if better := costs[best] < least - _GAIN * worth:
                point = tried[best]
                break
        if not better:
            break
    return point


def _descents(J: np.ndarray, residuals: np.ndarray) -> list[np.ndarray]:
    """Damped steps of Gauss and Newton, (D,) each."""
    lengths = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    H, slope = (J / lengths).T @ (J / lengths), (J / lengths).T @ residuals
    moves = []
    for damping, length in itertools.product(_DAMPINGS, _LENGTHS):
        moves.append(-length * np.linalg.lstsq(H + damping * np.eye(len(H)), slope)[0] / lengths)
    return moves


def _strides(J: np.ndarray, sigma: float) -> list[np.ndarray]:
    """Steps along single principal directions, to both sides, (D,) each: along a ridge the next mode may lie some
    standard deviations further, with worse between."""
    lengths = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    squares, directions = np.linalg.eigh((J / lengths).T @ (J / lengths))
    deviations = directions / np.sqrt(np.maximum(squares, 1e-9)) / lengths[:, None] * sigma
    return [sign * stride * one for one, stride in itertools.product(deviations.T, _STRIDES) for sign in (1.0, -1.0)]
