"""The work of the commands: from parsed options to files and printed tables."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env import simulation
from cradle_env.cradle import Cradle
from cradle_env.effects import effect
from cradle_env.release import Release
from identification.experiment.experiment import Experiment
from identification.experiment.experiment_file import FILE_NAME
from identification.experiment.run import ReleaseInfo, Run, check_noise
from identification.inference.instrument import Instrument
from identification.inference.posterior import Posterior
from identification.inference.samples import FORMAT as POSTERIOR_FORMAT
from identification.number_format import (
    format_estimate,
    format_number,
    format_ratio,
    format_statistics,
    rounding_of,
    unit_plain,
)
from identification.reporting import result_files
from identification.reporting.terminal import TerminalProgress, print_table
from identification.reporting.verdicts import convergence_verdict, disagreement_warnings, model_verdict
from identification.storage.lock import locks_output
from identification.storage.stamps import check_replaceable, check_report

if TYPE_CHECKING:
    from identification.diagnosis.next_experiment.expected_information import Advice


@locks_output
def simulate(
    cradle: Cradle,
    release: Release,
    duration: float,
    sample_rate: float,
    out: Path,
    noise: float | None,
    seed: int,
) -> None:
    """Simulate one run and write it; with noise [rad], write an experiment with its data too."""
    if noise is not None:
        check_noise(noise, "rad")
    written = (*result_files.RUN_FILES, *(() if noise is None else (FILE_NAME, Run.file)))
    check_replaceable(out, (result_files.SUMMARY, *written), result_files.SUMMARY, result_files.RUN_FORMAT)
    with TerminalProgress() as progress:
        progress("simulate", None, "the first run after installation compiles for some seconds")
        report = lambda part: progress("simulate", part, f"{part * duration:.3g} of {duration:g} s")  # noqa: E731
        run = simulation.simulate(cradle, release, duration, sample_rate, progress=report)
        progress("draw", None)
        described_by = {"cradle": result_files.cradle_values(cradle), "release": result_files.release_values(release)}
        inputs = hashlib.sha256(json.dumps([described_by, duration, sample_rate], sort_keys=True).encode()).hexdigest()
        experiment = None if noise is None else _record_experiment(cradle, release, run.t, noise, seed)
        summary = result_files.save_run(run, out, seed=seed, inputs=inputs, experiment=experiment)
    rate, groups = summary["lambda"], summary["cradle"]["groups"] | {"gamma": summary["release"]["gamma"]}
    symbols = {"alpha": "α", "n": "n", "beta": "β", "gamma": "γ"}
    rows = [
        ("λ", f"– ({summary['no_lambda_because']})" if rate is None else f"{format_number(rate['value'], 5)} 1/s"),
        ("σ at the end", format_number(summary["sigma_final"])),
        ("impacts", str(summary["impacts"])),
        ("groups", ", ".join(f"{symbol} = {format_number(groups[key], 4)}" for key, symbol in symbols.items())),
    ]
    print_table(("quantity", "value"), rows)
    print(f"picture: {out / 'run.png'}")
    if noise is not None:
        print(f"experiment: {out / 'experiment.toml'}")


def _record_experiment(cradle: Cradle, release: Release, times: np.ndarray, noise: float, seed: int) -> Experiment:
    """Record a run with the model's instrument and Gaussian noise [rad]; the experiment states the true values."""
    instants = np.maximum(Instrument(cradle).instants(times), 0.0)
    order = np.argsort(instants, kind="stable")
    motion = simulation.simulate(cradle, release, times=instants[order], ledger=False)
    back = np.argsort(order, kind="stable")
    readings = Instrument(cradle).readings(motion.theta[back])
    readings = readings + noise * np.random.default_rng(seed).standard_normal(readings.shape)
    return Experiment(cradle, (Run(times, readings, release=ReleaseInfo(release), delta=cradle.delta, noise=noise),))


