"""The noise model of readings: white noise, its correlation in time, tracking noise, and impact-order noise."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.experiment.experiment import Experiment
from identification.experiment.noise import noise_of
from identification.experiment.run import Run
from identification.inference.click_likelihood import NOISE, SEARCH_WEIGHT
from identification.inference.low_rank_noise import LowRankNoise
from identification.inference.tracking_noise import TrackingNoise

#: While the noise of a run is unknown, a search divides residuals by at least this part of the readings' RMS.
_UNKNOWN_NOISE = 0.02


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """The noise of each run of an experiment.

    Parameters
    ----------
    scales : tuple of float
        Standard deviation of one reading of each run [rad or m]: as stated, or estimated from the readings.
    weights : tuple of float
        Least squares divides the residuals of each run by this [rad or m]: the scale, or a larger first guess while
        the noise is unknown.
    inflations : tuple of float
        Inflation of χ² of each run by noise that is correlated in time, (1 + ρ)/(1 − ρ) with the correlation ρ of
        successive readings; see `chi2_inflation`.
    tracking : tuple of TrackingNoise
        Of each run; empty where none is stated, and until a fit says where the bobs pass.
    impact_order : tuple of LowRankNoise
        Of each run, over the other kinds of noise; empty if the order of impacts is certain.
    """

    scales: tuple[float, ...]
    weights: tuple[float, ...]
    inflations: tuple[float, ...]
    tracking: tuple[TrackingNoise, ...] = ()
    impact_order: tuple[LowRankNoise, ...] = ()

    @classmethod
    def of(cls, experiment: Experiment) -> NoiseModel:
        """Make the model of white noise, as stated or estimated for each run."""
        scales = tuple(_scale(run) for run in experiment.runs)
        weights = (_weight(run, scale) for run, scale in zip(experiment.runs, scales, strict=True))
        return cls(scales, tuple(weights), (1.0,) * len(scales))

    def with_weights(self, weights: Sequence[float]) -> NoiseModel:
        """The same with other weights in least squares."""
        return dataclasses.replace(self, weights=tuple(weights))

    def with_inflations(self, inflations: Sequence[float]) -> NoiseModel:
        """The same with other inflations."""
        return dataclasses.replace(self, inflations=tuple(inflations))

    def with_tracking(self, tracking: Sequence[TrackingNoise]) -> NoiseModel:
        """The same with other tracking noise."""
        return dataclasses.replace(self, tracking=tuple(tracking))

    def with_impact_order(self, impact_order: Sequence[LowRankNoise]) -> NoiseModel:
        """The same with other impact-order noise."""
        return dataclasses.replace(self, impact_order=tuple(impact_order))

    def whiten(self, residuals: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
        """Divide residuals (R,) or (R, M) over the weights by the other kinds of noise as well; parts: slice of each
        run."""
        if self.tracking:
            residuals = residuals.copy()
            for noise, part in zip(self.tracking, parts, strict=True):
                residuals[part] = noise.whiten(residuals[part])
        return self.whiten_impact_order(residuals, parts)

    def whiten_tracking(self, run: int, residuals: np.ndarray) -> np.ndarray:
        """Divide residuals (R,) or (R, M) of a run by its tracking noise over white noise."""
        return self.tracking[run].whiten(residuals) if self.tracking else residuals

    def whiten_impact_order(self, residuals: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
        """Divide residuals (R,) or (R, M) over all but impact-order noise by this as well; parts: slice of each run."""
        if not self.impact_order:
            return residuals
        residuals = residuals.copy()
        for noise, part, weight in zip(self.impact_order, parts, self.weights, strict=True):
            residuals[part] = noise.whiten(residuals[part], weight)
        return residuals

    def log_density(self, run: int, residuals: np.ndarray, scale: float) -> float:
        """Log density of the residuals (R,) [rad or m] of a run whose white noise is `scale`, up to a constant."""
        residuals = self.whiten_tracking(run, residuals / scale)
        volume = len(residuals) * math.log(scale)
        if self.tracking:
            volume += self.tracking[run].log_volume()
        if self.impact_order:
            residuals = self.impact_order[run].whiten(residuals, scale)
            volume += self.impact_order[run].log_volume(scale)
        return -(0.5 * float(np.sum(residuals**2)) + volume) / self.inflations[run]


def _scale(run: Run) -> float:
    """Standard deviation of one reading, as stated or estimated; of clicks a first guess, for they lie on no curve."""
    if run.of_impacts:
        return NOISE if run.noise is None else run.noise
    return noise_of(run)


def _weight(run: Run, scale: float) -> float:
    """What least squares divides the residuals of a run by, until the best fit is known."""
    if run.of_impacts:
        return max(scale, SEARCH_WEIGHT)
    return scale if run.noise is not None else max(scale, _UNKNOWN_NOISE * rms(run.readings[run.fitted]))


def typical(residuals: np.ndarray, run: Run) -> float:
    """RMS of the residuals of a run; of clicks their median size as that of a normal distribution, which false ones
    change little."""
    if not run.of_impacts:
        return rms(residuals)
    finite = np.abs(residuals[np.isfinite(residuals)])
    return float(np.median(finite)) / 0.6745 if len(finite) else math.nan


def rms(values: np.ndarray) -> float:
    """Root mean square of the finite values; nan if there are none."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if len(finite) else math.nan
