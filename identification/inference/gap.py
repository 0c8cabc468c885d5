"""The gap: RMS residual over the noise (root of the reduced χ²), of a fit to the training part."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

#: The model does not describe the data if a gap exceeds both this value and the 99 % bound of noise alone.
MISFIT_GAP = 1.15


@dataclass(frozen=True)
class Gap:
    """RMS residuals over the noise, of a fit to the training part; 1 for a correct model.

    Parameters
    ----------
    train, held_out : float
        Gap of all training readings and of all held-out readings; nan if there are none.
    rms : mapping of str to ndarray of shape (1 + N,)
        RMS residual of all bobs and of each, by "train" and "held_out" [rad or m, the first run's quantity].
    allowed : float
        Held-out gap that a correct model exceeds in 1 of 100 experiments; nan if unknown.
    """

    train: float
    held_out: float
    rms: Mapping[str, np.ndarray] = field(default_factory=dict)
    allowed: float = math.nan
