"""A single frequency in residuals: the grid on which one is looked for, and what a line there would explain."""

from __future__ import annotations

import numpy as np

#: Frequencies looked at: as many to the width of a line, 1/duration; from so many swings over the duration to so many
#: per small-angle period of the cradle, beyond which a force hardly moves a bob.
_FINE, _LEAST, _FASTEST = 4, 2.0, 4.0


def frequencies(duration: float, period: float) -> np.ndarray:
    """Those at which a line [Hz] is looked for, (F,), in readings that last so long [s]; () where they are too short.
    Neighbours differ by a quarter of what such readings tell apart: in between, a line loses at most 5 % of its χ²."""
    return np.arange(_LEAST * _FINE, _FASTEST * _FINE * duration / period) / (_FINE * duration)


def independent(found: np.ndarray) -> float:
    """How many of such frequencies readings tell apart."""
    return max(1.0, len(found) / _FINE)


def power(times: np.ndarray, residuals: np.ndarray, found: np.ndarray) -> np.ndarray:
    """χ² that a cosine and a sine at each of these frequencies (F,) [Hz] save of residuals (R,) or (R, M) read at times
    (R,) [s], the same of all bobs: (F,) or (F, M). Of white noise each is χ² with two degrees of freedom."""
    instants, row = np.unique(times, return_inverse=True)
    together = np.zeros((len(instants), *residuals.shape[1:]))
    np.add.at(together, row, residuals)
    angle = 2.0 * np.pi * np.outer(found, instants - instants[0])
    waves = np.array([np.cos(angle), np.sin(angle)])
    parts = waves @ together.reshape(len(instants), -1)
    G = np.einsum("aft,bft,t->fab", waves, waves, np.bincount(row))
    saved = np.einsum("afm,fab,bfm->fm", parts, np.linalg.inv(G), parts)
    return saved.reshape(len(found), *residuals.shape[1:])
