"""Least-squares periodogram of residuals: the frequencies that are tried, and the χ² that a spectral line saves.

Source: Scargle (1982), Astrophys. J. 263, 835.
"""

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
    """Frequencies at which a spectral line is looked for [Hz], (F,); () where the readings are too short.

    duration: of the readings [s]. period: small-angle period of the cradle [s].
    """
    return np.arange(_MIN_PERIODS * _OVERSAMPLING, _MAX_HARMONIC * _OVERSAMPLING * duration / period) / (
        _OVERSAMPLING * duration
    )


def count_independent(frequencies: np.ndarray) -> float:
    """Number of independent frequencies in a grid (F,) by `frequency_grid`."""
    return max(1.0, len(frequencies) / _OVERSAMPLING)


def line_power(times: np.ndarray, residuals: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """χ² that a cosine and a sine, the same for all bobs, save at each frequency: (F,) or (F, M).

    times (R,): of the readings [s]. residuals (R,) or (R, M): over the noise. frequencies (F,): [Hz]. For white noise
    each value follows χ² with two degrees of freedom.
    """
    instants, row = np.unique(times, return_inverse=True)
    together = np.zeros((len(instants), *residuals.shape[1:]))
    np.add.at(together, row, residuals)
    together, count = together.reshape(len(instants), -1), np.bincount(row)
    saved = np.empty((len(frequencies), together.shape[1]))
    for some in np.array_split(
        np.arange(len(frequencies)), -(-len(frequencies) // _CHUNK)
    ):  # all at once need too much memory
        angle = 2.0 * np.pi * np.outer(frequencies[some], instants - instants[0])
        waves = np.array([np.cos(angle), np.sin(angle)])
        parts = waves @ together
        G = np.einsum("aft,bft,t->fab", waves, waves, count)
        saved[some] = np.einsum("afm,fab,bfm->fm", parts, np.linalg.inv(G), parts)
    return saved.reshape(len(frequencies), *residuals.shape[1:])
