"""The noise of a run: as stated, or estimated from the readings alone, whatever the model."""

from __future__ import annotations

import math

import numpy as np

from identification.runs import Run


def noise_of(run: Run) -> float:
    """Standard deviation of one reading [rad or m]: the stated one, or else the estimate."""
    return estimated_noise(run) if run.noise is None else run.noise


def estimated_noise(run: Run) -> float:
    """Standard deviation from third differences of successive readings, which take out any smooth motion.

    The median makes it blind to impacts. Readings smoothed by their instrument look less noisy than they are.
    """
    scatter = []
    for column in run.readings.T:
        third = np.diff(column[np.isfinite(column)], 3)
        if len(third) >= 10:
            scatter.append(np.median(np.abs(third)) / (0.6745 * math.sqrt(20.0)))
    if not scatter or max(scatter) == 0.0:
        raise ValueError(f"{run.file}: the noise cannot be estimated from so few or so coarse readings; state noise")
    return float(np.mean([s for s in scatter if s > 0.0]))
