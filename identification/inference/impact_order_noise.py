"""How readings jump about a mode, and what that leaves open of the unknowns.

Where the order of impacts hangs on differences far below what the data resolve, neither data nor model can be had
twice: each is one of the ways in which the bobs may have gone. A fit to such data ends where the model's way happens to
be the luckiest, and knows its unknowns no better than a jump d moves them: by C Jᵀ d, with the derivatives J and the
covariance C. Beside the noise, d scatters along few directions; what lies across them is known all the better.
"""

from __future__ import annotations

import math

import numpy as np

from cradle_env.threads import in_threads
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.laplace import Mode, laplace_approximation
from identification.inference.least_squares import MIN_BOBS_WITH_IMPACT_ORDER, Misfit, bounds, difference_steps
from identification.inference.likelihood import Likelihood
from identification.inference.noise_model import ImpactOrderNoise
from identification.inference.nonsmooth import (
    best_move,
    descend,
    descend_among_kappa_modes,
    gauss_newton_steps,
    wide_difference_jacobian,
)

#: Pairs of points about a mode from which the size of jumps is learned, and how often, each time as far out as they
#: then allow; those from which their directions are; and how far out at most, in steps of a smooth misfit.
_DRAWN, _WIDENED, _LEARNED, _FURTHEST = 16, 3, 64, 1e3
#: How much larger jumps count than they were, for those that were not drawn: unknowns are known by what lies across
#: all jumps, and get less than a tenth less certain, while the density they are sampled from gets far smoother; steps
#: to its mode; the share of the largest jump below which one counts as none.
_GENEROUS, _STEPS, _SMALL = 10.0, 2, 1e-3


def add_impact_order_noise(
    likelihood: Likelihood, point: np.ndarray, J: np.ndarray, covariance: np.ndarray, inflation: float = 1.0
) -> np.ndarray:
    """The covariance of a mode, (D, D), times that inflation, and widened by what jumps do to a fit; where readings are
    smooth, by nothing."""
    inflated = found = inflation * covariance
    for i in range(_WIDENED):
        moves = covariance @ J.T @ _linearization_errors(likelihood, point, J, found, _DRAWN, i)
        found = inflated + moves @ moves.T / max(moves.shape[1], 1)
    return found


def estimate_impact_order_noise(likelihood: Likelihood, mode: Mode) -> tuple[Likelihood, Mode]:
    """The likelihood of readings that jump as they do about its mode, and the mode of that. With less than three bobs
    no order can flip, and both stay as they are.

    Noise and jumps together have the covariance σ² I + g² Σ dᵢ dᵢᵀ/K, of K jumps dᵢ, g = `_GENEROUS`.
    """
    if likelihood.experiment.cradle.bobs < MIN_BOBS_WITH_IMPACT_ORDER:
        return likelihood, mode
    point = descend_among_kappa_modes(likelihood, descend(likelihood, mode.point))
    J = wide_difference_jacobian(likelihood, point, likelihood.residuals(point))
    covariance = add_impact_order_noise(likelihood, point, J, laplace_approximation(likelihood, point, J).covariance)
    scatter = _linearization_errors(likelihood, point, J, covariance, _LEARNED, 0)
    scatter *= _GENEROUS / math.sqrt(max(scatter.shape[1], 1))
    of_runs = zip(likelihood.reading_slices(), likelihood.noise_model.weights, strict=True)
    impact_order = [_principal_noise(scatter[part] * weight) for part, weight in of_runs]
    known = likelihood.with_noise(likelihood.noise_model.with_impact_order(impact_order))
    for _ in range(_STEPS):
        residuals = known.residuals(point)
        moved, reached, _ = best_move(known, point, gauss_newton_steps(known.whiten(J), residuals))
        if not reached < float(np.sum(residuals**2)):
            break
        point = moved
    return known, laplace_approximation(known, point, known.whiten(J))


def impact_order_chi2(likelihood: Misfit, point: np.ndarray, J: np.ndarray, covariance: np.ndarray) -> float:
    """χ² by which readings jump on moves about a point as far as the truth may lie, in the mean; infinite where none is
    possible."""
    pairs = _linearization_errors(likelihood, point, J, covariance, _DRAWN, 0)
    return 0.5 * float(np.mean(np.sum(pairs**2, axis=0))) if pairs.size else math.inf


def principal_axes(likelihood: Misfit, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Principal axes (D, D) of a covariance, in columns, a standard deviation long; and the part of each, (D,), that is
    no longer than from where on jumps are as large as anywhere: along what is hardly known, that is a small one."""
    scale = np.sqrt(np.diag(covariance))
    squares, directions = np.linalg.eigh(covariance / np.outer(scale, scale))
    axes = scale[:, None] * directions * np.sqrt(np.maximum(squares, 0.0))
    reach = _FURTHEST * difference_steps(likelihood)[:, None] / np.maximum(np.abs(axes), 1e-300)
    return axes, np.minimum(1.0, reach.min(axis=0))


def _principal_noise(scatter: np.ndarray) -> ImpactOrderNoise:
    """Directions and sizes of jumps that scatter so, (R, K) [rad or m]; all but the smallest."""
    directions, sizes, _ = np.linalg.svd(scatter, full_matrices=False)
    large = sizes > _SMALL * sizes[:1]
    return ImpactOrderNoise(directions[:, large], sizes[large])


def _linearization_errors(
    likelihood: Misfit, point: np.ndarray, J: np.ndarray, covariance: np.ndarray, count: int, seed: int
) -> np.ndarray:
    """What the derivatives do not foretell of the changes between points about a mode, (R, ≤ count): of pairs as far
    from it as the truth may lie, to both sides, so that what bends smoothly cancels. Impossible points show nothing."""
    axes, reach = principal_axes(likelihood, covariance)
    drawn = (axes * reach) @ np.random.default_rng(seed).standard_normal((len(point), count))

    def change(step: np.ndarray) -> np.ndarray | None:
        above, below = (np.clip(point + side * step, *bounds(likelihood)) for side in (1.0, -1.0))
        try:
            return likelihood.residuals(above) - likelihood.residuals(below) - J @ (above - below)
        except ImpossibleModelError:
            return None

    found = [one for one in in_threads(change, list(drawn.T), likelihood.workers) if one is not None]
    return np.array(found).reshape(len(found), len(J)).T
