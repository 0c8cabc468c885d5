"""The picture of a ring-down measurement."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cradle_env.notebook_figure import NotebookFigure
from cradle_env.plot_style import BLACK, BLUE, GREY, bob_styles, quiet_grid, styled
from identification.apparatus.ringdown.motion import Fit, amplitudes, period_of
from identification.number_format import escape_mathtext

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from identification.apparatus.ringdown.measure import RingdownMeasurement

#: Recordings that the legend names at most.
_NAMED = 8


@styled
def ringdown_figure(measured: RingdownMeasurement) -> NotebookFigure:
    """Amplitudes, residuals, damping against amplitude, and b against n."""
    figure = NotebookFigure(figsize=(9.0, 6.4), layout="constrained")
    (decay, rest), (local, groups) = figure.subplots(2, 2)
    recordings = measured.recordings
    for one, look in zip(recordings, bob_styles(len(recordings)), strict=True):
        _recording(one.fit, look, decay, rest, local)
    decay.set(yscale="log", xlabel="time [s]", ylabel="amplitude [mrad]", title="Amplitude: data (dots) and model")
    for which in ("major", "minor"):
        getattr(decay.yaxis, f"set_{which}_formatter")("{x:g}")
    if len(recordings) <= _NAMED:
        decay.legend(loc="lower left")
    rest.set(xlabel="time [s]", ylabel="residual / noise", title="What the model leaves")
    rest.axhline(0.0, color=GREY, linewidth=0.7)
    local.set(xlabel="amplitude [mrad]", ylabel="equivalent linear drag [g/s]")
    local.set_title("Damping against amplitude: data (dots) and model")
    _groups(groups, measured)
    for axes in (decay, rest, local, groups):
        quiet_grid(axes)
    return figure


def _recording(fit: Fit, look: dict, decay: Axes, rest: Axes, local: Axes) -> None:
    swing, period = fit.swing, period_of(fit.swing)
    label = escape_mathtext(f"{Path(swing.file).name}, n = {swing.bobs}")
    offset = fit.of("offset")[0]
    dots = {"color": look["color"], "linestyle": "", "marker": ".", "markersize": 4.0}
    for angle, style in ((swing.angle - offset, dots), (fit.model - offset, look)):
        times, sizes = amplitudes(swing, angle, period)
        decay.plot(times, 1e3 * sizes, **style, label=label if style is look else None)
        if len(times) > 3:
            rate = -2.0 * swing.cradle.mass * np.diff(np.log(sizes)) / np.diff(times)
            local.plot(1e3 * np.sqrt(sizes[1:] * sizes[:-1]), 1e3 * rate, **style)
    rest.plot(swing.times, fit.residual / swing.noise, color=look["color"], linestyle="", marker=",")


def _groups(axes: Axes, measured: RingdownMeasurement) -> None:
    for one in measured.recordings:
        axes.plot(one.fit.swing.bobs, 1e3 * one.fit.of("b")[0], color=GREY, linestyle="", marker="x", markersize=4.0)
    for n, (b, sd) in measured.groups.items():
        axes.errorbar(n, 1e3 * b, 1.96e3 * sd, color=BLACK, marker="s", markersize=4.0, capsize=3.0)
    most = max(measured.groups)
    if measured.law is not None:
        sizes = np.linspace(1.0, most, 100)
        middle, spread = (1e3 * part for part in measured.law.at(sizes))
        axes.plot(sizes, middle, color=BLUE, label="b (1 + slope · 2 (n − 1)/n)")
        axes.fill_between(sizes, middle - 1.96 * spread, middle + 1.96 * spread, color=BLUE, alpha=0.2, linewidth=0.0)
        axes.legend(loc="upper left")
    axes.set(xlabel="bobs that swing together, n", ylabel="$b_n$ [g/s]", title="Linear drag of a group")
    axes.set_xticks(range(1, most + 1))
    axes.set_xlim(0.5, most + 0.5)
