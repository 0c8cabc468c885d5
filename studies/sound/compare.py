"""The same simulated run, calibrated by its sound and by its angles.

Importance sampling about the mode samples the posterior that `cradle calibrate` samples, in a tenth of the time.
"""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import multivariate_t

from cradle_env import Cradle, Release, simulate
from identification import Experiment
from identification.apparatus import measure_sound
from identification.experiment.experiment import ReleaseInfo
from identification.inference.laplace import regularize_covariance
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import find_mode
from studies.sound.made import SECONDS, Case, write

#: Background of the recordings, peak of the loudest click over its RMS [dB], samples a second.
_BACKGROUND, _SNR, _RATE = "music", 30.0, 44100
#: Readings a second, and their noise [rad].
_ANGLES, _NOISE = 60.0, 1e-3
#: Draws of importance sampling, and degrees of freedom and width of the t distribution that they come from.
_DRAWS, _DEGREES, _WIDTH = 2000, 5, 1.1
#: Rounds that adapt this distribution, and draws of each. Weights are taken to the first of these powers at which
#: this many draws are effective.
_ROUNDS, _ADAPTING, _ENOUGH = 6, 400, 100.0
_POWERS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.1, 0.05, 0.02)


def compare(number: int) -> dict[str, Any]:
    """Truth, and what sound and angles say of k_f, kappa, b and λ."""
    rng = np.random.default_rng([9, number])
    cradle = Cradle(bobs=2, b=float(rng.uniform(1e-3, 3e-3)), k_f=18000.0 * float(np.exp(rng.normal(0.0, 0.15))),
                    kappa=196.6 * float(np.exp(rng.normal(0.0, 0.05))))  # fmt: skip
    release, late = Release(angle=float(rng.uniform(0.15, 0.28))), float(rng.uniform(0.5, 2.0))
    run = simulate(cradle, release, duration=SECONDS, sample_rate=240.0)
    truth = {"k_f": cradle.k_f, "kappa": cradle.kappa, "b": cradle.b, "lambda": float(run.newton_exponent())}
    instants = run.impacts["time"] + late
    kept = instants < SECONDS - 0.1
    case = Case(1000 + number, cradle, release, late, _BACKGROUND, _SNR, _RATE, "ogg", instants[kept],
                run.impacts["speed"][kept])  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        clicks = measure_sound(write(case, Path(folder))).clicks
    start = Cradle(bobs=2)
    readings = np.full((len(clicks.instants), 2), np.nan)
    readings[:, 0] = clicks.instants
    by_sound = Experiment.from_arrays(
        start, clicks.instants, readings, ReleaseInfo(release), quantity="impacts", unit="s",
        noise=float(np.median(clicks.instants_sd)),
    )  # fmt: skip
    every = slice(None, None, round(240.0 / _ANGLES))
    theta = run.theta[every] + _NOISE * rng.standard_normal(run.theta[every].shape)
    by_angles = Experiment.from_arrays(start, run.t[every], theta, ReleaseInfo(release), noise=_NOISE)
    return {"truth": truth, "sound": _found(by_sound), "angles": _found(by_angles)}


def _found(experiment: Experiment) -> dict[str, Any]:
    """Median, standard deviation and 95 % interval of each value; effective sample size."""
    likelihood, mode = find_mode(Likelihood(experiment, workers=1), seed=1)
    likelihood = likelihood.with_noise(
        dataclasses.replace(likelihood.noise_model, inflations=tuple(likelihood.noise_inflations(mode.point)))
    )
    centre, covariance = mode.point, mode.covariance
    unit: Any = _WIDTH**2 * np.eye(len(centre))  # SciPy's stubs take a number alone
    t = multivariate_t(np.zeros(len(centre)), unit, df=_DEGREES, seed=1)

    def draw(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points, their log density over that by which they are drawn, and λ."""
        steps = t.rvs(count)
        points = centre + steps @ np.linalg.cholesky(covariance).T
        density, rates = likelihood.log_densities(points).T
        return points, density - t.logpdf(steps), rates

    for _ in range(_ROUNDS):
        points, ratio, _ = draw(_ADAPTING)
        power = next((power for power in _POWERS if _effective(_weights(ratio, power)) > _ENOUGH), _POWERS[-1])
        if power == 1.0:
            break
        tempered = _weights(ratio, power)
        centre = tempered @ points
        covariance = regularize_covariance(np.cov(points.T, aweights=tempered))
    points, ratio, rates = draw(_DRAWS)
    weights = _weights(ratio, 1.0)
    rates = np.where(weights > 0.0, rates, 0.0)
    columns = {u.name: u.value(z) for u, z in zip(likelihood.unknowns, points.T, strict=True)}
    found: dict[str, Any] = {}
    for name, values in {**columns, "lambda": rates}.items():
        order = np.argsort(values)
        low, median, high = np.interp((0.025, 0.5, 0.975), np.cumsum(weights[order]), values[order])
        mean = weights @ values
        sd = float(np.sqrt(weights @ (values - mean) ** 2))
        found[name.partition("@")[0]] = {"median": float(median), "sd": sd, "ci95": [float(low), float(high)]}
    return {**found, "effective": _effective(weights), "inflation": likelihood.noise_model.inflations[0]}


def _weights(ratio: np.ndarray, power: float) -> np.ndarray:
    weights = np.exp(power * (ratio - ratio.max()))
    return weights / weights.sum()


def _effective(weights: np.ndarray) -> float:
    """Kish's effective sample size."""
    return float(1.0 / np.sum(weights**2))
