"""How large a gap a right model may leave on readings that were held out."""

from __future__ import annotations

import math

import numpy as np

from cradle_env.simulation import SimulationError, in_threads
from identification.diagnose.decide import ALPHA, coloured
from identification.diagnose.fitted import Fitted
from identification.fit import bounds, training_rows
from identification.likelihood import Likelihood

#: Points drawn of what the fit leaves open, and draws of noise for each.
_POINTS, _NOISES = 64, 200


def allowed_gap(fitted: Fitted) -> float:
    """The held-out gap that a right model passes by chance once in a hundred times: by noise, and by what the readings
    that were fitted leave open of the unknowns. nan where nothing was held out."""
    held = Likelihood(fitted.experiment, training_rows(fitted.experiment)[1], fitted.likelihood.workers)
    R = held.parts()[-1].stop
    if R == 0:
        return math.nan
    at_mode, inflation = held.residuals(fitted.point)[:R], coloured(fitted)[0]
    rng = np.random.default_rng(0)
    drawn = rng.multivariate_normal(np.zeros(len(fitted.point)), inflation * fitted.covariance, _POINTS)

    def departure(step: np.ndarray) -> float:
        """In χ²; where no run is possible, as the truth cannot be, nan."""
        try:
            return float(np.sum((held.residuals(np.clip(fitted.point + step, *bounds(held)))[:R] - at_mode) ** 2))
        except (SimulationError, ValueError):
            return math.nan

    departures = np.array(in_threads(departure, list(drawn), held.workers))
    departures = departures[np.isfinite(departures)][:, None]
    # χ² of noise beside a departure d: R + d², with variance 2 R c + 4 d² c.
    scatter = np.sqrt(inflation * (2.0 * R + 4.0 * departures)) * rng.standard_normal((len(departures), _NOISES))
    return math.sqrt(float(np.quantile(R + departures + scatter, 1.0 - ALPHA)) / R)
