"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Out = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the results; made if need be.")]
Seed = Annotated[int, typer.Option("--seed", min=0, max=2**32 - 1, help="Seed of all random numbers.")]
Workers = Annotated[int | None, typer.Option("--workers", min=1, help="Threads; all cores where omitted.")]
NoWorkers = Annotated[int | None, typer.Option("--workers", hidden=True)]

# A cradle, its release and how long it swings, for every command that simulates one.
Bobs = Annotated[int | None, typer.Option(help="Number of bobs.", show_default="5")]
Delta = Annotated[
    str | None, typer.Option(metavar="NUMBER", help="δ = d/2R − 1, or one per gap as 0,0.001.", show_default="0")
]
Angle = Annotated[float | None, typer.Option(help="rad.", show_default="0.228")]
Lifted = Annotated[int | None, typer.Option(help="Bobs lifted together.", show_default="1")]
Start = Annotated[str | None, typer.Option(help="unstretched | hanging: the lifted bobs' strings.")]
Model = Annotated[str | None, typer.Option(help="ho | pendulum | nsp, or a model.toml.", show_default="nsp")]
Beta = Annotated[float | None, typer.Option(help="β, which sets κ.", show_default="0.114")]
Kappa = Annotated[float | None, typer.Option(help="κ in N/m, instead of β.", show_default=False)]
KF = Annotated[float | None, typer.Option("--k-f", help="k_f in N s m^-3/2.", show_default=False)]
B = Annotated[float | None, typer.Option("--b", help="Linear drag in kg/s.", show_default=False)]
Effects = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME.KEY=VALUE",
        help="An effect's parameter; as 0.1,-0.1 for each bob or gap; =-NAME takes one out. Repeat at will.",
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Any other number of Cradle, as length=0.25. Repeat at will."),
]
Source = Annotated[
    Path | None,
    typer.Option("--from", metavar="FILE", help="Take cradle and first release from an experiment.toml;"
                 " the options above then change them. What it leaves open, a release or an effect's parameter, is"
                 " told with the value taken for it."),
]  # fmt: skip
Duration = Annotated[float, typer.Option(help="s")]
SampleRate = Annotated[float, typer.Option(help="1/s")]

# What `cradle sweep` asks for.
Over = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUES",
        help="An axis: FIRST:LAST:COUNT, with :log evenly in the logarithm, or"
        " numbers as 2,3,5. NAME: a number of Cradle, alpha, beta, gamma, delta,"
        " release_angle, lifted, or EFFECT.KEY. κ stays as it is unless beta is an axis. Repeat"
        " for a grid.",
    ),
]
Quantities = Annotated[
    list[str] | None,
    typer.Option(
        help="lambda | synchronization_time | energy_share | overtaking_time | impacts | sigma. Repeat at will.",
        show_default="lambda",
    ),
]
Times = Annotated[
    str | None, typer.Option(metavar="VALUES", help="s, of σ(t), like an axis.", show_default="every second")
]
Table = Annotated[str, typer.Option(metavar="NAME", help="In DIR; ends in .csv, .parquet or .nc.")]
Explore = Annotated[
    bool,
    typer.Option(
        "--explore",
        help="Also write explore.html, a page with a slider for each axis and the"
        " cradle in motion. Without --over, for β and δ.",
    ),
]
