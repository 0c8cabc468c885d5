"""The next experiment: of a small grid, the one that should tell the models in question apart.

For a model 0 with unknowns' covariance C and a rival whose readings differ by d, once the rival's own unknowns have
absorbed what they can (to first order, S their derivatives, scaled by the noise and joined by the old data as a prior
C⁻¹), the expected log Bayes factor is ½ |d − S x|² + ½ xᵀ C⁻¹ x at its least over x.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cradle_env.cradle import Release
from cradle_env.simulation import SimulationError
from identification.diagnose.fitted import Fitted
from identification.experiment import Experiment
from identification.fit import jacobian
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
    """Plans, the most telling first, and which sets of effects they tell apart."""

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
    """Ranks the grid by how well it tells the worst pair of the models apart; None if there are fewer than two."""
    if len(models) < 2:
        return None
    noise = float(models[0].likelihood.noise[0])
    if models[0].experiment.runs[0].quantity == "x":
        noise /= models[0].cradle.length
    plans = []
    for bobs in sorted({1, models[0].cradle.bobs}):
        for delta in _DELTAS if bobs > 1 else (0.0,):
            for angle in _ANGLES:
                for duration in _DURATIONS:
                    release = Release(angle=angle)
                    try:
                        views = [_view(m, release, delta, bobs, duration, noise) for m in models]
                    except (SimulationError, ValueError):
                        continue
                    worst = min(_telling(views[0], other) for other in views[1:])
                    plans.append(Plan(release, delta, bobs, duration, worst))
    plans.sort(key=lambda plan: -plan.expected_log_bayes)
    return Advice(tuple(plans), tuple(separates)) if plans else None


def _view(
    fitted: Fitted, release: Release, delta: float, bobs: int, duration: float, noise: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(residuals over the noise (R,), their derivatives (R, D), C⁻¹ (D, D)) of a model in a new experiment."""
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
    return residuals[: len(times) * bobs], J[: len(times) * bobs], precision + np.diag([
        0.0 if np.isnan(u.sd) else u.sd**-2 for u in likelihood.unknowns
    ])  # fmt: skip


def _telling(one: tuple[np.ndarray, ...], other: tuple[np.ndarray, ...]) -> float:
    """Expected log Bayes factor between two views, of one as the truth over the other."""
    difference = one[0] - other[0]
    S, precision = other[1], other[2]
    x = np.linalg.solve(S.T @ S + precision, S.T @ difference)
    return float(0.5 * np.sum((difference - S @ x) ** 2) + 0.5 * x @ precision @ x)
