"""The command `cradle`: what it understands, and how it ends.

Exit status: 0, done; 2, unusable input, with one line on stderr; 130, interrupted; 1, anything else. What a command
needs is imported when it runs, so that help and refusals come at once.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any

import typer

from identification.cli.measure_command import measure
from identification.cli.options import (
    KF,
    Angle,
    B,
    Beta,
    Bobs,
    Delta,
    Duration,
    Effects,
    Kappa,
    Lifted,
    Model,
    NoWorkers,
    Out,
    SampleRate,
    Seed,
    Settings,
    Source,
    Start,
    Workers,
)

_USAGE_ERROR: Any = typer.BadParameter.__mro__[1]  # click's, or typer's own copy of it
_UNUSABLE = (ValueError, FileNotFoundError, FileExistsError, PermissionError, IsADirectoryError, NotADirectoryError)

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Newton's cradle: simulate it, calibrate it against a measurement, predict how fast it synchronizes.",
)


app.add_typer(measure, name="measure")


class _InterruptedError(Exception):
    """Ctrl-C; the message says what is kept and how to go on."""


class _FullDiskError(Exception):
    """No room for a file; the message says what is kept and how to go on."""


#: No space left, a quota used up, a file larger than it may be.
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def _say_what_is_kept(out: Path | None, what: Callable[[], str]) -> Iterator[None]:
    """Where a command that writes to `out` is stopped: says what is kept."""
    try:
        yield
    except KeyboardInterrupt:
        raise _InterruptedError(f"interrupted; {what()}") from None
    except OSError as problem:
        if problem.errno not in _FULL:
            raise
        raise _FullDiskError(f"no space left in {out}; {what()}") from None


def _nothing_kept() -> str:
    return "nothing was written that was not finished"


def _same_command(what: str) -> Callable[[], str]:
    return lambda: f"{what}, and the same command goes on from there"


def _show_version(wanted: bool) -> None:
    if wanted:
        from identification import __version__

        typer.echo(f"newtons-cradle {__version__}")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[bool, typer.Option("--version", is_eager=True, callback=_show_version, help="Say it.")] = False,
) -> None:
    pass


@app.command()
def new(
    data: Annotated[Path, typer.Argument(metavar="DATA", help="A table with a header, or an export of Tracker.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="A folder, or a file that ends in .toml; that of the data where"
                     " omitted."),
    ] = None,
    time: Annotated[
        str | None, typer.Option("--time", metavar="COLUMN", help="The column of time, where its name does not say so.")
    ] = None,
    bob: Annotated[
        list[str] | None,
        typer.Option("--bob", metavar="N=COLUMN", help="The column of a bob; no others are read. Repeat."),
    ] = None,
    unit: Annotated[
        list[str] | None,
        typer.Option("--unit", metavar="UNIT", help="s, ms, us; rad, mrad, deg; m, cm, mm, um; or as \"0.44 mm\", the"
                     " size of a pixel. Once for the times, once for the readings."),
    ] = None,
    rate: Annotated[
        float | None, typer.Option("--rate", help="Frames per second, where a column counts frames and none is time.")
    ] = None,
    mirror: Annotated[
        bool, typer.Option("--mirror", help="Turn all signs: positive must be towards the last bob.")
    ] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files that this command wrote.")] = False,
    seed: Annotated[int, typer.Option("--seed", hidden=True)] = 0,
    workers: NoWorkers = None,
) -> None:  # fmt: skip
    """Write a first experiment.toml for a data file, with guesses from the data to check and correct.

    Prints what it understood. Where the table is not in the strict form of an experiment, a copy in that form goes
    beside experiment.toml; the file itself stays as it is.
    """
    from identification.experiment.scaffold import scaffold
    from identification.experiment.table_columns import Columns

    columns = Columns(time, dict(_parse_bob_column(text) for text in bob or ()), tuple(unit or ()), rate)
    path = scaffold(data, out, overwrite=overwrite, columns=columns, mirror=mirror, report=typer.echo)
    typer.echo(f"{path}: check each entry against your cradle, then: cradle calibrate {path} --out DIR")


def _parse_bob_column(text: str) -> tuple[int, str]:
    """(1, "Angle 1") of "1=Angle 1"."""
    number, equals, name = text.partition("=")
    if not (equals and name and number.isdecimal() and number.isascii()):
        raise ValueError(f'--bob {text}: expected N=COLUMN, as --bob 1="Angle 1 (deg)"')
    return int(number), name


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
        typer.Option("--experiment", help="Also write experiment.toml with run1.csv, for calibrate: what the model's"
                     " instrument would show, with noise. Its stated parameters are the true ones."),
    ] = False,
    noise: Annotated[
        float | None, typer.Option(help="rad, 1 sigma of a reading, with --experiment.", show_default="0.001")
    ] = None,
    seed: Seed = 0,
    workers: NoWorkers = None,
) -> None:  # fmt: skip
    """Simulate one run: trajectory.csv, impacts.csv, summary.json and run.png."""
    from identification.cli import commands

    if experiment:
        noise = 1e-3 if noise is None else noise
    elif noise is not None:
        raise ValueError(f"noise is {noise:g} rad, but only an experiment has readings; add --experiment, or omit it")
    fields = {"bobs": bobs, "model": model, "beta": beta, "kappa": kappa, "k_f": k_f, "b": b}
    cradle, release = commands.parse_cradle_options(
        source, fields, delta, effect or [], set_ or [], angle=release_angle, lifted=lifted, start=start
    )
    with _say_what_is_kept(out, _nothing_kept):
        commands.simulate(cradle, release, duration, sample_rate, out, noise, seed)


@app.command()
def calibrate(
    experiment: Annotated[Path, typer.Argument(metavar="EXPERIMENT.toml", help="See `cradle new`.")],
    out: Out,
    steps: Annotated[int | None, typer.Option(help="Steps in all; until converged where omitted.")] = None,
    max_steps: Annotated[int, typer.Option(help="Give up beyond so many steps.")] = 20000,
    seed: Seed = 0,
    workers: Workers = None,
) -> int:
    """Infer a cradle's parameters and λ: summary.json, chain.h5, posterior.nc, pictures and report.html.

    The same command goes on where it was interrupted. Status 1 if the chains have not converged.
    """
    from identification.cli import commands

    def sampled() -> str:
        from identification.inference.checkpoint import count_kept_steps

        file = out / "chain.h5"
        return f"{count_kept_steps(file) or 'no'} steps are kept in {file}; the same command goes on"

    with _say_what_is_kept(out, sampled):
        return commands.calibrate(experiment, out, steps, max_steps, seed, workers)


@app.command()
def predict(
    calibration: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that `cradle calibrate` wrote.")],
    out: Out,
    delta: Annotated[float | None, typer.Option(help="δ; that of the experiment where omitted.")] = None,
    release_angle: Annotated[float | None, typer.Option(help="rad; likewise.")] = None,
    bobs: Annotated[int | None, typer.Option(help="Number of bobs; likewise.")] = None,
    draws: Annotated[int, typer.Option(min=2, help="Samples of the posterior to simulate.")] = 200,
    seed: Seed = 0,
    workers: Workers = None,
) -> None:
    """Predict σ(t) and λ of any cradle from a calibration: prediction.json, prediction.csv and prediction.png."""
    from identification.cli import commands

    with _say_what_is_kept(out, _nothing_kept):
        commands.predict(calibration, out, delta, release_angle, bobs, draws, seed, workers)


@app.command()
def diagnose(
    experiment: Annotated[Path, typer.Argument(metavar="EXPERIMENT.toml")],
    out: Out,
    seed: Seed = 0,
    workers: Workers = None,
) -> None:
    """Find what a model lacks, name it and add it: diagnosis.json, model.toml and report.html.

    The same command goes on where it was interrupted.
    """
    from identification.cli import commands

    with _say_what_is_kept(out, _same_command(f"{out / 'fits.json'} holds the fits that were finished")):
        commands.diagnose(experiment, out, seed, workers)


@app.command()
def reproduce(
    out: Out,
    only: Annotated[
        list[str] | None, typer.Option(metavar="FIGURE", help="A figure by its name, as fig7. Repeat at will.")
    ] = None,
    values: Annotated[int, typer.Option(help="Values of each parameter in the sweeps, at least 16.")] = 400,
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder that `cradle calibrate` wrote, whose uncertainty the bands show; an"
                     " example, simulated and calibrated here, where omitted."),
    ] = None,
    seed: Seed = 0,
    workers: Workers = None,
) -> None:  # fmt: skip
    """Make the figures of Lee & Hong from the equations, and judge their claims: claims.md, and a folder per figure.

    Each folder holds a picture as PDF and PNG and the tables behind it. The same command goes on where it was
    interrupted.
    """
    from identification.cli import commands

    with _say_what_is_kept(out, _same_command(f"{out} holds the figures that were finished")):
        commands.reproduce(out, only or [], values, calibration, seed, workers)


@app.command()
def sweep(
    out: Out,
    over: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUES", help="An axis: FIRST:LAST:COUNT, with :log evenly in the logarithm, or"
                     " numbers as 2,3,5. NAME: a number of Cradle, alpha, beta, gamma, delta,"
                     " release_angle, lifted, or EFFECT.KEY. κ stays as it is unless beta is an axis. Repeat"
                     " for a grid."),
    ] = None,
    quantity: Annotated[
        list[str] | None,
        typer.Option(help="lambda | synchronization_time | energy_share | overtaking_time |"
                     " impacts | sigma. Repeat at will.",
                     show_default="lambda"),
    ] = None,
    times: Annotated[
        str | None, typer.Option(metavar="VALUES", help="s, of σ(t), like an axis.", show_default="every second")
    ] = None,
    table: Annotated[str, typer.Option(metavar="NAME", help="In DIR; ends in .csv, .parquet or .nc.")] = "sweep.csv",
    explore: Annotated[
        bool, typer.Option("--explore", help="Also write explore.html, a page with a slider for each axis and the"
                           " cradle in motion. Without --over, for β and δ.")
    ] = False,
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
    """Simulate a grid of cradles: a table of λ and more, sweep.png and sweep.json.

    The same command goes on where it was interrupted.
    """
    from identification.cli import commands, sweep_command
    from identification.sweep.explore import AXES

    axes = tuple(over or ())
    fields = {"bobs": bobs, "model": model, "beta": beta, "kappa": kappa, "k_f": k_f, "b": b}
    cradle, release = commands.parse_cradle_options(
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
    with _say_what_is_kept(out, _same_command(f"{out / 'runs.npy'} holds the runs that were finished")):
        sweep_command.run(cradle, release, asked, duration, sample_rate, out, seed, workers)


@app.command()
def design(
    experiment: Annotated[Path, typer.Argument(metavar="EXPERIMENT.toml")],
    out: Out,
    between: Annotated[
        list[str] | None,
        typer.Option(metavar="EFFECT[+EFFECT]", help="A model to tell from others. Give two or more; λ is in question"
                     " where omitted."),
    ] = None,
    diagnosis: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of a diagnosis of this experiment: what it named is taken over, and"
                     " what it could not tell apart is in question."),
    ] = None,
    seed: Seed = 0,
    workers: Workers = None,
) -> None:  # fmt: skip
    """Plan the run that tells most: design.json, design.png, experiment.toml and report.html.

    The same command goes on where it was interrupted.
    """
    from identification.cli import commands

    with _say_what_is_kept(out, _same_command(f"{out / 'fits.json'} holds the fits that were finished")):
        commands.design(experiment, out, between or [], diagnosis, seed, workers)


@app.command()
def bench(
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for bench.json.")] = None,
    duration: Annotated[float, typer.Option(min=1.0, help="Simulated time of each race, s.")] = 20.0,
    seed: Annotated[int, typer.Option("--seed", hidden=True)] = 0,
    workers: NoWorkers = None,
) -> None:
    """Measure speed and accuracy against SciPy on this machine, on one core, as ratios."""
    from identification.bench import run

    with _say_what_is_kept(out, lambda: "nothing was written"):
        run.main(duration, out)


@app.command()
def warmup(seed: Annotated[int, typer.Option("--seed", hidden=True)] = 0, workers: NoWorkers = None) -> None:
    """Compile what simulations and environments run, once for this machine; else their first calls do."""
    from cradle_env.warmup import warm_up
    from identification.reporting.terminal import TerminalProgress

    with TerminalProgress() as progress:
        progress("compile", None, "half a minute on two cores, once")
        warm_up()


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command; its exit status."""
    for stream in (sys.stdout, sys.stderr):  # λ and δ become ? where a terminal cannot show them
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        return int(app(args=arguments, prog_name="cradle", standalone_mode=False) or 0)
    except _USAGE_ERROR as problem:
        return _exit_status(2, _usage_message(problem))
    except _InterruptedError as problem:
        return _exit_status(130, str(problem))
    except _FullDiskError as problem:
        return _exit_status(1, str(problem))
    except (KeyboardInterrupt, typer.Abort):
        return _exit_status(130, "interrupted")
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except _UNUSABLE as problem:
        return _exit_status(2, _one_line(problem))
    except (OSError, MemoryError) as problem:
        return _exit_status(1, _one_line(problem) or type(problem).__name__)
    except RuntimeError as problem:
        from cradle_env.simulation import SimulationError

        if not isinstance(problem, SimulationError):
            raise
        return _exit_status(1, str(problem))


def _usage_message(problem: Exception) -> str:
    """A mistake on the command line in one line, with the nearest that is right."""
    possible = getattr(problem, "possibilities", None)
    message = problem.format_message()  # type: ignore[attr-defined]
    if possible:
        message = message.partition("(")[0].strip() + f"; did you mean {possible[0]}?"
    return f"{message}{'' if message.endswith(('.', '?')) else '.'} See cradle --help."


def _one_line(problem: BaseException) -> str:
    if isinstance(problem, OSError) and problem.filename is not None:
        return f"{problem.filename}: {problem.strerror}"
    return str(problem)


def _exit_status(status: int, message: str) -> int:
    print("cradle:", " ".join(message.split()), file=sys.stderr)
    return status
