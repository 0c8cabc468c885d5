"""A model fitted to the training part of an experiment: its residuals, their derivatives, and its uncertainty."""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.effects import LEARNED
from identification.experiment.experiment import Experiment
from identification.experiment.noise import chi2_inflation, estimate_noise, noise_of
from identification.experiment.train_test import training_rows
from identification.inference.impact_order_noise import add_impact_order_noise
from identification.inference.laplace import laplace_approximation
from identification.inference.least_squares import chi2_scale, has_impact_order
from identification.inference.likelihood import Likelihood
from identification.inference.noise_model import rms
from identification.inference.nonsmooth import wide_difference_jacobian, widest_steps
from identification.inference.predictive_check import predictive_bound

#: Squared singular value, over the largest one, below which a direction is not in a basis.
_RANK = 1e-9
#: Longest lag at which residuals are correlated with themselves [readings].
_LONGEST_LAG = 200
#: Correlations below this many standard deviations of those of white noise end the sum over lags.
_NOTABLE = 2.0
#: The variance of residuals counts as more than the noise from this many of its standard deviations on.
_EXCESS = 4.0
#: Least effective sample size: with fewer, every criterion that uses its logarithm would be empty.
_LEAST_SAMPLE = 10.0


def noise_is_estimated(experiment: Experiment) -> tuple[bool, ...]:
    """Of each run, whether `with_known_noise` estimates its noise."""
    return tuple(run.noise is None for run in experiment.runs)


def with_known_noise(experiment: Experiment) -> Experiment:
    """State the noise of each run, by an estimate if needed: an inferred noise would hide a misfit.

    For the same reason errors that repeat count as residuals, not as tracking noise.
    """
    runs = tuple(dataclasses.replace(run, noise=noise_of(run), tracking=None) for run in experiment.runs)
    return dataclasses.replace(experiment, runs=runs)


@dataclass(frozen=True, eq=False)
class ResidualIndex:
    """Run and bob, from 0, and time [s] of each of the R residuals of a fit; each (R,)."""

    run: np.ndarray
    bob: np.ndarray
    time: np.ndarray

    @classmethod
    def of(cls, likelihood: Likelihood) -> ResidualIndex:
        """The index of the residuals of a likelihood, in their order."""
        parts = []
        for k, (run, rows) in enumerate(zip(likelihood.experiment.runs, likelihood.rows, strict=True)):
            row, bob = np.nonzero(~np.isnan(run.readings[rows]))
            parts.append((np.full(len(row), k), bob, run.times[rows][row]))
        return cls(*(np.concatenate(column) for column in zip(*parts, strict=True)))


class EffectiveSample(NamedTuple):
    """Effective sample of correlated residuals; see `estimate_effective_sample`.

    inflation: c, by which Δχ² is divided, at least 1; size: the effective sample size, at least 10.
    """

    inflation: float
    size: float


