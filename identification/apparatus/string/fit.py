"""The law of a string fitted to curves, and which of its terms the data ask for."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from identification.apparatus.residuals import correlation_of
from identification.apparatus.string.curve import Curve
from identification.apparatus.string.law import TERMS, Reference, possible, tension

#: Step of a numerical derivative, in units of a parameter's scale: below the grain of the data, above rounding.
_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Fit:
    """The law fitted with some terms.

    terms: beside eq. 4; values, covariance: in the order of `names`, the covariance widened by `inflation`, how many
    successive residuals count for one; models: (T,) [N] of each curve; squares: Σ (residual/noise)², and count of them.
    """

    curves: tuple[Curve, ...]
    terms: tuple[str, ...]
    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    inflation: float
    models: tuple[np.ndarray, ...]
    squares: float
    count: int

    def of(self, name: str) -> tuple[float, float]:
        """(value, standard deviation) of a parameter."""
        k = self.names.index(name)
        return float(self.values[k]), float(np.sqrt(self.covariance[k, k]))

    def bic(self, inflation: float) -> float:
        """BIC, where so many successive residuals count for one."""
        count = self.count / inflation
        return count * np.log(self.squares / self.count) + len(self.values) * np.log(count)


def fit(curves: Sequence[Curve], terms: Sequence[str], start: Fit | None = None) -> Fit:
    """Least squares, each curve weighted by its noise; start: a fit of the same curves, from where to begin."""
    reference = Reference.of(curves)
    names, begin, scales = ["kappa"], [_stiffness(curves)], [0.01 * _stiffness(curves)]
    for k, curve in enumerate(curves):
        names.append(f"straight {k}")
        begin.append(curve.straight)
        scales.append(1e-2 * np.ptp(curve.displacement))
        if curve.slack:
            names.append(f"zero {k}")
            begin.append(0.0)
            scales.append(curve.noise)
    names += terms
    begin += [0.0] * len(terms)
    scales += [TERMS[name] for name in terms]
    scale = np.array(scales)
    if start is not None:
        known = dict(zip(start.names, start.values, strict=True))
        begin = [known.get(name, value) for name, value in zip(names, begin, strict=True)]

    def models(values: np.ndarray) -> list[np.ndarray]:
        of = dict(zip(names, values, strict=True))
        law = {name: of[name] for name in terms}
        return [
            tension(curve, of["kappa"], of[f"straight {k}"], law, reference) + of.get(f"zero {k}", 0.0)
            for k, curve in enumerate(curves)
        ]

    def residual(unit: np.ndarray) -> np.ndarray:
        made = models(unit * scale)
        return np.concatenate([(curve.force - one) / curve.noise for curve, one in zip(curves, made, strict=True)])

    found = least_squares(residual, np.array(begin) / scale, diff_step=_STEP, x_scale=1.0, xtol=1e-8, ftol=1e-9)
    unit = found.x
    jacobian = np.column_stack([
        (residual(unit + step) - residual(unit - step)) / (2.0 * _STEP) for step in _STEP * np.eye(len(unit))
    ])  # fmt: skip
    values, squares = unit * scale, float(found.fun @ found.fun)
    ends = np.cumsum([0, *(len(curve.force) for curve in curves)])
    inflation = float(np.mean([correlation_of(found.fun[a:b]) for a, b in itertools.pairwise(ends)]))
    variance = squares / max(len(found.fun) - len(unit), 1) * inflation
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance * np.outer(scale, scale)
    return Fit(
        tuple(curves), tuple(terms), tuple(names), values, covariance, inflation, tuple(models(values)), squares,
        len(found.fun),
    )  # fmt: skip


def selected(curves: Sequence[Curve]) -> tuple[Fit, Mapping[str, Fit]]:
    """The fit with the terms that the data ask for by BIC, added one by one; and, by each possible term, the fit that
    tells it: the chosen one, or that with this term besides."""
    terms = possible(curves)
    inflation = fit(curves, terms).inflation
    best = fit(curves, ())
    while True:
        tried = [fit(curves, (*best.terms, name), best) for name in terms if name not in best.terms]
        better = min(tried, key=lambda one: one.bic(inflation), default=best)
        if better.bic(inflation) >= best.bic(inflation):
            break
        best = better
    beside = {one.terms[-1]: one for one in tried}
    return best, {name: beside.get(name, best) for name in terms}


def _stiffness(curves: Sequence[Curve]) -> float:
    """κ [N/m] by the mean slope of the first loading of each curve."""
    slopes = []
    for curve in curves:
        rows = slice(curve.legs[0].first, curve.legs[0].last)
        x, f = curve.displacement[rows], curve.force[rows]
        steep = f > 0.3 * np.quantile(f, 0.98)
        slopes.append(np.polyfit(x[steep], f[steep], 1)[0])
    return float(np.mean(slopes))
