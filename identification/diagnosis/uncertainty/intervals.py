"""Confidence intervals of the unknowns of a fitted model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from cradle_env.threads import in_threads
from identification.diagnosis.selection.fit_cache import PointCache, compute_uncached, fit_key
from identification.diagnosis.uncertainty.alternative_modes import find_alternative_modes, shape_unknowns
from identification.diagnosis.uncertainty.conditional_likelihood import refit_others
from identification.diagnosis.uncertainty.profile_likelihood import REFIT_EVALUATIONS, find_profile_end
from identification.inference.fit_result import FitResult
from identification.inference.least_squares import bounds, has_impact_order
from identification.inference.linear_algebra import on_one_thread

#: Probabilities below the median and below the two ends of an interval.
_QUANTILES = 0.5, 0.025, 0.975
#: Standard deviations from the mode to the end of an interval of a normal distribution.
_END_SD = float(ndtri(_QUANTILES[2]))


@dataclass(frozen=True, eq=False)
class Interval:
    """Median and central 95 % interval of an unknown."""

    unit: str
    median: float
    ci95: tuple[float, float]


@on_one_thread
def compute_intervals(
    fitted: FitResult, cache: PointCache = compute_uncached, modes: Sequence[FitResult] = ()
) -> dict[str, Interval]:
    """Median and 95 % interval of each unknown, by name.

    1. The Laplace approximation, inflated for correlated residuals and truncated at the bounds.
    2. With fewer than three bobs χ² is smooth. There the profile likelihood replaces the intervals of the model's own
       unknowns: two that compensate each other lie on a curved ridge of χ².
    3. The intervals also cover other modes of the model: those of effects with alternative modes, and those known.

    cache: of the ends of profiles and of the alternative modes. modes: others that are known, none better.
    """
    from scipy.stats import truncnorm  # half a second for which other commands need not wait

    deviations = np.sqrt(np.maximum(np.diag(fitted.covariance), 1e-300))
    others, widths = find_alternative_modes(fitted, 2.0 * _QUANTILES[1], cache)
    for mode in modes:
        room = _END_SD**2 - (mode.chi2 - fitted.chi2) / fitted.effective_sample.inflation
        if room > 0.0:  # a profile likelihood about this mode, too, χ² taken as a parabola
            others = np.vstack([others, mode.point])
            widths = np.vstack([widths, np.sqrt(room * np.maximum(np.diag(mode.covariance), 0.0))])
    smooth, shapes = not has_impact_order(fitted.cradle) and not fitted.has_learned_law, shape_unknowns(fitted)
    followed = [i for i, u in enumerate(fitted.likelihood.unknowns) if smooth and not u.nuisance and i not in shapes]
    steps = [(i, sign * deviations[i]) for i in followed for sign in (-1.0, 1.0)]

    def end(step: tuple[int, float]) -> float:
        key = fit_key("end of an interval", fitted.experiment, fitted.point.tolist(), *step)
        return float(cache(key, lambda: np.array([_interval_end(fitted, *step)]))[0])

    reached = in_threads(end, steps, fitted.likelihood.workers)
    by_profile = dict(zip(followed, zip(reached[::2], reached[1::2], strict=True), strict=True))
    result, (least, most) = {}, bounds(fitted.likelihood)
    for i, (u, z, sd) in enumerate(zip(fitted.likelihood.unknowns, fitted.point, deviations, strict=True)):
        lowest, highest = (math.log(u.low), math.log(u.high)) if u.log else (u.low, u.high)
        low, high = ((bound - z) / sd if math.isfinite(bound) else bound for bound in (lowest, highest))
        median, *ends = truncnorm.ppf(_QUANTILES, min(low, -1e-12), max(high, 1e-12), z, sd)
        if i in by_profile:
            ends = by_profile[i]
            median = min(max(median, ends[0]), ends[1])
        first = min([ends[0], *(others[:, i] - widths[:, i])])
        last = max([ends[1], *(others[:, i] + widths[:, i])])
        ci95 = (  # a search stays a little within the bounds
            u.low if first <= least[i] else float(u.value(first)),
            u.high if last >= most[i] else float(u.value(last)),
        )
        result[u.name] = Interval(u.unit, float(u.value(median)), ci95)
    return result


def _interval_end(fitted: FitResult, i: int, step: float) -> float:
    """The coordinate of unknown i where its profile of χ² over the inflation has risen to the end of the interval.

    step: one standard deviation of the coordinate, towards the side that is searched. Returns the bound of the unknown
    if the profile does not rise so far.
    """
    likelihood, least, inflation = fitted.likelihood, fitted.chi2, fitted.effective_sample.inflation
    within = bounds(likelihood)
    limit = float(within[0 if step < 0.0 else 1][i])

    def refit(u: float, start: np.ndarray) -> tuple[np.ndarray, float]:
        fixed = float(np.clip(fitted.point[i] + u * step, within[0][i], within[1][i]))
        refitted, chi2 = refit_others(likelihood, i, fixed, start, REFIT_EVALUATIONS)
        return refitted, math.sqrt(max(chi2 - least, 0.0) / inflation)

    ahead = fitted.covariance[i] / fitted.covariance[i, i] * step
    furthest = (limit - fitted.point[i]) / step
    u, _ = find_profile_end(refit, fitted.point, ahead, furthest, _END_SD)
    if u > (1.0 - 1e-9) * furthest:  # within rounding
        return limit
    return float(np.clip(fitted.point[i] + u * step, within[0][i], within[1][i]))
