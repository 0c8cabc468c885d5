"""Pictures of a sweep: curves over one axis, maps over two, panels of them over more."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env.plot_style import bob_styles, quiet_grid, styled
from identification.number_format import mathtext, unit_mathtext
from identification.sweep.grid import Axis, Grid
from identification.sweep.quantities import Quantity
from identification.sweep.sweep_result import SweepResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: A second axis with at most this many values makes curves, not a map. Largest number of panels on a page.
_MOST_CURVES, _MOST_PANELS = 5, 12
#: Colour of points that cannot be simulated.
_IMPOSSIBLE_COLOUR = "#D9D9D9"


def label(symbol: str, unit: str) -> str:
    """Axis label of a quantity: a symbol in mathematical type, words as they are."""
    text = mathtext(symbol) if re.fullmatch(r"\w(_\w+)?(\[\d+\])?", symbol) else symbol
    return text + unit_mathtext(unit)


def _axis_label(axis: Axis) -> str:
    unit, symbol = axis.unit_and_symbol
    return label(symbol, unit)


@styled
def sweep_figure(swept: SweepResult) -> Figure:
    """Draw each quantity of a sweep in a row of panels.

    A panel has curves over the longest axis, one for each value of a short second axis. With two long axes, or with
    time as the second one, it has a map. Each combination of the further axes has a panel; if there are too many,
    evenly spaced ones are drawn.

    Parameters
    ----------
    swept : SweepResult
        A finished sweep.

    Returns
    -------
    matplotlib.figure.Figure
        A figure that belongs to no window.
    """
    from matplotlib.figure import Figure

    grid, quantities = swept.plan.grid, swept.plan.quantities
    order = sorted(range(len(grid.axes)), key=lambda k: -grid.shape[k])
    rows = [_Row(swept, q, order[: 1 if q.series else 2]) for q in quantities]
    most = max(len(row.panels) for row in rows)
    columns = min(most, 4)
    lines = [math.ceil(len(row.panels) / columns) for row in rows]
    width = 6.4 if columns == 1 else 3.1 * columns + 0.8
    figure = Figure(figsize=(width, 3.4 * sum(lines)), layout="constrained")
    parts: Any = figure.subfigures(len(rows), 1, height_ratios=lines, squeeze=False)
    for part, row, height in zip(parts[:, 0], rows, lines, strict=True):
        panels = part.subplots(height, columns, squeeze=False, sharex=True, sharey=True)
        row.draw(panels.ravel(), part)
    return figure


class _Row:
    """One quantity of a sweep. Each panel draws the axes in `drawn` at one combination of the other axes."""

    def __init__(self, swept: SweepResult, quantity: Quantity, drawn: list[int]) -> None:
        self.grid, self.quantity = swept.plan.grid, quantity
        others = [k for k in range(len(self.grid.axes)) if k not in drawn]
        shape = tuple(self.grid.shape[k] for k in others)
        count = math.prod(shape)
        chosen = np.unique(np.linspace(0, count - 1, min(count, _MOST_PANELS)).round().astype(int))
        self.panels = [np.unravel_index(i, shape) for i in chosen] if shape else [()]
        self.others, self.left_out = others, count - len(chosen)
        values = np.moveaxis(swept[quantity.name], (*others, *drawn), range(len(self.grid.axes)))
        self.axes = []
        for place, axis in enumerate((self.grid.axes[k] for k in drawn), len(others)):
            rising = np.argsort(axis.values)
            self.axes.append(Axis(axis.name, {name: column[rising] for name, column in axis.columns.items()}))
            values = np.take(values, rising, place)
        self.times = np.sort(swept.plan.times)
        if quantity.series:
            values = np.take(values, np.argsort(swept.plan.times), -1)
        self.values = np.array([values[tuple(panel)] for panel in self.panels])

    def draw(self, panels: np.ndarray, figure: Any) -> None:
        """Draw every panel, and one colour bar for all maps."""
        name = label(self.quantity.symbol, self.quantity.unit)
        second = self.axes[1] if len(self.axes) == 2 else None
        image = None
        map_of = self.quantity.series or (second is not None and len(second) > _MOST_CURVES)
        for axes, panel, values in zip(panels, self.panels, self.values, strict=False):
            axes.set_xlabel(_axis_label(self.axes[0]))
            axes.set_title(_panel_title(self.grid, self.others, panel))
            if map_of:
                image = self._map(axes, values)
            else:
                self._curves(axes, values, second)
                axes.set_ylabel(name)
        for axes in panels[len(self.panels) :]:
            axes.set_axis_off()
        if image is not None:
            figure.colorbar(image, ax=list(panels), label=name, pad=0.01)
        notes = []
        if self.left_out:
            notes.append(f"{len(self.panels)} of {len(self.panels) + self.left_out} combinations")
        if map_of and not np.isfinite(self.values).all():
            notes.append("grey: no value")
        if notes:
            figure.suptitle("; ".join(notes), fontsize=8)

    def _curves(self, axes: Axes, values: np.ndarray, second: Axis | None) -> None:
        """Draw one curve for values (n,), or several for values (n, few)."""
        x = self.axes[0].values
        several = [("", values)]
        if second is not None:
            several = [(_format_coordinate(second, i), values[:, i]) for i in range(len(second))]
        marker = "." if len(x) <= 60 else None
        for (text, line), style in zip(several, bob_styles(len(several)), strict=True):
            axes.plot(x, line, marker=marker, label=text, **style)
        if not np.isfinite(values).any():
            axes.text(0.5, 0.5, "no value", ha="center", va="center", transform=axes.transAxes)
        if second is not None:
            axes.legend()
        _scale(axes.set_xscale, x)
        if not np.isfinite(self.values).any():  # no curve sets the limits
            axes.set(xlim=_edges(x)[[0, -1]], yticks=[])
        quiet_grid(axes)

    def _map(self, axes: Axes, values: np.ndarray) -> Any:
        """Draw values (n, m) against the second axis or time, with impossible points in grey."""
        x, y = self.axes[0].values, self.times if self.quantity.series else self.axes[1].values
        low, high = _limits(self.values)
        axes.set_facecolor(_IMPOSSIBLE_COLOUR)
        image = axes.pcolormesh(
            _edges(x), _edges(y), values.T, cmap="viridis", vmin=low, vmax=high, rasterized=True
        )  # fmt: skip
        _scale(axes.set_xscale, x)
        if self.quantity.series:
            axes.set_ylabel("time [s]")
        else:
            axes.set_ylabel(_axis_label(self.axes[1]))
            _scale(axes.set_yscale, y)
        return image


def _panel_title(grid: Grid, others: list[int], panel: tuple) -> str:
    return ", ".join(_format_coordinate(grid.axes[k], int(i)) for k, i in zip(others, panel, strict=True))


def _format_coordinate(axis: Axis, i: int) -> str:
    """Format a value of an axis, such as "β = 0.114"."""
    unit, symbol = axis.unit_and_symbol
    told = f"{label(symbol, '1')} = {axis.values[i]:.4g}{'' if unit == '1' else ' ' + unit}"
    return told.replace("-", "−")


def _limits(values: np.ndarray) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)


def _geometric(x: np.ndarray) -> bool:
    """Whether values are evenly spaced in their logarithm, over at least half a decade."""
    return len(x) > 2 and x[0] > 0.0 and x[-1] > 3.0 * x[0] and np.ptp(np.diff(np.log(x))) < 1e-6


def _scale(set_scale: Any, x: np.ndarray) -> None:
    if _geometric(x):
        set_scale("log")


def _edges(x: np.ndarray) -> np.ndarray:
    """Borders (n + 1,) of the cells around n points, halfway between them, evenly spaced or not."""
    if len(x) == 1:
        return np.array([x[0] - 0.5, x[0] + 0.5])
    logarithmic = _geometric(x)
    u = np.log(x) if logarithmic else x
    middle = 0.5 * (u[1:] + u[:-1])
    edges = np.concatenate([[2.0 * u[0] - middle[0]], middle, [2.0 * u[-1] - middle[-1]]])
    return np.exp(edges) if logarithmic else edges
