"""How well the unknowns of a fitted model are known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, truncnorm

from identification.diagnose.fitted import Fitted
from identification.fit import SEVERAL, bounds, refine
from identification.likelihood import Likelihood

#: Normal quantile of the ends of an interval.
_END = float(norm.ppf(0.975))
#: How near to it, relatively, a profile must come for its end to be read off; how much shorter a stride that went too
#: far becomes; refits at most on the way to an end, and evaluations of each.
_NEAR, _SHORTER, _MARCH, _EVALUATIONS = 0.15, (0.1, 0.7), 24, 40


@dataclass(frozen=True, eq=False)
class Interval:
    """An unknown's median and central 95 %."""

    unit: str
    median: float
    ci95: tuple[float, float]


def intervals(fitted: Fitted) -> dict[str, Interval]:
    """Medians and 95 % intervals by Laplace, inflated for residuals that are not white and cut at the bounds; of
    fewer than three bobs, over which the misfit is smooth, the intervals of what is of the model by profile: of
    unknowns that make up for each other the most probable values may lie on a bent ridge."""
    deviations = np.sqrt(np.maximum(np.diag(fitted.covariance), 1e-300))
    smooth = fitted.cradle.bobs < SEVERAL and not fitted.learned
    found = {}
    for i, (u, z, sd) in enumerate(zip(fitted.likelihood.unknowns, fitted.point, deviations, strict=True)):
        low, high = (
            (bound - z) / sd if math.isfinite(bound) else bound
            for bound in ((math.log(u.low), math.log(u.high)) if u.log else (u.low, u.high))
        )
        median, *ends = truncnorm.ppf((0.5, 0.025, 0.975), min(low, -1e-12), max(high, 1e-12), z, sd)
        if smooth and not u.nuisance:
            ends = [_profile_end(fitted, i, sign * sd) for sign in (-1.0, 1.0)]
            median = min(max(median, ends[0]), ends[1])
        found[u.name] = Interval(u.unit, float(u.value(median)), (float(u.value(ends[0])), float(u.value(ends[1]))))
    return found


def _profile_end(fitted: Fitted, i: int, step: float) -> float:
    """The coordinate of unknown i, on the side to which `step` leads [its standard deviation], where χ² over the
    inflation, refitted in all others, has risen by that of the interval's end; its bound where it rises by less.

    Refits march along the ridge on which the others follow it, in longer and longer steps, each from where the last
    two point to.
    """
    likelihood, least, inflation = fitted.likelihood, fitted.chi2, fitted.coloured[0]
    limit = float(bounds(likelihood)[0 if step < 0.0 else 1][i])
    ahead = fitted.covariance[i] / fitted.covariance[i, i] * step
    at, risen, stride, growth = (
        fitted.point,
        0.0,
        _END,
        2.0,
    )  # strides and rises in standard deviations, were all normal
    for _ in range(_MARCH):
        start = np.clip(at + stride * ahead, *bounds(likelihood))
        others, chi2 = refine(_Held(likelihood, i, start[i]), np.delete(start, i), _EVALUATIONS)
        reached = math.sqrt(max(chi2 - least, 0.0) / inflation)
        if abs(reached - _END) < _NEAR * _END and reached > risen:
            share = (_END - risen) / (reached - risen)
            end = float(at[i] + share * (start[i] - at[i]))
            return max(end, limit) if step < 0.0 else min(end, limit)
        if reached > _END:  # too far
            stride *= float(np.clip((_END - risen) / (reached - risen), *_SHORTER))
            growth = 1.0
        elif start[i] == limit:
            return limit
        else:
            point = np.insert(others, i, start[i])
            ahead = (point - at) / stride
            at, risen, stride = point, reached, growth * stride
    return float(at[i])


class _Held(Likelihood):
    """A likelihood with unknown i held at a coordinate, for least squares."""

    def __init__(self, of: Likelihood, i: int, coordinate: float):
        self.__dict__.update(of.__dict__)
        self.unknowns = (*of.unknowns[:i], *of.unknowns[i + 1 :])
        self._of, self._place, self._coordinate = of, i, coordinate

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Those of the whole."""
        return self._of.residuals(np.insert(point, self._place, self._coordinate))
