"""emcee in separate ensembles, over the batch of simulations; checkpoints that survive a kill; when to stop."""

from __future__ import annotations

import io
import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import emcee
import h5py
import numpy as np

from cradle_env import hdf5_files
from identification.inference.likelihood import Jumps, Likelihood
from identification.inference.mode_search import Mode, Progress, well_conditioned
from identification.inference.posterior import Convergence
from identification.storage.files import ExperimentError, write
from identification.storage.provenance import program
from identification.storage.schema import check

ENSEMBLES = 2
_REMEDY = "it is not a chain that can be resumed; remove it, or choose another --out"
#: What a chain must reach before it is called converged.
RHAT, ESS, TAUS = 1.01, 400.0, 50.0
#: Seconds between checkpoints, about: what a kill can lose.
_CHECKPOINT = 8.0
# Steps after which the proposals are adapted to the chains; samples before the last of them are burn-in, for a chain
# must not adapt to itself. There is no verdict before the first.
_ADAPTATIONS = (40, 240)
#: The steps between the first verdicts.
_JUDGED = 20
#: The walkers start this many times as wide as the mode: from outside in.
_OVERDISPERSION = 1.5


@dataclass(frozen=True)
class Chains:
    """Sampled so far: chain (E, S, W, D), log_density (E, S, W), newton_exponent (E, S, W)."""

    chain: np.ndarray
    log_density: np.ndarray
    newton_exponent: np.ndarray


class NearMode(emcee.moves.MHMove):
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


