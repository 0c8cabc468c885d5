"""Other shapes of an effect that fit as well as the most probable one.

A frame that yields may be heavy on a soft spring or light on a stiff one: over its frequency the misfit is a long flat
valley with narrow dips, where the frame rings in time with the blows, and the deepest dip of many owes its place to
noise. Neither a covariance nor a profile that ends where it first rises leads out of a dip; so a ladder of values is
climbed, all else refitted on each rung.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.stats import chi2 as chi2_distribution

from cradle_env.effects import LEARNED
from cradle_env.threads import in_threads
from identification.diagnosis.selection.candidates import parameter_of
from identification.diagnosis.selection.search import PointCache, fit_key
from identification.diagnosis.uncertainty.conditional_likelihood import ConditionalLikelihood, refit_others
from identification.inference.fit_result import Fitted
from identification.inference.impact_order_noise import size
from identification.inference.laplace import mode_at
from identification.inference.least_squares import SEVERAL, bounds, jacobian
from identification.inference.nonsmooth import broad_jacobian

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


def find_alternative_modes(fitted: Fitted, chance: float, cache: PointCache) -> tuple[np.ndarray, np.ndarray]:
    """Points that fit as well as the mode with other shapes of an effect, and how far about each the truth may lie but
    by this chance, that shape held; both (K, D), and none where no effect has shapes. keep: of what they are.

    As well: with no more χ² than the deepest of so many dips as there are rungs has by noise over that of the truth,
    and than readings jump where the order of impacts may flip.
    """
    D, found = len(fitted.point), [np.empty((0, 2 * len(fitted.point)))]
    for i in shape_unknowns(fitted):
        key = fit_key("branches", fitted.experiment, fitted.point.tolist(), chance, i)
        found.append(cache(key, lambda i=i: _modes_along(fitted, i, chance).ravel()).reshape(-1, 2 * D))
    points, widths = np.split(np.concatenate(found), 2, axis=1)
    return points, widths


def shape_unknowns(fitted: Fitted) -> list[int]:
    """Which unknowns are shapes of effects on a scale of ratios; those of learned laws go with their terms."""
    learned = {declared.name for declared in LEARNED}
    found = []
    for i, unknown in enumerate(fitted.likelihood.unknowns):
        owner, dot, _ = unknown.name.partition(".")
        if unknown.log and dot and owner not in learned and not parameter_of(unknown.name).is_strength:
            found.append(i)
    return found


def _modes_along(fitted: Fitted, i: int, chance: float) -> np.ndarray:
    """Those of other values of unknown i: points and widths, (K, 2 D)."""
    rungs = _refit_ladder(fitted, i)
    points, risen = rungs[:, :-1], np.clip((rungs[:, -1] - fitted.chi2) / fitted.coloured[0], 0.0, _IMPOSSIBLE)
    single, enough = (float(chi2_distribution.isf(chance / n, 1)) for n in (1, len(rungs)))
    if fitted.cradle.bobs >= SEVERAL:
        jumps = size(fitted.likelihood, fitted.point, fitted.jacobian, fitted.coloured[0] * fitted.smooth)
        enough += jumps / fitted.coloured[0] if math.isfinite(jumps) else 0.0
    as_well = [(point, enough - rise) for point, rise in zip(points, risen, strict=True) if rise < enough]
    for k in np.flatnonzero(np.diff(risen < enough)):  # as far as the way to the next would go by a straight line
        share = (math.sqrt(enough) - math.sqrt(risen[k])) / (math.sqrt(risen[k + 1]) - math.sqrt(risen[k]))
        as_well.append((points[k] + share * (points[k + 1] - points[k]), 0.0))

    def with_widths(branch: tuple[np.ndarray, float]) -> np.ndarray:
        point, room = branch
        there, others = ConditionalLikelihood(fitted.likelihood, i, point[i]), np.delete(point, i)
        derivatives = broad_jacobian if fitted.cradle.bobs >= SEVERAL else jacobian
        covariance = mode_at(there, others, derivatives(there, others, there.residuals(others))).covariance
        widths = np.sqrt(min(room, single) * fitted.coloured[0] * np.diag(covariance))
        return np.concatenate([point, np.insert(widths, i, 0.0)])

    return np.array(in_threads(with_widths, as_well, fitted.likelihood.workers))


def _refit_ladder(fitted: Fitted, i: int) -> np.ndarray:
    """Refits with unknown i held at one rung after the other, both ways from the mode until a valley ends; the points
    and their χ², in the order of the unknown, (K, D + 1)."""
    low, high = (float(bound[i]) for bound in bounds(fitted.likelihood))
    wall = fitted.chi2 + _WALL * fitted.coloured[0]

    def climb(side: float) -> list[np.ndarray]:
        at, last, ahead, rungs = fitted.point, fitted.chi2, np.zeros(len(fitted.point)), []
        stride, limit = math.log(_RATIO), low if side < 0.0 else high
        while last < wall and at[i] != limit:
            there = min(max(float(at[i]) + side * stride, low), high)
            # From where the last two point to; before a wall ends the ladder, from the last, too.
            begin = at + abs(there - at[i]) * ahead
            further, chi2 = refit_others(fitted.likelihood, i, there, begin, _EVALUATIONS)
            if chi2 > wall:
                again = refit_others(fitted.likelihood, i, there, at, _WALL_EVALUATIONS)
                further, chi2 = min((further, chi2), again, key=lambda pair: pair[1])
            ahead, at, last = (further - at) / abs(there - at[i]), further, chi2
            rungs.append(np.append(at, last))
            stride *= _GROWTH
        return rungs

    down, up = in_threads(climb, (-1.0, 1.0), fitted.likelihood.workers)
    return np.array([*down[::-1], np.append(fitted.point, fitted.chi2), *up])
