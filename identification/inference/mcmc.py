"""MCMC by emcee in separate ensembles: proposals, their adaptation, and when to stop.

Sources: Foreman-Mackey et al., PASP 125, 306 (2013); ter Braak & Vrugt, Stat. Comput. 18, 435 (2008), for the
differential-evolution and snooker moves.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import emcee
import numpy as np

from identification.inference.checkpoint import ENSEMBLES, Checkpoint, walker_count
from identification.inference.convergence import Convergence, assess_convergence
from identification.inference.laplace import Mode
from identification.inference.likelihood import Likelihood
from identification.inference.search_options import DEFAULT, SearchOptions
from identification.progress import Progress

#: Time between checkpoints [s], about: a kill loses as much.
_CHECKPOINT_SECONDS = 8.0
#: Steps between the first verdicts. Later ones are a tenth of the chain apart.
_VERDICT_INTERVAL = 20
#: Steps of the first stretch, whose speed sets the length of the next one.
_FIRST_STRETCH = 4
#: Autocorrelation times beyond those wanted that the progress report expects: τ grows while chains are short.
_EXTRA_TIMES = 4.0
#: Draws of walkers at most until as many points as walkers are possible.
_START_DRAWS = 1000


class IndependenceMove(emcee.moves.MHMove):
    """An independence Metropolis-Hastings move: proposes points about the mode, whatever the walker's own position.

    The proposal is a multivariate t with the mode's covariance. Where the posterior is nearly Gaussian, almost every
    proposal is accepted and τ falls to a few steps; elsewhere the other moves carry on. The Hastings ratio keeps the
    balance exact. Source: Tierney, Ann. Stat. 22, 1701 (1994).
    """

    #: Degrees of freedom of the t: its tails must be heavier than those of the posterior.
    _FREEDOM = 5.0
    #: Width of the t over that of the mode.
    _WIDTH = 1.1

    def __init__(self, mode: Mode):
        self.point, self.root = mode.point, np.linalg.cholesky(mode.covariance) * self._WIDTH
        super().__init__(self._propose)

    def _propose(self, coordinates: np.ndarray, random) -> tuple[np.ndarray, np.ndarray]:
        W, D = coordinates.shape
        heavy = np.sqrt(self._FREEDOM / random.chisquare(self._FREEDOM, W))
        proposed = self.point + (random.standard_normal((W, D)) * heavy[:, None]) @ self.root.T
        return proposed, self._log_density(coordinates) - self._log_density(proposed)

    def _log_density(self, points: np.ndarray) -> np.ndarray:
        distance = np.sum(np.linalg.solve(self.root, (points - self.point).T) ** 2, axis=0)
        return -0.5 * (self._FREEDOM + len(self.point)) * np.log1p(distance / self._FREEDOM)


class Sampler(emcee.EnsembleSampler):
    """emcee's sampler for a function of all walkers at once.

    emcee's own wrapper prints a traceback for whatever it catches; this one lets Ctrl-C pass without.
    """

    def __init__(self, likelihood: Likelihood, walkers: int, **settings: Any) -> None:
        super().__init__(walkers, len(likelihood.unknowns), likelihood.log_densities, **settings)
        self.likelihood = likelihood

    def compute_log_prob(self, coords: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Log densities and λ of points (W, D), each (W,)."""
        densities = self.likelihood.log_densities(coords)
        return densities[:, 0], densities[:, 1]


def sample(
    likelihood: Likelihood,
    checkpoint: Checkpoint,
    *,
    steps: int | None,
    max_steps: int,
    progress: Progress,
    options: SearchOptions = DEFAULT,
) -> Convergence:
    """Sample until converged, or exactly to `steps` in total, at most to `max_steps`; resumes where it stopped.

    The chains are on disk after every stretch. Random numbers depend on the seed and the step alone, and a chain ends
    only at one of `verdict_steps`, so that a resumed chain equals the uninterrupted one, on any machine.
    """
    goal = max_steps if steps is None else steps
    stretch, done, began, first = _FIRST_STRETCH, checkpoint.steps(), time.monotonic(), checkpoint.steps()
    while True:
        following = next(step for step in verdict_steps() if step >= done)
        if done >= goal or (steps is None and done == following):
            verdict = assess_convergence(checkpoint.read(), options)
            if done >= goal or verdict.converged:
                return verdict
            following = next(step for step in verdict_steps() if step > done)
        if done in options.adaptation_steps:
            checkpoint.adapt(done)
        adaptations = (step for step in options.adaptation_steps if step > done)
        ahead = [goal, *([following] if steps is None else []), *adaptations]
        stretch = min(stretch, *(step - done for step in ahead))
        start = time.monotonic()
        _advance(likelihood, checkpoint, done, stretch, options)
        done += stretch
        took = time.monotonic() - start
        stretch = max(1, min(4 * stretch, round(stretch * _CHECKPOINT_SECONDS / max(took, 1e-3))))
        verdict = assess_convergence(checkpoint.read(), options)
        rate = (done - first) / max(time.monotonic() - began, 1e-9)
        simulations = rate * ENSEMBLES * walker_count(likelihood)
        wanted = goal if steps is not None else _expect_steps(verdict, done, goal, options)
        _report(progress, verdict, done, wanted, rate, simulations, steps is not None)


