"""σ(t) and λ of a cradle over draws of a posterior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.release import Release
from cradle_env.synchronization import window_of
from identification.inference.statistics import statistics


@dataclass(frozen=True)
class Prediction:
    """σ(t) and λ of a cradle over draws of a posterior: t (T,) [s], sigma (K, T), newton_exponent (K,) [1/s].

    cradle: that of the first draw, with δ as stated or, where it was inferred, at its median over the draws; gaps:
    (K, N − 1) δ of each gap in each draw, with what effects add.
    """

    cradle: Cradle
    release: Release
    t: np.ndarray
    sigma: np.ndarray
    newton_exponent: np.ndarray
    gaps: np.ndarray

    def summary(self) -> dict[str, Any]:
        """Mean, sd, median and intervals of λ, as in a calibration's summary."""
        return {"unit": "1/s", **statistics(self.newton_exponent), "window_s": window_of(self.t)}

    def sigma_bands(self) -> dict[str, np.ndarray]:
        """σ(t): median (T,), ci68 and ci95 (2, T)."""
        q = np.quantile(self.sigma, (0.025, 0.16, 0.5, 0.84, 0.975), axis=0)
        return {"median": q[2], "ci68": q[[1, 3]], "ci95": q[[0, 4]]}


def release_for_bobs(release: Release, calibrated: int, bobs: int) -> Release:
    """A release of so many bobs for another number of them; ValueError where it then lifts others."""
    angles = release.angles or {}
    highest = range(calibrated - len(angles) + 1, calibrated + 1)
    if angles and sorted(angles) == [*highest] and len(set(angles.values())) == 1:
        return Release(angle=angles[calibrated], bobs=len(angles), start=release.start)
    if calibrated in angles or max(angles, default=0) > bobs:
        raise ValueError(
            f"bobs is {bobs}, but the release calibrated names bob {max(angles)} of {calibrated};"
            f" predict for {calibrated} bobs"
        )
    return release
