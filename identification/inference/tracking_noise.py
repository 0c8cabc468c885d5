"""Tracking noise: errors of readings that repeat where a bob passes the same place as fast.

What a camera sees of a bob depends on where the bob is, how fast it moves, and what is behind and beside it. Part of
the error of a reading is a function of these. It repeats in each swing, and many swings do not average it out. It is a
Gaussian process over the bob's place and speed, with a squared exponential covariance (Rasmussen & Williams, Gaussian
Processes for Machine Learning, 2006, eq. 4.9), beside the white noise.

Place and speed are those of the fitted model. Those of the readings contain the noise itself, and a covariance that is
made of them biases what is inferred: b by several standard deviations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.experiment.run import Tracking
from identification.inference.low_rank_noise import LowRankNoise

#: Part of the variance of a reading that the low-rank covariance may leave out.
_LEFT_OUT = 0.02


@dataclass(frozen=True, eq=False)
class TrackingNoise:
    """Tracking noise of the R readings of a run, over their white noise.

    Parameters
    ----------
    bobs : tuple of (ndarray of int, LowRankNoise)
        For each bob, which of the readings are its own, and their noise where white noise has the size 1; none where
        no tracking noise is stated.
    """

    bobs: tuple[tuple[np.ndarray, LowRankNoise], ...] = ()

    @classmethod
    def of(cls, tracking: Tracking, times: np.ndarray, motion: np.ndarray, seen: np.ndarray) -> TrackingNoise:
        """Of the readings that are seen, bool (T, N), of a motion (T, N) [rad or m] at times (T,) [s]."""
        speeds = np.gradient(motion, times, axis=0)
        number = np.cumsum(seen).reshape(seen.shape) - 1
        bobs = []
        for bob, own in enumerate(seen.T):
            passes = np.column_stack([motion[own, bob] / tracking.place, speeds[own, bob] / tracking.speed])
            directions, sizes, _ = np.linalg.svd(_covariance_factor(passes), full_matrices=False)
            bobs.append((number[own, bob], LowRankNoise(directions, tracking.ratio * sizes)))
        return cls(tuple(bobs))

    def whiten(self, residuals: np.ndarray) -> np.ndarray:
        """Convert residuals (R,) or (R, M) over white noise into residuals over both kinds of noise."""
        residuals = residuals.copy()
        for own, noise in self.bobs:
            residuals[own] = noise.whiten(residuals[own], 1.0)
        return residuals

    def log_volume(self) -> float:
        """Half the logarithm of the determinant of the covariance, over that of white noise."""
        return sum(noise.log_volume(1.0) for _, noise in self.bobs)


def _covariance_factor(points: np.ndarray) -> np.ndarray:
    """L (T, K) with L Lᵀ ≈ exp(−d²/2), where d are the distances of the points (T, 2).

    A pivoted Cholesky decomposition, which stops when no point has more than a small rest of its variance left
    (Harbrecht et al., Appl. Numer. Math. 62, 428, 2012).
    """
    rest, columns = np.ones(len(points)), np.zeros((0, len(points)))
    while len(points) and rest.max() > _LEFT_OUT:
        pivot = int(np.argmax(rest))
        covariance = np.exp(-0.5 * np.sum((points - points[pivot]) ** 2, axis=1))
        column = (covariance - columns[:, pivot] @ columns) / np.sqrt(rest[pivot])
        columns = np.vstack([columns, column])
        rest = rest - column**2
    return columns.T
