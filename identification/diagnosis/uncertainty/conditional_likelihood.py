"""Conditional likelihood: one unknown is fixed, and all others are refitted."""

from __future__ import annotations

import numpy as np

from identification.inference.least_squares import bounds, refine
from identification.inference.likelihood import Likelihood
from identification.inference.noise_model import NoiseModel


class ConditionalLikelihood:
    """The likelihood of the other unknowns with unknown i fixed at a coordinate."""

    def __init__(self, of: Likelihood, i: int, coordinate: float):
        self.experiment, self.workers = of.experiment, of.workers
        self.unknowns = (*of.unknowns[:i], *of.unknowns[i + 1 :])
        self._of, self._place, self._coordinate = of, i, coordinate

    @property
    def noise_model(self) -> NoiseModel:
        """The noise of each run."""
        return self._of.noise_model

    @property
    def names(self) -> list[str]:
        """Names of the other unknowns, (D − 1,)."""
        return [u.name for u in self.unknowns]

    def reading_slices(self) -> list[slice]:
        """The residuals of each run."""
        return self._of.reading_slices()

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Residuals (R + P,) at a point (D − 1,) of the other unknowns."""
        return self._of.residuals(np.insert(point, self._place, self._coordinate))


def refit_others(
    likelihood: Likelihood, i: int, coordinate: float, start: np.ndarray, evaluations: int
) -> tuple[np.ndarray, float]:  # fmt: skip
    """(point (D,), χ²) of a refit from `start` (D,) with unknown i fixed at a coordinate."""
    inside = np.delete(np.clip(start, *bounds(likelihood)), i)
    others, chi2 = refine(ConditionalLikelihood(likelihood, i, coordinate), inside, evaluations)
    return np.insert(others, i, coordinate), chi2
