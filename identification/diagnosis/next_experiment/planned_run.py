"""A planned run: what a fitted model predicts for it, and how probable data of that run are under the model.

The posterior of the present data is the prior of the unknowns in the planned run.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cradle_env.parameter_name import ParameterName
from cradle_env.release import Release
from identification.experiment.experiment import Experiment
from identification.experiment.run import ReleaseInfo, Run
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError, raises_impossible
from identification.inference.least_squares import bounds, difference_jacobian, refine
from identification.inference.likelihood import Likelihood
from identification.inference.start_points import point_at

#: Readings per second of a planned run; a faster recording counts as one of this rate with less noise, for the swing is
#: slower.
_RATE = 60.0
#: Standard deviation of the release where the experiment states none: angle [rad] and instant [s].
_UNSTATED = (0.01, 0.01)
#: Departure from the linearized run that counts as predictable, in χ²: a share of the χ² of the linear change itself.
_NONLINEAR_SHARE = 0.05
#: The same where that change is small: two standard deviations of one reading cannot be seen.
_NONLINEAR_CHI2 = 4.0
#: Draws from the posterior of the old data by which this is judged.
_DRAWS = 4
#: Evaluations of a refit to simulated data.
_EVALUATIONS = 20


@dataclass(frozen=True)
class Setting:
    """The setting of a run: bobs on the cradle, number of bobs lifted, release angle [rad], and δ."""

    bobs: int
    lifted: int
    angle: float
    delta: float | tuple[float, ...]


@dataclass(frozen=True)
class Instrument:
    """How runs are recorded: as the first run was.

    noise: of a reading [rad or m]. rate: readings per second. angle_sd [rad], time_sd [s]: uncertainty of the release.
    inflation: of χ² by correlated residuals.
    """

    quantity: str
    unit: str
    scale: float
    rest: str
    start: str
    noise: float
    rate: float
    angle_sd: float
    time_sd: float
    inflation: float

    @classmethod
    def of(cls, fitted: FitResult) -> Instrument:
        """The instrument of a fitted experiment."""
        run, release = fitted.experiment.runs[0], fitted.experiment.runs[0].release
        rate = 1.0 / float(np.median(np.diff(run.times)))
        known = _UNSTATED if release is None else (release.angle_sd, release.time_sd)
        return cls(
            run.quantity,
            run.unit,
            run.scale,
            run.rest,
            "unstretched" if release is None else release.release.start,
            float(fitted.likelihood.noise_model.scales[0]),
            rate,
            *known,
            fitted.effective_sample.inflation,
        )

    def run(self, setting: Setting, duration: float) -> Run:
        """The planned run; its readings are zeros."""
        rate = min(self.rate, _RATE)
        times = np.arange(round(duration * rate) + 1) / rate
        release = Release(angle=setting.angle, bobs=setting.lifted, start=self.start)
        return Run(
            times,
            np.zeros((len(times), setting.bobs)),
            quantity=self.quantity,
            unit=self.unit,
            scale=self.scale,
            rest=self.rest,
            release=ReleaseInfo(release, self.angle_sd, self.time_sd),
            delta=setting.delta,
            noise=self.noise * math.sqrt(self.inflation * rate / self.rate),
        )


class PlannedRun(Likelihood):
    """The likelihood of a planned run, with the posterior of the present data as the prior of its unknowns.

    precision (D, D): C⁻¹ of the prior in sampled coordinates. prior_mean (D,): the mode of the fit.
    """

    @raises_impossible
    def __init__(self, fitted: FitResult, run: Run):
        old = fitted.experiment
        cradle = fitted.cradle.replace(bobs=run.readings.shape[1], delta=run.delta)
        new = Experiment(cradle, (run,), old.infer, old.unknown_effect_parameters)
        super().__init__(new, None, fitted.likelihood.workers)
        own = {name: value for name, value in fitted.values.items() if ParameterName.parse(name).run is None}
        self.prior_mean = point_at(self, {**self.values(self.start()), **own})
        self.precision = self._precision(fitted)
        self._root = np.linalg.cholesky(self.precision).T

    def _precision(self, fitted: FitResult) -> np.ndarray:
        """The posterior's precision for shared unknowns, the prior's for those of the run."""
        # Unknowns of the run without a prior, such as rest positions, are free.
        precision = np.diag([1e-9 if math.isnan(u.sd) else u.sd**-2 for u in self.unknowns])
        shared = [i for i, u in enumerate(self.unknowns) if not u.nuisance]
        theirs = [fitted.likelihood.names.index(self.names[i]) for i in shared]
        precision[np.ix_(shared, shared)] = np.linalg.inv(fitted.covariance[np.ix_(theirs, theirs)])
        return 0.5 * (precision + precision.T)

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Model less readings over the noise, then the departure from the prior in its standard deviations."""
        run = self.experiment.runs[0]
        data = (self.predict(point, 0, self.rows[0])[0] - run.readings) / self.noise_model.scales[0]
        return np.concatenate([data.ravel(), self._root @ (point - self.prior_mean)])

    @functools.cached_property
    def linearized(self) -> LinearizedRun:
        """The run to first order about the mode of the present data."""
        readings = self.experiment.runs[0].readings
        base = self.residuals(self.prior_mean)
        S = difference_jacobian(self, self.prior_mean, base)[: readings.size]
        model = base[: readings.size] + readings.ravel() / self.noise_model.scales[0]
        times = np.repeat(self.experiment.runs[0].times, readings.shape[1])
        return LinearizedRun(self.names, times, model, S, self.precision)

    def with_readings(self, readings: np.ndarray) -> PlannedRun:
        """The same run with readings (T, N) [rad or m]."""
        _ = self.linearized  # it does not depend on the readings, so the copy shares it
        new = copy.copy(self)
        run = dataclasses.replace(self.experiment.runs[0], readings=readings)
        new.experiment = dataclasses.replace(self.experiment, runs=(run,))
        return new

    def draw_readings(self, rng: np.random.Generator) -> tuple[np.ndarray, dict[str, float]]:
        """(simulated readings (T, N), the unknowns that gave them): unknowns from the prior, and noise."""
        ahead = np.linalg.solve(self._root, rng.standard_normal(len(self.prior_mean)))
        point = np.clip(self.prior_mean + ahead, *bounds(self))
        seen = self.predict(point, 0, self.rows[0])[0]
        return seen + self.noise_model.scales[0] * rng.standard_normal(seen.shape), self.values(point)

    def find_mode(self, near: Mapping[str, float] | None = None) -> tuple[np.ndarray, float]:
        """(point (D,), χ²) of a refit to the readings and the prior.

        It starts at the best of three points: the mode of the present data, the linear solution, and values `near`.
        """
        S, precision = self.linearized.S, self.precision
        ahead = self.experiment.runs[0].readings.ravel() / self.noise_model.scales[0] - self.linearized.model
        starts = [self.prior_mean, self.prior_mean + np.linalg.solve(S.T @ S + precision, S.T @ ahead)]
        if near is not None:
            starts.append(point_at(self, {**self.values(self.prior_mean), **near}))
        return refine(self, min(starts, key=self._cost), _EVALUATIONS)

    def _cost(self, point: np.ndarray) -> float:
        try:
            return float(np.sum(self.residuals(np.clip(point, *bounds(self))) ** 2))
        except ImpossibleModelError:
            return math.inf

    def log_evidence(self, near: Mapping[str, float]) -> float:
        """ln p(readings | model, present data) by the Laplace approximation, up to a constant of all models."""
        point, cost = self.find_mode(near)
        J = difference_jacobian(self, point, self.residuals(point))
        learned = np.linalg.slogdet(J.T @ J)[1] - np.linalg.slogdet(self.precision)[1]
        return -0.5 * float(cost + learned)

    @functools.cached_property
    def predictable_duration(self) -> float:
        """Time [s] for which the run stays linear over the prior's uncertainty.

        Beyond it the motion is chaotic, as with open gaps that close now and then, and no refit converges.
        """
        rng, view, times = np.random.default_rng(0), self.linearized, self.experiment.runs[0].times
        kept = np.ones(len(times), bool)
        for _ in range(_DRAWS):
            step = np.linalg.solve(self._root, rng.standard_normal(len(self.prior_mean)))
            point = np.clip(self.prior_mean + step, *bounds(self))
            along = view.S @ (point - self.prior_mean)
            seen = self.predict(point, 0, self.rows[0])[0].ravel() / self.noise_model.scales[0]
            departure, distance = (
                np.cumsum(np.sum(part.reshape(len(times), -1) ** 2, axis=1))
                for part in (seen - view.model - along, along)
            )
            kept &= departure <= _NONLINEAR_SHARE * distance + _NONLINEAR_CHI2
        lost = np.flatnonzero(~kept)
        return float(times[lost[0]]) if len(lost) else math.inf