@locks_output
def calibrate(
    path: Path, out: Path, steps: int | None, max_steps: int, seed: int, workers: int | None
) -> int:  # fmt: skip
    """Calibrate an experiment and write all results; return 0 if the chains have converged, else 1."""
    from identification.inference.calibration import calibrate as run

    check_report(out, "calibrate")
    check_replaceable(
        out, (result_files.SUMMARY, *result_files.CALIBRATION_FILES), result_files.SUMMARY, POSTERIOR_FORMAT
    )
    experiment = Experiment.load(path)
    with TerminalProgress() as progress:
        posterior = run(
            experiment, out=out, steps=steps, max_steps=max_steps, seed=seed, workers=workers, progress=progress
        )
        summary = result_files.save_calibration(posterior, out, lambda fraction, text: progress("draw", fraction, text))
    found = {**summary["parameters"], **({"λ": summary["lambda"]} if summary["lambda"] else {})}
    print_table(_COLUMNS, [_row(name, entry, entry["unit"]) for name, entry in found.items()])
    print(model_verdict(summary))
    for warning in disagreement_warnings(summary):
        print(f"cradle: {warning}", file=sys.stderr)
    print(f"report: {out / 'report.html'}")
    if not summary["converged"]:
        print(f"cradle: {convergence_verdict(summary)}", file=sys.stderr)
        return 1
    print(convergence_verdict(summary))
    return 0


@locks_output
def diagnose(path: Path, out: Path, explain: bool, seed: int, workers: int | None) -> None:
    """Diagnose an experiment and write the results."""
    from identification.diagnosis import selection_path
    from identification.diagnosis.report import check_folder, save, verdict_sentence
    from identification.diagnosis.workflow import diagnose as run

    check_report(out, "diagnose")
    check_folder(out)
    experiment = Experiment.load(path)
    with TerminalProgress() as progress:
        diagnosis = run(experiment, out=out, seed=seed, workers=workers, progress=progress)
        content = save(diagnosis, out, progress)
    if explain:
        print_table(selection_path.COLUMNS, selection_path.path_rows(content["path"]))
    if content["steps"]:
        rows = []
        for step in content["steps"]:
            units = {p.key: p.unit for p in effect(step["effect"]).parameters}
            found = ", ".join(
                f"{key} = {_format_parameter(entry, units[key])}" for key, entry in step["parameters"].items()
            )
            rows.append(
                (step["effect"], found or "–", format_ratio(step["gap_before"]), format_ratio(step["gap_after"]))
            )
        print_table(("effect", "parameters (95 %)", "gap before", "gap after"), rows)
    for warning in content["warnings"]:
        print(f"cradle: {warning}", file=sys.stderr)
    print(f"{content['verdict']}: {verdict_sentence(content)}")
    if diagnosis.advice is not None:
        print(format_advice(diagnosis.advice))
    print(f"report: {out / 'report.html'}")


def format_advice(advice: Advice) -> str:
    """Describe the next experiment in one line."""
    from identification.diagnosis.next_experiment.run_grid import describe_run

    if advice.separates_none:
        return advice.alternative
    plan = advice.plans[0]
    return f"next experiment: {describe_run(plan.setting, plan.duration)}. {advice.alternative}".rstrip()


@locks_output
def design(
    path: Path, out: Path, between: Sequence[str], diagnosis: Path | None, seed: int, workers: int | None
) -> None:
    """Design the next experiment and write it."""
    from identification.diagnosis.next_experiment.design import design as run
    from identification.diagnosis.next_experiment.design_report import (
        advice_sentence,
        check_folder,
        format_information,
        save,
    )
    from identification.diagnosis.next_experiment.run_grid import describe_run

    check_folder(out)
    experiment = Experiment.load(path)
    with TerminalProgress() as progress:
        designed = run(
            experiment, between=between, diagnosis=diagnosis, out=out, seed=seed, workers=workers, progress=progress
        )
        progress("draw", None)
        save(designed, out)
    column = "log Bayes factor" if designed.sets else "ln of the gain in λ"
    rows = [
        (
            describe_run(plan.setting, plan.duration),
            format_number(plan.predicted),
            *([format_information(plan)] if designed.sets else []),
        )
        for plan in designed.advice.plans[:5]
    ]
    print_table(("run", f"{column}, first order", *(["simulated"] if designed.sets else [])), rows)
    print(advice_sentence(designed))
    print(f"report: {out / 'report.html'}")


