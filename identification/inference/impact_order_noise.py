"""Impact-order noise: the covariance of jumps of predicted readings, and what it does to a fit.

With three or more bobs the order of two impacts can depend on differences too small to measure, so predicted readings
jump. Neither data nor model can be repeated: each shows one of the possible orders. A jump d of the readings moves the
fitted unknowns by C Jᵀ d, with the Jacobian J and the covariance C. Calibration estimates the covariance of the jumps
by simulation and adds it to the noise, as a model discrepancy (Kennedy & O'Hagan, J. R. Stat. Soc. B 63, 425, 2001).
"""

from __future__ import annotations

import math

import numpy as np

from cradle_env.threads import in_threads
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.laplace import Mode, laplace_approximation
from identification.inference.least_squares import Misfit, bounds, difference_steps, has_impact_order
from identification.inference.likelihood import Likelihood
from identification.inference.low_rank_noise import LowRankNoise
from identification.inference.nonsmooth import (
    best_move,
    descend,
    descend_among_kappa_modes,
    gauss_newton_steps,
    wide_difference_jacobian,
)
from identification.inference.search_options import DEFAULT, SearchOptions

#: Pairs of points from which the size of jumps is estimated.
_PAIRS = 16
#: Rounds of that estimate, each with pairs as far apart as the last covariance allows.
_ROUNDS = 3
#: Longest distance of a point from the mode, in difference steps of a smooth misfit: jumps are as large there as
#: anywhere, and farther out the model may be no model of this experiment.
_LONGEST_STEP = 1e3
#: Gauss-Newton steps to the mode of the density with impact-order noise.
_STEPS = 2
#: Jumps below this fraction of the largest one are dropped.
_LEAST_SIZE = 1e-3


def add_impact_order_noise(
    likelihood: Likelihood, point: np.ndarray, J: np.ndarray, covariance: np.ndarray, inflation: float = 1.0
) -> np.ndarray:
    """The covariance (D, D) of a mode, times `inflation`, plus what jumps of the readings do to a fit.

    J (R, D): the Jacobian at the point (D,). Smooth readings add nothing.
    """
    inflated = total = inflation * covariance
    for i in range(_ROUNDS):
        moves = covariance @ J.T @ _linearization_errors(likelihood, point, J, total, _PAIRS, i)
        total = inflated + moves @ moves.T / max(moves.shape[1], 1)
    return total


def estimate_impact_order_noise(
    likelihood: Likelihood, mode: Mode, options: SearchOptions = DEFAULT
) -> tuple[Likelihood, Mode]:
    """Estimate the impact-order noise about a mode; (the likelihood with it, the mode of that).

    White noise and jumps together have the covariance σ² I + g² Σ dᵢ dᵢᵀ/K, of K jumps dᵢ, with the factor g of
    `options`. With fewer than three bobs no order can change, and both stay as they are.
    """
    if not has_impact_order(likelihood.experiment.cradle):
        return likelihood, mode
    point = descend_among_kappa_modes(likelihood, descend(likelihood, mode.point, options=options), options)
    J = wide_difference_jacobian(likelihood, point, likelihood.residuals(point))
    covariance = laplace_approximation(likelihood, point, J).covariance
    covariance = add_impact_order_noise(likelihood, point, J, covariance)
    jumps = _linearization_errors(likelihood, point, J, covariance, options.impact_order_draws, 0)
    jumps *= options.impact_order_factor / math.sqrt(max(jumps.shape[1], 1))
    runs = zip(likelihood.reading_slices(), likelihood.noise_model.weights, strict=True)
    impact_order = [_principal_noise(jumps[part] * weight) for part, weight in runs]
    known = likelihood.with_noise(likelihood.noise_model.with_impact_order(impact_order))
    J = known.noise_model.whiten_impact_order(J, known.reading_slices())
    for _ in range(_STEPS):
        residuals = known.residuals(point)
        moved, reached, _ = best_move(known, point, gauss_newton_steps(J, residuals))
        if not reached < float(np.sum(residuals**2)):
            break
        point = moved
    return known, laplace_approximation(known, point, J)


def impact_order_chi2(likelihood: Misfit, point: np.ndarray, J: np.ndarray, covariance: np.ndarray) -> float:
    """Mean χ² of the jumps of readings about a point (D,) as far as its covariance (D, D) reaches.

    Infinite if no point there can be simulated.
    """
    pairs = _linearization_errors(likelihood, point, J, covariance, _PAIRS, 0)
    return 0.5 * float(np.mean(np.sum(pairs**2, axis=0))) if pairs.size else math.inf


def principal_axes(likelihood: Misfit, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Principal axes (D, D) of a covariance, in columns, one standard deviation long; and the fraction of each, (D,).

    The fraction, at most 1, ends an axis where jumps are as large as anywhere. Along a direction that is hardly
    constrained it is small.
    """
    scale = np.sqrt(np.diag(covariance))
    squares, directions = np.linalg.eigh(covariance / np.outer(scale, scale))
    axes = scale[:, None] * directions * np.sqrt(np.maximum(squares, 0.0))
    reach = _LONGEST_STEP * difference_steps(likelihood)[:, None] / np.maximum(np.abs(axes), 1e-300)
    return axes, np.minimum(1.0, reach.min(axis=0))


def _principal_noise(jumps: np.ndarray) -> LowRankNoise:
    """Principal directions and sizes of jumps (R, K) [rad or m] of a run, without the smallest."""
    directions, sizes, _ = np.linalg.svd(jumps, full_matrices=False)
    large = sizes > _LEAST_SIZE * sizes[:1]
    return LowRankNoise(directions[:, large], sizes[large])


def _linearization_errors(
    likelihood: Misfit, point: np.ndarray, J: np.ndarray, covariance: np.ndarray, count: int, seed: int
) -> np.ndarray:
    """Change of the residuals between two points about a mode less its linear prediction, (R, ≤ count).

    The points of a pair lie on opposite sides of the mode, drawn from its covariance, so that smooth curvature cancels.
    Pairs with an impossible point are left out.
    """
    axes, reach = principal_axes(likelihood, covariance)
    drawn = (axes * reach) @ np.random.default_rng(seed).standard_normal((len(point), count))

    def error(step: np.ndarray) -> np.ndarray | None:
        above, below = (np.clip(point + side * step, *bounds(likelihood)) for side in (1.0, -1.0))
        try:
            return likelihood.residuals(above) - likelihood.residuals(below) - J @ (above - below)
        except ImpossibleModelError:
            return None

    errors = [one for one in in_threads(error, list(drawn.T), likelihood.workers) if one is not None]
    return np.array(errors).reshape(len(errors), len(J)).T
