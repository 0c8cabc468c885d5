"""What a calibration gives back: the sampled posterior, its summary, and what follows from it."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.errors import check_range
from cradle_env.release import Release
from cradle_env.simulation import simulate_batch
from cradle_env.synchronization import WINDOW, window_of
from identification.experiment.experiment import Experiment
from identification.experiment.noise import gap_of_noise
from identification.inference.likelihood import STEP_FACTOR, Likelihood, lifted_further
from identification.inference.mode_search import training_rows
from identification.inference.unknowns import SEARCH, Unknown

FORMAT = "cradle-posterior/1"
# Draws over which λ is simulated where it did not come with the likelihood.
_LAMBDA_DRAWS = 400
#: A gap beyond this says that the model does not describe the data, where noise alone hardly passes it.
MISFIT_GAP = 1.15
#: The part of the width in the logarithm next to a bound, and the share of samples there, that cut a posterior off.
_EDGE, _MANY = 0.01, 0.01


@dataclass(frozen=True)
class Gap:
    """RMS residual over the noise: 1 is the floor. Both from a fit to the training part alone.

    train, held_out: over all runs; nan where there are no such readings. rms: in the unit of the first run's
    quantity (rad or m), by "train" or "held_out", all bobs and each: shape (1 + N,). allowed: the held-out gap that a
    right model passes by chance once in a hundred times, with what the training part leaves open; nan: not known.
    """

    train: float
    held_out: float
    rms: Mapping[str, np.ndarray] = field(default_factory=dict)
    allowed: float = math.nan


@dataclass(frozen=True)
class Convergence:
    """Whether the chains may be trusted. tau: autocorrelation time of the slowest unknown [steps]."""

    converged: bool
    rhat_max: float
    ess_min: float
    tau_max: float
    steps: int
    burn_in: int
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True)
class Prediction:
    """σ(t) and λ of a cradle over draws of a posterior: t (T,) [s], sigma (K, T), newton_exponent (K,) [1/s].

    cradle: that of the first draw, with δ as stated or, where it was inferred, at its median over the draws; gaps:
    (K, N − 1) δ of each gap in each draw, with what effects add.
    """

    cradle: Cradle
    release: Release
    t: np.ndarray
    sigma: np.ndarray
    newton_exponent: np.ndarray
    gaps: np.ndarray

    def summary(self) -> dict[str, Any]:
        """Mean, sd, median and intervals of λ, as in a calibration's summary."""
        return {"unit": "1/s", **statistics(self.newton_exponent), "window_s": window_of(self.t)}

    def sigma_bands(self) -> dict[str, np.ndarray]:
        """σ(t): median (T,), ci68 and ci95 (2, T)."""
        q = np.quantile(self.sigma, (0.025, 0.16, 0.5, 0.84, 0.975), axis=0)
        return {"median": q[2], "ci68": q[[1, 3]], "ci95": q[[0, 4]]}


