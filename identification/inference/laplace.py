"""The Laplace approximation: a mode of the posterior and its covariance.

Source: MacKay, Information Theory, Inference, and Learning Algorithms, chapter 27.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from identification.inference.least_squares import Misfit
from identification.inference.noise_model import NoiseModel, rms
from identification.inference.unknowns import noise_name

#: Least RMS of the residuals [sigma] from which an unknown noise is taken: 0 has no logarithm.
_LEAST_SCALE = 1e-3
#: Standard deviation, in the logarithm, of an unknown that the data do not constrain.
_OPEN_LOG_WIDTH = 5.0
#: Standard deviation of any other unknown that the data do not constrain, in the half width of its search box.
_OPEN_WIDTH = 10.0
#: Least eigenvalue of a correlation matrix that a Cholesky decomposition and rounding allow.
_LEAST_EIGENVALUE = 1e-9


class MisfitWithNoise(Misfit, Protocol):
    """A misfit that has a mode: a likelihood, or one with an unknown held."""

    @property
    def noise_model(self) -> NoiseModel:
        """The noise of each run."""
        ...

    @property
    def names(self) -> list[str]:
        """Names of the unknowns, (D,)."""
        ...

    def reading_slices(self) -> list[slice]:
        """Where the residuals of each run lie."""
        ...


@dataclass(frozen=True)
class Mode:
    """A mode of the posterior: point (D,) and covariance (D, D) in sampled coordinates, sum of squared residuals."""

    point: np.ndarray
    covariance: np.ndarray
    cost: float


def laplace_approximation(likelihood: MisfitWithNoise, point: np.ndarray, J: np.ndarray) -> Mode:
    """The mode at a point (D,) with its Laplace covariance, from the Jacobian J (R, D) of the residuals.

    An unknown noise is set to the RMS of the residuals. An unknown that the data do not constrain is as wide as its
    bounds allow.
    """
    residuals, slices = likelihood.residuals(point), likelihood.reading_slices()
    chi2, weight = float(np.sum(residuals**2)), np.ones(len(residuals))
    point = point.copy()
    readings_by_noise = {}
    for k, part in enumerate(slices):
        name = noise_name(k)
        readings_by_noise[name] = part.stop - part.start
        if name in likelihood.names and part.stop > part.start:
            scale = max(rms(residuals[part]), _LEAST_SCALE)
            weight[part] = 1.0 / scale
            point[likelihood.names.index(name)] = math.log(likelihood.noise_model.weights[k] * scale)
    information = (J * weight[:, None] ** 2).T @ J
    for i, u in enumerate(likelihood.unknowns):
        if u.name in readings_by_noise:  # the Fisher information of ln σ
            information[i, i] = 2.0 * readings_by_noise[u.name]
        if not math.isnan(u.width):
            information[i, i] += 1.0 / u.width**2
            continue
        open_width = min(u.high - u.low, _OPEN_WIDTH * max(u.search, abs(u.start), 1e-3))
        information[i, i] += 1.0 / (_OPEN_LOG_WIDTH if u.log else open_width) ** 2
    return Mode(point, regularize_covariance(np.linalg.inv(information)), chi2)


def regularize_covariance(covariance: np.ndarray) -> np.ndarray:
    """The covariance (D, D) made symmetric and positive definite: correlations are kept below what rounding allows."""
    sd = np.sqrt(np.maximum(np.abs(np.diag(covariance)), 1e-300))
    correlation = 0.5 * (covariance + covariance.T) / np.outer(sd, sd)
    values, vectors = np.linalg.eigh(correlation)
    return np.outer(sd, sd) * ((vectors * np.maximum(values, _LEAST_EIGENVALUE)) @ vectors.T)