def verdict_steps() -> Iterator[int]:
    """The steps after which convergence is assessed: every 20, later every tenth part more."""
    step = _VERDICT_INTERVAL
    while True:
        yield step
        step += _VERDICT_INTERVAL * max(1, step // (10 * _VERDICT_INTERVAL))


def _expect_steps(verdict: Convergence, done: int, goal: int, options: SearchOptions) -> int:
    """The steps that convergence will take by the present autocorrelation time; the goal while that is unknown."""
    if not math.isfinite(verdict.tau_max):
        return goal
    times = options.min_autocorrelation_times + _EXTRA_TIMES
    expected = min(goal, math.ceil(times * verdict.tau_max))
    if verdict.ess_min > 0:
        expected = max(expected, min(goal, math.ceil(done * options.min_ess / verdict.ess_min)))
    return expected


def _report(
    progress: Progress, verdict: Convergence, done: int, wanted: int, rate: float, simulations: float, is_exact: bool
) -> None:
    """Report steps done and wanted, their rate [1/s] and the time left; is_exact: the steps wanted were asked for."""
    is_known = is_exact or math.isfinite(verdict.tau_max)
    left = f", about {max(wanted - done, 0) / rate:.0f} s left" if is_known else ""
    quality = f"R̂ {verdict.rhat_max:.3f}, ESS {verdict.ess_min:.0f}"
    text = f"step {done} of about {max(wanted, done)}, {simulations:.0f} simulations/s, {quality}{left}"
    progress("sample", min(1.0, done / max(wanted, done, 1)), text)


def _advance(likelihood: Likelihood, checkpoint: Checkpoint, done: int, count: int, options: SearchOptions) -> None:
    """Take `count` steps of every ensemble on a copy of the file, which then replaces it."""
    mode, W = checkpoint.mode(done), walker_count(likelihood)
    with checkpoint.backends() as backends:
        for k, backend in enumerate(backends):
            kinds = IndependenceMove(mode), emcee.moves.DEMove(), emcee.moves.DESnookerMove()
            moves = list(zip(kinds, options.move_weights, strict=True))
            sampler = Sampler(likelihood, W, moves=moves, backend=backend)
            if done == 0:
                begin = _draw_start(likelihood, mode, W, np.random.default_rng([checkpoint.seed, k]), options)
            else:
                last = backend.get_last_sample()
                begin = emcee.State(last.coords, log_prob=last.log_prob, blobs=last.blobs)
            steps = sampler.sample(begin, iterations=count, skip_initial_state_check=done > 0)
            for step in range(done, done + count):
                sampler.random_state = np.random.RandomState([checkpoint.seed, k, step]).get_state()
                next(steps)
            steps.close()


def _draw_start(
    likelihood: Likelihood, mode: Mode, walkers: int, rng: np.random.Generator, options: SearchOptions
) -> emcee.State:
    """Possible points about the mode, drawn wider than the posterior. ValueError if there are too few."""
    root = np.linalg.cholesky(mode.covariance) * options.overdispersion
    points: list[np.ndarray] = []
    for _ in range(_START_DRAWS):
        drawn = mode.point + rng.standard_normal((walkers, len(mode.point))) @ root.T
        density = likelihood.log_densities(drawn)[:, 0]
        points.extend(drawn[np.isfinite(density)])
        if len(points) >= walkers:
            return emcee.State(np.array(points[:walkers]))
    raise ValueError("no possible point near the best fit; widen the priors in [infer]")
