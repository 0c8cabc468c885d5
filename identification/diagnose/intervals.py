"""How well the unknowns of a fitted model are known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, truncnorm

from cradle_env.simulation import in_threads
from identification.diagnose.fitted import Fitted
from identification.diagnose.profile import EVALUATIONS, profile_end
from identification.diagnose.search import Keep, at_once, fit_key
from identification.fit import SEVERAL, bounds, refine
from identification.likelihood import Likelihood
from identification.linear_algebra import on_one_thread

#: Normal quantile of the ends of an interval.
_END = float(norm.ppf(0.975))


@dataclass(frozen=True, eq=False)
class Interval:
    """An unknown's median and central 95 %."""

    unit: str
    median: float
    ci95: tuple[float, float]


@on_one_thread
def intervals(fitted: Fitted, keep: Keep = at_once) -> dict[str, Interval]:
    """Medians and 95 % intervals by Laplace, inflated for residuals that are not white and cut at the bounds; of
    fewer than three bobs, over which the misfit is smooth, the intervals of what is of the model by profile: of
    unknowns that make up for each other the most probable values may lie on a bent ridge. keep: of ends of profiles."""
    deviations = np.sqrt(np.maximum(np.diag(fitted.covariance), 1e-300))
    smooth = fitted.cradle.bobs < SEVERAL and not fitted.learned
    followed = [i for i, u in enumerate(fitted.likelihood.unknowns) if smooth and not u.nuisance]
    steps = [(i, sign * deviations[i]) for i in followed for sign in (-1.0, 1.0)]

    def end(step: tuple[int, float]) -> float:
        key = fit_key("end of an interval", fitted.experiment, fitted.point.tolist(), *step)
        return float(keep(key, lambda: np.array([_profile_end(fitted, *step)]))[0])

    reached = in_threads(end, steps, fitted.likelihood.workers)
    by_profile = dict(zip(followed, zip(reached[::2], reached[1::2], strict=True), strict=True))
    found = {}
    for i, (u, z, sd) in enumerate(zip(fitted.likelihood.unknowns, fitted.point, deviations, strict=True)):
        low, high = (
            (bound - z) / sd if math.isfinite(bound) else bound
            for bound in ((math.log(u.low), math.log(u.high)) if u.log else (u.low, u.high))
        )
        median, *ends = truncnorm.ppf((0.5, 0.025, 0.975), min(low, -1e-12), max(high, 1e-12), z, sd)
        if i in by_profile:
            ends = by_profile[i]
            median = min(max(median, ends[0]), ends[1])
        found[u.name] = Interval(u.unit, float(u.value(median)), (float(u.value(ends[0])), float(u.value(ends[1]))))
    return found


def _profile_end(fitted: Fitted, i: int, step: float) -> float:
    """The coordinate of unknown i, on the side to which `step` leads [its standard deviation], where χ² over the
    inflation, refitted in all others, has risen by that of the interval's end; its bound where it rises by less."""
    likelihood, least, inflation = fitted.likelihood, fitted.chi2, fitted.coloured[0]
    within = bounds(likelihood)
    limit = float(within[0 if step < 0.0 else 1][i])

    def refit(u: float, start: np.ndarray) -> tuple[np.ndarray, float]:
        held = float(np.clip(fitted.point[i] + u * step, within[0][i], within[1][i]))
        others, chi2 = refine(_Held(likelihood, i, held), np.delete(np.clip(start, *within), i), EVALUATIONS)
        return np.insert(others, i, held), math.sqrt(max(chi2 - least, 0.0) / inflation)

    ahead = fitted.covariance[i] / fitted.covariance[i, i] * step
    u, _ = profile_end(refit, fitted.point, ahead, (limit - fitted.point[i]) / step, _END)
    return float(np.clip(fitted.point[i] + u * step, within[0][i], within[1][i]))


class _Held(Likelihood):
    """A likelihood with unknown i held at a coordinate, for least squares."""

    def __init__(self, of: Likelihood, i: int, coordinate: float):
        self.__dict__.update(of.__dict__)
        self.workers = 1
        self.unknowns = (*of.unknowns[:i], *of.unknowns[i + 1 :])
        self._of, self._place, self._coordinate = of, i, coordinate

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Those of the whole."""
        return self._of.residuals(np.insert(point, self._place, self._coordinate))
