"""The posterior that a calibration returns: its samples, summary, predictions and figures."""

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
from identification.inference.contribution_plots import contribution_figure
from identification.inference.gap import MISFIT_GAP
from identification.inference.likelihood import TOLERANCE, shift_release_angle
from identification.inference.posterior_file import read_posterior, write_posterior
from identification.inference.prediction import Prediction, release_for_bobs
from identification.inference.samples import FORMAT, Samples
from identification.inference.statistics import statistics
from identification.inference.unknowns import SEARCH_WIDTHS, name_in_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Draws for which λ is simulated if the likelihood does not give it: its mean is then known to 5 % of its sd.
_LAMBDA_DRAWS = 400
#: Samples within this part of the prior's width in the logarithm from a bound count as at the bound.
_BOUND_MARGIN = 0.01
#: A posterior is cut off if more than this share of its samples is at a bound.
_BOUND_SHARE = 0.01


@dataclass(frozen=True)
class Posterior(Samples):
    """The posterior of an experiment's unknowns, as `calibrate` returns it; for its fields see `Samples`."""

    @property
    def describes_data(self) -> bool:
        """Whether the misfit is not "large"."""
        return self.misfit != "large"

    @property
    def misfit(self) -> str:
        """The size of the misfit.

        "large" if a gap exceeds MISFIT_GAP and its 99 % bound for a correct model; "small" if the noise is stated and
        a gap exceeds only this bound; else "none".
        """
        (train, held_out), gap = training_rows(self.experiment), self.gap
        allowed = [
            noise_gap_bound(self.experiment.runs, rows, self.likelihood.noise_model.inflations)
            for rows in (train, held_out)
        ]
        pairs = (gap.train, allowed[0]), (gap.held_out, max(allowed[1], gap.allowed))
        if any(value > max(MISFIT_GAP, bound) for value, bound in pairs):
            return "large"
        stated = all(run.noise is not None for run in self.experiment.runs)
        return "small" if stated and any(value > bound for value, bound in pairs) else "none"

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Which of k_f, kappa and b, without a stated prior, have a posterior that a bound of the search cuts off."""
        names = []
        for k, u in enumerate(self.unknowns):
            if u.name in SEARCH_WIDTHS and math.isnan(u.sd) and u.name not in self.experiment.infer:
                margin = _BOUND_MARGIN * math.log(u.high / u.low)
                z = self.chain[..., k]
                if np.mean((z < math.log(u.low) + margin) | (z > math.log(u.high) - margin)) > _BOUND_SHARE:
                    names.append(u.name)
        return tuple(names)

    def samples(self, name: str) -> np.ndarray:
        """Return all samples of one unknown.

        Parameters
        ----------
        name : str
            As in `summary`, such as "kappa" or "quadratic_drag.c2".

        Returns
        -------
        ndarray of shape (E S W,)
            In the unit of the unknown.

        Raises
        ------
        ValueError
            If no unknown has this name.
        """
        names = self.likelihood.names
        if name not in names:
            raise ValueError(f"{name!r} was not inferred; inferred: {', '.join(names)}")
        k = names.index(name)
        return np.asarray(self.unknowns[k].value(self.chain[..., k].ravel()))

    def draws(self, count: int) -> np.ndarray:
        """Draw `count` points from the samples, the same ones each time; sampled coordinates (count, D)."""
        flat = self.chain.reshape(-1, self.chain.shape[-1])
        rng = np.random.default_rng(self.seed)
        return flat[rng.choice(len(flat), size=count, replace=count > len(flat))]

    def best(self) -> np.ndarray:
        """Return the sampled point of highest density, (D,)."""
        return self.chain.reshape(-1, self.chain.shape[-1])[np.argmax(self.log_density)]

    def release(self) -> Release:
        """Return the first run's release; if it is not stated, a release at the first peak of the data."""
        run = self.experiment.runs[0]
        if run.release is not None:
            return run.release.release
        early = run.fitted & (run.times <= run.fit_from + 1.1 * self.experiment.cradle.period)
        peaks = np.nan_to_num(np.abs(run.angles(self.experiment.cradle)[early])).max(axis=0)
        bob = self.experiment.cradle.bobs if peaks[-1] >= peaks[0] else 1
        return Release(angles={bob: float(peaks.max()) * (1.0 if bob > 1 else -1.0)})

    @property
    def synchronizes(self) -> bool:
        """Whether λ is defined: the first run's release leaves bobs at rest."""
        release = self.release()
        try:
            release.check_synchronizes(self.experiment.cradle)
        except ValueError:
            return False
        return True

    def newton_exponent(self) -> np.ndarray:
        """Return samples of λ for the first run's δ and release.

        Returns
        -------
        ndarray
            λ over 1 to 60 s [1/s], simulated; empty if it is not defined, see `synchronizes`.
        """
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
        """Predict σ(t) and λ over draws of the posterior; omitted settings are those of the first run.

        Parameters
        ----------
        delta : float or tuple of float, optional
            δ of all gaps, or of each.
        release_angle : float, optional
            Largest angle of the lifted bobs [rad]; several keep their proportions. A stated angle counts as exact.
        bobs : int, optional
            Number of bobs.
        count : int
            Number of draws; each is a simulation.
        duration : float
            Length of the runs [s].
        sample_rate : float
            Samples per second [1/s].

        Returns
        -------
        Prediction

        Raises
        ------
        ValueError
            If a setting is impossible.
        """
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
                raise ValueError(
                    f"{problem}; the calibration had {calibrated} bobs; predict for {calibrated}"
                ) from None
            # The run's own angle has the error that was inferred.
            error = values.get(name_in_run("release_angle_error", 0), 0.0) if release_angle is None else 0.0
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
        """Return the content of `summary.json`.

        Returns
        -------
        dict
            Verdict on convergence; median, sd and intervals of each parameter, with unit, and of λ; gap and misfit.
        """
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
            "contributions": None if self.contributions is None else self.contributions.content(),
            "at_bounds": {u.name: [u.low, u.high] for u in self.unknowns if u.name in self.at_bounds},
        }

    def save(self, path: str | Path) -> Path:
        """Write the samples, in their units, to an ArviZ netCDF file that `load` can read.

        Parameters
        ----------
        path : str or Path
            The file; replaced if it exists.

        Returns
        -------
        Path
            The same path.
        """
        return write_posterior(self, Path(path))

    def to_inference_data(self) -> Any:
        """Convert the samples, in their units, for ArviZ.

        The groups posterior and sample_stats have the variables of posterior.nc, each (chain, draw). A chain is one
        ensemble; its draws are the positions of all walkers, step by step. `load` reads a file that `to_netcdf` of the
        result writes.

        Returns
        -------
        InferenceData or xarray.DataTree
            InferenceData up to ArviZ 0.23, DataTree from 1.0.

        Examples
        --------

        >>> arviz.summary(posterior.to_inference_data())  # doctest: +SKIP
        """
        return inference_data(self)

    def plot_corner(self) -> Figure:
        """Plot the joint posterior of the cradle's unknowns and λ; contours contain 68 and 95 % probability."""
        return posterior_plots.corner_figure(self)

    def plot_fit(self) -> Figure:
        """Plot each bob's readings and the model's 95 % bands, without and with the noise."""
        return posterior_plots.fit_figure(self)

    def plot_contributions(self) -> Figure:
        """Plot the posterior of each source alone, of all, and of all without each.

        Raises ValueError if the experiment has one source alone.
        """
        return contribution_figure(self)

    def __repr__(self) -> str:
        return posterior_display.line(self)

    def _repr_html_(self) -> str:
        return posterior_display.page(self)

    @classmethod
    def load(cls, path: str | Path, workers: int | None = None) -> Posterior:
        """Read a file that `save` wrote.

        Parameters
        ----------
        path : str or Path
            The file.
        workers : int, optional
            Threads for predictions; all cores if omitted.

        Returns
        -------
        Posterior

        Raises
        ------
        ValueError
            If it is not such a file; the message names file and field.
        """
        samples = read_posterior(Path(path), workers)
        return cls(**{field.name: getattr(samples, field.name) for field in dataclasses.fields(samples)})
