"""How well the unknowns of a fitted model are known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import truncnorm

from identification.diagnose.decide import coloured
from identification.diagnose.fitted import Fitted


@dataclass(frozen=True, eq=False)
class Interval:
    """An unknown's median and central 95 %."""

    unit: str
    median: float
    ci95: tuple[float, float]


def intervals(fitted: Fitted) -> dict[str, Interval]:
    """Medians and 95 % intervals by Laplace, inflated for residuals that are not white and cut at the bounds."""
    inflation = coloured(fitted)[0]
    deviations = np.sqrt(inflation * np.maximum(np.diag(fitted.covariance), 1e-300))
    found = {}
    for u, z, sd in zip(fitted.likelihood.unknowns, fitted.point, deviations, strict=True):
        low, high = (
            (bound - z) / sd if math.isfinite(bound) else bound
            for bound in ((math.log(u.low), math.log(u.high)) if u.log else (u.low, u.high))
        )
        quantiles = truncnorm.ppf((0.5, 0.025, 0.975), min(low, -1e-12), max(high, 1e-12), z, sd)
        median, *ends = (float(u.value(q)) for q in quantiles)
        found[u.name] = Interval(u.unit, median, (ends[0], ends[1]))
    return found
