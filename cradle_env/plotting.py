"""Pictures of a run. Figures belong to no window; a notebook shows them."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.plot_style import BLUE, GREY, ORANGE, RED, SKY, bob_styles, quiet_grid, styled
from cradle_env.release import Release
from cradle_env.synchronization import ENVELOPE_PERIODS, FLOOR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from cradle_env.trajectory import Trajectory

#: More bobs than these are shown as an image rather than as lines.
_MOST_STRIPS, _MOST_LINES = 8, 5
#: Width of the close-ups of a run [small-angle periods].
_CLOSE_UP_PERIODS = 3.0


@styled
def run_figure(run: Trajectory) -> Figure:
    """θ(t) of each bob, first and last swings, σ(t) with exp(−λt), and where the energy went."""
    from cradle_env.notebook_figure import NotebookFigure

    bobs = run.cradle.bobs
    upper = 0.6 + (2.4 if bobs > _MOST_STRIPS else max(1.4, 0.6 * bobs))
    figure = NotebookFigure(figsize=(11.0, upper + 2.9), layout="constrained")
    parts: Any = figure.subfigures(2, 1, height_ratios=(upper, 2.9))
    top, bottom = parts
    _show_motion(top, run)
    panels = bottom.subplots(1, 4, width_ratios=(0.8, 0.8, 1.0, 1.1))
    _show_close_ups(panels[:2], run)
    _show_synchronization(panels[2], run)
    _show_energy(panels[3], run)
    return figure


@styled
def small_figure(run: Trajectory) -> Figure:
    """First and last swings, and σ(t) with exp(−λt), to stand beside text."""
    from cradle_env.notebook_figure import NotebookFigure

    figure = NotebookFigure(figsize=(9.0, 2.4), layout="constrained")
    panels = figure.subplots(1, 3)
    _show_close_ups(panels[:2], run)
    _show_synchronization(panels[2], run)
    return figure


@styled
def sigma_picture(run: Trajectory | None, duration: float) -> np.ndarray:
    """σ(t) of a run with exp(−λt), its δ and release angle above; empty axes over `duration` [s] without a run.

    (600, 800, 3) uint8.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 6.0), dpi=100, layout="constrained")
    canvas, axes = FigureCanvasAgg(figure), figure.subplots()
    if run is None:
        sigma_axes(axes, np.array([0.0, duration]), FLOOR)
    else:
        _show_sigma(axes, run)
        angle = f"{run.release.angle:.3f} rad" if isinstance(run.release, Release) else ""
        figure.suptitle(f"δ = {float(np.max(run.cradle.delta)):+.4f}, released at {angle}")
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3]


def _show_motion(figure: SubFigure, run: Trajectory) -> None:
    """θ(t): a strip for each bob, or an image where there are many."""
    from matplotlib.ticker import MaxNLocator

    bobs, degrees = run.cradle.bobs, np.rad2deg(run.theta)
    limit = 1.05 * float(np.max(np.abs(degrees), initial=0.0)) or 1.0
    if bobs > _MOST_STRIPS:
        axes = figure.subplots()
        image = axes.imshow(
            degrees.T, aspect="auto", origin="lower", extent=(*_shown_times(run), 0.5, bobs + 0.5),
            cmap="RdBu_r", vmin=-limit, vmax=limit, interpolation="nearest",
        )  # fmt: skip
        axes.set(xlabel="time [s]", ylabel="bob", title="angle of each bob")
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        figure.colorbar(image, ax=axes, label="θ [°]", pad=0.01)
        return
    strips = figure.subplots(bobs, 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for i, (axes, style) in enumerate(zip(strips, bob_styles(bobs), strict=True)):
        axes.plot(run.t, degrees[:, i], color=style["color"], linewidth=0.7)
        axes.set(ylabel=f"$θ_{{{i + 1}}}$ [°]", ylim=(-limit, limit), xlim=_shown_times(run))
        axes.tick_params(axis="x", length=0 if i < bobs - 1 else 3.5)
        quiet_grid(axes)
    strips[0].set_title("angle of each bob")
    strips[-1].set_xlabel("time [s]")


def _show_close_ups(panels: Sequence[Axes], run: Trajectory) -> None:
    """First and last swings, of all bobs if they are few, or of those at the ends."""
    bobs = run.cradle.bobs
    begin, end = _shown_times(run)
    length = min(_CLOSE_UP_PERIODS * run.cradle.period, end - begin)
    which = range(bobs) if bobs <= _MOST_LINES else (0, bobs - 1)
    styles = list(bob_styles(len(which)))
    for axes, start, title in zip(panels, (begin, end - length), ("first swings", "last swings"), strict=True):
        inside = (run.t >= start) & (run.t <= start + length)
        for i, style in zip(which, styles, strict=True):
            axes.plot(run.t[inside], np.rad2deg(run.theta[inside, i]), label=f"{i + 1}", **style)
        axes.set(title=title, xlabel="time [s]", ylabel="θ [°]", xlim=(start, start + length))
        axes.margins(y=0.08)
        quiet_grid(axes)
    if bobs > 1:
        low, high = panels[1].get_ylim()
        panels[1].set_ylim(low, high + 0.45 * (high - low))
        panels[1].legend(title="bob", loc="upper center", ncols=3, handlelength=2.0, columnspacing=1.0)


def _show_synchronization(axes: Axes, run: Trajectory) -> None:
    """σ(t); of one bob its amplitude."""
    if run.cradle.bobs > 1:
        _show_sigma(axes, run)
    else:
        _show_peaks(axes, run)


def _show_peaks(axes: Axes, run: Trajectory) -> None:
    """The amplitude of one bob, swing by swing."""
    size = np.abs(run.theta[:, 0])
    peaks = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:])) + 1
    axes.plot(run.t[peaks], np.rad2deg(size[peaks]), ".", color=BLUE, markersize=4.0)
    axes.set(title="amplitude of the swing", xlabel="time [s]", ylabel="peak |θ| [°]")
    quiet_grid(axes)