@dataclass(frozen=True)
class Posterior:
    """Samples of the unknowns of an experiment.

    chain: (E, S, W, D) sampled coordinates of E ensembles of W walkers over S steps after burn-in, D as `unknowns`;
    log_density: (E, S, W); newton_exponents: (E, S, W) λ of the first run's δ and release [1/s], nan for one bob, or
    None where it does not come with the likelihood (then computed on draws).
    """

    likelihood: Likelihood
    chain: np.ndarray
    log_density: np.ndarray
    newton_exponents: np.ndarray | None
    convergence: Convergence
    gap: Gap
    seed: int = 0

    @property
    def experiment(self) -> Experiment:
        """The experiment that was calibrated."""
        return self.likelihood.experiment

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """What was inferred, in the order of the chain's last axis."""
        return self.likelihood.unknowns

    @property
    def describes_data(self) -> bool:
        """Whether neither gap is beyond MISFIT_GAP, and beyond what a right model passes by chance."""
        return self.misfit != "large"

    @property
    def misfit(self) -> str:
        """ "large" where a gap is beyond MISFIT_GAP and beyond chance; "small" where it is only beyond chance, as can
        be said of stated noise; else "none"."""
        (train, held), gap = training_rows(self.experiment), self.gap
        allowed = [gap_of_noise(self.experiment.runs, rows, self.likelihood.inflations) for rows in (train, held)]
        pairs = (gap.train, allowed[0]), (gap.held_out, max(allowed[1], gap.allowed))
        if any(found > max(MISFIT_GAP, chance) for found, chance in pairs):
            return "large"
        stated = all(run.noise is not None for run in self.experiment.runs)
        return "small" if stated and any(found > chance for found, chance in pairs) else "none"

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Of k_f, kappa and b without a prior of their own, those with many samples at the bound of where they are
        looked for, which cuts their posterior off."""
        found = []
        for k, u in enumerate(self.unknowns):
            if u.name in SEARCH and math.isnan(u.sd) and u.name not in self.experiment.infer:
                edge = _EDGE * math.log(u.high / u.low)
                z = self.chain[..., k]
                if np.mean((z < math.log(u.low) + edge) | (z > math.log(u.high) - edge)) > _MANY:
                    found.append(u.name)
        return tuple(found)

    def samples(self, name: str) -> np.ndarray:
        """All samples of one unknown in its unit, flat; ValueError for an unknown name."""
        names = self.likelihood.names
        if name not in names:
            raise ValueError(f"{name!r} was not inferred; inferred: {', '.join(names)}")
        k = names.index(name)
        return np.asarray(self.unknowns[k].value(self.chain[..., k].ravel()))

    def draws(self, count: int) -> np.ndarray:
        """`count` points drawn from the samples (the same ones each time), shape (count, D)."""
        flat = self.chain.reshape(-1, self.chain.shape[-1])
        rng = np.random.default_rng(self.seed)
        return flat[rng.choice(len(flat), size=count, replace=count > len(flat))]

    def best(self) -> np.ndarray:
        """The sampled point of highest density, shape (D,)."""
        return self.chain.reshape(-1, self.chain.shape[-1])[np.argmax(self.log_density)]

    def release(self) -> Release:
        """The first run's release; where it was not seen, of its first peak as the data show it."""
        run = self.experiment.runs[0]
        if run.release is not None:
            return run.release.release
        early = run.fitted & (run.times <= run.fit_from + 1.1 * self.experiment.cradle.period)
        peaks = np.nan_to_num(np.abs(run.angles(self.experiment.cradle)[early])).max(axis=0)
        bob = self.experiment.cradle.bobs if peaks[-1] >= peaks[0] else 1
        return Release(angles={bob: float(peaks.max()) * (1.0 if bob > 1 else -1.0)})

    @property
    def synchronizes(self) -> bool:
        """Whether the first run's bobs have something to synchronize with, so that there is a λ."""
        release = self.release()
        try:
            release.check_synchronizes(self.experiment.cradle)
        except ValueError:
            return False
        return True

    def newton_exponent(self) -> np.ndarray:
        """Samples of λ [1/s] of the first run's δ and release over 1 to 60 s, simulated; empty where there is none."""
        if not self.synchronizes:
            return np.empty(0)
        if self.newton_exponents is not None:
            return self.newton_exponents.ravel()
        return self._predicted_exponent

    @functools.cached_property
    def _predicted_exponent(self) -> np.ndarray:
        return self.predict(count=_LAMBDA_DRAWS).newton_exponent

    def predict(
        self,
        delta: float | tuple[float, ...] | None = None,
        release_angle: float | None = None,
        bobs: int | None = None,
        count: int = 200,
        duration: float = WINDOW[1],
        sample_rate: float = 240.0,
    ) -> Prediction:
        """σ(t) and λ at any δ, release angle [rad] and number of bobs, over `count` draws; of the first run where
        omitted. Its bobs are lifted, at angles in proportion. Raises ValueError for impossible settings."""
        count = int(check_range("count", count, "", 1, remedy="each draw of the posterior is a run"))
        release, calibrated = self.release(), self.experiment.cradle.bobs
        bobs = calibrated if bobs is None else bobs
        if release_angle is not None:
            release = release.lifted_to(release_angle, self.experiment.cradle)
        if bobs != calibrated:
            release = _of_other_bobs(release, calibrated, bobs)
        cradles, releases = [], []
        for point in self.draws(count):
            values = self.likelihood.values(point)
            cradle = self.likelihood.cradle(values)
            stated = cradle.delta if bobs == calibrated else float(np.mean(cradle.delta))
            try:
                cradles.append(cradle.replace(bobs=bobs, delta=stated if delta is None else delta))
            except ValueError as problem:
                if bobs == calibrated:
                    raise
                raise ValueError(f"{problem}; the calibration was of {calibrated} bobs, predict for as many") from None
            # A stated angle is taken as exact; the run's own is as uncertain as the calibration left it.
            error = values.get("release_angle_error@1", 0.0) if release_angle is None else 0.0
            releases.append(lifted_further(release, error))
        release.check_synchronizes(cradles[0])
        runs = simulate_batch(
            cradles, releases, duration, sample_rate, step_factor=STEP_FACTOR, workers=self.likelihood.workers
        )
        inferred = "delta" in self.likelihood.names and delta is None
        return Prediction(
            cradles[0].replace(delta=float(np.median([c.delta for c in cradles]))) if inferred else cradles[0],
            release,
            runs[0].t,
            np.array([run.sigma() for run in runs]),
            np.array([run.newton_exponent() for run in runs]),
            np.array([cradle.gaps for cradle in cradles]),
        )

    def summary(self) -> dict[str, Any]:
        """What `summary.json` holds."""
        from cradle_env import __version__

        c = self.convergence
        rates = self.newton_exponent()
        return {
            "format": FORMAT,
            "version": __version__,
            "seed": self.seed,
            "inputs": self.experiment.digest,
            "converged": c.converged,
            "rhat_max": c.rhat_max,
            "ess_min": c.ess_min,
            "tau_max": c.tau_max,
            "steps": c.steps,
            "burn_in": c.burn_in,
            "not_converged_because": list(c.reasons),
            "parameters": {
                u.name: {"unit": u.unit, **statistics(self.samples(u.name))} for u in self.unknowns if not u.nuisance
            },
            "nuisance": {
                u.name: {"unit": u.unit, **statistics(self.samples(u.name))} for u in self.unknowns if u.nuisance
            },
            "lambda": {"unit": "1/s", **statistics(rates), "window_s": list(WINDOW)} if len(rates) else None,
            "gap": {"train": self.gap.train, "held_out": self.gap.held_out, "allowed": self.gap.allowed},
            "model_describes_data": self.describes_data,
            "misfit": self.misfit,
            "noise_inflation": list(self.likelihood.inflations),
            "at_bounds": {u.name: [u.low, u.high] for u in self.unknowns if u.name in self.at_bounds},
        }

    def save(self, path: str | Path) -> Path:
        """Writes the samples, in their units, as an ArviZ netCDF file, with what is needed to load it again."""
        from identification.inference.posterior_file import write_posterior

        return write_posterior(self, Path(path))

    @classmethod
    def load(cls, path: str | Path, workers: int | None = None) -> Posterior:
        """Reads what `save` wrote; ExperimentError, naming file and field, if it is not such a file."""
        from identification.inference.posterior_file import read_posterior

        return read_posterior(Path(path), workers)


