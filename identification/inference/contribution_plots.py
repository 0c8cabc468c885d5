"""The picture of what each source contributes to a joint posterior: intervals of each alone, of all, without each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env.plot_style import BLACK, BLUE, GREY, RED, SKY, styled
from identification.inference.samples import Samples
from identification.inference.statistics import statistics
from identification.number_format import mathtext, rounding_of, unit_mathtext

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of a panel, in that of all intervals in it.
_MARGIN = 1.15


@styled
def contribution_figure(samples: Samples) -> Figure:
    """Plot 68 and 95 % intervals of each parameter and of λ: a row for each source alone, for all, and without each.

    Raises ValueError if there is one source alone.
    """
    from cradle_env.notebook_figure import NotebookFigure

    found = samples.contributions
    if found is None:
        raise ValueError("the experiment has one source alone; add an instrument to it, such as [[string]]")
    sampled: dict[str, Any] = {
        u.name: statistics(u.value(samples.chain[..., k].ravel())) for k, u in enumerate(samples.unknowns)
    }
    rows: list[tuple[str, Mapping[str, Any], str]] = [
        *((f"{name} alone", told, BLUE) for name, told in found.alone.items()),
        ("all", sampled, BLACK),
        *((f"without {name}", told, GREY) for name, told in found.without.items()),
    ]
    if samples.newton_exponents is not None:
        sampled["lambda"] = statistics(samples.newton_exponents.ravel())
    names = [name for name in found.units if name in sampled]
    symbols = {u.name: u.symbol for u in samples.unknowns} | {"lambda": "λ"}
    apart = {name for one in found.disagreements for name in one.between}
    figure = NotebookFigure(figsize=(1.6 + 1.9 * len(names), 1.1 + 0.26 * len(rows)), layout="constrained")
    panels = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, names, strict=True):
        exponent = rounding_of(sampled[name]).exponent
        scaled = [(_scaled(told.get(name), exponent), colour) for _, told, colour in rows]
        _show(axes, scaled, _scaled(sampled[name], exponent))
        axes.set_xlabel(mathtext(symbols[name]) + unit_mathtext(found.units[name], exponent))
    panels[0].set_yticks(range(len(rows)), [label for label, *_ in rows])
    for label, (text, *_) in zip(panels[0].get_yticklabels(), rows, strict=True):
        if text.removesuffix(" alone") in apart:
            label.set_color(RED)
        if text == "all":
            label.set_fontweight("bold")
    panels[0].set_ylim(len(rows) - 0.4, -0.6)
    return figure


def _scaled(one: Mapping[str, Any] | None, exponent: int) -> dict[str, Any] | None:
    """Median and intervals over a power of ten; None where they are not known."""
    if one is None or one["median"] is None:
        return None
    return {key: np.asarray(one[key]) / 10.0**exponent for key in ("median", "ci68", "ci95")}


def _show(axes: Axes, rows: list[tuple[Any, str]], sampled: Mapping[str, Any] | None) -> None:
    """Draw the intervals of one parameter, a row each; sampled: its statistics of all, a band behind the rows."""
    told = [one for one, _ in rows if one is not None]
    low, high = min(one["ci95"][0] for one in told), max(one["ci95"][1] for one in told)
    middle, half = 0.5 * (low + high), 0.5 * _MARGIN * (high - low)
    axes.set_xlim(middle - half, middle + half)
    if sampled is not None:
        axes.axvspan(*sampled["ci95"], color=SKY, alpha=0.3, linewidth=0)
    for row, (one, colour) in enumerate(rows):
        if one is None:
            axes.text(0.5, row, "–", transform=axes.get_yaxis_transform(), ha="center", va="center", color=GREY)
            continue
        for interval, width in (("ci95", 1.0), ("ci68", 3.0)):
            axes.plot(one[interval], (row, row), color=colour, linewidth=width, solid_capstyle="butt")
        axes.plot(one["median"], row, "o", color=colour, markersize=3.5)
    axes.locator_params(axis="x", nbins=3)
    axes.tick_params(axis="y", length=0)
    axes.ticklabel_format(axis="x", useOffset=False)
