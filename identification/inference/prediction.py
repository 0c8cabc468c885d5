"""Predictions of σ(t) and λ over draws of a posterior."""

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
    """σ(t) and λ of a cradle over K draws of a posterior.

    Parameters
    ----------
    cradle : Cradle
        That of the first draw; an inferred δ is the median over the draws.
    release : Release
        Release of all runs, without the error of its angle.
    t : ndarray of shape (T,)
        Times [s].
    sigma : ndarray of shape (K, T)
        σ(t) of each draw.
    newton_exponent : ndarray of shape (K,)
        λ of each draw [1/s]; nan if it is not defined.
    gaps : ndarray of shape (K, N − 1)
        δ of each gap in each draw, including effects such as `spacer_offset`.
    """

    cradle: Cradle
    release: Release
    t: np.ndarray
    sigma: np.ndarray
    newton_exponent: np.ndarray
    gaps: np.ndarray

    def summary(self) -> dict[str, Any]:
        """Mean, sd, median and intervals of λ, in the form of a calibration's summary."""
        return {"unit": "1/s", **statistics(self.newton_exponent), "window_s": window_of(self.t)}

    def sigma_bands(self) -> dict[str, np.ndarray]:
        """Quantiles of σ(t): median (T,), ci68 (2, T) and ci95 (2, T)."""
        q = np.quantile(self.sigma, (0.025, 0.16, 0.5, 0.84, 0.975), axis=0)
        return {"median": q[2], "ci68": q[[1, 3]], "ci95": q[[0, 4]]}


def release_for_bobs(release: Release, calibrated: int, bobs: int) -> Release:
    """Adapt the release of a calibrated cradle to another number of bobs.

    Raises ValueError if the release states angles of bobs that the new cradle does not have or that are not its end.
    """
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
