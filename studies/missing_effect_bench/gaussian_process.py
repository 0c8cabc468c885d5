"""The rival that names nothing: a Gaussian process as the discrepancy of the model as stated.

The model is fitted, and what it leaves of each bob is a Gaussian process over time beside white noise (Kennedy &
O'Hagan, J. R. Stat. Soc. B 63, 425, 2001). Its marginal likelihood says how probable a discrepancy is, not which.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping

import numpy as np

from identification.experiment.experiment import Experiment
from identification.inference.fit_result import FitResult
from studies.missing_effect_bench.candidates import NOTHING, Names
from studies.missing_effect_bench.regression import fit_as_stated

#: Readings of a bob that the process sees at least, evenly over the run, where there are as many: its cost is cubic.
READINGS = 600
#: Hyperparameters of the process: the size and the length in time.
PARAMETERS = 2
#: Lengths in time to choose from at first, in periods, and the bounds.
LENGTHS, SHORTEST, LONGEST = (0.15, 1.0, 10.0), 0.05, 50.0


def weigh(experiment: Experiment, prior: Mapping[Names, float]) -> dict[Names, float]:
    """Nothing against something, which is spread as before the data."""
    fitted = fit_as_stated(experiment)
    evidence = sum(log_bayes_factor(fitted, bob) for bob in range(fitted.cradle.bobs))
    odds = math.exp(min(evidence, 700.0))
    weights = {names: p * (1.0 if names == NOTHING else odds) for names, p in prior.items()}
    total = sum(weights.values())
    return {names: weight / total for names, weight in weights.items()}


def log_bayes_factor(fitted: FitResult, bob: int) -> float:
    """Log evidence of the process over white noise, at the best hyperparameters, less what Schwarz's criterion asks."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    own = np.flatnonzero(fitted.readings.bob == bob)
    own = own[:: max(1, len(own) // READINGS)]
    time, left = fitted.readings.time[own, None] / fitted.cradle.period, fitted.residuals[own]
    noise = fitted.noise_inflation
    best = -math.inf
    for length in LENGTHS:
        kernel = ConstantKernel(0.1, (1e-5, 1e3)) * RBF(length, (SHORTEST, LONGEST))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # a hyperparameter at its bound is an answer
            process = GaussianProcessRegressor(kernel, alpha=noise).fit(time, left)
        best = max(best, float(process.log_marginal_likelihood_value_))
    white = -0.5 * float(np.sum(left**2) / noise + len(left) * math.log(2.0 * math.pi * noise))
    return best - white - 0.5 * PARAMETERS * math.log(len(left))
