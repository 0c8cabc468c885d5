"""A likelihood with one unknown held at a value, for refits of all others."""

from __future__ import annotations

import numpy as np

from identification.inference.least_squares import bounds, refine
from identification.inference.likelihood import Likelihood
from identification.inference.noise_model import NoiseModel


class ConditionalLikelihood:
    """A likelihood with unknown i held at a coordinate, for least squares over the others."""

    def __init__(self, of: Likelihood, i: int, coordinate: float):
        self.experiment = of.experiment
        #: Refits run side by side, one on each core.
        self.workers: int | None = 1
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

    def parts(self) -> list[slice]:
        """Where the residuals of each run lie."""
        return self._of.parts()

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Residuals (R + P,) at a point (D − 1,) of the other unknowns."""
        return self._of.residuals(np.insert(point, self._place, self._coordinate))


def refit_others(
    likelihood: Likelihood, i: int, coordinate: float, start: np.ndarray, evaluations: int
) -> tuple[np.ndarray, float]:  # fmt: skip
    """(point (D,), χ²) near `start` (D,), with unknown i held at a coordinate."""
    inside = np.delete(np.clip(start, *bounds(likelihood)), i)
    others, chi2 = refine(ConditionalLikelihood(likelihood, i, coordinate), inside, evaluations)
    return np.insert(others, i, coordinate), chi2