@dataclass(frozen=True, eq=False)
class FitResult:
    """A likelihood over the training part, and its mode: point (D,) in sampled coordinates."""

    likelihood: Likelihood
    point: np.ndarray

    @property
    def experiment(self) -> Experiment:
        """The experiment that was fitted."""
        return self.likelihood.experiment

    @functools.cached_property
    def cradle(self) -> Cradle:
        """The cradle as fitted, at the δ of the first run."""
        return self.likelihood.cradle(self.values)

    @functools.cached_property
    def values(self) -> dict[str, float]:
        """The unknowns at the mode, by name."""
        return self.likelihood.values(self.point)

    def scale_of(self, name: str) -> float:
        """The change of an unknown's coordinate that changes it by its own size, to first order."""
        unknown = self.likelihood.unknowns[self.likelihood.names.index(name)]
        return 1.0 if unknown.log else self.values[name]

    @property
    def has_learned_law(self) -> bool:
        """Whether the model holds a law learned from data."""
        return any(self.cradle.has(declared.name) for declared in LEARNED)

    @functools.cached_property
    def residuals(self) -> np.ndarray:
        """Model less data over the noise, then the residuals of the priors; (R + P,)."""
        return self.likelihood.residuals(self.point)

    @functools.cached_property
    def readings(self) -> ResidualIndex:
        """Run, bob and time of each residual."""
        return ResidualIndex.of(self.likelihood)

    @property
    def count(self) -> int:
        """R, the number of readings fitted."""
        return len(self.readings.time)

    @property
    def chi2(self) -> float:
        """Sum of squared residuals, those of the priors included."""
        return float(np.sum(self.residuals**2))

    @property
    def chi2_scale(self) -> float:
        """The scale factor of differences in χ²; see `least_squares.chi2_scale`."""
        return chi2_scale(self.chi2, self.count)

    @functools.cached_property
    def jacobian(self) -> np.ndarray:
        """Derivatives of the residuals with respect to the sampled coordinates, (R + P, D), by wide differences."""
        return self._derivatives[0]

    @property
    def widths(self) -> np.ndarray:
        """The steps of these differences, (D,)."""
        return self._derivatives[1]

    @functools.cached_property
    def _derivatives(self) -> tuple[np.ndarray, np.ndarray]:
        widths = widest_steps(self.likelihood)
        return wide_difference_jacobian(self.likelihood, self.point, self.residuals, widths), widths

    @functools.cached_property
    def tangent_basis(self) -> np.ndarray:
        """Orthonormal basis of the residuals that a change of the unknowns can make, (R + P, rank)."""
        return orthonormal_basis(self.jacobian)

    def project(self, vectors: np.ndarray) -> np.ndarray:
        """Project the tangent space out of vectors (R + P,) or (R + P, M): v − Q Qᵀ v, their residual after a refit."""
        return vectors - self.tangent_basis @ (self.tangent_basis.T @ vectors)

    @functools.cached_property
    def effective_sample(self) -> EffectiveSample:
        """Inflation of Δχ² and effective sample size of the residuals of the readings."""
        return estimate_effective_sample(self.residuals[: self.count], self.readings)

    @functools.cached_property
    def correlations(self) -> list[float]:
        """ρ of successive readings of each run, 0 where their noise is white."""
        return self.likelihood.correlations(self.residuals)

    @property
    def noise_inflation(self) -> float:
        """Inflation of χ² by noise that is correlated in time: the mean over readings."""
        counts = np.bincount(self.readings.run, minlength=len(self.correlations))
        return float(np.average([chi2_inflation(rho) for rho in self.correlations], weights=counts))

    def _rows_by_bob(self, run: int) -> list[np.ndarray]:
        """Indices of the residuals of each bob of a run, in order of time."""
        at = self.readings
        here = [np.flatnonzero((at.run == run) & (at.bob == bob)) for bob in range(self.cradle.bobs)]
        return [rows for rows in here if len(rows) > 2]

    @functools.cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of the point, (D, D): Laplace, inflated for correlated residuals; of three bobs or more
        with impact-order noise.

        Impact-order noise is not inflated, since other misfits of the model do not make it larger.
        """
        smooth, inflation = self.laplace_covariance, self.effective_sample.inflation
        if not has_impact_order(self.cradle):
            return inflation * smooth
        return add_impact_order_noise(self.likelihood, self.point, self.jacobian, smooth, inflation)

    @functools.cached_property
    def laplace_covariance(self) -> np.ndarray:
        """Laplace covariance of the point, (D, D), for white noise and smooth readings."""
        return laplace_approximation(self.likelihood, self.point, self.jacobian).covariance

    def gap(self, rows: list[np.ndarray]) -> float:
        """RMS residual over the noise in rows (T,) of each run; nan if there are none."""
        parts = []
        for k, run in enumerate(self.experiment.runs):
            if rows[k].any():
                model = self.likelihood.predict(self.point, k, rows[k])[0]
                parts.append(((model - run.readings[rows[k]]) / self.likelihood.noise_model.scales[k]).ravel())
        return rms(np.concatenate(parts)) if parts else float("nan")

    def held_out_gap(self) -> float:
        """The gap on the held-out part."""
        return self.gap(training_rows(self.experiment)[1])

    @functools.cached_property
    def predictive_bound(self) -> float:
        """The held-out gap that a correct model exceeds in 1 of 100 experiments."""
        held_out = Likelihood(self.experiment, training_rows(self.experiment)[1], self.likelihood.workers)
        inflation = self.effective_sample.inflation
        return predictive_bound(self.likelihood, held_out, self.point, self.covariance, self.jacobian, inflation)

    def training_gap(self) -> float:
        """The gap on the training part."""
        return self.gap(training_rows(self.experiment)[0])

    def replicates(self, count: int, rng: np.random.Generator, estimated: tuple[bool, ...]) -> np.ndarray:
        """Residuals that refits to simulated data of this model would leave, (R + P, count), to first order.

        Each replicate is noise as correlated as that of the readings, with the tangent space projected out. estimated:
        for each run, whether its noise is an estimate; it is then estimated from each replicate as well.
        """
        noise = rng.standard_normal((len(self.residuals), count))
        for k, rho in enumerate(self.correlations):
            for rows in self._rows_by_bob(k) if rho > 0.0 else []:
                spacing = np.diff(self.readings.time[rows])
                kept = rho ** (spacing / np.median(spacing))
                for before, row, share in zip(rows, rows[1:], kept, strict=False):
                    noise[row] = share * noise[before] + math.sqrt(1.0 - share**2) * noise[row]
        for k in np.flatnonzero(estimated):
            run, rows = self.experiment.runs[k], self.likelihood.rows[k]
            if not rows.any():  # the whole run is held out
                continue
            here = np.flatnonzero(self.readings.run == k)
            seen = ~np.isnan(run.readings[rows])
            for column in range(count):
                readings = np.full(seen.shape, np.nan)
                readings[seen] = noise[here, column]
                noise[here, column] /= estimate_noise(dataclasses.replace(
                    run, times=run.times[rows], readings=readings, fit_from=run.times[rows][0], fit_to=None
                ))  # fmt: skip
        return self.project(noise)


def orthonormal_basis(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the span of columns (R, K), (R, rank); the columns may have any units."""
    lengths = np.linalg.norm(columns, axis=0)
    columns = columns[:, lengths > 0.0] / lengths[lengths > 0.0]
    if columns.shape[1] == 0:
        return columns
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    return U[:, s > np.sqrt(_RANK) * s[0]]