class Checkpoint:
    """The chains on disk: chain.h5, in emcee's HDF format, one group per ensemble.

    A stretch of sampling works on a copy in memory that then takes the file's place, so that a kill or a full disk
    leaves the last whole one.
    """

    def __init__(self, path: Path, likelihood: Likelihood, seed: int):
        self.path, self.likelihood, self.seed = path, likelihood, seed

    def exists(self) -> bool:
        """Whether there are chains of this very inference to go on with; ExperimentError if of another."""
        if not self.path.exists():
            return False
        known = self._checked()
        if known["inputs"] != self.likelihood.experiment.digest or known["names"] != self.likelihood.names:
            raise ExperimentError(
                f"{self.path}: holds chains of other data or unknowns; choose another --out, or remove the file"
            )
        if known["seed"] != self.seed:
            raise ExperimentError(
                f"{self.path}: holds chains of seed {known['seed']}, not {self.seed}; give that one, choose another "
                "--out, or remove the file"
            )
        if known.get("program") != program(self.likelihood.experiment.cradle.composition):
            raise ExperimentError(
                f"{self.path}: holds chains by another version of the program, or of an effect from outside it;"
                " go on with that one, choose another --out, or remove the file"
            )
        return True

    def _checked(self) -> dict[str, Any]:
        """What the file says of itself; ExperimentError, naming the field, if it is not whole."""
        try:
            with hdf5_files.opened(self.path) as file:
                known = hdf5_files.attributes(file)
                check(known, "chain", self.path, _REMEDY)
                # Those of another experiment have other shapes, and are refused as such.
                if known["names"] == self.likelihood.names and known["inputs"] == self.likelihood.experiment.digest:
                    self._check_arrays(file, len(known["inflations"]))
        except hdf5_files.UnreadableError as problem:
            raise ExperimentError(f"{problem}; {_REMEDY}") from None
        return known

    def _check_arrays(self, file: Any, runs: int) -> None:
        D, W = len(self.likelihood.unknowns), walkers_for(self.likelihood)
        modes, jumps = hdf5_files.group(file, "modes"), hdf5_files.group(file, "jumps")
        if "0" not in modes or not all(name.isdigit() for name in modes):
            raise hdf5_files.UnreadableError(f"{self.path}: modes must be numbered by steps, from 0 on")
        for name in modes:
            mode = hdf5_files.group(modes, name)
            for key, shape in (("point", (D,)), ("covariance", (D, D)), ("cost", ())):
                hdf5_files.numbers(mode, key, shape)
        if len(jumps) not in (0, runs):
            raise hdf5_files.UnreadableError(f"{self.path}: jumps are of {len(jumps)} runs of {runs}")
        for k in range(len(jumps)):
            of_run = hdf5_files.group(jumps, str(k + 1))
            run, rows = self.likelihood.experiment.runs[k], self.likelihood.rows[k]
            readings = int(np.count_nonzero(~np.isnan(run.readings[rows])))
            directions = hdf5_files.numbers(of_run, "directions", (readings, None))
            hdf5_files.numbers(of_run, "sizes", (directions.shape[1],))
        for k in range(ENSEMBLES):
            name = f"ensemble_{k + 1}"
            if name not in file:
                continue
            ensemble = hdf5_files.group(file, name)
            known = hdf5_files.attributes(ensemble)
            check(known, "chain-ensemble", f"{self.path}: {name}", _REMEDY)
            if known["iteration"]:
                if known.get("has_blobs") is not True:
                    raise hdf5_files.UnreadableError(f"{self.path}: {name}.has_blobs is not true: λ is missing")
                steps = len(hdf5_files.numbers(ensemble, "chain", (None, W, D)))
                hdf5_files.numbers(ensemble, "log_prob", (steps, W))
                hdf5_files.numbers(ensemble, "blobs", (steps, W))
                if known["iteration"] > steps:
                    raise hdf5_files.UnreadableError(f"{self.path}: {name} holds {steps} steps of {known['iteration']}")

    def begin(self, mode: Mode, jumps: Sequence[Jumps], inflations: Sequence[float]) -> None:
        """A file without steps, with the mode from which sampling starts, how the readings of each run jump, and how
        many of them count for one."""
        with self._changed(new=True) as image, _open(image, "w") as file:
            file.attrs["inputs"] = self.likelihood.experiment.digest
            file.attrs["names"] = self.likelihood.names
            file.attrs["program"] = program(self.likelihood.experiment.cradle.composition)
            file.attrs["seed"] = self.seed
            file.attrs["inflations"] = list(inflations)
            _write_mode(file, 0, mode)
            file.create_group("jumps")
            for k, of_run in enumerate(jumps):
                file[f"jumps/{k + 1}/directions"], file[f"jumps/{k + 1}/sizes"] = of_run.directions, of_run.sizes

    @contextmanager
    def _changed(self, new: bool = False) -> Iterator[io.BytesIO]:
        """A copy of the file in memory to work on, which takes its place if all went well."""
        with io.BytesIO(b"" if new else self.path.read_bytes()) as image:
            yield image
            write(self.path, image.getvalue())

    def inflations(self) -> list[float]:
        """How many readings of each run count for one."""
        with _open(self.path, "r") as file:
            return [float(value) for value in file.attrs["inflations"]]

    def jumps(self) -> list[Jumps]:
        """How the readings of each run jump; none where that is not known."""
        with _open(self.path, "r") as file:
            known = file["jumps"]
            parts = [known[f"{k + 1}"] for k in range(len(known))]
            return [Jumps(part["directions"][:], part["sizes"][:]) for part in parts]

    def mode(self, step: int) -> Mode:
        """The mode about which points are proposed at a step: that of the fit, or as last adapted to the chains."""
        with _open(self.path, "r") as file:
            latest = file[f"modes/{max(int(name) for name in file['modes'] if int(name) <= step)}"]
            return Mode(latest["point"][:], latest["covariance"][:], float(latest["cost"][()]))

    def adapt(self, step: int) -> None:
        """Takes the mode from here on from the second half of the chains so far."""
        D = len(self.likelihood.unknowns)
        points = self.read().chain[:, step // 2 : step].reshape(-1, D)
        covariance = well_conditioned(np.cov(points.T).reshape(D, D))
        with self._changed() as image, _open(image, "a") as file:
            if str(step) not in file["modes"]:
                _write_mode(file, step, Mode(points.mean(axis=0), covariance, 0.0))

    @contextmanager
    def backends(self) -> Iterator[list[emcee.backends.HDFBackend]]:
        """emcee's view of each ensemble, on a copy of the file that takes its place if all went well."""
        with self._changed() as image:
            yield [Image(image, f"ensemble_{k + 1}") for k in range(ENSEMBLES)]

    def steps(self) -> int:
        """Steps that all ensembles have taken."""
        return steps_kept(self.path)

    def read(self) -> Chains:
        """All that was sampled by all ensembles."""
        steps = self.steps()
        parts = []
        for k in range(ENSEMBLES):
            backend: Any = emcee.backends.HDFBackend(str(self.path), name=f"ensemble_{k + 1}")
            parts.append((backend.get_chain()[:steps], backend.get_log_prob()[:steps], backend.get_blobs()[:steps]))
        chain, log_density, blobs = (np.array(group) for group in zip(*parts, strict=True))
        return Chains(chain, log_density, blobs.reshape(log_density.shape))


class Image(emcee.backends.HDFBackend):
    """emcee's backend on a file in memory: on a full disk it is one write that fails, and not h5py halfway."""

    def __init__(self, image: io.BytesIO, name: str) -> None:
        super().__init__(image, name=name)

    @property
    def initialized(self) -> bool:
        """Whether the ensemble has taken a step."""
        with self.open() as file:
            return self.name in file


def _open(file: Path | io.BytesIO, mode: str) -> Any:
    """An HDF5 file; untyped, for what stands in it is known to whoever wrote it."""
    return h5py.File(file, mode)


def steps_kept(path: Path) -> int:
    """Steps that all ensembles in a chain.h5 have taken; 0 where there is none."""
    if not path.is_file():
        return 0
    with _open(path, "r") as file:
        groups = [file.get(f"ensemble_{k + 1}") for k in range(ENSEMBLES)]
        return min(int(g.attrs["iteration"]) if g is not None else 0 for g in groups)


def _write_mode(file: Any, step: int, mode: Mode) -> None:
    for name in ("point", "covariance", "cost"):
        file[f"modes/{step}/{name}"] = getattr(mode, name)


def walkers_for(likelihood: Likelihood) -> int:
    """Walkers of one ensemble: more than twice the unknowns, as the moves demand, and even."""
    return max(16, 2 * len(likelihood.unknowns) + 4)


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
    at one of `judged` alone, so that a resumed chain is the uninterrupted one, on a slow machine as on a fast one.
    """
    goal = max_steps if steps is None else steps
    stretch, done, began, first = 4, checkpoint.steps(), time.monotonic(), checkpoint.steps()
    while True:
        following = next(step for step in judged() if step >= done)
        if done >= goal or (steps is None and done == following):
            verdict = convergence(checkpoint.read())
            if done >= goal or verdict.converged:
                return verdict
            following = next(step for step in judged() if step > done)
        if done in _ADAPTATIONS:
            checkpoint.adapt(done)
        ahead = [goal, *([following] if steps is None else []), *(step for step in _ADAPTATIONS if step > done)]
        stretch = min(stretch, *(step - done for step in ahead))
        start = time.monotonic()
        _advance(likelihood, checkpoint, done, stretch)
        done += stretch
        took = time.monotonic() - start
        stretch = max(1, min(4 * stretch, round(stretch * _CHECKPOINT / max(took, 1e-3))))
        _tell(progress, likelihood, checkpoint, goal, steps, done, done - first, time.monotonic() - began)


def judged() -> Iterator[int]:
    """The steps after which it is asked whether chains have converged: every 20, later every tenth part more."""
    step = _JUDGED
    while True:
        yield step
        step += _JUDGED * max(1, step // (10 * _JUDGED))


def _tell(progress, likelihood, checkpoint, goal, steps, done, new, seconds) -> None:
    """Reports how far the chains are, how fast, and how long it will take as far as can be told."""
    rate = new / max(seconds, 1e-9)
    verdict = convergence(checkpoint.read())
    wanted = goal
    if steps is None and math.isfinite(verdict.tau_max):
        wanted = min(goal, math.ceil((TAUS + 4.0) * verdict.tau_max))
        if verdict.ess_min > 0:
            wanted = max(wanted, min(goal, math.ceil(done * ESS / verdict.ess_min)))
    left = (
        f", about {max(wanted - done, 0) / rate:.0f} s left"
        if math.isfinite(verdict.tau_max) or steps is not None
        else ""
    )
    runs = rate * ENSEMBLES * walkers_for(likelihood)
    quality = f"R̂ {verdict.rhat_max:.3f}, ESS {verdict.ess_min:.0f}"
    text = f"step {done} of about {max(wanted, done)}, {runs:.0f} simulations/s, {quality}{left}"
    progress("sample", min(1.0, done / max(wanted, done, 1)), text)


def _advance(likelihood: Likelihood, checkpoint: Checkpoint, done: int, count: int) -> None:
    """Takes `count` steps of every ensemble on a copy of the file, which then takes its place."""
    mode, W = checkpoint.mode(done), walkers_for(likelihood)
    with checkpoint.backends() as backends:
        for k, backend in enumerate(backends):
            moves = [(NearMode(mode), 0.6), (emcee.moves.DEMove(), 0.3), (emcee.moves.DESnookerMove(), 0.1)]
            sampler = Sampler(likelihood, W, moves=moves, backend=backend)
            if done == 0:
                begin = _scattered(likelihood, mode, W, np.random.default_rng([checkpoint.seed, k]))
            else:
                last = backend.get_last_sample()
                begin = emcee.State(last.coords, log_prob=last.log_prob, blobs=last.blobs)
            steps = sampler.sample(begin, iterations=count, skip_initial_state_check=done > 0)
            for step in range(done, done + count):
                sampler.random_state = np.random.RandomState([checkpoint.seed, k, step]).get_state()
                next(steps)
            steps.close()


def _scattered(likelihood: Likelihood, mode: Mode, walkers: int, rng: np.random.Generator) -> emcee.State:
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


def convergence(chains: Chains) -> Convergence:
    """R̂, effective sample size and autocorrelation time of the slowest unknown (λ included), and the verdict.

    Burn-in: the first fifth, at least two autocorrelation times, and all before the last adaptation. R̂ compares the
    halves of the separate ensembles: walkers of one ensemble move by each other's positions, so that they are no
    independent chains. ESS counts all samples over τ.
    """
    E, S, W, _ = chains.chain.shape
    series = np.concatenate([chains.chain, chains.newton_exponent[..., None]], axis=-1)
    varying = np.isfinite(series).all(axis=(0, 1, 2)) & (series.std(axis=(0, 1, 2)) > 0.0)
    series = series[..., varying]
    adapted = max((step for step in _ADAPTATIONS if step < S), default=S)
    if S - adapted <= 4 or series.shape[-1] == 0:
        return Convergence(False, math.nan, 0.0, math.nan, S, S // 2, ("too few steps to tell",))
    tau = _autocorrelation(series[:, min(max(S // 5, adapted), S // 2) :])
    burn = max(adapted, min(S // 2, max(S // 5, math.ceil(2.0 * tau))))
    kept = series[:, burn:]
    tau = _autocorrelation(kept)
    n = kept.shape[1] // 2
    halves = np.concatenate([kept[:, :n], kept[:, -n:]]).reshape(2 * E, -1, kept.shape[-1])
    within, between = halves.var(axis=1, ddof=1).mean(axis=0), halves.mean(axis=1).var(axis=0, ddof=1)
    rhat = float(np.sqrt(1.0 + between / within).max())
    ess = E * W * kept.shape[1] / tau
    reasons = []
    if not rhat < RHAT:
        reasons.append(f"R̂ = {rhat:.4f}, wanted below {RHAT}")
    if not ess >= ESS:
        reasons.append(f"ESS = {ess:.0f}, wanted at least {ESS:.0f}")
    if not kept.shape[1] >= TAUS * tau:
        reasons.append(f"{kept.shape[1]} steps are {kept.shape[1] / tau:.0f} τ, wanted {TAUS:.0f} τ (τ = {tau:.0f})")
    return Convergence(not reasons, rhat, float(ess), float(tau), S, burn, tuple(reasons))


def _autocorrelation(series: np.ndarray) -> float:
    """Integrated autocorrelation time [steps] of the slowest column of (E, S, W, K), at least 1.

    Where a walker has not moved at all it cannot be told, and counts as the whole length.
    """
    slowest = 1.0
    for ensemble in series:
        with np.errstate(invalid="ignore"):
            tau = emcee.autocorr.integrated_time(ensemble, c=5, tol=0, quiet=True)
        stuck = (ensemble.max(axis=0) == ensemble.min(axis=0)).any(axis=0)
        slowest = max(slowest, float(np.where(stuck, len(ensemble), tau).max()))
    return slowest