@dataclass(frozen=True, eq=False)
class LinearizedRun:
    """A model of a planned run, to first order.

    names (D,): of the unknowns. times (R,): of the readings [s]. model (R,): over the noise. S (R, D): its derivatives.
    precision (D, D): C⁻¹ of the prior.
    """

    names: Sequence[str]
    times: np.ndarray
    model: np.ndarray
    S: np.ndarray
    precision: np.ndarray

    def until(self, duration: float) -> LinearizedRun:
        """The run up to a duration [s]."""
        rows = self.times <= duration
        return LinearizedRun(self.names, self.times[rows], self.model[rows], self.S[rows], self.precision)


def expected_log_bayes(true: PlannedRun, other: PlannedRun, duration: float) -> float:
    """Expected log Bayes factor of the true model over another for a run of this duration [s], to first order.

    Both models predict normal readings, N(f, Σ = 1 + S C Sᵀ). The expectation is the Kullback–Leibler divergence
    ½ (tr Σ'⁻¹Σ − R + dᵀ Σ'⁻¹ d + ln det Σ'/det Σ) between them, d the difference of their means (Box and Hill 1967,
    Technometrics 9, 57).
    """
    own, view = true.linearized.until(duration), other.linearized.until(duration)
    d = own.model - view.model
    G, G_, X = own.S.T @ own.S, view.S.T @ view.S, view.S.T @ own.S
    after, C = np.linalg.inv(G_ + view.precision), np.linalg.inv(own.precision)
    along = view.S.T @ d
    distance = d @ d - along @ after @ along
    spread = np.sum(C * G) - np.sum(after * G_) - np.trace(after @ X @ C @ X.T)
    learned = [np.linalg.slogdet(g + p)[1] - np.linalg.slogdet(p)[1]
               for g, p in ((G_, view.precision), (G, own.precision))]  # fmt: skip
    return 0.5 * float(distance + spread + learned[0] - learned[1])
