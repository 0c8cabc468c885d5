"""A fitted model in an experiment that could be done: what it predicts, what its unknowns could absorb there, and how
probable it makes data of that experiment, all in the light of the data there are."""

from __future__ import annotations

import copy
import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cradle_env.release import Release
from identification.experiment.experiment import Experiment
from identification.experiment.run import ReleaseInfo, Run
from identification.inference.fit_result import Fitted
from identification.inference.impossible_model import ImpossibleModelError, raises_impossible
from identification.inference.least_squares import bounds, jacobian, refine
from identification.inference.likelihood import Likelihood
from identification.inference.start_points import placed

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
    """A run that could be done: bobs on the cradle, how many of them are lifted, to what angle [rad], and δ."""

    bobs: int
    lifted: int
    angle: float
    delta: float | tuple[float, ...]


@dataclass(frozen=True)
class Instrument:
    """How a run would be recorded: as the first one was. noise [rad or m] of a reading, `rate` of them per second;
    angle_sd [rad], time_sd [s] of the release; inflation: of χ² by residuals that are not white."""

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
    def of(cls, fitted: Fitted) -> Instrument:
        """That of a fitted experiment."""
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
            fitted.coloured[0],
        )

    def run(self, setting: Setting, duration: float) -> Run:
        """The run, without readings."""
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
    """The likelihood of a planned run, with what the fit to the data there are says of its unknowns as their prior.

    precision: C⁻¹ (D, D) of that prior in sampled coordinates; before: its mean (D,), the mode of the fit.
    """

    @raises_impossible
    def __init__(self, fitted: Fitted, run: Run):
        old = fitted.experiment
        cradle = fitted.cradle.replace(bobs=run.readings.shape[1], delta=run.delta)
        new = Experiment(cradle, (run,), old.infer, old.unknown_effect_parameters)
        super().__init__(new, None, fitted.likelihood.workers)
        own = {name: value for name, value in fitted.values.items() if "@" not in name}
        self.prior_mean = placed(self, {**self.values(self.start()), **own})
        self.precision = self._precision(fitted)
        self._root = np.linalg.cholesky(self.precision).T

    def _precision(self, fitted: Fitted) -> np.ndarray:
        """Of the old posterior for what is shared, of its prior for what belongs to the run."""
        # Where no prior says so, rest positions and the like are as good as free.
        precision = np.diag([1e-9 if math.isnan(u.sd) else u.sd**-2 for u in self.unknowns])
        shared = [i for i, u in enumerate(self.unknowns) if not u.nuisance]
        theirs = [fitted.likelihood.names.index(self.names[i]) for i in shared]
        precision[np.ix_(shared, shared)] = np.linalg.inv(fitted.covariance[np.ix_(theirs, theirs)])
        return 0.5 * (precision + precision.T)

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Model less readings over the noise, then what departs from the prior, in its standard deviations."""
        run = self.experiment.runs[0]
        data = (self.predict(point, 0, self.rows[0])[0] - run.readings) / self.noise_model.scales[0]
        return np.concatenate([data.ravel(), self._root @ (point - self.prior_mean)])

    @functools.cached_property
    def linearized(self) -> LinearizedRun:
        """To first order about the mode of the old data."""
        readings = self.experiment.runs[0].readings
        base = self.residuals(self.prior_mean)
        S = jacobian(self, self.prior_mean, base)[: readings.size]
        model = base[: readings.size] + readings.ravel() / self.noise_model.scales[0]
        times = np.repeat(self.experiment.runs[0].times, readings.shape[1])
        return LinearizedRun(self.names, times, model, S, self.precision)

    def with_readings(self, readings: np.ndarray) -> PlannedRun:
        """The same with readings (T, N) [rad or m]; what is known to first order does not depend on them."""
        _ = self.linearized
        new = copy.copy(self)
        run = dataclasses.replace(self.experiment.runs[0], readings=readings)
        new.experiment = dataclasses.replace(self.experiment, runs=(run,))
        return new

    def draw_readings(self, rng: np.random.Generator) -> tuple[np.ndarray, dict[str, float]]:
        """(readings (T, N) that the model may give, the unknowns behind them): as the old data leave these, and
        noise."""
        ahead = np.linalg.solve(self._root, rng.standard_normal(len(self.prior_mean)))
        point = np.clip(self.prior_mean + ahead, *bounds(self))
        seen = self.predict(point, 0, self.rows[0])[0]
        return seen + self.noise_model.scales[0] * rng.standard_normal(seen.shape), self.values(point)

    def find_mode(self, near: Mapping[str, float] | None = None) -> tuple[np.ndarray, float]:
        """(point (D,), χ²) of a refit to the readings and the prior, from the best of the old mode, of what is right to
        first order, and of values near by."""
        S, precision = self.linearized.S, self.precision
        ahead = self.experiment.runs[0].readings.ravel() / self.noise_model.scales[0] - self.linearized.model
        starts = [self.prior_mean, self.prior_mean + np.linalg.solve(S.T @ S + precision, S.T @ ahead)]
        if near is not None:
            starts.append(placed(self, {**self.values(self.prior_mean), **near}))
        return refine(self, min(starts, key=self._cost), _EVALUATIONS)

    def _cost(self, point: np.ndarray) -> float:
        try:
            return float(np.sum(self.residuals(np.clip(point, *bounds(self))) ** 2))
        except ImpossibleModelError:
            return math.inf

    def log_evidence(self, near: Mapping[str, float]) -> float:
        """ln p(readings | model, old data), by Laplace, up to what all models have in common."""
        point, cost = self.find_mode(near)
        J = jacobian(self, point, self.residuals(point))
        learned = np.linalg.slogdet(J.T @ J)[1] - np.linalg.slogdet(self.precision)[1]
        return -0.5 * float(cost + learned)

    @functools.cached_property
    def predictable_duration(self) -> float:
        """For how long [s] the run keeps to first order, over what the old data leave open of the unknowns: beyond, as
        where open gaps make an impact now and then, it is chaos, and no refit finds the way."""
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
    """A model in a planned run, to first order: names of the unknowns (D,), times of the readings (R,), the model
    over the noise (R,), its derivatives S (R, D), and the unknowns' precision beforehand, C⁻¹ (D, D)."""

    names: Sequence[str]
    times: np.ndarray
    model: np.ndarray
    S: np.ndarray
    precision: np.ndarray

    def until(self, duration: float) -> LinearizedRun:
        """The first so many seconds of the run."""
        rows = self.times <= duration
        return LinearizedRun(self.names, self.times[rows], self.model[rows], self.S[rows], self.precision)


def expected_log_bayes(true: PlannedRun, other: PlannedRun, duration: float) -> float:
    """Expected log Bayes factor of the true model over another in the first so many seconds, to first order.

    Both predict normal readings, N(f, 1 + S C Sᵀ); it is the Kullback–Leibler divergence between them,
    ½ (tr Σ'⁻¹Σ − R + dᵀ Σ'⁻¹ d + ln det Σ'/det Σ), d the difference of their means.
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
