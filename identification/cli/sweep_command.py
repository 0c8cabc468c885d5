"""The work of `cradle sweep`: from parsed options to files and printed tables."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cradle_env import __version__
from cradle_env.cradle import Cradle
from cradle_env.parameter_name import ParameterName
from cradle_env.plot_style import png
from cradle_env.release import Release
from identification.inference.unknowns import matters
from identification.number_format import format_number, unit_plain
from identification.reporting.result_files import cradle_values, release_values
from identification.reporting.terminal import TerminalProgress, print_table
from identification.storage.lock import locks_output
from identification.storage.stamps import check_replaceable, write_results
from identification.sweep import explore
from identification.sweep.engine import sweep
from identification.sweep.figure import sweep_figure
from identification.sweep.grid import Grid, unit_and_symbol
from identification.sweep.quantities import QUANTITIES
from identification.sweep.store import FORMAT
from identification.sweep.sweep_result import SweepResult
from identification.sweep.tables import check_table

#: Largest number of values on an axis; more are a typing error.
_MAX_VALUES = 10_000_000
#: The file that describes a finished sweep, and the other files beside its table.
_STAMP, _PICTURE, _PAGE = "sweep.json", "sweep.png", "explore.html"
#: The parameter that a group of the paper sets, for those that a cradle may ignore.
_SETS = {"beta": "kappa"}


@dataclass(frozen=True)
class SweepRequest:
    """A sweep as the command line states it.

    over: axes as "name=values"; times: "values" in s; table: a file name; explore: whether to write explore.html.
    """

    over: Sequence[str]
    quantities: Sequence[str]
    times: str | None
    table: str
    explore: bool


def parse_axis(text: str) -> tuple[str, np.ndarray]:
    """Parse "beta=0.05:0.4:400", "k_f=1e3:1e5:50:log" or "bobs=2,3,5" into a name and its values."""
    name, equals, values = text.partition("=")
    if not equals:
        raise ValueError(f"--over {text}: expected NAME=VALUES, as beta=0.05:0.4:400 or bobs=2,3,5")
    return name, parse_values(f"--over {text}", values)


def parse_values(at: str, text: str) -> np.ndarray:
    """Parse "FIRST:LAST:COUNT", "FIRST:LAST:COUNT:log" or "2,3,5" into values; at: the option, for errors."""
    ranged = text.removesuffix(":log")
    try:
        if ":" not in ranged:
            return np.array([float(part) for part in text.split(",")])
        first, last, count = ranged.split(":")
        low, high, many = float(first), float(last), int(count)
    except ValueError:
        raise ValueError(f"{at}: expected FIRST:LAST:COUNT, FIRST:LAST:COUNT:log or numbers as 2,3,5") from None
    if not 1 <= many <= _MAX_VALUES:
        raise ValueError(f"{at}: {many} values; the count must be from 1 to {_MAX_VALUES}")
    if ranged != text and not (low > 0.0 and high > 0.0):
        raise ValueError(f"{at}: a logarithmic axis goes from one positive number to another")
    return np.geomspace(low, high, many) if ranged != text else np.linspace(low, high, many)


@locks_output
def run(
    cradle: Cradle,
    release: Release,
    asked: SweepRequest,
    duration: float,
    sample_rate: float,
    out: Path,
    seed: int,
    workers: int | None,
) -> None:
    """Run the sweep and write its table, picture, summary and, on request, page."""
    check_table(out / asked.table)
    if Path(asked.table).name != asked.table:
        raise ValueError(f"--table {asked.table}: expected a name alone; --out names the folder")
    check_replaceable(out, (_STAMP, asked.table, _PICTURE, *([_PAGE] if asked.explore else [])), _STAMP, FORMAT)
    axes = _axes(asked)
    grid = Grid(axes, cradle, release)
    for name in _ignored_axes(grid):
        told = f"model {cradle.model}, {cradle.bobs} bob{'s' if cradle.bobs > 1 else ''}"
        print(f"cradle: {name} does not matter to this cradle ({told}); along it all runs are alike", file=sys.stderr)
    times = None if asked.times is None else parse_values(f"--times {asked.times}", asked.times)
    if asked.explore:
        explore.check_size(grid, duration)
    with TerminalProgress() as progress:
        progress("sweep", None, "the first run after installation compiles for some seconds")
        settings: dict[str, Any] = {"duration": duration, "sample_rate": sample_rate, "workers": workers}
        swept = sweep(grid, asked.quantities, times=times, out=out, progress=progress, **settings)
        files: dict[str, str | bytes | Path] = {_PICTURE: png(sweep_figure(swept))}
        if asked.explore:
            report = lambda _, fraction, text: progress("page", fraction, text)  # noqa: E731
            files[_PAGE] = explore.explore_html(grid, out=out / "explore", progress=report, **settings)
        progress("write", None, asked.table)
        with TemporaryDirectory(dir=out) as scratch:
            files[asked.table] = swept.save(Path(scratch) / asked.table)
            content = write_results(out, files, _STAMP, _summary(swept, seed))
    rows = []
    for name, found in content["quantities"].items():
        unit = unit_plain(QUANTITIES[name].unit)
        ends = [found[end] for end in _ENDS if found.get(end)]
        if ends:
            told = (f"{format_number(end['value'], 4)} {unit} at {_format_point(end['at'])}" for end in ends)
            rows.append((QUANTITIES[name].symbol, *told))
        elif not QUANTITIES[name].series:
            rows.append((QUANTITIES[name].symbol, "–", "–"))
    if rows:
        print_table(("quantity", *_ENDS), rows)
    for reason, count in content["impossible"].items():
        print(f"{count} of {len(grid)} points cannot be simulated; the first: {reason}")
    print(f"table: {out / asked.table}")
    print(f"picture: {out / _PICTURE}")
    if asked.explore:
        print(f"page: {out / _PAGE}")


_ENDS = ("least", "largest")


def _axes(asked: SweepRequest) -> Mapping[str, np.ndarray]:
    if not asked.over and asked.explore:
        return explore.AXES
    axes: dict[str, np.ndarray] = {}
    for text in asked.over:
        name, values = parse_axis(text)
        if name in axes:
            raise ValueError(f"--over {name} is given twice; leave one out")
        axes[name] = values
    return axes


def _ignored_axes(grid: Grid) -> list[str]:
    """Names of swept parameters that have no effect on this cradle."""
    if "bobs" in grid.names:
        return []
    wholes = {name: str(ParameterName.parse(name).whole) for name in grid.names}
    return [name for name, whole in wholes.items() if not matters(grid.cradle, _SETS.get(whole, whole))]


def _format_point(at: dict[str, float]) -> str:
    return ", ".join(f"{unit_and_symbol(name)[1]} = {value:.6g}" for name, value in at.items())


def _summary(swept: SweepResult, seed: int) -> dict[str, Any]:
    """Build sweep.json: the axes, and the least and largest value of each quantity with its place."""
    plan = swept.plan
    quantities: dict[str, dict[str, Any]] = {}
    for q in plan.quantities:
        quantities[q.name] = {"unit": q.unit, "meaning": q.meaning}
        if q.series:
            continue
        values = swept[q.name].ravel()
        for end, find in zip(_ENDS, (np.nanargmin, np.nanargmax), strict=True):
            quantities[q.name][end] = None
            if np.isfinite(values).any():
                index = int(find(values))
                at = zip(plan.grid.names, plan.grid.values(np.array([index]))[0], strict=True)
                quantities[q.name][end] = {"value": values[index], "at": dict(at)}
    return {
        "format": FORMAT,
        "version": __version__,
        "seed": seed,
        "inputs": plan.digest(),
        "cradle": cradle_values(plan.grid.cradle),
        "release": release_values(plan.grid.release),
        "axes": {
            axis.name: {
                "unit": axis.unit_and_symbol[0],
                "first": axis.values[0],
                "last": axis.values[-1],
                "count": len(axis),
            }
            for axis in plan.grid.axes
        },
        "duration_s": plan.duration,
        "runs": len(plan.grid),
        "quantities": quantities,
        "impossible": swept.failures(),
    }
