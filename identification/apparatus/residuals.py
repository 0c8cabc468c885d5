"""What residuals say of themselves."""

from __future__ import annotations

import numpy as np


def correlation_of(residual: np.ndarray) -> float:
    """How many successive residuals count for one: 1 + 2 Σ of their correlations, up to where these end; at least 1."""
    centred = residual - residual.mean()
    size = 1 << (2 * len(centred) - 1).bit_length()
    spectrum = np.fft.rfft(centred, size)
    correlations = np.fft.irfft(spectrum * np.conj(spectrum), size)[: len(centred)]
    if correlations[0] <= 0.0:
        return 1.0
    correlations = correlations / correlations[0]
    times = 2.0 * np.cumsum(correlations) - 1.0
    ends = np.flatnonzero(np.arange(len(times)) >= 5.0 * times)  # Sokal's window
    return max(1.0, float(times[ends[0]] if len(ends) else times[-1]))
