"""A smooth density of posterior samples, for pictures."""

from __future__ import annotations

import numpy as np

#: Samples that count as independent, at most: about as many effective samples as a converged chain has. More would make
#: the kernel narrower than the autocorrelation of the chain allows, and the curve ragged.
_INDEPENDENT_SAMPLES = 400
#: Samples that are summed, at most: more change nothing that a picture shows.
_SUMMED_SAMPLES = 20000


def kernel_density(samples: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Estimate the probability density of samples by a Gaussian kernel of Scott's bandwidth.

    The kernel smooths across bounds; use it for quantities that have none near their samples.

    Parameters
    ----------
    samples : ndarray of shape (K,)
        Samples with a spread above 0, possibly autocorrelated.
    grid : ndarray of shape (G,)
        Points in the unit of the samples.

    Returns
    -------
    ndarray of shape (G,)
        Density, in the inverse unit of the samples.
    """
    from scipy.stats import gaussian_kde

    bandwidth = min(len(samples), _INDEPENDENT_SAMPLES) ** -0.2  # Scott's factor in one dimension
    return gaussian_kde(samples[:: max(1, len(samples) // _SUMMED_SAMPLES)], bandwidth)(grid)
