"""`cradle new`: a first experiment.toml for a data file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from identification.cli.options import NoWorkers


def new(
    data: Annotated[
        Path, typer.Argument(metavar="DATA", help="A table with a header, a ZIP of phyphox, or an export of Tracker.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR",
                     help="Folder, or a file name that ends in .toml. Default: the folder of the"
                     " data."),
    ] = None,
    time: Annotated[
        str | None, typer.Option("--time", metavar="COLUMN",
             help="Name of the time column, if its meaning is not clear.")
    ] = None,
    bob: Annotated[
        list[str] | None,
        typer.Option("--bob", metavar="N=COLUMN",
                     help="Name of the column of bob N. Other columns are ignored. May be repeated."),
    ] = None,
    unit: Annotated[
        list[str] | None,
        typer.Option("--unit", metavar="UNIT", help="s, ms, us; rad, mrad, deg; m, cm, mm, um; or as \"0.44 mm\", the"
                     " size of a pixel. Once for the times, once for the readings."),
    ] = None,
    rate: Annotated[
        float | None, typer.Option("--rate", help="Frames per second, if the table counts frames and has no times.")
    ] = None,
    run: Annotated[
        str | None, typer.Option("--run", metavar="NAME", help="Which run to read, of a table that holds several.")
    ] = None,
    mirror: Annotated[
        bool, typer.Option("--mirror", help="Change the sign of all readings. Positive must be towards the last bob.")
    ] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files that this command wrote.")] = False,
    seed: Annotated[int, typer.Option("--seed", hidden=True)] = 0,
    workers: NoWorkers = None,
) -> None:  # fmt: skip
    """Write a first experiment.toml for a data file, with guesses from the data to check and correct.

    The command prints how it understood the table. It never changes the data file.

    If the table is not in the strict form of an experiment, it writes a copy in that form beside experiment.toml.
    """
    from identification.experiment.scaffold import scaffold
    from identification.experiment.table_columns import Columns

    columns = Columns(time, dict(_parse_bob_column(text) for text in bob or ()), tuple(unit or ()), rate, run)
    path = scaffold(data, out, overwrite=overwrite, columns=columns, mirror=mirror, report=typer.echo)
    typer.echo(f"{path}: check each entry against your cradle, then: cradle calibrate {path} --out DIR")


def _parse_bob_column(text: str) -> tuple[int, str]:
    """Parse "1=Angle 1" into (1, "Angle 1")."""
    number, equals, name = text.partition("=")
    if not (equals and name and number.isdecimal() and number.isascii()):
        raise ValueError(f'--bob {text}: expected N=COLUMN, as --bob 1="Angle 1 (deg)"')
    return int(number), name
