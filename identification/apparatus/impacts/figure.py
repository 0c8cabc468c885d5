"""The picture of a measurement of impacts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env.constitutive import contact_times, restitution_curve
from cradle_env.cradle import Cradle
from cradle_env.notebook_figure import NotebookFigure
from cradle_env.plot_style import BLACK, BLUE, GREY, RED, bob_styles, quiet_grid, styled
from identification.apparatus.impacts.chain import dissipation, passed_on
from identification.number_format import escape_mathtext

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from identification.apparatus.impacts.measure import ImpactsMeasurement

_BAND: dict[str, Any] = {"color": BLUE, "alpha": 0.2, "linewidth": 0.0}
_POINTS: dict[str, Any] = {
    "color": BLACK, "linestyle": "", "marker": "o", "markersize": 3.0, "capsize": 2.0, "elinewidth": 0.7,
}  # fmt: skip


@styled
def impacts_figure(measured: ImpactsMeasurement) -> NotebookFigure:
    """Speeds, durations, e(v) and residuals."""
    figure = NotebookFigure(figsize=(9.0, 6.4), layout="constrained")
    (ratio, time), (curve, rest) = figure.subplots(2, 2)
    cradle, (k_f, sd) = measured.cradle, measured.chosen.of("k_f")
    ends = [cradle.replace(k_f=max(0.0, k_f + z * sd)) for z in (-1.96, 1.96)]
    v = np.geomspace(0.02, 1.5, 120)
    _ratios(ratio, measured, ends)
    if measured.durations:
        _times(time, measured, ends)
    else:
        time.text(0.5, 0.5, "no durations were given", ha="center", transform=time.transAxes)
        time.set_axis_off()
    curve.plot(v, restitution_curve(cradle, v), color=BLUE, label="eq. 1 at the measured k_f")
    low, high = (restitution_curve(one, v) for one in ends)
    curve.fill_between(v, low, high, **_BAND)
    alpha, n = measured.values["alpha"].median, measured.values["n"].median
    curve.plot(v, 1.0 - alpha * v**n, color=RED, linestyle="--", label=f"1 − {alpha:.4f} v$^{{{n:.3f}}}$")
    curve.set(xscale="log", xlabel="impact velocity [m/s]", ylabel="e", title="Coefficient of restitution")
    curve.legend(loc="lower left")
    tables = [
        *((one.file, one.before) for one in measured.passed),
        *((one.file, one.speed) for one in measured.durations),
    ]
    for (file, speeds), residual, look in zip(tables, measured.chosen.residuals, bob_styles(len(tables)), strict=True):
        rest.plot(speeds, residual, color=look["color"], linestyle="", marker="o", markersize=3.0,
                  label=escape_mathtext(Path(file).name))  # fmt: skip
    for level in (-2.0, 0.0, 2.0):
        rest.axhline(level, color=GREY, linewidth=0.7, linestyle="-" if level == 0.0 else ":")
    rest.set(xlabel="impact velocity [m/s]", ylabel="residual / standard deviation", title="What eq. 1 leaves")
    if len(tables) <= 8:
        rest.legend(loc="best")
    for axes in (ratio, time, curve, rest):
        quiet_grid(axes)
    return figure


def _ratios(axes: Axes, measured: ImpactsMeasurement, ends: list[Cradle]) -> None:
    if not measured.passed:
        axes.text(0.5, 0.5, "no speeds were given", ha="center", transform=axes.transAxes)
        axes.set_axis_off()
        return
    every = np.concatenate([one.before for one in measured.passed])
    v = np.linspace(0.8 * every.min(), 1.1 * every.max(), 80)
    for bobs, look in zip(sorted({one.bobs for one in measured.passed}), bob_styles(8), strict=False):
        of = [passed_on(bobs, dissipation(one.k_f, one.k_el, one.mass, v)) for one in (measured.cradle, *ends)]
        axes.plot(v, of[0], **look, label=f"eq. 1, {bobs} bobs")
        axes.fill_between(v, of[1], of[2], color=look["color"], alpha=0.2, linewidth=0.0)
    for one, spread in zip(measured.passed, measured.chosen.spreads, strict=False):
        errors = 1.96 * spread / one.before, 1.96 * np.nan_to_num(one.before_sd)
        axes.errorbar(one.before, one.after / one.before, *errors, **_POINTS)
    axes.set(
        xlabel="speed of the first bob before [m/s]", ylabel="last after / first before", title="What is passed on"
    )
    axes.legend(loc="best")


def _times(axes: Axes, measured: ImpactsMeasurement, ends: list[Cradle]) -> None:
    every = np.concatenate([one.speed for one in measured.durations])
    v = np.geomspace(0.8 * every.min(), 1.2 * every.max(), 80)
    axes.plot(v, 1e6 * contact_times(measured.cradle, v), color=BLUE, label="eq. 1 at the measured k_f")
    low, high = (1e6 * contact_times(one, v) for one in ends)
    axes.fill_between(v, low, high, **_BAND)
    axes.plot(v, 1e6 * contact_times(measured.cradle.replace(k_f=0.0), v), color=BLACK, linestyle="--",
              label="without dissipation")  # fmt: skip
    for one, spread in zip(measured.durations, measured.chosen.spreads[len(measured.passed) :], strict=True):
        axes.errorbar(one.speed, 1e6 * one.duration, 1.96e6 * spread, 1.96 * np.nan_to_num(one.speed_sd), **_POINTS)
    axes.set(xlabel="impact velocity [m/s]", ylabel="contact duration [µs]", title="How long two bobs touch")
    axes.legend(loc="best")
