"""Write results as files. Each file gets a temporary name and is then renamed, so that none is half-written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cradle_env import __version__
from cradle_env.cradle import Cradle
from cradle_env.plot_style import png
from cradle_env.release import Release
from cradle_env.synchronization import ENVELOPE_PERIODS, check_duration, window_of
from cradle_env.trajectory import Trajectory
from identification.experiment.csv_file import csv_text
from identification.experiment.experiment import Experiment
from identification.inference.posterior import Posterior
from identification.inference.prediction import Prediction
from identification.storage.stamps import write_results

#: Called before each picture with the fraction done and the name of the picture.
PictureProgress = Callable[[float, str], None]

#: The last file of a run or a calibration, the format of a run's, and the other files of each.
SUMMARY, RUN_FORMAT, RUN_FILES = "summary.json", "cradle-run/1", ("trajectory.csv", "impacts.csv", "run.png")
CALIBRATION_FILES = (
    "posterior.nc", "corner.png", "fit.png", "residuals.png", "lambda.png", "contributions.png", "report.html"
)  # fmt: skip
#: The same of a prediction.
PREDICTION, PREDICTION_FORMAT = "prediction.json", "cradle-prediction/1"
PREDICTION_FILES = ("prediction.csv", "prediction.png")


def table_text(columns: Mapping[str, np.ndarray]) -> str:
    """Write columns (T,), by label, as CSV with nine digits; quote labels that contain a comma."""
    rows = np.column_stack([np.asarray(column, dtype=float) for column in columns.values()])
    lines = (",".join("" if value != value else f"{value:.9g}" for value in row) for row in rows.tolist())
    labels = (f'"{label}"' if "," in label else label for label in columns)
    return "\n".join([",".join(labels), *lines, ""])


def cradle_values(cradle: Cradle) -> dict[str, Any]:
    """A cradle in SI units and in the paper's groups."""
    fields = {name: getattr(cradle, name) for name in cradle.__dataclass_fields__ if name != "effects"}
    effects = {name: dict(values) for name, values in cradle.effects.items()}
    groups = {"alpha": cradle.alpha, "n": cradle.n, "beta": cradle.beta}
    return {**fields, "effects": effects, "groups": groups}


def release_values(release: Release) -> dict[str, Any]:
    """A release, by its fields."""
    angles = None if release.angles is None else {str(bob): angle for bob, angle in release.angles.items()}
    return {"angle": release.angle, "bobs": release.bobs, "angles": angles, "start": release.start}


def save_run(
    run: Trajectory, folder: Path, *, seed: int, inputs: str, experiment: Experiment | None = None
) -> dict[str, Any]:
    """Write trajectory.csv, impacts.csv, run.png, the files of the experiment, if any, and last summary.json.

    Returns the content of summary.json.
    """
    assert isinstance(run.release, Release)
    energy = run.energy()
    sigma, rate, none_because = None, None, None
    try:
        run.release.check_synchronizes(run.cradle)
        sigma = run.sigma()
        check_duration(run.t[-1])
        rate = run.newton_exponent()
    except ValueError as problem:  # or too sparse or too short for the envelopes
        none_because = str(problem)
    whole = run.t[-1] - 0.5 * ENVELOPE_PERIODS * run.cradle.period  # the last whole envelope
    summary = {
        "format": RUN_FORMAT,
        "version": __version__,
        "seed": seed,
        "inputs": inputs,
        "cradle": cradle_values(run.cradle),
        "release": release_values(run.release) | {"gamma": run.release.gamma(run.cradle)},
        "duration_s": float(run.t[-1]),
        "lambda": None if rate is None else {"unit": "1/s", "value": rate, "window_s": window_of(run.t)},
        "sigma_final": None if sigma is None else float(np.interp(whole, run.t, sigma)),
        "no_lambda_because": none_because,
        "impacts": len(run.impacts),
        "energy_J": {
            name: {"start": getattr(energy, name)[0], "end": getattr(energy, name)[-1]}
            for name in ("kinetic", "gravity", "strings", "drag", "impacts", "total")
        },
    }
    impacts = {"time [s]": "time", "pair": "pair", "speed [m/s]": "speed", "loss [J]": "loss"}
    table = table_text({label: run.impacts[name] for label, name in impacts.items()})
    made = (csv_text(run.t, run.theta, "theta"), table, png(run.plot()))
    files = {**dict(zip(RUN_FILES, made, strict=True)), **({} if experiment is None else experiment.texts())}
    return write_results(folder, files, SUMMARY, summary)


def save_calibration(posterior: Posterior, folder: Path, progress: PictureProgress = lambda *_: None) -> dict[str, Any]:
    """Write posterior.nc, the pictures, report.html and last summary.json; return its content."""
    from identification.inference import contribution_plots, posterior_plots, prediction_plots
    from identification.reporting.calibration_report import calibration_html

    summary = posterior.summary()
    data, *names, report = CALIBRATION_FILES
    figures = (
        posterior_plots.corner_figure,
        posterior_plots.fit_figure,
        posterior_plots.residual_figure,
        prediction_plots.lambda_figure,
        contribution_plots.contribution_figure,
    )
    draw = dict(zip(names, figures, strict=True))
    if not posterior.synchronizes:
        del draw["lambda.png"]
    if posterior.contributions is None:
        del draw["contributions.png"]
    pictures: dict[str, bytes] = {}
    for name, figure in draw.items():
        progress(len(pictures) / len(draw), name)
        pictures[name] = png(figure(posterior))
    page = calibration_html(posterior, summary, pictures)
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder) as scratch:
        saved = posterior.save(Path(scratch) / data)
        return write_results(folder, {data: saved, **pictures, report: page}, SUMMARY, summary)


def save_prediction(prediction: Prediction, folder: Path, *, posterior: Posterior, seed: int) -> dict[str, Any]:
    """Write prediction.csv, prediction.png and last prediction.json; return its content."""
    from identification.inference.prediction_plots import prediction_figure

    bands = prediction.sigma_bands()
    end, angle = prediction.release.lead(prediction.cradle)
    fit = posterior.summary()
    content = {
        "format": PREDICTION_FORMAT,
        "version": __version__,
        "seed": seed,
        "inputs": posterior.experiment.digest,
        "bobs": prediction.cradle.bobs,
        "delta": prediction.cradle.delta,
        "release": release_values(prediction.release) | {"lead_bob": end + 1, "lead_angle": angle},
        "draws": len(prediction.newton_exponent),
        "lambda": prediction.summary(),
        "sigma_at_s": {
            f"{t:g}": {"median": bands["median"][i], "ci68": bands["ci68"][:, i], "ci95": bands["ci95"][:, i]}
            for t in (5.0, 10.0, 20.0, 30.0, 45.0)
            if (i := int(np.searchsorted(prediction.t, t))) < len(prediction.t)
        },
        "calibration": {key: fit[key] for key in ("converged", "model_describes_data", "gap")},
    }
    columns = {"t [s]": prediction.t, "sigma_median": bands["median"]}
    for name in ("ci68", "ci95"):
        columns |= {f"sigma_{name}_low": bands[name][0], f"sigma_{name}_high": bands[name][1]}
    made = (table_text(columns), png(prediction_figure(prediction)))
    return write_results(folder, dict(zip(PREDICTION_FILES, made, strict=True)), PREDICTION, content)