def _of_other_bobs(release: Release, calibrated: int, bobs: int) -> Release:
    """A release of so many bobs for another number of them; ValueError where it then lifts others."""
    angles = release.angles or {}
    highest = range(calibrated - len(angles) + 1, calibrated + 1)
    if angles and sorted(angles) == [*highest] and len(set(angles.values())) == 1:
        return Release(angle=angles[calibrated], bobs=len(angles), start=release.start)
    if calibrated in angles or max(angles, default=0) > bobs:
        raise ValueError(
            f"bobs is {bobs}, but the release calibrated names bob {max(angles)} of {calibrated};"
            f" predict for {calibrated} bobs"
        )
    return release


def statistics(samples: np.ndarray) -> dict[str, Any]:
    """Mean, sd, median, central 68 and 95 % intervals of samples; nan left out."""
    finite = samples[np.isfinite(samples)]
    if len(finite) == 0:
        return {"mean": None, "sd": None, "median": None, "ci68": [None, None], "ci95": [None, None]}
    q = np.quantile(finite, (0.025, 0.16, 0.5, 0.84, 0.975))
    return {
        "mean": float(finite.mean()),
        "sd": float(finite.std(ddof=1)) if len(finite) > 1 else 0.0,
        "median": float(q[2]),
        "ci68": [float(q[1]), float(q[3])],
        "ci95": [float(q[0]), float(q[4])],
    }
