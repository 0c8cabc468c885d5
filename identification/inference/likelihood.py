"""The posterior density of an experiment's unknowns: noise about simulated readings, constraints and priors."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.release import InitialState, Release
from cradle_env.simulation import equilibrium, simulate
from cradle_env.synchronization import WINDOW, newton_exponent, sigma
from cradle_env.threads import in_threads
from cradle_env.trajectory import Trajectory
from identification.experiment.experiment import Experiment
from identification.experiment.noise import chi2_inflation, estimate_correlation
from identification.experiment.run import Run
from identification.inference import click_likelihood
from identification.inference.impossible_model import ImpossibleModelError, raises_impossible
from identification.inference.instrument import Instrument
from identification.inference.noise_model import NoiseModel
from identification.inference.tracking_noise import TrackingNoise
from identification.inference.unknowns import (
    CLICK_LAG,
    FALSE_RATE,
    MISSED,
    RELEASE_TIME,
    Unknown,
    model_unknowns,
    name_in_run,
    noise_name,
    run_unknowns,
    sag,
)

#: Sampling of θ_n for σ and λ [1/s].
LAMBDA_RATE = 240.0
#: Tolerance of the inference's simulations, looser than that of `simulate`. Errors stay far below any noise: 1e-7 rad
#: over 10 s, 3e-6 with dry friction, 1e-5 with contacts followed in time, a thousandth of the change by string creep.
TOLERANCE = 5e-12
_LAMBDA_GRID, _NONE = np.arange(int(WINDOW[1] * LAMBDA_RATE) + 1) / LAMBDA_RATE, np.empty(0)


class Likelihood:
    """The posterior density of an experiment: Gaussian noise about the simulated readings, constraints and priors.

    A point is a vector of sampled coordinates, one for each of `unknowns`.

    Parameters
    ----------
    experiment : Experiment
        Measured runs of one cradle.
    rows : list of ndarray of bool, each (T,), optional
        For each run, the readings that count; those that may be fitted if omitted.
    workers : int, optional
        Threads; all cores if omitted.
    parameters : sequence of str, optional
        Which of k_f, kappa and b to infer; all that matter if omitted.

    Raises
    ------
    ValueError
        If one of `parameters` has no effect on this cradle.
    """

    def __init__(
        self,
        experiment: Experiment,
        rows: list[np.ndarray] | None = None,
        workers: int | None = None,
        parameters: Sequence[str] | None = None,
    ):
        self.experiment, self.workers, self.parameters = experiment, workers, parameters
        #: The noise of each run. Its inflations count in the density alone, not in least squares.
        self.noise_model = NoiseModel.of(experiment)
        self.rows = [run.fitted for run in experiment.runs] if rows is None else rows
        self.cradle_unknowns = model_unknowns(experiment, parameters)
        self.unknowns_by_run = [run_unknowns(experiment, k, scale) for k, scale in enumerate(self.noise_model.scales)]
        self.unknowns: tuple[Unknown, ...] = (*self.cradle_unknowns, *(u for run in self.unknowns_by_run for u in run))

    @property
    def names(self) -> list[str]:
        """Names of the unknowns."""
        return [u.name for u in self.unknowns]

    def with_noise(self, noise_model: NoiseModel) -> Likelihood:
        """The same likelihood with another noise model."""
        other = copy.copy(self)
        other.noise_model = noise_model
        return other

    def correlations(self, residuals: np.ndarray) -> list[float]:
        """Correlation ρ of successive readings of each run, from residuals (R,); 0 if the noise is white."""
        correlations = []
        for run, rows, part in zip(self.experiment.runs, self.rows, self.reading_slices(), strict=True):
            by_bob = np.full(run.readings[rows].shape, np.nan)
            seen = ~np.isnan(run.readings[rows])
            by_bob[seen] = residuals[part]
            bobs = zip(by_bob.T, seen.T, strict=True)
            correlations.append(estimate_correlation([(run.times[rows][own], bob[own]) for bob, own in bobs]))
        return correlations

    def noise_inflations(self, point: np.ndarray) -> list[float]:
        """Inflation of χ² of each run by noise that is correlated in time, from the residuals at a point (D,)."""
        return [chi2_inflation(rho) for rho in self.correlations(self.residuals(point))]

    def reading_slices(self) -> list[slice]:
        """Slices of the residuals that belong to each run."""
        ends = np.cumsum([
            np.sum(~np.isnan(run.readings[rows])) for run, rows in zip(self.experiment.runs, self.rows, strict=True)
        ])  # fmt: skip
        return [slice(int(begin), int(end)) for begin, end in zip([0, *ends[:-1]], ends, strict=True)]

    def start(self) -> np.ndarray:
        """The point (D,) from which to search."""
        return np.array([u.coordinate(u.start) for u in self.unknowns])

    def values(self, point: np.ndarray) -> dict[str, float]:
        """Values of the unknowns at a point, by name."""
        return {u.name: float(u.value(z)) for u, z in zip(self.unknowns, point, strict=True)}

    @raises_impossible
    def cradle(self, values: Mapping[str, float], run: Run | None = None) -> Cradle:
        """The cradle with these values, at the δ of a run, the first if omitted."""
        cradle = self.experiment.cradle_of(run or self.experiment.runs[0])
        return cradle.with_values({u.name: values[u.name] for u in self.cradle_unknowns})

    @raises_impossible
    def initial_condition(self, values: Mapping[str, float], index: int) -> tuple[Release | InitialState, float]:
        """Initial condition of run `index`.

        Returns (release or initial state, the time in its file at which the simulation starts [s]).
        """
        run = self.experiment.runs[index]
        if run.state == "release":
            assert run.release is not None
            error = values.get(name_in_run("release_angle_error", index), 0.0)
            late = values.get(name_in_run(RELEASE_TIME if run.of_impacts else "release_time_error", index), 0.0)
            return shift_release_angle(run.release.release, error), late
        bobs = range(1, self.experiment.cradle.bobs + 1)

        def of_bobs(quantity: str) -> np.ndarray | None:
            names = [name_in_run(quantity, index, bob) for bob in bobs]
            return np.array([values[name] for name in names]) if names[0] in values else None

        stretch = of_bobs("stretch")
        cradle = self.cradle(values, run)
        tension_ratio = of_bobs("tension_ratio")
        r = None if stretch is None else hanging_radius(cradle, tension_ratio) + stretch
        theta, theta_dot = of_bobs("theta"), of_bobs("theta_dot")
        assert theta is not None and theta_dot is not None
        return InitialState(theta, theta_dot, r, of_bobs("r_dot"), tension_ratio), run.fit_from

    @raises_impossible
    def predict(self, point: np.ndarray, index: int, rows: np.ndarray, with_lambda: bool = False):
        """Predict the readings of run `index` at a point (D,).

        Returns (readings (T, N) at its times[rows], λ [1/s] of the run or nan). Raises ImpossibleModelError if there is
        no such run. Of impacts, the readings are the predicted instant nearest to each click, nan where none is near.
        """
        values, run = self.values(point), self.experiment.runs[index]
        if run.of_impacts:
            instants, rate = self.clicks(values, index, rows, with_lambda)
            return click_likelihood.as_readings(run.times[rows], instants, run.readings.shape[1]), rate
        cradle = self.cradle(values, run)
        initial, zero = self.initial_condition(values, index)
        grid = _LAMBDA_GRID if with_lambda else _NONE
        readings, theta = self.simulate_readings(cradle, initial, run.times[rows] - zero, values, index, grid)
        return readings, _newton_exponent(cradle, initial, grid, theta) if with_lambda else math.nan

    @raises_impossible
    def clicks(
        self, values: Mapping[str, float], index: int, rows: np.ndarray, with_lambda: bool = False
    ) -> tuple[np.ndarray, float]:
        """Predict the clicks of run `index` up to its last row.

        Returns (instants [s] in order, λ [1/s] or nan). Raises ImpossibleModelError if there is no such run.
        """
        run = self.experiment.runs[index]
        cradle = self.cradle(values, run)
        initial, zero = self.initial_condition(values, index)
        clock, grid = self.instrument(cradle, index).clock, _LAMBDA_GRID if with_lambda else _NONE
        until = (float(run.times[rows][-1]) + click_likelihood.GATE - zero) / clock
        instants, theta = click_likelihood.simulate_clicks(
            cradle, initial, max(until, 0.0), values[name_in_run(CLICK_LAG, index)], grid, TOLERANCE
        )
        rate = _newton_exponent(cradle, initial, grid, theta) if with_lambda else math.nan
        return zero + clock * instants, rate

    @raises_impossible
    def motion(self, values: Mapping[str, float], index: int, times: np.ndarray) -> Trajectory:
        """Simulate the motion in run `index` at times (T,) [s] of its file; earlier times count as the start."""
        cradle = self.cradle(values, self.experiment.runs[index])
        initial, zero = self.initial_condition(values, index)
        true = np.maximum((times - zero) / self.instrument(cradle, index).clock, 0.0)
        return simulate(cradle, initial, times=true, ledger=False, tolerance=TOLERANCE)

    def instrument(self, cradle: Cradle, index: int) -> Instrument:
        """The instrument that turns the motion of the cradle into the readings of run `index`."""
        return Instrument(cradle, self.experiment.runs[index].quantity)

    @raises_impossible
    def simulate_readings(
        self,
        cradle: Cradle,
        initial: Release | InitialState,
        times: np.ndarray,
        values: Mapping[str, float],
        index: int,
        more: np.ndarray = _NONE,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Simulate the readings of run `index`.

        Returns (readings (T, N) of its instrument at times (T,) [s] after the start, θ (M, N) [rad] at the times
        `more` (M,)).
        """
        instrument = self.instrument(cradle, index)
        wanted = np.maximum(instrument.instants(times), 0.0)
        together = np.concatenate([wanted, more])
        order = np.argsort(together, kind="stable")
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        motion = simulate(cradle, initial, times=together[order], ledger=False, tolerance=TOLERANCE)
        theta, r = motion.theta[back], motion.r[back]
        rest = np.array([values.get(name_in_run("rest", index, bob), 0.0) for bob in range(1, cradle.bobs + 1)])
        at_rest = equilibrium(cradle) if instrument.quantity == "x" else None
        readings = instrument.readings(theta[: len(wanted)], r[: len(wanted)], at_rest) + rest
        return readings, theta[len(wanted) :]

    def sigma_of(self, values: Mapping[str, float], index: int) -> float:
        """Standard deviation of the noise of run `index` [rad or m]."""
        return values.get(noise_name(index), self.noise_model.scales[index])

    @property
    def gives_lambda(self) -> bool:
        """Whether λ comes with the density: the first run starts from a release, and there is more than one bob."""
        return self.experiment.runs[0].state == "release" and self.experiment.cradle.bobs > 1

    def log_density(self, point: np.ndarray) -> tuple[float, float]:
        """Compute the log posterior density at a point (D,), up to a constant, and λ [1/s].

        The density is −inf if there is no such run; λ is nan if it is not defined.
        """
        prior = sum(u.log_prior(z) for u, z in zip(self.unknowns, point, strict=True))
        if not math.isfinite(prior):
            return -math.inf, math.nan
        total, rate = prior, math.nan
        values = self.values(point)
        for k, rows in enumerate(self.rows):
            if not rows.any():
                continue
            try:
                density, found = self._log_density_of_run(point, values, k, with_lambda=k == 0 and self.gives_lambda)
            except ImpossibleModelError:
                return -math.inf, math.nan
            total, rate = total + density, found if k == 0 else rate
        try:
            total -= 0.5 * float(np.sum(self.constraint_residuals(values) ** 2))
        except ImpossibleModelError:
            return -math.inf, math.nan
        return (total, rate) if math.isfinite(total) else (-math.inf, math.nan)

    def _log_density_of_run(
        self, point: np.ndarray, values: Mapping[str, float], index: int, with_lambda: bool
    ) -> tuple[float, float]:
        """Compute (log density of the readings of run `index`, λ [1/s] or nan)."""
        run, rows, noise = self.experiment.runs[index], self.rows[index], self.sigma_of(values, index)
        if run.of_impacts:
            instants, rate = self.clicks(values, index, rows, with_lambda)
            missed, false_rate = (values[name_in_run(name, index)] for name in (MISSED, FALSE_RATE))
            density = click_likelihood.log_density(run.times[rows], instants, noise, missed, false_rate)
            return density / self.noise_model.inflations[index], rate
        readings, rate = self.predict(point, index, rows, with_lambda)
        residual = (run.readings[rows] - readings)[~np.isnan(run.readings[rows])]
        return self.noise_model.log_density(index, residual, noise), rate

    def log_densities(self, points: np.ndarray) -> np.ndarray:
        """Compute `log_density` at each of (K, D) points, in threads; shape (K, 2)."""
        return np.array(in_threads(self.log_density, list(points), self.workers))

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Compute the residuals for least squares, (R + P,): readings over their noise, then constraints and priors.

        P: quantities of the constraints, and normal priors. Missing readings are left out. The noise counts as known,
        so an unknown noise has no residual. Raises ImpossibleModelError if a run is impossible.
        """
        parts = []
        for k, (run, rows) in enumerate(zip(self.experiment.runs, self.rows, strict=True)):
            if not rows.any():
                continue
            weight = self.noise_model.weights[k]
            if run.of_impacts:
                instants, _ = self.clicks(self.values(point), k, rows)
                parts.append(click_likelihood.residuals(run.times[rows], instants, weight))
                continue
            seen = ~np.isnan(run.readings[rows])
            parts.append(((self.predict(point, k, rows)[0] - run.readings[rows]) / weight)[seen])
        prior = [
            (u.value(z) - u.mean) / u.sd for u, z in zip(self.unknowns, point, strict=True) if not math.isnan(u.sd)
        ]
        residuals = np.concatenate([*parts, self.constraint_residuals(self.values(point)), np.array(prior)])
        return self.noise_model.whiten(residuals, self.reading_slices())

    @raises_impossible
    def constraint_residuals(self, values: Mapping[str, float]) -> np.ndarray:
        """Residuals of the constraints, each with standard deviation 1; raises ImpossibleModelError."""
        constraints = self.experiment.constraints
        if not constraints:
            return _NONE
        cradle = self.cradle(values)
        return np.concatenate([constraint.residuals(cradle) for constraint in constraints])

    def with_tracking_noise(self, point: np.ndarray) -> Likelihood:
        """The same with the tracking noise of each run that states it, where the bobs pass at a point (D,)."""
        if all(run.tracking is None for run in self.experiment.runs):
            return self
        known = []
        for k, (run, rows) in enumerate(zip(self.experiment.runs, self.rows, strict=True)):
            if run.tracking is None or rows.sum() < 2:
                known.append(TrackingNoise())
                continue
            motion = self.predict(point, k, rows)[0]
            known.append(TrackingNoise.of(run.tracking, run.times[rows], motion, ~np.isnan(run.readings[rows])))
        return self.with_noise(self.noise_model.with_tracking(known))


def _newton_exponent(cradle: Cradle, initial: Release | InitialState, grid: np.ndarray, theta: np.ndarray) -> float:
    assert isinstance(initial, Release)
    end, theta0 = initial.lead(cradle)
    return float(newton_exponent(grid, sigma(grid, theta[:, end], theta0, cradle.period)))


@raises_impossible
def hanging_radius(cradle: Cradle, tension_ratio: np.ndarray | None = None) -> np.ndarray:
    """r of each bob where it hangs alone [m], (N,).

    tension_ratio (N,): tension of its strings over that of new strings at the same stretch. Worn strings stretch more.
    """
    new = equilibrium(cradle.replace(delta=1.0))[1]
    return new if tension_ratio is None else new + sag(cradle) * (1.0 / tension_ratio - 1.0)


def shift_release_angle(release: Release, error: float) -> Release:
    """Increase the magnitude of every angle of a release by `error` [rad]."""
    if error == 0.0:
        return release
    if release.angles is not None:
        shifted = {bob: angle + math.copysign(1.0, angle) * error for bob, angle in release.angles.items()}
        return dataclasses.replace(release, angles=shifted)
    assert release.angle is not None
    return dataclasses.replace(release, angle=release.angle + math.copysign(1.0, release.angle) * error)
