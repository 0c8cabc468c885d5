"""Calibration: find the mode, sample around it, and measure the gap."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cradle_env.errors import check_range
from identification.experiment.experiment import Experiment
from identification.experiment.train_test import training_rows
from identification.experiment.unit_check import check_unit
from identification.inference.checkpoint import Chains, Checkpoint
from identification.inference.contributions import measure_contributions
from identification.inference.gap import Gap
from identification.inference.laplace import laplace_approximation
from identification.inference.likelihood import Likelihood
from identification.inference.linear_algebra import on_one_thread
from identification.inference.mcmc import sample
from identification.inference.mode_search import refit
from identification.inference.noise_model import rms, typical
from identification.inference.nonsmooth import jacobian_at_mode
from identification.inference.normal_approximation import normal_approximation
from identification.inference.posterior import Posterior
from identification.inference.predictive_check import predictive_bound
from identification.inference.search_options import DEFAULT, SearchOptions
from identification.progress import Progress
from identification.storage.lock import locks_output

#: Fewest steps of a chain for which R̂ and the effective sample size are computed.
_LEAST_STEPS = 50


@locks_output
@on_one_thread
def calibrate(
    experiment: Experiment,
    parameters: Sequence[str] | None = None,
    *,
    out: str | Path | None = None,
    steps: int | None = None,
    max_steps: int = 20000,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress | None = None,
    search: SearchOptions = DEFAULT,
) -> Posterior:
    """Sample the posterior of an experiment's unknowns by MCMC.

    Parameters
    ----------
    experiment : Experiment
        Measured runs of one cradle, and what is known about them.
    parameters : sequence of str, optional
        Which of k_f, kappa and b to infer; the others keep their stated values. All that matter if omitted.
    out : path, optional
        Folder for chain.h5, from which the same call resumes.
    steps : int, optional
        Total number of steps of each walker. Sampling stops on convergence if omitted.
    max_steps : int
        Largest number of steps of each walker.
    seed : int
        Seed of all random numbers.
    workers : int, optional
        Threads; all cores if omitted.
    progress : callable, optional
        Called with (stage, fraction done, text).
    search : SearchOptions
        Options of the search, of the sampler and of the predictive check.

    Returns
    -------
    Posterior
        Unconverged if `posterior.convergence` says so.

    Raises
    ------
    ValueError
        If the experiment cannot be calibrated, or its readings cannot be in their stated unit.

    Examples
    --------
    >>> import numpy as np
    >>> from cradle_env import Cradle, Release, simulate
    >>> from identification import Experiment
    >>> cradle, release = Cradle(bobs=1, model="pendulum", b=0.01), Release(angle=0.2)
    >>> run = simulate(cradle, release, duration=10.0, sample_rate=30.0)
    >>> readings = run.theta + 1e-3 * np.random.default_rng(0).standard_normal(run.theta.shape)
    >>> posterior = calibrate(Experiment.from_arrays(cradle, run.t, readings, release, noise=1e-3), steps=300)
    >>> posterior.convergence.steps, bool(abs(posterior.samples("b").mean() - 0.01) < 1e-3)
    (300, True)
    """
    report = progress or (lambda *_: None)
    max_steps = _check_steps("max_steps", max_steps)
    steps = None if steps is None else _check_steps("steps", steps)
    likelihood = Likelihood(experiment, workers=workers, parameters=parameters)
    if not likelihood.unknowns:
        raise ValueError("there is nothing to infer; name a parameter, or give a prior to an uncertain one")
    for run in experiment.runs:
        check_unit(run, experiment.cradle_of(run))
    with TemporaryDirectory() as scratch:
        folder = Path(scratch if out is None else out)
        folder.mkdir(parents=True, exist_ok=True)
        checkpoint = Checkpoint(folder / "chain.h5", likelihood, seed, search)
        if not checkpoint.exists():
            known, mode = normal_approximation(likelihood, seed, report, search)
            checkpoint.begin(mode, known.noise_model.impact_order, known.noise_model.inflations)
        likelihood = likelihood.with_noise(checkpoint.noise_model())
        verdict = sample(likelihood, checkpoint, steps=steps, max_steps=max_steps, progress=report, options=search)
        chains = checkpoint.read()
    kept = Chains(*(array[:, verdict.burn_in :] for array in dataclasses.astuple(chains)))
    rates = kept.newton_exponent if likelihood.gives_lambda else None
    posterior = Posterior(likelihood, kept.chain, kept.log_density, rates, verdict, Gap(np.nan, np.nan), seed)
    report("gap", 0.0, "fit to the training part")
    gap = measure_gap(posterior, search)
    contributions = measure_contributions(likelihood, posterior.best(), seed, report, search)
    return dataclasses.replace(posterior, gap=gap, contributions=contributions)


def _check_steps(name: str, steps: float) -> int:
    return int(check_range(name, steps, "", _LEAST_STEPS, remedy="with fewer, convergence cannot be assessed"))


def measure_gap(posterior: Posterior, options: SearchOptions = DEFAULT) -> Gap:
    """Refit the training part, and compute the gap on it and on the held-out part.

    Parameters
    ----------
    posterior : Posterior
        The refit starts from its best sample.
    options : SearchOptions
        Options of the refit and of the predictive check.

    Returns
    -------
    Gap
    """
    full = posterior.likelihood
    train, held_out = training_rows(full.experiment)
    likelihood = Likelihood(full.experiment, train, full.workers, full.parameters)
    likelihood, point = refit(likelihood, posterior.best(), options)
    unseen = Likelihood(full.experiment, held_out, full.workers, full.parameters)
    # An estimate from few frames may contain part of the motion; the noise is at most the RMS residual of the fit.
    weights = list(unseen.noise_model.scales)
    for k, run in enumerate(full.experiment.runs):
        if run.noise is None and train[k].any():
            residual = likelihood.predict(point, k, train[k])[0] - run.readings[train[k]]
            weights[k] = min(weights[k], typical(residual, run))
    unseen = unseen.with_noise(unseen.noise_model.with_weights(weights))
    scaled: dict[str, list[np.ndarray]] = {"train": [], "held_out": []}
    raw: dict[str, list[np.ndarray]] = {"train": [], "held_out": []}
    length, quantity = full.experiment.cradle.length, full.experiment.runs[0].quantity
    for k, run in enumerate(full.experiment.runs):
        in_first = 1.0 if run.quantity == quantity else length if quantity == "x" else 1.0 / length
        for part, rows in (("train", train[k]), ("held_out", held_out[k])):
            if rows.any():
                residual = likelihood.predict(point, k, rows)[0] - run.readings[rows]
                if run.of_impacts == (quantity == "impacts"):
                    raw[part].append(residual * in_first)
                if run.of_impacts:  # false clicks are no misfit: each click counts with the typical residual
                    residual = np.where(np.isfinite(residual), typical(residual, run), np.nan)
                scaled[part].append((residual / weights[k]).ravel())
    by_bob = {part: _rms_by_bob(rows) for part, rows in raw.items() if rows}
    ratio = {part: rms(np.concatenate(rows)) if rows else np.nan for part, rows in scaled.items()}
    residuals = likelihood.residuals(point)
    J = jacobian_at_mode(likelihood, point, residuals)
    inflation = max(full.noise_model.inflations)
    covariance = inflation * laplace_approximation(likelihood, point, J).covariance
    allowed = predictive_bound(likelihood, unseen, point, covariance, J, inflation, options)
    return Gap(ratio["train"], ratio["held_out"], by_bob, allowed)


def _rms_by_bob(residuals: list[np.ndarray]) -> np.ndarray:
    """RMS of all bobs together, then of each; (1 + N,)."""
    together = np.concatenate(residuals)
    return np.array([rms(together), *(rms(column) for column in together.T)])
