"""The Laplace approximation: a mode of the posterior and its covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from identification.inference.least_squares import Misfit
from identification.inference.noise_model import NoiseModel, rms


class MisfitWithNoise(Misfit, Protocol):
    """What has a mode: a likelihood, or one with an unknown held."""

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
    """The mode at a point, with its covariance, from derivatives J of the residuals (R, D); unknown noise goes to the
    RMS of the residuals that are left."""
    residuals, parts = likelihood.residuals(point), likelihood.reading_slices()
    least, weight = float(np.sum(residuals**2)), np.ones(len(residuals))
    point = point.copy()
    for k, part in enumerate(parts):
        name = f"noise@{k + 1}"
        if name in likelihood.names and part.stop > part.start:
            scale = max(rms(residuals[part]), 1e-3)
            weight[part] = 1.0 / scale
            point[likelihood.names.index(name)] = math.log(likelihood.noise_model.weights[k] * scale)
    information = (J * weight[:, None] ** 2).T @ J
    for i, u in enumerate(likelihood.unknowns):
        if u.name.startswith("noise@"):
            part = parts[int(u.name.partition("@")[2]) - 1]
            information[i, i] = 2.0 * (part.stop - part.start)
        # What the data leave open is as wide as its bounds allow.
        open_width = min(u.high - u.low, 10.0 * max(u.search, abs(u.start), 1e-3)) if not u.log else 5.0
        information[i, i] += 1.0 / open_width**2
    return Mode(point, regularize_covariance(np.linalg.inv(information)), least)


def regularize_covariance(covariance: np.ndarray) -> np.ndarray:
    """The covariance (D, D), symmetric and positive: correlations closer to 1 than rounding allows are cut off."""
    sd = np.sqrt(np.maximum(np.abs(np.diag(covariance)), 1e-300))
    correlation = 0.5 * (covariance + covariance.T) / np.outer(sd, sd)
    values, vectors = np.linalg.eigh(correlation)
    return np.outer(sd, sd) * ((vectors * np.maximum(values, 1e-9)) @ vectors.T)
