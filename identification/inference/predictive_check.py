"""How large a gap a right model may leave on readings that were held out."""

from __future__ import annotations

import math

import numpy as np

from cradle_env.threads import in_threads
from identification.inference.impact_order_noise import principal_axes
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.least_squares import bounds
from identification.inference.likelihood import Likelihood

#: The chance by which a right model may pass what is allowed.
CHANCE = 0.01
#: Points drawn of what the fit leaves open, and draws of noise for each.
_POINTS, _NOISES = 64, 200
#: χ² over the inflation that a standard deviation must cost the readings that were fitted, of which it costs 1 or more
#: where these say all that is known.
_SEEN = 0.5


def predictive_bound(
    training: Likelihood, held: Likelihood, point: np.ndarray, covariance: np.ndarray, J: np.ndarray, inflation: float
) -> float:  # fmt: skip
    """The gap on what was held out that a right model passes by chance once in a hundred times: by noise, and by what
    the readings that were fitted leave open of the unknowns. nan where nothing was held out.

    point (D,), covariance (D, D), derivatives J (R, D): of the fit to the training part; inflation: of χ², of residuals
    that are not white.
    """
    R = held.reading_slices()[-1].stop
    if R == 0:
        return math.nan
    at_mode = held.residuals(point)[:R]
    rng = np.random.default_rng(0)
    axes, reach = principal_axes(training, covariance)
    # What no reading sees is as open as its bounds, and far out no model of this experiment.
    unseen = np.sum((J @ axes) ** 2, axis=0) < _SEEN * inflation
    drawn = rng.standard_normal((_POINTS, len(reach))) @ (axes * np.where(unseen, reach, 1.0)).T

    def departure(step: np.ndarray) -> float:
        """In χ²; where no run is possible, as the truth cannot be, nan."""
        try:
            return float(np.sum((held.residuals(np.clip(point + step, *bounds(held)))[:R] - at_mode) ** 2))
        except ImpossibleModelError:
            return math.nan

    departures = np.array(in_threads(departure, list(drawn), held.workers))
    departures = departures[np.isfinite(departures)][:, None]
    # χ² of noise beside a departure d: R + d², with variance 2 R c + 4 d² c.
    scatter = np.sqrt(inflation * (2.0 * R + 4.0 * departures)) * rng.standard_normal((len(departures), _NOISES))
    return math.sqrt(float(np.quantile(R + departures + scatter, 1.0 - CHANCE)) / R)
