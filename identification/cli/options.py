"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Out = Annotated[
    Path,
    typer.Option("--out", metavar="DIR", help="Folder for the results. The command creates it if it does not exist."),
]
Seed = Annotated[int, typer.Option("--seed", min=0, max=2**32 - 1, help="Seed of all random numbers.")]
Workers = Annotated[int | None, typer.Option("--workers", min=1, help="Number of threads. Default: all cores.")]
NoWorkers = Annotated[int | None, typer.Option("--workers", hidden=True)]

# A cradle, its release and how long it swings, for every command that simulates one.
Bobs = Annotated[int | None, typer.Option(help="Number of bobs.", show_default="5")]
Delta = Annotated[
    str | None,
    typer.Option(metavar="NUMBER", help="δ = d/2R − 1. One number, or one for each gap: 0,0.001.", show_default="0"),
]
Angle = Annotated[float | None, typer.Option(help="Release angle in rad.", show_default="0.228")]
Lifted = Annotated[int | None, typer.Option(help="Number of bobs lifted together.", show_default="1")]
Start = Annotated[str | None, typer.Option(help="unstretched | hanging: length of the lifted bobs' strings.")]
Model = Annotated[str | None, typer.Option(help="ho | pendulum | nsp, or a model.toml.", show_default="nsp")]
Beta = Annotated[float | None, typer.Option(help="β, which sets κ.", show_default="0.114")]
Kappa = Annotated[float | None, typer.Option(help="κ in N/m, instead of β.", show_default=False)]
KF = Annotated[float | None, typer.Option("--k-f", help="k_f in N s m^-3/2.", show_default=False)]
B = Annotated[float | None, typer.Option("--b", help="Linear drag in kg/s.", show_default=False)]
Effects = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME.KEY=VALUE",
        help="Set a parameter of an effect: one number, or one for each bob or gap as 0.1,-0.1. =-NAME removes an"
        " effect. May be repeated.",
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="NAME=VALUE", help="Set another number of Cradle, such as length=0.25. May be repeated."
    ),
]
Source = Annotated[
    Path | None,
    typer.Option("--from", metavar="FILE", help="Take the cradle and the first release from an experiment.toml. The"
                 " options above change them. Missing values (release, effect parameters) take defaults, which are"
                 " printed."),
]  # fmt: skip
Duration = Annotated[float, typer.Option(help="Simulated time in s.")]
SampleRate = Annotated[float, typer.Option(help="Samples per second.")]

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
