"""Noise of low rank: a covariance of a few directions beside white noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class LowRankNoise:
    """Noise of R readings along K directions, beside white noise.

    Parameters
    ----------
    directions : ndarray of shape (R, K)
        Orthonormal directions, in columns.
    sizes : ndarray of shape (K,)
        Standard deviations along them, in the unit of the white noise.
    """

    directions: np.ndarray
    sizes: np.ndarray

    def whiten(self, residuals: np.ndarray, sigma: float) -> np.ndarray:
        """Convert residuals (R,) or (R, M) over white noise sigma into residuals over both kinds of noise."""
        shrunk = 1.0 / np.sqrt(1.0 + (self.sizes / sigma) ** 2) - 1.0
        return residuals + (self.directions * shrunk) @ (self.directions.T @ residuals)

    def log_volume(self, sigma: float) -> float:
        """Half the logarithm of the determinant of the covariance, over that of white noise sigma."""
        return 0.5 * float(np.sum(np.log1p((self.sizes / sigma) ** 2)))