def _show_sigma(axes: Axes, run: Trajectory) -> None:
    """σ(t) and exp(−λt)."""
    try:
        if isinstance(run.release, Release):
            run.release.check_synchronizes(run.cradle)
        values, rate = run.sigma(), run.newton_exponent()
    except ValueError as problem:  # or too sparse or too short for the envelopes
        _show_text(axes, str(problem))
        return
    seen = within_envelopes(run.t, run.cradle)
    axes.plot(run.t[seen], values[seen], color=BLUE, label="σ(t)")
    axes.set_title("synchronization")
    if np.isfinite(rate):
        show_decay(axes, run.t, rate)
        axes.set_title(f"λ = {rate:.4f} s$^{{-1}}$")
    sigma_axes(axes, run.t, float(values[seen].min()))
    axes.legend(loc="upper right")


def _show_energy(axes: Axes, run: Trajectory) -> None:
    """The energy released, stacked by where it is.

    Bobs sink as their strings give; what gravity so feeds into the strings is no part of the swing, and taken off.
    """
    axes.set_title("energy, by where it is")
    if run.ledger is None:
        _show_text(axes, "this run kept no energy ledger; simulate with ledger=True")
        return
    energy = run.energy()
    hanging = -run.cradle.mass * run.cradle.gravity * run.r.sum(axis=1)
    strings = energy.strings + hanging
    parts = {
        "swing": run.swing_energy(),
        "strings: held, lost": strings - strings.min(),
        "impacts": energy.impacts,
        "drag": energy.drag,
    }
    axes.stackplot(
        run.t, *(1e3 * part for part in parts.values()), colors=(BLUE, SKY, ORANGE, GREY), labels=parts, linewidth=0
    )
    axes.set_xlim(*_shown_times(run))
    axes.set_ylim(0.0, 1.3e3 * max(sum(part[0] for part in parts.values()), 1e-12))
    axes.set(xlabel="time [s]", ylabel="energy [mJ]")
    axes.legend(loc="upper right", ncols=2, handlelength=1.2)


def _shown_times(run: Trajectory) -> tuple[float, float]:
    """First and last instant on an axis of time [s]; an axis needs a width, which a run of one sample has not."""
    begin, end = float(run.t[0]), float(run.t[-1])
    return begin, end if end > begin else begin + 1.0


def _show_text(axes: Axes, text: str) -> None:
    """A text in place of a picture."""
    axes.text(0.5, 0.5, textwrap.fill(text, 34), ha="center", va="center", transform=axes.transAxes)
    axes.set_axis_off()


def within_envelopes(t: np.ndarray, cradle: Cradle) -> np.ndarray:
    """Where σ rests on whole envelopes: half a window away from the ends of the record; all of a short one."""
    half = 0.5 * ENVELOPE_PERIODS * cradle.period
    inside = (t >= t[0] + half) & (t <= t[-1] - half)
    return inside if inside.any() else np.ones_like(inside)


def show_decay(axes: Axes, t: np.ndarray, rate: float) -> None:
    """exp(−λt) at a rate λ [1/s]."""
    axes.plot(t, np.exp(-rate * t), color=RED, linestyle=(0, (5, 2)), label=r"exp(−$\lambda t$)")


def sigma_axes(axes: Axes, t: np.ndarray, least: float) -> None:
    """A logarithmic axis from a power of ten below the least σ shown, but not below what λ counts."""
    axes.set_yscale("log")
    axes.set_ylim(max(FLOOR, min(0.1, 10.0 ** np.floor(np.log10(max(0.5 * least, FLOOR))))), 2.0)
    axes.set_xlim(t[0], t[-1])
    axes.set_xlabel("time [s]")
    axes.set_ylabel("σ")
    quiet_grid(axes)
