"""The curves of Fig. 8 with their uncertainty: λ over draws from a calibration's posterior."""

from __future__ import annotations

from pathlib import Path

import matplotlib.figure
import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.parameter_name import ParameterName
from cradle_env.plot_style import quiet_grid
from cradle_env.simulation import simulate
from identification.experiment.experiment import Experiment
from identification.experiment.run import ReleaseInfo, Run
from identification.inference.calibration import calibrate
from identification.inference.posterior import Posterior
from identification.progress import Progress
from identification.reproduce.figure import ANGLE, BOBS, STANDARD_RELEASE, Figure, Study, Tables
from identification.reproduce.impacts import PUBLISHED_ALPHA, PUBLISHED_N
from identification.reproduce.sweeps import COLOURS, PARAMETERS
from identification.storage.provenance import program_hash

_DRAWS = 24
#: What a parameter of a sweep sets instead of the posterior.
_SETS = {"alpha": "k_f", "beta": "kappa", "delta": "delta"}
# The example: a short film by a slow camera, so that there is an uncertainty to see.
_DURATION, _RATE, _NOISE = 8.0, 30.0, 5e-3


def calibrate_example(folder: Path, seed: int, workers: int | None, progress: Progress) -> Posterior:
    """The posterior of a simulated experiment: two bobs of the standard set, filmed for 8 s with 5 mrad of noise."""
    cradle = Cradle(bobs=2)
    run = simulate(cradle, STANDARD_RELEASE, _DURATION, _RATE)
    readings = run.theta + _NOISE * np.random.default_rng(seed).standard_normal(run.theta.shape)
    seen = Run(run.t, readings, release=ReleaseInfo(STANDARD_RELEASE, angle_sd=1e-3), delta=0.0, noise=_NOISE)
    # A folder of its own, so that no chain of another program is resumed and no other calibration is replaced.
    own = folder / program_hash(cradle.composition)
    posterior = calibrate(Experiment(cradle, (seen,)), out=own, seed=seed, workers=workers, progress=progress)
    posterior.save(own / "posterior.nc")
    return posterior


def check_posterior(posterior: Posterior) -> None:
    """Raise ValueError if the calibrated cradle cannot be swept, for example if it has a value for each bob."""
    for parameter in PARAMETERS:
        for bobs in BOBS:
            _cradle(posterior, parameter.name, bobs)


def _cradle(posterior: Posterior, swept: str, bobs: int) -> Cradle:
    """The calibrated cradle with `bobs` bobs, for the sweep of a parameter."""
    calibrated = posterior.experiment.cradle_of(posterior.experiment.runs[0])
    law = (PUBLISHED_ALPHA, PUBLISHED_N) if swept == "alpha" else calibrated.power_law
    return calibrated.replace(bobs=bobs, delta=float(np.mean(calibrated.delta)), power_law=law)


def _data(study: Study) -> Tables:
    posterior = study.posterior()
    points = posterior.draws(_DRAWS)
    # A value of one bob or gap of the experiment does not apply to a cradle with more of them.
    drawn = {
        u.name: np.asarray(u.value(points[:, k]))
        for k, u in enumerate(posterior.unknowns)
        if not u.nuisance and ParameterName.parse(u.name).element is None
    }
    tables: dict[str, dict[str, np.ndarray]] = {"draws": dict(drawn)}
    for parameter in PARAMETERS:
        count = study.values // 2 if parameter.denser > 1 else max(8, study.values // 10)
        values = np.linspace(parameter.low, parameter.high, count)
        kept = {name: column for name, column in drawn.items() if name != _SETS.get(parameter.name)}
        columns = {parameter.name: values}
        for bobs in BOBS:
            axes = {"draw": kept, parameter.name: values}
            swept = study.sweep(f"{parameter.name}-N{bobs}", axes, _cradle(posterior, parameter.name, bobs))
            q = np.nanquantile(swept["lambda"], (0.0, 0.16, 0.5, 0.84, 1.0), axis=0)
            for label, column in zip(_LABELS, q, strict=True):
                columns[f"lambda {label}, N = {bobs} [1/s]"] = column
        tables[parameter.name] = columns
    return tables


_LABELS = ("least", "68 % low", "median", "68 % high", "greatest")


def _draw(tables: Tables) -> matplotlib.figure.Figure:
    figure = matplotlib.figure.Figure(figsize=(10.0, 7.0), layout="constrained")
    for letter, parameter, axes in zip("abcd", PARAMETERS, figure.subplots(2, 2).ravel(), strict=True):
        table = tables[parameter.name]
        x = table[parameter.name]
        for bobs in BOBS:
            least, low, middle, high, greatest = (table[f"lambda {label}, N = {bobs} [1/s]"] for label in _LABELS)
            axes.fill_between(x, least, greatest, color=COLOURS[bobs], alpha=0.25, linewidth=0)
            axes.fill_between(x, low, high, color=COLOURS[bobs], alpha=0.45, linewidth=0)
            axes.plot(x, middle, color=COLOURS[bobs], linewidth=0.8, label=f"N = {bobs}: median, 68 % and all draws")
        axes.set(title=f"({letter})", xlabel=parameter.symbol, ylabel="λ [s$^{-1}$]", ylim=(0.0, None))
        quiet_grid(axes)
        if letter == "a":
            axes.legend(loc="upper left")
    return figure


FIGURE = Figure(
    "bands", f"λ with bands of a calibration, {_DRAWS} draws, released at {ANGLE} rad", _data, _draw, calibrated=True
)
