"""emcee in separate ensembles, over the batch of simulations: proposals, adaptation, when to stop."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import emcee
import numpy as np

from identification.inference.checkpoint import (
    ENSEMBLES,
    Checkpoint,
    walker_count,
)
from identification.inference.convergence import ADAPTATION_STEPS, MIN_ESS, MIN_TAUS, Convergence, assess_convergence
from identification.inference.laplace import Mode
from identification.inference.likelihood import Likelihood
from identification.progress import Progress

#: Seconds between checkpoints, about: what a kill can lose.
_CHECKPOINT_SECONDS = 8.0
#: The steps between the first verdicts.
_VERDICT_INTERVAL = 20
#: The walkers start this many times as wide as the mode: from outside in.
_OVERDISPERSION = 1.5


class IndependenceMove(emcee.moves.MHMove):
    """Proposes points about the mode whatever the walker's own: a multivariate t with the mode's covariance.

    Where the posterior is nearly Gaussian almost every proposal is taken, and τ falls to a few steps; where it is
    not, the other moves carry on. The correction for the density of the proposal keeps the balance exact.
    """

    _FREEDOM, _WIDTH = 5.0, 1.1

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
    """emcee's sampler for a function of all walkers at once; Ctrl-C in it goes up without the traceback that emcee
    prints of whatever its own wrapper catches."""

    def __init__(self, likelihood: Likelihood, walkers: int, **settings: Any) -> None:
        super().__init__(walkers, len(likelihood.unknowns), likelihood.log_densities, **settings)
        self.likelihood = likelihood

    def compute_log_prob(self, coords: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Log densities and λ of points (W, D), each (W,)."""
        found = self.likelihood.log_densities(coords)
        return found[:, 0], found[:, 1]


def sample(
    likelihood: Likelihood,
    checkpoint: Checkpoint,
    *,
    steps: int | None,
    max_steps: int,
    progress: Progress,
) -> Convergence:
    """Samples until converged, or exactly to `steps` in total, at most to `max_steps`; goes on where it stopped.

    After every stretch the chains are on disk. Random numbers depend on the seed and the step alone, and a chain ends
    at one of `verdict_steps` alone, so that a resumed chain is the uninterrupted one, on any machine.
    """
    goal = max_steps if steps is None else steps
    stretch, done, began, first = 4, checkpoint.steps(), time.monotonic(), checkpoint.steps()
    while True:
        following = next(step for step in verdict_steps() if step >= done)
        if done >= goal or (steps is None and done == following):
            verdict = assess_convergence(checkpoint.read())
            if done >= goal or verdict.converged:
                return verdict
            following = next(step for step in verdict_steps() if step > done)
        if done in ADAPTATION_STEPS:
            checkpoint.adapt(done)
        ahead = [goal, *([following] if steps is None else []), *(step for step in ADAPTATION_STEPS if step > done)]
        stretch = min(stretch, *(step - done for step in ahead))
        start = time.monotonic()
        _advance(likelihood, checkpoint, done, stretch)
        done += stretch
        took = time.monotonic() - start
        stretch = max(1, min(4 * stretch, round(stretch * _CHECKPOINT_SECONDS / max(took, 1e-3))))
        _report(progress, likelihood, checkpoint, goal, steps, done, done - first, time.monotonic() - began)


def verdict_steps() -> Iterator[int]:
    """The steps after which it is asked whether chains have converged: every 20, later every tenth part more."""
    step = _VERDICT_INTERVAL
    while True:
        yield step
        step += _VERDICT_INTERVAL * max(1, step // (10 * _VERDICT_INTERVAL))


def _report(progress, likelihood, checkpoint, goal, steps, done, new, seconds) -> None:
    """Reports how far the chains are, how fast, and how long it will take as far as can be told."""
    rate = new / max(seconds, 1e-9)
    verdict = assess_convergence(checkpoint.read())
    wanted = goal
    if steps is None and math.isfinite(verdict.tau_max):
        wanted = min(goal, math.ceil((MIN_TAUS + 4.0) * verdict.tau_max))
        if verdict.ess_min > 0:
            wanted = max(wanted, min(goal, math.ceil(done * MIN_ESS / verdict.ess_min)))
    left = (
        f", about {max(wanted - done, 0) / rate:.0f} s left"
        if math.isfinite(verdict.tau_max) or steps is not None
        else ""
    )
    runs = rate * ENSEMBLES * walker_count(likelihood)
    quality = f"R̂ {verdict.rhat_max:.3f}, ESS {verdict.ess_min:.0f}"
    text = f"step {done} of about {max(wanted, done)}, {runs:.0f} simulations/s, {quality}{left}"
    progress("sample", min(1.0, done / max(wanted, done, 1)), text)


def _advance(likelihood: Likelihood, checkpoint: Checkpoint, done: int, count: int) -> None:
    """Takes `count` steps of every ensemble on a copy of the file, which then takes its place."""
    mode, W = checkpoint.mode(done), walker_count(likelihood)
    with checkpoint.backends() as backends:
        for k, backend in enumerate(backends):
            moves = [(IndependenceMove(mode), 0.6), (emcee.moves.DEMove(), 0.3), (emcee.moves.DESnookerMove(), 0.1)]
            sampler = Sampler(likelihood, W, moves=moves, backend=backend)
            if done == 0:
                begin = _draw_start(likelihood, mode, W, np.random.default_rng([checkpoint.seed, k]))
            else:
                last = backend.get_last_sample()
                begin = emcee.State(last.coords, log_prob=last.log_prob, blobs=last.blobs)
            steps = sampler.sample(begin, iterations=count, skip_initial_state_check=done > 0)
            for step in range(done, done + count):
                sampler.random_state = np.random.RandomState([checkpoint.seed, k, step]).get_state()
                next(steps)
            steps.close()


def _draw_start(likelihood: Likelihood, mode: Mode, walkers: int, rng: np.random.Generator) -> emcee.State:
    """Possible points drawn about the mode, wider than the posterior."""
    root = np.linalg.cholesky(mode.covariance) * _OVERDISPERSION
    points: list[np.ndarray] = []
    for _ in range(1000):
        drawn = mode.point + rng.standard_normal((walkers, len(mode.point))) @ root.T
        density = likelihood.log_densities(drawn)[:, 0]
        points.extend(drawn[np.isfinite(density)])
        if len(points) >= walkers:
            return emcee.State(np.array(points[:walkers]))
    raise ValueError("no possible point near the best fit; widen the priors in [infer]")
