"""Pictures of a run, and of σ(t) and λ with their uncertainty. Figures belong to no window; see `style.png`."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.release import Release
from cradle_env.synchronization import ENVELOPE_PERIODS, FLOOR
from cradle_env.trajectory import Trajectory
from identification.inference.posterior import Posterior, Prediction, statistics
from identification.reporting.plot_style import BLACK, BLUE, GREY, ORANGE, RED, SKY, bob_styles, quiet_grid, styled
from identification.reporting.wording import rounding_of, shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

#: More bobs than these are shown as an image rather than as lines.
_MOST_STRIPS, _MOST_LINES = 8, 5
#: Width of the close-ups of a run [small-angle periods].
_CLOSE_UP_PERIODS = 3.0


@styled
def lambda_figure(posterior: Posterior, draws: int = 100) -> Figure:
    """The posterior of λ, and σ(t) over draws with exp(−λt); for two bobs or more."""
    return _synchronization_figure(posterior.predict(count=draws), posterior.newton_exponent())


@styled
def prediction_figure(prediction: Prediction) -> Figure:
    """σ(t) with its bands, and λ, of a prediction."""
    return _synchronization_figure(prediction, prediction.newton_exponent)


def _synchronization_figure(prediction: Prediction, rates: np.ndarray) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.55))
    found = statistics(rates)
    _show_rates(left, rates[np.isfinite(rates)])
    bands = prediction.sigma_bands()
    seen = _within_envelopes(prediction.t, prediction.cradle)
    t = prediction.t[seen]
    right.plot(t, bands["median"][seen], color=BLACK, linewidth=1.0, label="median σ(t)")
    right.fill_between(t, *bands["ci68"][:, seen], color=BLUE, alpha=0.6, linewidth=0, label="68 %")
    right.fill_between(t, *bands["ci95"][:, seen], color=SKY, alpha=0.45, linewidth=0, label="95 %")
    if found["median"] is not None:
        _show_decay(right, prediction.t, found["median"])
    _sigma_axes(right, prediction.t, float(bands["ci95"][0][seen].min()))
    bobs, angle = prediction.cradle.bobs, prediction.release.lead(prediction.cradle)[1]
    right.set_title(f"{bobs} bobs, {_delta(prediction.gaps)}, released at {angle:.3g} rad".replace("-", "−"))
    right.legend(loc="upper right")
    return figure


def _delta(gaps: np.ndarray) -> str:
    """δ of gaps (K, N − 1) over draws, in words: of all gaps with its uncertainty, or from the least to the largest."""
    medians = np.median(gaps, axis=0)
    if np.ptp(medians) > 0.0:
        return f"δ = {medians.min():.3g} to {medians.max():.3g}"
    if np.ptp(gaps[:, 0]) == 0.0:
        return f"δ = {medians[0]:.3g}"
    found = statistics(gaps[:, 0])
    text, scale = shown(found), rounding_of(found).exponent
    return f"δ = ({text['median']} ± {text['sd']})" + (rf"$\,\times\,10^{{{scale}}}$" if scale else "")


def _show_rates(axes: Axes, rates: np.ndarray) -> None:
    """Density of λ with its median and its 68 and 95 % intervals."""
    found = statistics(rates)
    if found["median"] is None or np.ptp(rates) == 0.0:
        axes.text(0.5, 0.5, "λ is not defined here", ha="center", va="center", transform=axes.transAxes)
        return
    low, high = np.quantile(rates, (0.001, 0.999))
    margin = 0.1 * (high - low)
    bins = int(np.clip(np.sqrt(len(rates)), 12, 60))
    counts, edges = np.histogram(rates, bins, range=(low - margin, high + margin), density=True)
    for interval, colour in (("ci95", SKY), ("ci68", BLUE)):
        axes.axvspan(*found[interval], color=colour, alpha=0.30, linewidth=0, label=f"{interval[2:]} %")
    axes.stairs(counts, edges, color=BLACK, linewidth=1.1)
    axes.axvline(found["median"], color=BLACK, linewidth=1.0, linestyle="--", label="median")
    text = shown(found)
    scale = rounding_of(found).exponent
    factor = rf" $\times\,10^{{{scale}}}$" if scale else ""
    axes.set_title(f"λ = ({text['median']} ± {text['sd']}){factor} s$^{{-1}}$")
    axes.set_xlabel("λ [s$^{-1}$]")
    axes.set_ylabel("probability density [s]")
    axes.set_xlim(low - margin, high + margin)
    axes.set_ylim(0.0, 1.28 * counts.max())
    axes.ticklabel_format(axis="x", useOffset=False)
    axes.locator_params(axis="x", nbins=5)
    axes.legend(loc="upper right")


def _within_envelopes(t: np.ndarray, cradle: Cradle) -> np.ndarray:
    """Where σ rests on whole envelopes: half a window away from the ends of the record; all of a short one."""
    half = 0.5 * ENVELOPE_PERIODS * cradle.period
    inside = (t >= t[0] + half) & (t <= t[-1] - half)
    return inside if inside.any() else np.ones_like(inside)


def _show_decay(axes: Axes, t: np.ndarray, rate: float) -> None:
    axes.plot(t, np.exp(-rate * t), color=RED, linestyle=(0, (5, 2)), label=r"exp(−$\lambda t$)")


def _sigma_axes(axes: Axes, t: np.ndarray, least: float) -> None:
    """A logarithmic axis from a power of ten below the least σ shown, but not below what λ counts."""
    axes.set_yscale("log")
    axes.set_ylim(max(FLOOR, min(0.1, 10.0 ** np.floor(np.log10(max(0.5 * least, FLOOR))))), 2.0)
    axes.set_xlim(t[0], t[-1])
    axes.set_xlabel("time [s]")
    axes.set_ylabel("σ")
    quiet_grid(axes)


@styled
def run_figure(run: Trajectory) -> Figure:
    """θ(t) of each bob, first and last swings, σ(t) with exp(−λt), and where the energy went."""
    from matplotlib.figure import Figure

    bobs = run.cradle.bobs
    upper = 0.6 + (2.4 if bobs > _MOST_STRIPS else max(1.4, 0.6 * bobs))
    figure = Figure(figsize=(11.0, upper + 2.9), layout="constrained")
    parts: Any = figure.subfigures(2, 1, height_ratios=(upper, 2.9))
    top, bottom = parts
    _show_motion(top, run)
    panels = bottom.subplots(1, 4, width_ratios=(0.8, 0.8, 1.0, 1.1))
    _show_close_ups(panels[:2], run)
    if bobs > 1:
        _show_sigma(panels[2], run)
    else:
        _show_peaks(panels[2], run)
    _show_energy(panels[3], run)
    return figure


def _show_motion(figure: SubFigure, run: Trajectory) -> None:
    """θ(t): a strip for each bob, or an image where there are many."""
    from matplotlib.ticker import MaxNLocator

    bobs, degrees = run.cradle.bobs, np.rad2deg(run.theta)
    limit = 1.05 * float(np.max(np.abs(degrees), initial=0.0)) or 1.0
    if bobs > _MOST_STRIPS:
        axes = figure.subplots()
        image = axes.imshow(
            degrees.T, aspect="auto", origin="lower", extent=(run.t[0], run.t[-1], 0.5, bobs + 0.5),
            cmap="RdBu_r", vmin=-limit, vmax=limit, interpolation="nearest",
        )  # fmt: skip
        axes.set(xlabel="time [s]", ylabel="bob", title="angle of each bob")
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        figure.colorbar(image, ax=axes, label="θ [°]", pad=0.01)
        return
    strips = figure.subplots(bobs, 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for i, (axes, style) in enumerate(zip(strips, bob_styles(bobs), strict=True)):
        axes.plot(run.t, degrees[:, i], color=style["color"], linewidth=0.7)
        axes.set(ylabel=f"$θ_{{{i + 1}}}$ [°]", ylim=(-limit, limit), xlim=(run.t[0], run.t[-1]))
        axes.tick_params(axis="x", length=0 if i < bobs - 1 else 3.5)
        quiet_grid(axes)
    strips[0].set_title("angle of each bob")
    strips[-1].set_xlabel("time [s]")


def _show_close_ups(panels: Sequence[Axes], run: Trajectory) -> None:
    """First and last swings, of all bobs if they are few, or of those at the ends."""
    bobs = run.cradle.bobs
    length = min(_CLOSE_UP_PERIODS * run.cradle.period, run.t[-1])
    which = range(bobs) if bobs <= _MOST_LINES else (0, bobs - 1)
    styles = list(bob_styles(len(which)))
    for axes, start, title in zip(panels, (0.0, run.t[-1] - length), ("first swings", "last swings"), strict=True):
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
        axes.text(0.5, 0.5, textwrap.fill(str(problem), 34), ha="center", va="center", transform=axes.transAxes)
        axes.set_axis_off()
        return
    seen = _within_envelopes(run.t, run.cradle)
    axes.plot(run.t[seen], values[seen], color=BLUE, label="σ(t)")
    axes.set_title("synchronization")
    if np.isfinite(rate):
        _show_decay(axes, run.t, rate)
        axes.set_title(f"λ = {rate:.4f} s$^{{-1}}$")
    _sigma_axes(axes, run.t, float(values[seen].min()))
    axes.legend(loc="upper right")


def _show_energy(axes: Axes, run: Trajectory) -> None:
    """The energy released, stacked by where it is.

    Bobs sink as their strings give; what gravity so feeds into the strings is no part of the swing, and taken off.
    """
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
    axes.set_xlim(run.t[0], run.t[-1])
    axes.set_ylim(0.0, 1.3e3 * max(sum(part[0] for part in parts.values()), 1e-12))
    axes.set(title="energy, by where it is", xlabel="time [s]", ylabel="energy [mJ]")
    axes.legend(loc="upper right", ncols=2, handlelength=1.2)
