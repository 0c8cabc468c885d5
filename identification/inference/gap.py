"""The gap: RMS residual over the noise, of a fit to the training part alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

#: A gap beyond this says that the model does not describe the data, where noise alone hardly passes it.
MISFIT_GAP = 1.15


@dataclass(frozen=True)
class Gap:
    """RMS residual over the noise: 1 is the floor. Both from a fit to the training part alone.

    train, held_out: over all runs; nan where there are no such readings. rms: in the unit of the first run's
    quantity (rad or m), by "train" or "held_out", all bobs and each: shape (1 + N,). allowed: the held-out gap that a
    right model passes by chance once in a hundred times, with what the training part leaves open; nan: not known.
    """

    train: float
    held_out: float
    rms: Mapping[str, np.ndarray] = field(default_factory=dict)
    allowed: float = math.nan
