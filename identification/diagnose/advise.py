"""The next experiment: of a small grid, the one that should tell the models in question apart.

For a model 0 with unknowns' covariance C and a rival whose readings differ by d, once the rival's own unknowns have
absorbed what they can (to first order, S their derivatives, scaled by the noise and joined by the old data as a prior
C⁻¹), the expected log Bayes factor is ½ |d − S x|² + ½ xᵀ C⁻¹ x at its least over x.

Where no models are in question, it is λ that should become certain: ½ ln(gᵀ C g / gᵀ (C⁻¹ + SᵀS)⁻¹ g), g = dλ/dx.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cradle_env.cradle import Release
from cradle_env.simulation import SimulationError, simulate
from identification.diagnose.fitted import Fitted
from identification.experiment import Experiment
from identification.fit import bounds, jacobian
from identification.likelihood import Likelihood
from identification.runs import ReleaseInfo, Run

#: The grid: release angles [rad], δ, bobs in the cradle (None: as many as now), duration [s], readings per second.
_ANGLES, _DELTAS, _DURATIONS, _RATE = (0.1, 0.228, 0.4), (0.0, 0.002), (30.0, 90.0), 30.0


@dataclass(frozen=True)
class Plan:
    """An experiment that could be done, and what it should tell."""

    release: Release
    delta: float
    bobs: int
    duration: float
    expected_log_bayes: float


@dataclass(frozen=True)
class Advice:
    """Plans, the most telling first, and which sets of effects they tell apart; none: what they tell is of λ."""

    plans: tuple[Plan, ...]
    separates: tuple[tuple[str, ...], ...]

    def content(self) -> dict[str, Any]:
        """As in diagnosis.json."""
        best = self.plans[0]
        return {
            "release": {"bobs": best.release.bobs, "angle": best.release.angle},
            "delta": best.delta,
            "bobs": best.bobs,
            "duration": best.duration,
            "separates": [list(names) for names in self.separates],
            "expected_log_bayes": best.expected_log_bayes,
        }


def advise(models: Sequence[Fitted], separates: Sequence[tuple[str, ...]]) -> Advice | None:
    """Ranks the grid by how well it tells the first of the models from the rest, the least of them."""
    return _ranked(models, lambda views: min(_telling(views[0], other) for other in views[1:]), separates)


def advise_on_lambda(fitted: Fitted) -> Advice | None:
    """Ranks the grid by what it tells of λ, that of the first run's setting; None where there is no λ."""
    gradient = _lambda_gradient(fitted)
    if gradient is None:
        return None

    def gain(views: list[View]) -> float:
        view = views[0]
        g = np.array([gradient.get(name, 0.0) for name in view.names])
        after = np.linalg.inv(view.S.T @ view.S + view.precision)
        return float(0.5 * np.log((g @ np.linalg.inv(view.precision) @ g) / (g @ after @ g)))

    return _ranked([fitted], gain, ())


def _ranked(
    models: Sequence[Fitted], worth: Callable[[list[View]], float], separates: Sequence[tuple[str, ...]]
) -> Advice | None:
    noise = float(models[0].likelihood.noise[0])
    if models[0].experiment.runs[0].quantity == "x":
        noise /= models[0].cradle.length
    plans = []
    for bobs in sorted({1, models[0].cradle.bobs}):
        for delta, angle, duration in itertools.product(_DELTAS if bobs > 1 else (0.0,), _ANGLES, _DURATIONS):
            release = Release(angle=angle)
            try:
                views = [_view(model, release, delta, bobs, duration, noise) for model in models]
            except (SimulationError, ValueError):
                continue
            plans.append(Plan(release, delta, bobs, duration, worth(views)))
    plans.sort(key=lambda plan: -plan.expected_log_bayes)
    return Advice(tuple(plans), tuple(separates)) if plans else None


def _lambda_gradient(fitted: Fitted) -> dict[str, float] | None:
    """dλ/dx by the unknowns of the cradle, over one standard deviation to either side; None where λ is not defined."""
    likelihood = fitted.likelihood
    run, deviations = fitted.experiment.runs[0], np.sqrt(np.diag(fitted.covariance()))
    if run.release is None or fitted.cradle.bobs == 1:
        return None
    releases = run.release.release

    def rate(point: np.ndarray) -> float:
        return simulate(likelihood.cradle(likelihood.values(point)), releases, ledger=False).newton_exponent()

    found = {}
    for i, u in enumerate(likelihood.unknowns):
        if not u.nuisance:
            step = np.zeros_like(fitted.point)
            step[i] = deviations[i]
            low, high = (np.clip(fitted.point + side * step, *bounds(likelihood)) for side in (-1.0, 1.0))
            try:
                slope = (rate(high) - rate(low)) / (high[i] - low[i])
            except (SimulationError, ValueError):
                return None
            found[u.name] = slope
    return found if found and all(map(np.isfinite, found.values())) and any(found.values()) else None


@dataclass(frozen=True, eq=False)
class View:
    """A model in a new experiment: names of its unknowns (D,), model over the noise (R,), derivatives S (R, D), and
    what is known of the unknowns beforehand, C⁻¹ (D, D)."""

    names: list[str]
    model: np.ndarray
    S: np.ndarray
    precision: np.ndarray


def _view(fitted: Fitted, release: Release, delta: float, bobs: int, duration: float, noise: float) -> View:
    times = np.arange(int(duration * _RATE) + 1) / _RATE
    run = Run(
        times, np.zeros((len(times), bobs)), release=ReleaseInfo(release, angle_sd=1e-3), noise=noise, delta=delta
    )
    old = fitted.experiment
    cradle = fitted.cradle.replace(bobs=bobs, delta=delta)
    new = Experiment(cradle, (run,), old.infer, old.unknown_effect_parameters, digest="plan")
    likelihood = Likelihood(new, None, fitted.likelihood.workers)
    point = likelihood.start()
    residuals = likelihood.residuals(point)
    J = jacobian(likelihood, point, residuals)
    precision = np.diag(np.full(len(point), 1e-9))
    names = fitted.likelihood.names
    shared = [i for i, name in enumerate(likelihood.names) if name in names and "@" not in name]
    theirs = [names.index(likelihood.names[i]) for i in shared]
    covariance = fitted.covariance()[np.ix_(theirs, theirs)]
    precision[np.ix_(shared, shared)] += np.linalg.inv(covariance)
    count = len(times) * bobs
    priors = np.diag([0.0 if np.isnan(u.sd) else u.sd**-2 for u in likelihood.unknowns])
    return View(likelihood.names, residuals[:count], J[:count], precision + priors)


def _telling(one: View, other: View) -> float:
    """Expected log Bayes factor between two views, of one as the truth over the other."""
    difference, S = one.model - other.model, other.S
    x = np.linalg.solve(S.T @ S + other.precision, S.T @ difference)
    return float(0.5 * np.sum((difference - S @ x) ** 2) + 0.5 * x @ other.precision @ x)
