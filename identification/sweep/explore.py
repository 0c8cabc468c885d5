"""A page to explore a sweep: a slider for each axis, the moving cradle, and σ(t)."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.parameter_name import ParameterName
from cradle_env.plot_style import BLUE, RED
from cradle_env.synchronization import ENVELOPE_PERIODS, FLOOR
from cradle_env.trajectory import Trajectory
from identification.number_format import markup, unit_markup
from identification.reporting.html_page import render
from identification.sweep.engine import sweep
from identification.sweep.grid import Grid
from identification.sweep.quantities import Quantity
from identification.sweep.sweep_result import SweepResult

if TYPE_CHECKING:
    from identification.progress import Progress

#: Default axes of the page. With five bobs and 60 s it has 8 MB.
AXES: Mapping[str, np.ndarray] = {"beta": np.linspace(0.05, 0.33, 29), "delta": np.linspace(-0.02, 0.02, 11)}
#: Positions per second.
RATE = 30
#: Number of positions for each stored σ.
SIGMA_EVERY = 6
#: The largest page [bytes].
LARGEST = 10e6
#: Integer steps per unit of log10 σ.
_SIGMA_STEPS = 8000
#: Smallest stored σ.
_LEAST_SIGMA = FLOOR / 10.0


@dataclass(frozen=True)
class _Angle:
    """θ of one bob, by its index; nan if the cradle has fewer bobs."""

    bob: int

    def __call__(self, run: Trajectory) -> np.ndarray:
        return run.theta[:, self.bob] if self.bob < run.cradle.bobs else np.full(len(run.t), np.nan)


def _most_bobs(grid: Grid) -> int:
    axis = next((axis for axis in grid.axes if "bobs" in axis.columns), None)
    return grid.cradle.bobs if axis is None else int(axis.columns["bobs"].max())


def check_size(grid: Grid, duration: float) -> None:
    """Raise ValueError if the page of a grid would be too large to open."""
    run = _most_bobs(grid) * duration * RATE * 8.0 / 3.0
    if len(grid) * run > LARGEST:
        raise ValueError(
            f"a page of {len(grid)} runs of {duration:g} s is too large; a page may have at most"
            f" {int(LARGEST / run)} such runs ({LARGEST / 1e6:g} MB); give fewer values or a shorter --duration"
        )


def explore_html(
    grid: Grid,
    *,
    duration: float = 60.0,
    sample_rate: float = 240.0,
    out: str | Path | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> str:
    """Simulate every point of the grid and write a page that works offline, with 30 positions per second.

    The page stores angles in steps of 1/32767 of the largest one.

    Parameters
    ----------
    grid : Grid
        Axes, cradle and release.
    duration, sample_rate, out, workers, progress
        As in `sweep`.

    Returns
    -------
    str
        The page as HTML.

    Raises
    ------
    ValueError
        If the page would be too large to open.
    """
    check_size(grid, duration)
    angles = [Quantity(f"theta_{i + 1}", "θ", "rad", "angle", _Angle(i), series=True) for i in range(_most_bobs(grid))]
    times = np.arange(int(duration * RATE) + 1) / RATE
    swept = sweep(
        grid, ("lambda", "sigma", *angles), duration=duration, sample_rate=sample_rate, times=times, out=out,
        workers=workers, progress=progress,
    )  # fmt: skip
    # nan if a run has fewer bobs, or if there is no run.
    scale = float(np.fmax.reduce([np.fmax.reduce(np.abs(swept[q.name]), axis=None) for q in angles])) / 32767.0
    runs = [_run(swept, index, scale) for index in range(len(grid))]
    widest = max(run["pivots"][-1] for run in runs if run["theta"])
    content = {
        "axes": [_axis(grid, k) for k in range(len(grid.axes))],
        "runs": runs,
        "times": {"rate": RATE, "count": len(times), "sigmaEvery": SIGMA_EVERY},
        "thetaScale": scale,
        "thetaLargest": 32767.0 * scale,
        "sigmaSteps": _SIGMA_STEPS,
        "widest": widest,
        "colours": {"sigma": BLUE, "decay": RED},
    }
    return render(
        "explore.html",
        title="A Newton's cradle to explore",
        content=content,
        cradle=grid.cradle,
        axes=[(*content["axes"][k].values(), k) for k in range(len(grid.axes))],
        count=len(grid),
        rate=RATE,
        duration=duration,
    )


def _axis(grid: Grid, k: int) -> dict[str, Any]:
    """An axis for the page: symbol and unit as HTML, name as plain text, formatted values, index of the first value."""
    axis = grid.axes[k]
    unit, symbol = axis.unit_and_symbol
    here = _stated_value(grid, ParameterName.parse(axis.name)) if axis.name in axis.columns else None
    return {
        "symbol": markup(symbol),
        "unit": unit_markup(unit),
        "name": symbol.replace("_", ""),
        "values": [f"{value:.6g}".replace("-", "−") for value in axis.values],
        "start": int(np.argmin(np.abs(axis.values - here))) if here is not None else 0,
    }


def _stated_value(grid: Grid, name: ParameterName) -> float | None:
    """Value of a parameter in the cradle and the release of the grid; None if it is not a single number."""
    cradle, release = grid.cradle, grid.release
    stated = {"release_angle": release.lead(cradle)[1], "gamma": release.gamma(cradle), "lifted": release.bobs}
    if name.element is not None:
        return None
    if name.effect:
        value = cradle.effects.get(name.effect, {}).get(name.key)
    else:
        value = stated.get(name.key, getattr(cradle, name.key, None))
    return float(value) if isinstance(value, float | int) else None


def _run(swept: SweepResult, index: int, scale: float) -> dict[str, Any]:
    """One run for the page: θ in integer steps, bob by bob, and log10 σ in integer steps, both int16 in base64."""
    problem = swept.problems(index, index + 1)[0]
    if problem:
        return {
            "problem": problem,
            "theta": "",
            "sigma": "",
            "lambda": None,
            "pivots": [],
            "length": 1.0,
            "radius": 0.1,
        }
    row = swept.rows[index]
    cradle: Cradle = swept.plan.grid.point(index)[0]
    theta = np.column_stack([row[f"theta_{i + 1}"] for i in range(cradle.bobs)])
    whole = swept.plan.times <= swept.plan.duration - 0.5 * ENVELOPE_PERIODS * cradle.period  # else envelopes are cut
    sigma = np.log10(np.fmax(row["sigma"][whole][::SIGMA_EVERY], _LEAST_SIGMA))
    rate = float(row["lambda"])
    return {
        "problem": "",
        "theta": _base64(theta / scale),
        "sigma": _base64(sigma * _SIGMA_STEPS),
        "lambda": rate if np.isfinite(rate) else None,
        "pivots": cradle.pivots.round(7).tolist(),
        "length": cradle.length,
        "radius": cradle.radius,
    }


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(np.rint(values).astype("<i2").tobytes()).decode()