def estimate_effective_sample(residuals: np.ndarray, at: ResidualIndex) -> EffectiveSample:
    """Inflation of Δχ² and effective sample size by the autocorrelation of residuals (R,) over the noise.

    The size is R/τ with the integrated autocorrelation time τ; the inflation is τ times the variance of the residuals
    if that significantly exceeds the variance of the noise.

    Source: Sokal, in Functional Integration, NATO ASI B 361, 131 (1997).
    """
    products, total = np.zeros(1), 0.0
    for k in np.unique(at.run):
        for bob in np.unique(at.bob[at.run == k]):
            own = residuals[(at.run == k) & (at.bob == bob)]
            lags = min(len(own) // 4, _LONGEST_LAG)
            own_products = np.array([own[: len(own) - lag] @ own[lag:] for lag in range(lags + 1)])
            size = max(len(products), len(own_products))
            products = np.pad(products, (0, size - len(products))) + np.pad(own_products, (0, size - len(own_products)))
            total += len(own)
    variance = products[0] / total
    correlation = products[1:] / products[0]
    # The sum over lags ends at the first correlation that white noise of this length may have by chance.
    below = np.flatnonzero(correlation < _NOTABLE / math.sqrt(total))
    tau = 1.0 + 2.0 * float(np.sum(correlation[: below[0] if len(below) else None]))
    noise = variance if variance > 1.0 + _EXCESS * math.sqrt(2.0 / total) else 1.0
    return EffectiveSample(max(1.0, noise * tau), max(total / tau, _LEAST_SAMPLE))
