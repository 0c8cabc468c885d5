"""A smooth density of posterior samples, for pictures."""

from __future__ import annotations

import numpy as np

from identification.inference.search_options import DEFAULT

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

    # Scott's factor in one dimension, of as many independent samples as a converged chain has at least: that of all
    # samples would make the kernel narrower than the autocorrelation of the chain allows, and the curve ragged.
    bandwidth = min(len(samples), DEFAULT.min_ess) ** -0.2
    return gaussian_kde(samples[:: max(1, len(samples) // _SUMMED_SAMPLES)], bandwidth)(grid)
