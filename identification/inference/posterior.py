"""What a calibration gives back: the sampled posterior, its summary, and what follows from it."""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env.errors import check_range
from cradle_env.release import Release
from cradle_env.simulation import simulate_batch
from cradle_env.synchronization import WINDOW
from identification.experiment.noise import noise_gap_bound
from identification.experiment.train_test import training_rows
from identification.inference import posterior_display, posterior_plots
from identification.inference.arviz_data import inference_data
from identification.inference.gap import MISFIT_GAP
from identification.inference.likelihood import TOLERANCE, shift_release_angle
from identification.inference.posterior_file import read_posterior, write_posterior
from identification.inference.prediction import Prediction, release_for_bobs
from identification.inference.samples import FORMAT, Samples
from identification.inference.statistics import statistics
from identification.inference.unknowns import SEARCH_WIDTHS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Draws over which λ is simulated where it did not come with the likelihood.
_LAMBDA_DRAWS = 400
#: The part of the width in the logarithm next to a bound, and the share of samples there, that cut a posterior off.
_BOUND_MARGIN, _BOUND_SHARE = 0.01, 0.01


@dataclass(frozen=True)
class Posterior(Samples):
    """The posterior of an experiment's unknowns: its samples (see `Samples`), and what follows from them."""

    @property
    def describes_data(self) -> bool:
        """Whether neither gap is beyond MISFIT_GAP, and beyond what a right model passes by chance."""
        return self.misfit != "large"

    @property
    def misfit(self) -> str:
        """ "large" where a gap is beyond MISFIT_GAP and beyond chance; "small" where it is only beyond chance, as can
        be said of stated noise; else "none"."""
        (train, held), gap = training_rows(self.experiment), self.gap
        allowed = [
            noise_gap_bound(self.experiment.runs, rows, self.likelihood.noise_model.inflations)
            for rows in (train, held)
        ]
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
            if u.name in SEARCH_WIDTHS and math.isnan(u.sd) and u.name not in self.experiment.infer:
                edge = _BOUND_MARGIN * math.log(u.high / u.low)
                z = self.chain[..., k]
                if np.mean((z < math.log(u.low) + edge) | (z > math.log(u.high) - edge)) > _BOUND_SHARE:
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
            release = release_for_bobs(release, calibrated, bobs)
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
            releases.append(shift_release_angle(release, error))
        release.check_synchronizes(cradles[0])
        runs = simulate_batch(
            cradles, releases, duration, sample_rate, tolerance=TOLERANCE, workers=self.likelihood.workers
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
            "noise_inflation": list(self.likelihood.noise_model.inflations),
            "at_bounds": {u.name: [u.low, u.high] for u in self.unknowns if u.name in self.at_bounds},
        }

    def save(self, path: str | Path) -> Path:
        """Writes the samples, in their units, as an ArviZ netCDF file, with what is needed to load it again."""
        return write_posterior(self, Path(path))

    def to_inference_data(self) -> Any:
        """The samples, in their units, for ArviZ: InferenceData up to ArviZ 0.23, an xarray DataTree from 1.0.

        Groups posterior and sample_stats with the variables of posterior.nc, each (chain, draw): a chain is one
        ensemble, its draws are the walkers' positions step by step. `load` reads what its `to_netcdf` writes.

        >>> arviz.summary(posterior.to_inference_data())  # doctest: +SKIP
        """
        return inference_data(self)

    def plot_corner(self) -> Figure:
        """A Matplotlib figure of the joint posterior of the cradle's unknowns and λ; contours hold 68 and 95 %."""
        return posterior_plots.corner_figure(self)

    def plot_fit(self) -> Figure:
        """A Matplotlib figure of each bob's readings and the model's 95 % bands, without and with the noise."""
        return posterior_plots.fit_figure(self)

    def __repr__(self) -> str:
        return posterior_display.line(self)

    def _repr_html_(self) -> str:
        return posterior_display.page(self)

    @classmethod
    def load(cls, path: str | Path, workers: int | None = None) -> Posterior:
        """Reads what `save` wrote; ExperimentError, naming file and field, if it is not such a file."""
        samples = read_posterior(Path(path), workers)
        return cls(**{field.name: getattr(samples, field.name) for field in dataclasses.fields(samples)})
