"""The picture of a measurement of a string."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cradle_env.notebook_figure import NotebookFigure
from cradle_env.plot_style import BLACK, BLUE, GREY, RED, bob_styles, quiet_grid, styled
from identification.number_format import escape_mathtext

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from identification.apparatus.string.measure import StringMeasurement

#: Readings of a curve that are drawn at most.
_DRAWN = 2000


@styled
def string_figure(measured: StringMeasurement) -> NotebookFigure:
    """Curves, unloading, what eq. 4 leaves, and the stiffness of each cycle."""
    figure = NotebookFigure(figsize=(9.0, 6.8), layout="constrained")
    (curves, unloading), (left, stiffness) = figure.subplots(2, 2)
    chosen, plain = measured.chosen, measured.plain
    for k, (curve, look) in enumerate(zip(chosen.curves, bob_styles(len(chosen.curves)), strict=True)):
        few = slice(None, None, max(1, len(curve.force) // _DRAWN))
        s = curve.displacement - chosen.of(f"straight {k}")[0]
        curves.plot(1e3 * s[few], plain.models[k][few], color=GREY, linewidth=0.8)
        curves.plot(1e3 * s[few], curve.force[few], color=look["color"], linestyle="", marker=".", markersize=2.0)
        curves.plot(1e3 * s[few], chosen.models[k][few], **look, label=escape_mathtext(Path(curve.file).name))
        for leg in curve.legs:
            rows = slice(leg.first, leg.last, few.step)
            residual = (curve.force - plain.models[k])[rows] / curve.noise
            colour, marker = (BLUE, "^") if leg.loading else (RED, "v")
            left.plot(1e3 * s[rows], residual, color=colour, linestyle="", marker=marker, markersize=2.0)
            if not leg.loading and leg.first and s[leg.first] > 0.0:
                part = s[rows] > 0.0
                top = chosen.models[k][leg.first - 1]
                unloading.plot(s[rows][part] / s[leg.first - 1], curve.force[rows][part] / top, color=look["color"],
                               linestyle="", marker=".", markersize=2.0)  # fmt: skip
    if len(chosen.curves) <= 8:
        curves.legend(loc="upper left")
    curves.set(xlabel="displacement from straight [mm]", ylabel="force [N]", title="Data, chosen law, eq. 4 (grey)")
    share = np.linspace(0.0, 1.0, 100)
    unloading.plot(share, share**2, color=BLACK, label="eq. 4: $(s/s_{max})^2$")
    unloading.set(xlabel="$s/s_{max}$", ylabel="$T/T_{max}$", title="Unloading")
    unloading.legend(loc="upper left")
    left.plot([], [], color=BLUE, linestyle="", marker="^", label="loading")
    left.plot([], [], color=RED, linestyle="", marker="v", label="unloading")
    left.set(xlabel="displacement from straight [mm]", ylabel="residual / noise", title="What eq. 4 leaves")
    left.legend(loc="best")
    _stiffness(stiffness, measured)
    for axes in (curves, unloading, left, stiffness):
        quiet_grid(axes)
    return figure


def _stiffness(axes: Axes, measured: StringMeasurement) -> None:
    for cycle in measured.cycles:
        value, sd = cycle.stiffness
        axes.errorbar(cycle.force, value, 1.96 * sd, color=BLACK, marker="o", markersize=3.0, capsize=2.0, linestyle="")
    kappa = measured.values["kappa"]
    axes.axhline(kappa.median, color=BLUE, label="κ, 95 % band")
    axes.axhspan(*kappa.ci95, color=BLUE, alpha=0.2, linewidth=0.0)
    axes.set(xlabel="largest force of the cycle [N]", ylabel="loading stiffness [N/m]", title="Each cycle by itself")
    axes.legend(loc="best")
