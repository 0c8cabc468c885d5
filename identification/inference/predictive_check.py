"""Predictive check: how large a held-out gap a correct model leaves by chance.

Source: Gelman, Meng & Stern, Statistica Sinica 6, 733 (1996), with the posterior in its Laplace approximation.
"""

from __future__ import annotations

import math

import numpy as np

from cradle_env.threads import in_threads
from identification.inference.impact_order_noise import principal_axes
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.least_squares import bounds
from identification.inference.likelihood import Likelihood
from identification.inference.search_options import DEFAULT, SearchOptions

#: A principal axis counts as constrained by the training data if a one-sigma step along it raises χ²/c by at least 0.5,
#: with c the inflation; it is 1 if only the data constrained it.
_CONSTRAINED = 0.5


def predictive_bound(
    training: Likelihood,
    held_out: Likelihood,
    point: np.ndarray,
    covariance: np.ndarray,
    J: np.ndarray,
    inflation: float,
    options: SearchOptions = DEFAULT,
) -> float:
    """The held-out gap that a correct model exceeds with probability `options.predictive_chance`, by default 1 %.

    The bound allows for noise and for the uncertainty of the unknowns. nan if nothing was held out.

    point (D,), covariance (D, D), Jacobian J (R, D): of the fit to the training part. inflation: of χ², for residuals
    that are not white.
    """
    R = held_out.reading_slices()[-1].stop
    if R == 0:
        return math.nan
    at_mode = held_out.residuals(point)[:R]
    rng = np.random.default_rng(0)
    axes, reach = principal_axes(training, covariance)
    # An axis that no reading constrains is as long as its bounds; its far end is no model of this experiment.
    is_open = np.sum((J @ axes) ** 2, axis=0) < _CONSTRAINED * inflation
    normal = rng.standard_normal((options.predictive_points, len(reach)))
    drawn = normal @ (axes * np.where(is_open, reach, 1.0)).T

    def departure(step: np.ndarray) -> float:
        """χ² of the change in predicted readings; nan where no run is possible: the truth is not there."""
        try:
            changed = held_out.residuals(np.clip(point + step, *bounds(held_out)))[:R]
        except ImpossibleModelError:
            return math.nan
        return float(np.sum((changed - at_mode) ** 2))

    departures = np.array(in_threads(departure, list(drawn), held_out.workers))
    departures = departures[np.isfinite(departures)][:, None]
    # χ² of noise beside a departure d: R + d², with variance 2 R c + 4 d² c.
    noise = rng.standard_normal((len(departures), options.predictive_noises))
    scatter = np.sqrt(inflation * (2.0 * R + 4.0 * departures)) * noise
    return math.sqrt(float(np.quantile(R + departures + scatter, 1.0 - options.predictive_chance)) / R)
