"""A single frequency in residuals: the grid on which one is looked for, and what a line there would explain."""

from __future__ import annotations

import numpy as np

#: Frequencies per width of a spectral line, 1/duration: between them a line loses at most 5 % of its χ².
_OVERSAMPLING = 4
#: Lowest frequency [periods over the duration].
_MIN_PERIODS = 2.0
#: Highest frequency [small-angle frequencies of the cradle]: beyond it a force hardly moves a bob.
_MAX_HARMONIC = 4.0
#: Frequencies whose waves are in memory at once.
_CHUNK = 64


def frequency_grid(duration: float, period: float) -> np.ndarray:
    """Those at which a line [Hz] is looked for, (F,), in readings that last so long [s]; () where they are too short.
    Neighbours differ by a quarter of what such readings tell apart: in between, a line loses at most 5 % of its χ²."""
    return np.arange(_MIN_PERIODS * _OVERSAMPLING, _MAX_HARMONIC * _OVERSAMPLING * duration / period) / (
        _OVERSAMPLING * duration
    )


def count_independent(found: np.ndarray) -> float:
    """How many of such frequencies readings tell apart."""
    return max(1.0, len(found) / _OVERSAMPLING)


def line_power(times: np.ndarray, residuals: np.ndarray, found: np.ndarray) -> np.ndarray:
    """χ² that a cosine and a sine at each of these frequencies (F,) [Hz] save of residuals (R,) or (R, M) read at times
    (R,) [s], the same of all bobs: (F,) or (F, M). Of white noise each is χ² with two degrees of freedom."""
    instants, row = np.unique(times, return_inverse=True)
    together = np.zeros((len(instants), *residuals.shape[1:]))
    np.add.at(together, row, residuals)
    together, count = together.reshape(len(instants), -1), np.bincount(row)
    saved = np.empty((len(found), together.shape[1]))
    for some in np.array_split(np.arange(len(found)), -(-len(found) // _CHUNK)):  # all at once are too many to hold
        angle = 2.0 * np.pi * np.outer(found[some], instants - instants[0])
        waves = np.array([np.cos(angle), np.sin(angle)])
        parts = waves @ together
        G = np.einsum("aft,bft,t->fab", waves, waves, count)
        saved[some] = np.einsum("afm,fab,bfm->fm", parts, np.linalg.inv(G), parts)
    return saved.reshape(len(found), *residuals.shape[1:])
