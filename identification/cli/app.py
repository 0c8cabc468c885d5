"""The command `cradle`: its commands with their options.

A command imports what it needs when it runs, so that help texts and refusals come at once.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated

import typer

from identification.cli.exit_status import nothing_kept, report_what_is_kept, resumable, run_to_exit_status
from identification.cli.measure_command import measure
from identification.cli.new_command import new
from identification.cli.options import (
    KF,
    Angle,
    B,
    Beta,
    Bobs,
    Delta,
    Duration,
    Effects,
    Explore,
    Kappa,
    Lifted,
    Model,
    NoWorkers,
    Out,
    Over,
    Quantities,
    SampleRate,
    Seed,
    Settings,
    Source,
    Start,
    Table,
    Times,
    Workers,
)

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Newton's cradle: simulate it, calibrate it against a measurement, predict how fast it synchronizes.",
)


app.add_typer(measure, name="measure")


def _show_version(wanted: bool) -> None:
    if wanted:
        from identification import __version__

        typer.echo(f"newtons-cradle {__version__}")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_show_version, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


app.command()(new)


@app.command()
def simulate(
    out: Out,
    bobs: Bobs = None,
    delta: Delta = None,
    release_angle: Angle = None,
    lifted: Lifted = None,
    start: Start = None,
    model: Model = None,
    beta: Beta = None,
    kappa: Kappa = None,
    k_f: KF = None,
    b: B = None,
    effect: Effects = None,
    set_: Settings = None,
    source: Source = None,
    duration: Duration = 60.0,
    sample_rate: SampleRate = 240.0,
    experiment: Annotated[
        bool,
        typer.Option("--experiment",
                     help="Also write experiment.toml and run1.csv for `cradle calibrate`: the readings of"
                     " the model's instrument with noise. The file states the true parameters."),
    ] = False,
    noise: Annotated[
        float | None, typer.Option(help="1 sigma of a reading in rad, with --experiment.", show_default="0.001")
    ] = None,
    seed: Seed = 0,
    workers: NoWorkers = None,
) -> None:  # fmt: skip
    """Simulate one run: trajectory.csv, impacts.csv, summary.json and run.png."""
    from identification.cli import commands, cradle_options

    if experiment:
        noise = 1e-3 if noise is None else noise
    elif noise is not None:
        raise ValueError(f"noise is {noise:g} rad, but only an experiment has readings; add --experiment, or omit it")
    fields = {"bobs": bobs, "model": model, "beta": beta, "kappa": kappa, "k_f": k_f, "b": b}
    cradle, release = cradle_options.parse_cradle_options(
        source, fields, delta, effect or [], set_ or [], angle=release_angle, lifted=lifted, start=start
    )
    with report_what_is_kept(out, nothing_kept):
        commands.simulate(cradle, release, duration, sample_rate, out, noise, seed)


@app.command()
def calibrate(
    experiment: Annotated[Path, typer.Argument(metavar="EXPERIMENT.toml", help="See `cradle new`.")],
    out: Out,
    steps: Annotated[
        int | None, typer.Option(help="Total number of steps. Default: until the chains converge.")
    ] = None,
    max_steps: Annotated[int, typer.Option(help="Stop after this many steps, converged or not.")] = 20000,
    seed: Seed = 0,
    workers: Workers = None,
) -> int:
    """Infer a cradle's parameters and λ: summary.json, chain.h5, posterior.nc, pictures and report.html.

    The same command resumes an interrupted calibration. Exit status 1 means that the chains have not converged.
    """
    from identification.cli import commands

    def sampled() -> str:
        from identification.inference.checkpoint import count_kept_steps

        file = out / "chain.h5"
        return f"{count_kept_steps(file) or 'no'} steps are kept in {file}; the same command goes on"

    with report_what_is_kept(out, sampled):
        return commands.calibrate(experiment, out, steps, max_steps, seed, workers)


@app.command()
def predict(
    calibration: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder that `cradle calibrate` wrote, or its posterior.nc.")
    ],
    out: Out,
    delta: Annotated[float | None, typer.Option(help="δ. Default: as in the experiment.")] = None,
    release_angle: Annotated[
        float | None, typer.Option(help="Release angle in rad. Default: as in the experiment.")
    ] = None,
    bobs: Annotated[int | None, typer.Option(help="Number of bobs. Default: as in the experiment.")] = None,
    draws: Annotated[int, typer.Option(min=2, help="Number of samples of the posterior to simulate.")] = 200,
    seed: Seed = 0,
    workers: Workers = None,
) -> None:
    """Predict σ(t) and λ of any cradle from a calibration: prediction.json, prediction.csv and prediction.png."""
    from identification.cli import commands

    with report_what_is_kept(out, nothing_kept):
        commands.predict(calibration, out, delta, release_angle, bobs, draws, seed, workers)


@app.command()
def diagnose(
    experiment: Annotated[Path, typer.Argument(metavar="EXPERIMENT.toml")],
    out: Out,
    explain: Annotated[
        bool, typer.Option("--explain", help="Print how it came to this: models visited, evidence and tests.")
    ] = False,
    seed: Seed = 0,
    workers: Workers = None,
) -> None:
    """Find the effects that a model lacks and add them: diagnosis.json, model.toml and report.html.

    The same command resumes an interrupted diagnosis.
    """
    from identification.cli import commands

    with report_what_is_kept(out, resumable(f"{out / 'fits.json'} holds the fits that were finished")):
        commands.diagnose(experiment, out, explain, seed, workers)


@app.command()
def reproduce(
    out: Out,
    only: Annotated[
        list[str] | None, typer.Option(metavar="FIGURE", help="Name of a figure, such as fig7. May be repeated.")
    ] = None,
    values: Annotated[int, typer.Option(help="Number of values of each parameter in the sweeps, at least 16.")] = 400,
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="DIR",
                     help="Folder that `cradle calibrate` wrote. The bands show its uncertainty. Default:"
                     " the command simulates and calibrates an example."),
    ] = None,
    seed: Seed = 0,
    workers: Workers = None,
) -> None:  # fmt: skip
    """Make the figures of Lee & Hong from the equations, and judge their claims: claims.md, and a folder per figure.

    Each folder holds a picture as PDF and PNG, and its tables. The same command resumes an interrupted run.
    """
    from identification.cli import commands

    with report_what_is_kept(out, resumable(f"{out} holds the figures that were finished")):
        commands.reproduce(out, only or [], values, calibration, seed, workers)


@app.command()
def sweep(
    out: Out,
    over: Over = None,
    quantity: Quantities = None,
    times: Times = None,
    table: Table = "sweep.csv",
    explore: Explore = False,
    bobs: Bobs = None,
    delta: Delta = None,
    release_angle: Angle = None,
    lifted: Lifted = None,
    start: Start = None,
    model: Model = None,
    beta: Beta = None,
    kappa: Kappa = None,
    k_f: KF = None,
    b: B = None,
    effect: Effects = None,
    set_: Settings = None,
    source: Source = None,
    duration: Duration = 60.0,
    sample_rate: SampleRate = 240.0,
    seed: Annotated[int, typer.Option("--seed", hidden=True)] = 0,
    workers: Workers = None,
) -> None:  # fmt: skip
    """Simulate a grid of cradles: a table of λ and other quantities, sweep.png and sweep.json.

    The same command resumes an interrupted sweep.
    """
    from identification.cli import cradle_options, sweep_command
    from identification.sweep.explore import AXES

    axes = tuple(over or ())
    fields = {"bobs": bobs, "model": model, "beta": beta, "kappa": kappa, "k_f": k_f, "b": b}
    cradle, release = cradle_options.parse_cradle_options(
        source,
        fields,
        delta,
        effect or [],
        set_ or [],
        angle=release_angle,
        lifted=lifted,
        start=start,
        over=axes or tuple(AXES if explore else ()),
    )
    asked = sweep_command.SweepRequest(axes, tuple(quantity or ("lambda",)), times, table, explore)
    with report_what_is_kept(out, resumable(f"{out / 'runs.npy'} holds the runs that were finished")):
        sweep_command.run(cradle, release, asked, duration, sample_rate, out, seed, workers)


@app.command()
def design(
    experiment: Annotated[Path, typer.Argument(metavar="EXPERIMENT.toml")],
    out: Out,
    between: Annotated[
        list[str] | None,
        typer.Option(metavar="EFFECT[+EFFECT]",
                     help="A model to compare with others; give two or more. Default: plan the"
                     " run that constrains λ most."),
    ] = None,
    diagnosis: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of a diagnosis of this experiment. The plan includes the effects that"
                     " it named, and compares the models that it found equivalent."),
    ] = None,
    seed: Seed = 0,
    workers: Workers = None,
) -> None:  # fmt: skip
    """Plan the most informative next run: design.json, design.png, experiment.toml and report.html.

    The same command resumes an interrupted design.
    """
    from identification.cli import commands

    with report_what_is_kept(out, resumable(f"{out / 'fits.json'} holds the fits that were finished")):
        commands.design(experiment, out, between or [], diagnosis, seed, workers)


@app.command()
def bench(
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for bench.json, bench.png.")] = None,
    duration: Annotated[float, typer.Option(min=1.0, help="Simulated time of each comparison, s.")] = 20.0,
    seed: Annotated[int, typer.Option("--seed", hidden=True)] = 0,
    workers: NoWorkers = None,
) -> None:
    """Compare speed and accuracy with other engines on one core of this machine."""
    from identification.bench import run

    with report_what_is_kept(out, lambda: "nothing was written"):
        run.main(duration, out)


@app.command()
def warmup(seed: Annotated[int, typer.Option("--seed", hidden=True)] = 0, workers: NoWorkers = None) -> None:
    """Compile the simulation kernels once for this machine. Otherwise the first simulation compiles them."""
    from cradle_env.warmup import warm_up
    from identification.reporting.terminal import TerminalProgress

    with TerminalProgress() as progress:
        progress("compile", None, "half a minute on two cores, once")
        warm_up()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    for stream in (sys.stdout, sys.stderr):  # λ and δ become ? where a terminal cannot show them
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    return run_to_exit_status(lambda: app(args=arguments, prog_name="cradle", standalone_mode=False))
