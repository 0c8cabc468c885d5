"""`cradle measure KIND`: raw recordings of an instrument in, values with their uncertainty out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cradle_env.errors import check_range
from identification.cli.options import NoWorkers, Out, Seed

if TYPE_CHECKING:
    from cradle_env.cradle import Cradle
    from identification.apparatus.measurement import Measurement
    from identification.progress import Progress

measure = typer.Typer(help="Measure parameters with an instrument: measurement.json, a picture and report.html.")

From = Annotated[
    Path | None, typer.Option("--from", metavar="FILE", help="Take the cradle from an experiment.toml.")
]  # fmt: skip
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Set a number of Cradle, such as mass=0.2813. May be repeated."),
]
HiddenSeed = Annotated[int, typer.Option("--seed", hidden=True)]


@measure.callback()
def _kinds() -> None:
    pass


@measure.command()
def ringdown(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...",
                       help="CSV files of angles or displacements, or experiment.toml files, of which"
                       " all runs are read. In each file all bobs swing together."),
    ],
    out: Out,
    bobs: Annotated[
        list[int] | None,
        typer.Option(help="Number of bobs that swing together in a CSV file. Default: its number of columns."
                     " Give it once for each CSV file, in order."),
    ] = None,
    fit_from: Annotated[float | None, typer.Option(help="Ignore readings before this time, s.")] = None,
    fit_to: Annotated[float | None, typer.Option(help="Ignore readings after this time, s.")] = None,
    source: From = None,
    set_: Set = None,
    seed: HiddenSeed = 0,
    workers: NoWorkers = None,
) -> None:  # fmt: skip
    """Measure linear, quadratic and Coulomb damping of bobs that swing together, from their ring-downs."""
    from identification.apparatus.ringdown.measure import measure_ringdown

    cradle = _cradle(source, set_)
    _run(
        "ringdown",
        out,
        lambda progress: measure_ringdown(
            files, cradle, bobs=bobs, fit_from=fit_from, fit_to=fit_to, progress=progress
        ),
    )


@measure.command()
def string(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...", help="CSV files with columns displacement [mm] and force [N], and t [s] if"
                       " the speed matters."),
    ],
    out: Out,
    seed: HiddenSeed = 0,
    workers: NoWorkers = None,
) -> None:  # fmt: skip
    """Measure stiffness κ and hysteresis of a string from force-displacement cycles."""
    from identification.apparatus.string.measure import measure_string

    _run("string", out, lambda progress: measure_string(files, progress=progress))


@measure.command()
def impacts(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...", help="Tables with columns v1 [m/s] and v3 [m/s] (the third of three bobs,"
                       " after the impact), or v [m/s] and duration [us] of two; or recordings of bobs."),
    ],
    out: Out,
    source: From = None,
    set_: Set = None,
    seed: Seed = 0,
    workers: NoWorkers = None,
) -> None:  # fmt: skip
    """Measure k_f and e(v) of a contact from speeds before and after impacts and from contact durations."""
    from identification.apparatus.impacts.measure import measure_impacts

    cradle = _cradle(source, set_)
    _run("impacts", out, lambda progress: measure_impacts(files, cradle, seed=seed, progress=progress))


@measure.command()
def contacts(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...", help="Traces: CSV of an oscilloscope, NumPy, WAV, or numbers behind a line of JSON."
        ),
    ],
    out: Out,
    bobs: Annotated[int, typer.Option(min=2, help="Number of bobs in the circuit.")],
    supply: Annotated[float, typer.Option(help="Voltage of the source, V.")],
    step: Annotated[float, typer.Option(help="Smallest resistor, Ω. The others are 2, 4, … times as large.")] = 11.0,
    shunt: Annotated[float, typer.Option(help="Resistor across the oscilloscope, Ω.")] = 22.0,
    rate: Annotated[float | None, typer.Option(help="Sample rate in 1/s, if a file does not state it.")] = None,
    channel: Annotated[int | None, typer.Option(help="Which channel of a CSV that has several, from 1.")] = None,
    speed: Annotated[
        list[float] | None,
        typer.Option(
            help="m/s, of the first impact of a trace: durations then give k_f. Once for each file, in order."
        ),
    ] = None,
    speed_sd: Annotated[float | None, typer.Option(help="m/s, standard deviation of these speeds.")] = None,
    source: From = None,
    set_: Set = None,
    seed: HiddenSeed = 0,
    workers: NoWorkers = None,
) -> None:
    """Measure which bobs touch, when and for how long, from oscilloscope traces of the contact resistance."""
    from identification.apparatus.contacts.circuit import Circuit
    from identification.apparatus.contacts.measure import TABLE, measure_contacts

    cradle, circuit = _cradle(source, set_), Circuit.binary(bobs, supply, step, shunt)
    _run(
        "contacts",
        out,
        lambda progress: measure_contacts(
            files, circuit, cradle, rate=rate, channel=channel, speeds=speed, speed_sd=speed_sd, progress=progress
        ),
        TABLE,
    )


@measure.command()
def sound(
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="WAV, FLAC, OGG or MP3, as a phone makes it.")],
    out: Out,
    seed: HiddenSeed = 0,
    workers: NoWorkers = None,
) -> None:
    """Measure when bobs hit each other, and how hard, from a recording of the sound: clicks.csv for calibrate."""
    from identification.apparatus.sound.measure import TABLE, measure_sound

    _run("sound", out, lambda progress: measure_sound(recording, progress=progress), TABLE)


@measure.command()
def video(
    film: Annotated[Path, typer.Argument(metavar="FILM", help="MP4, MOV, AVI, WebM, GIF, or a folder of images.")],
    out: Out,
    diameter: Annotated[
        float | None, typer.Option(help="m, of a bob; sets the scale. Else that of --from or --set radius=.")
    ] = None,
    bobs: Annotated[int | None, typer.Option(min=1, help="How many; counted where omitted.")] = None,
    box: Annotated[
        list[str] | None,
        typer.Option(metavar="X,Y,WIDTH,HEIGHT", help="Around a bob in the first frame [pixels]. Once for each bob."),
    ] = None,
    click: Annotated[
        list[str] | None,
        typer.Option(metavar="X,Y", help="A point on a bob in the first frame [pixels]. Once for each bob."),
    ] = None,
    slow_motion: Annotated[float, typer.Option(help="By which factor the film plays too slowly.")] = 1.0,
    rate: Annotated[
        float | None, typer.Option(help="Frames per second as played, instead of the file's times.")
    ] = None,
    source: From = None,
    set_: Set = None,
    seed: HiddenSeed = 0,
    workers: NoWorkers = None,
) -> None:  # fmt: skip
    """Angles of the bobs from a film: experiment.toml and run1.csv for calibrate, and overlay.mp4 to look at."""
    import os

    from identification.apparatus.video.measure import measure_video

    if diameter is not None:
        check_range("--diameter", diameter, "m", 0.0, above=True)
    settings = [*(set_ or []), *([] if diameter is None else [f"radius={diameter / 2.0!r}"])]
    cradle = _cradle(source, settings)
    known = {text.partition("=")[0] for text in settings}
    if cradle is None or (source is None and "radius" not in known):
        raise ValueError("the scale is not known; state the diameter of a bob, as --diameter 0.04, in m")
    length = cradle.length if source is not None or "length" in known else None
    part = out / f".overlay.mp4.{os.getpid()}.part"
    boxes = [(x, y, width, height) for x, y, width, height in (_numbers("--box", text, 4) for text in box or ())]
    clicks = [(x, y) for x, y in (_numbers("--click", text, 2) for text in click or ())]
    try:
        _run(
            "video",
            out,
            lambda progress: measure_video(
                film, cradle, bobs=bobs, boxes=boxes, clicks=clicks, slow_motion=slow_motion, rate=rate,
                stated_length=length, overlay=part, progress=progress,
            ),
            "experiment.toml", "run1.csv", "overlay.mp4",
        )  # fmt: skip
    finally:
        part.unlink(missing_ok=True)


def _numbers(option: str, text: str, count: int) -> tuple[float, ...]:
    """(10.0, 20.0) of "10,20"."""
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if len(found) != count:
        raise ValueError(f"{option} {text}: expected {count} numbers with commas between them, in pixels")
    return found


def _run(kind: str, out: Path, work: Callable[[Progress], Measurement], *tables: str) -> None:
    """Measure, write the results into the locked folder and print them."""
    from identification.apparatus.measurement_files import check_folder, save
    from identification.number_format import format_statistics, rounding_of, unit_plain
    from identification.reporting.terminal import TerminalProgress, print_table
    from identification.storage.lock import lock_folder

    with lock_folder(out):
        check_folder(out, kind, tables)
        with TerminalProgress() as progress:
            measured = work(progress)
            progress("draw", None)
            content = save(measured, out)
    rows = []
    for name, entry in content["values"].items():
        text = format_statistics(entry)
        rows.append((name, f"{text['median']} ± {text['sd']}", text["ci95"],
                     unit_plain(entry["unit"], rounding_of(entry).exponent)))  # fmt: skip
    print_table(("value", "median ± sd", "95 % interval", "unit"), rows)
    for finding in measured.findings:
        print(finding)
    for warning in measured.warnings:
        print(f"cradle: {warning}", file=sys.stderr)
    print(f"report: {out / 'report.html'}")


def _cradle(source: Path | None, settings: list[str] | None) -> Cradle | None:
    """Build the cradle that a command line states; None if it states none."""
    from cradle_env.cradle import Cradle
    from identification.cli.cradle_options import parse_setting
    from identification.experiment.experiment import Experiment

    if source is None and not settings:
        return None
    cradle = Cradle() if source is None else Experiment.load(source).cradle
    return cradle.replace(**dict(parse_setting(text) for text in settings or ()))
