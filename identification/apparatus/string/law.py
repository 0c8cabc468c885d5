"""Eq. 4 and what it does not say, as one law of the tension along the legs of a curve.

    loading    T = T_min + κ (s − s_min) (1 + c (s + s_min)/2)
    unloading  T = T_max (s/s_max)^p
    slack      T = 0, and the string forgets

Eq. 4 is p = 2 and c = 0. Each term beside it is 0 where it is absent:

    exponent   p − 2
    curvature  c [1/m]
    rate       growth of κ by a factor e in speed
    force      growth of p by a factor e in T_max
    creep      growth of the slack with ln(1 + t/1 s) [m]; with ln(1 + cycle) where no times are given
    backlash   how far the machine turns back before the string notices [m]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from identification.apparatus.string.curve import Curve

#: Terms beside eq. 4, and about how large each may be expected: units of the search.
TERMS = {"exponent": 0.1, "curvature": 10.0, "rate": 0.01, "force": 0.1, "creep": 1e-5, "backlash": 2e-5}


@dataclass(frozen=True)
class Reference:
    """The speed [m/s] and largest tension [N] that `rate` and `force` compare with: geometric means of the curves."""

    rate: float
    force: float

    @classmethod
    def of(cls, curves: Sequence[Curve]) -> Reference:
        """That of some curves."""
        legs = [(curve, leg) for curve in curves for leg in curve.legs if leg.loading]
        rates = np.array([leg.rate for _, leg in legs])
        peaks = np.array([max(curve.force[leg.last - 1], curve.noise) for curve, leg in legs])
        rate = float(np.exp(np.mean(np.log(rates)))) if np.isfinite(rates).all() else np.nan
        return cls(rate, float(np.exp(np.mean(np.log(peaks)))))


def tension(
    curve: Curve, kappa: float, straight: float, terms: Mapping[str, float], reference: Reference
) -> np.ndarray:
    """Force (T,) [N] of one string along a curve, straight at that displacement [m] at its start.

    The memory of the string begins each leg where the machine turns, between two rows.
    """
    x, force = curve.displacement, np.zeros(len(curve.displacement))
    s_turn, t_turn = 0.0, 0.0
    for number, leg in enumerate(curve.legs):
        rows = slice(leg.first, leg.last)
        age = _age(curve, number)[rows]
        s = np.append(x[rows], leg.end) - straight - terms.get("creep", 0.0) * np.append(age, age[-1])
        if leg.loading:
            s = np.maximum(s, s_turn)
            stiffness = kappa
            if "rate" in terms:
                stiffness *= 1.0 + terms["rate"] * np.log(leg.rate / reference.rate)
            mean = 0.5 * (s + s_turn)
            tensions = t_turn + stiffness * (s - s_turn) * (1.0 + terms.get("curvature", 0.0) * mean)
        else:
            s = np.clip(s + terms.get("backlash", 0.0), 0.0, s_turn)
            p = 2.0 + terms.get("exponent", 0.0)
            if "force" in terms and t_turn > 0.0:
                p += terms["force"] * np.log(t_turn / reference.force)
            tensions = t_turn * (s / s_turn) ** max(p, 0.1) if s_turn > 0.0 else np.zeros(len(s))
        force[rows] = tensions[:-1]
        s_turn, t_turn = (float(s[-1]), float(tensions[-1])) if s[-1] > 0.0 else (0.0, 0.0)
    return force


def possible(curves: Sequence[Curve]) -> tuple[str, ...]:
    """The terms that these curves can tell anything of."""
    rates = [leg.rate for curve in curves for leg in curve.legs if leg.loading]
    peaks = [curve.force[leg.last - 1] for curve in curves for leg in curve.legs if leg.loading]
    several = any(len(curve.legs) > 2 for curve in curves)
    unloads = any(not leg.loading for curve in curves for leg in curve.legs)
    allowed = {
        "exponent": unloads,
        "curvature": True,
        "rate": bool(np.isfinite(rates).all() and max(rates) > 1.5 * min(rates)) and len({*rates}) > 1,
        "force": unloads and max(peaks) > 1.3 * min(peaks),
        "creep": several,
        "backlash": unloads,
    }
    return tuple(name for name in TERMS if allowed[name])


def _age(curve: Curve, leg: int) -> np.ndarray:
    """What the slack grows with: ln(1 + t/1 s), or ln(1 + cycle), from the first row (T,)."""
    if curve.time is not None:
        return np.log1p(curve.time - curve.time[0])
    return np.full(len(curve.force), np.log1p(leg // 2))
