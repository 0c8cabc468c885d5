"""Alternative modes: other values of an effect's shape parameters that fit as well as the best ones.

A frame may be heavy on a soft spring or light on a stiff one. Over its frequency, χ² is a long flat valley with narrow
dips, where the frame resonates with the impacts, and noise decides which of them is deepest. Neither the Laplace
covariance nor a profile that ends where χ² first rises leads out of a dip. So a ladder of fixed values covers the
valley, with a refit of all other unknowns at each rung.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import chdtri

from cradle_env.effects import LEARNED
from cradle_env.parameter_name import ParameterName
from cradle_env.threads import in_threads
from identification.diagnosis.selection.candidates import parameter_of
from identification.diagnosis.selection.fit_cache import PointCache, fit_key
from identification.diagnosis.uncertainty.conditional_likelihood import ConditionalLikelihood, refit_others
from identification.inference.fit_result import FitResult
from identification.inference.impact_order_noise import impact_order_chi2
from identification.inference.laplace import laplace_approximation
from identification.inference.least_squares import bounds, has_impact_order
from identification.inference.nonsmooth import jacobian_at_mode

#: Ratio of a parameter's values from the mode to the first rung of the ladder.
_RATIO = 1.5
#: Factor by which the logarithm of that ratio grows from rung to rung.
_GROWTH = 1.4
#: Evaluations of the refit at each rung.
_EVALUATIONS = 8
#: Evaluations of a second refit from the last rung, before a ladder ends at a wall.
_WALL_EVALUATIONS = 20
#: Rise of χ² over the inflation at which a ladder ends: no mode beyond it is as good by chance.
_WALL = 100.0
#: The rise that stands for an infinite one, where the cradle cannot be simulated.
_IMPOSSIBLE = 1e12


def find_alternative_modes(fitted: FitResult, chance: float, cache: PointCache) -> tuple[np.ndarray, np.ndarray]:
    """Points (K, D) that fit as well as the mode, and half widths (K, D) of the confidence interval about each.

    chance: probability that the truth lies outside. cache: of the points and widths, which need many refits.

    A rung fits as well if its χ² is above that of the mode by no more than noise explains: the χ² by which the deepest
    of K independent dips is below the truth with this probability, and the jumps of the readings with the order of
    impacts.
    """
    D, modes = len(fitted.point), [np.empty((0, 2 * len(fitted.point)))]
    for i in shape_unknowns(fitted):
        key = fit_key("branches", fitted.experiment, fitted.point.tolist(), chance, i)
        modes.append(cache(key, lambda i=i: _modes_along(fitted, i, chance).ravel()).reshape(-1, 2 * D))
    points, widths = np.split(np.concatenate(modes), 2, axis=1)
    return points, widths


def shape_unknowns(fitted: FitResult) -> list[int]:
    """Indices of the unknowns that are shape parameters of effects on a logarithmic scale, learned laws excepted."""
    learned = {declared.name for declared in LEARNED}
    indices = []
    for i, unknown in enumerate(fitted.likelihood.unknowns):
        owner = ParameterName.parse(unknown.name).effect
        if unknown.log and owner and owner not in learned and not parameter_of(unknown.name).is_strength:
            indices.append(i)
    return indices


def _modes_along(fitted: FitResult, i: int, chance: float) -> np.ndarray:
    """Alternative modes at other values of unknown i: points and widths, (K, 2 D)."""
    rungs = _refit_ladder(fitted, i)
    points, risen = (
        rungs[:, :-1],
        np.clip((rungs[:, -1] - fitted.chi2) / fitted.effective_sample.inflation, 0.0, _IMPOSSIBLE),
    )
    single, enough = (float(chdtri(1, chance / n)) for n in (1, len(rungs)))
    if has_impact_order(fitted.cradle):
        jumps = impact_order_chi2(
            fitted.likelihood,
            fitted.point,
            fitted.jacobian,
            fitted.effective_sample.inflation * fitted.laplace_covariance,
        )
        enough += jumps / fitted.effective_sample.inflation if math.isfinite(jumps) else 0.0
    modes = [(point, enough - rise) for point, rise in zip(points, risen, strict=True) if rise < enough]
    for k in np.flatnonzero(np.diff(risen < enough)):  # interpolated to the χ² that is allowed
        share = (math.sqrt(enough) - math.sqrt(risen[k])) / (math.sqrt(risen[k + 1]) - math.sqrt(risen[k]))
        modes.append((points[k] + share * (points[k + 1] - points[k]), 0.0))

    def with_widths(mode: tuple[np.ndarray, float]) -> np.ndarray:
        point, room = mode
        there, others = ConditionalLikelihood(fitted.likelihood, i, point[i]), np.delete(point, i)
        covariance = laplace_approximation(
            there, others, jacobian_at_mode(there, others, there.residuals(others))
        ).covariance
        widths = np.sqrt(min(room, single) * fitted.effective_sample.inflation * np.diag(covariance))
        return np.concatenate([point, np.insert(widths, i, 0.0)])

    return np.array(in_threads(with_widths, modes, fitted.likelihood.workers))


def _refit_ladder(fitted: FitResult, i: int) -> np.ndarray:
    """Refits with unknown i fixed at one rung after the other, both ways from the mode until χ² has risen to the wall.

    Returns the points and their χ², in the order of the unknown, (K, D + 1).
    """
    low, high = (float(bound[i]) for bound in bounds(fitted.likelihood))
    wall = fitted.chi2 + _WALL * fitted.effective_sample.inflation

    def climb(side: float) -> list[np.ndarray]:
        at, last, slope, rungs = fitted.point, fitted.chi2, np.zeros(len(fitted.point)), []
        stride, limit = math.log(_RATIO), low if side < 0.0 else high
        while last < wall and at[i] != limit:
            there = min(max(float(at[i]) + side * stride, low), high)
            # It starts where the last two rungs extrapolate to, and before the ladder ends, at the last rung, too.
            begin = at + abs(there - at[i]) * slope
            refitted, chi2 = refit_others(fitted.likelihood, i, there, begin, _EVALUATIONS)
            if chi2 > wall:
                again = refit_others(fitted.likelihood, i, there, at, _WALL_EVALUATIONS)
                refitted, chi2 = min((refitted, chi2), again, key=lambda pair: pair[1])
            slope, at, last = (refitted - at) / abs(there - at[i]), refitted, chi2
            rungs.append(np.append(at, last))
            stride *= _GROWTH
        return rungs

    down, up = in_threads(climb, (-1.0, 1.0), fitted.likelihood.workers)
    return np.array([*down[::-1], np.append(fitted.point, fitted.chi2), *up])