def _format_parameter(entry: Mapping[str, Any], unit: str) -> str:
    """Format a parameter of an effect with its 95 % interval, or one for each bob or gap."""
    if isinstance(entry["median"], Sequence):
        pairs = zip(entry["median"], entry["ci95"], strict=True)
        return (
            "[" + ", ".join(_format_parameter({"median": median, "ci95": ends}, unit) for median, ends in pairs) + "]"
        )
    median, interval, exponent = format_estimate(entry["median"], entry["ci95"])
    return f"{median} ({interval}) {unit_plain(unit, exponent)}".rstrip()


@locks_output
def predict(
    folder: Path,
    out: Path,
    delta: float | None,
    release_angle: float | None,
    bobs: int | None,
    draws: int,
    seed: int,
    workers: int | None,
) -> None:
    """Predict σ(t) and λ from a calibration and write them."""
    file = _find_posterior(folder)
    check_replaceable(
        out,
        (result_files.PREDICTION, *result_files.PREDICTION_FILES),
        result_files.PREDICTION,
        result_files.PREDICTION_FORMAT,
    )
    with TerminalProgress() as progress:
        progress("load", None)
        posterior = dataclasses.replace(Posterior.load(file, workers), seed=seed)
        progress("predict", None, f"{draws} runs")
        prediction = posterior.predict(delta, release_angle, bobs, count=draws)
        progress("draw", None)
        content = result_files.save_prediction(prediction, out, posterior=posterior, seed=seed)
    rows = [_row("λ", content["lambda"], "1/s")]
    for second, bands in content["sigma_at_s"].items():
        half = 0.5 * float(bands["ci68"][1] - bands["ci68"][0])
        rows.append(_row(f"σ({second} s)", {**bands, "sd": half}, "1"))
    print_table(_COLUMNS, rows)
    for key, verdict in (("converged", convergence_verdict), ("model_describes_data", model_verdict)):
        if not content["calibration"][key]:
            print(f"cradle: of the calibration: {verdict(posterior.summary())}", file=sys.stderr)
    print(f"picture: {out / 'prediction.png'}")


def _find_posterior(folder: Path) -> Path:
    """Find posterior.nc, given the file or the folder of the calibration."""
    file = folder / "posterior.nc" if folder.is_dir() else folder
    if not file.is_file():
        raise FileNotFoundError(
            2, "no posterior there; make one with cradle calibrate EXPERIMENT.toml --out", str(file)
        )
    return file


@locks_output
def reproduce(
    out: Path, only: Sequence[str], values: int, calibration: Path | None, seed: int, workers: int | None
) -> None:
    """Make the paper's figures and judge its claims."""
    from identification.reproduce.run import reproduce as run

    source = None if calibration is None else _find_posterior(calibration)
    with TerminalProgress() as progress:
        content = run(out, only, values=values, calibration=source, seed=seed, workers=workers, progress=progress)
    print_table(
        ("verdict", "figure", "claim"),
        [(claim["verdict"], claim["figure"], claim["statement"]) for claim in content["claims"]],
    )
    print(f"claims, with their numbers: {out / 'claims.md'}")


_COLUMNS = ("quantity", "median ± sd", "68 % interval", "95 % interval", "unit")


def _row(name: str, found: Mapping[str, Any], unit: str) -> tuple[str, ...]:
    """Format a row of a table of results, rounded to its uncertainty."""
    text = format_statistics(found)
    spread = f"{text['median']} ± {text['sd']}"
    return name, spread, text["ci68"], text["ci95"], unit_plain(unit, rounding_of(found).exponent)
