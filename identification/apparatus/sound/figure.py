"""The picture of a measurement of sound."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cradle_env.notebook_figure import NotebookFigure
from cradle_env.plot_style import BLACK, BLUE, GREY, RED, quiet_grid, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from identification.apparatus.sound.measure import SoundMeasurement


@styled
def sound_figure(measured: SoundMeasurement) -> NotebookFigure:
    """Amplitudes, intervals, shape and candidates."""
    figure = NotebookFigure(figsize=(9.0, 6.4), layout="constrained")
    (sizes, intervals), (shape, candidates) = figure.subplots(2, 2)
    clicks = measured.clicks
    for rows, colour, marker, name in (
        (~clicks.doubtful, BLACK, ".", "clicks"),
        (clicks.doubtful, RED, "x", "doubtful"),
    ):
        if rows.any():
            sizes.errorbar(clicks.instants[rows], np.abs(clicks.amplitudes[rows]), clicks.amplitudes_sd[rows],
                           color=colour, linestyle="", marker=marker, elinewidth=0.6, label=name)  # fmt: skip
    largest = np.abs(clicks.amplitudes).max()
    sizes.set(yscale="log", xlabel="time [s]", ylabel="amplitude / full scale", title="Amplitudes of the clicks",
              ylim=(0.5 * max(np.abs(clicks.amplitudes).min(), 1e-4 * largest), 1.6 * largest))  # fmt: skip
    sizes.legend(loc="upper right")
    _intervals(intervals, measured)
    times = 1e3 * np.arange(len(measured.template.plain)) / measured.rate
    shape.plot(times, measured.template.plain, color=BLUE)
    shape.set(xlabel="time [ms]", ylabel="sound pressure / peak")
    shape.set_title(f"Shape of a click, mean of {measured.template.alike}")
    _candidates(candidates, measured)
    for axes in (sizes, intervals, shape, candidates):
        quiet_grid(axes)
    return figure


def _intervals(axes: Axes, measured: SoundMeasurement) -> None:
    axes.set(xlabel="time [s]", ylabel="time from click to click − median [ms]", title="Intervals")
    if np.isnan(measured.half_swing) or (~measured.clicks.doubtful).sum() < 2:
        axes.text(0.5, 0.5, "no regular sequence", transform=axes.transAxes, ha="center", color=GREY)
        return
    numbers, instants = measured.clicks.sequence(measured.half_swing)
    apart = np.diff(instants) / np.diff(numbers)
    spread = measured.clicks.instants_sd[~measured.clicks.doubtful]
    errors = np.hypot(spread[1:], spread[:-1]) / np.diff(numbers)
    middle = np.median(apart)
    axes.errorbar(instants[1:], 1e3 * (apart - middle), 1e3 * errors, color=BLACK, linestyle="", marker=".",
                  elinewidth=0.6)  # fmt: skip
    axes.set_title(f"Intervals; their median is {middle:.5f} s")


def _candidates(axes: Axes, measured: SoundMeasurement) -> None:
    scores, clicks = measured.candidates, measured.clicks
    other = ~np.isin(scores.instants, clicks.instants)
    shown = ((scores.snr[other], scores.likeness[other], GREY, ".", "no clicks"),
             (clicks.snr[~clicks.doubtful], clicks.likeness[~clicks.doubtful], BLACK, ".", "clicks"),
             (clicks.snr[clicks.doubtful], clicks.likeness[clicks.doubtful], RED, "x", "doubtful"))  # fmt: skip
    for snr, likeness, colour, marker, name in shown:
        if len(snr):
            axes.plot(np.maximum(snr, 0.5), likeness, color=colour, linestyle="", marker=marker, label=name)
    axes.set(xscale="log", xlabel="signal-to-noise ratio", ylabel="likeness to the shape", ylim=(-0.05, 1.05),
             title="Candidates")  # fmt: skip
    axes.xaxis.set_major_formatter("{x:g}")
    axes.legend(loc="lower right")
