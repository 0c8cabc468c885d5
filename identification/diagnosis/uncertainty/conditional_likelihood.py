"""A likelihood with one unknown held, for refits of all others."""

from __future__ import annotations

import numpy as np

from identification.inference.least_squares import bounds, refine
from identification.inference.likelihood import Likelihood


class Held(Likelihood):
    """A likelihood with unknown i held at a coordinate, for least squares."""

    def __init__(self, of: Likelihood, i: int, coordinate: float):
        self.__dict__.update(of.__dict__)
        self.workers = 1
        self.unknowns = (*of.unknowns[:i], *of.unknowns[i + 1 :])
        self._of, self._place, self._coordinate = of, i, coordinate

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Those of the whole."""
        return self._of.residuals(np.insert(point, self._place, self._coordinate))


def refit_others(
    likelihood: Likelihood, i: int, coordinate: float, start: np.ndarray, evaluations: int
) -> tuple[np.ndarray, float]:  # fmt: skip
    """(point (D,), χ²) near `start` (D,), with unknown i held at a coordinate."""
    inside = np.delete(np.clip(start, *bounds(likelihood)), i)
    others, chi2 = refine(Held(likelihood, i, coordinate), inside, evaluations)
    return np.insert(others, i, coordinate), chi2
