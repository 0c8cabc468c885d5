"""Pictures of a run, and of σ(t) and λ with their uncertainty. Figures belong to no window; see `style.png`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cradle_env.cradle import Release
from cradle_env.synchronization import ENVELOPE_PERIODS, FLOOR, WINDOW
from cradle_env.trajectory import Trajectory
from identification.posterior import Posterior, Prediction, statistics
from identification.style import BLACK, BLUE, GREEN, GREY, ORANGE, RED, SKY, bob_styles, quiet_grid, styled
from identification.wording import rounding_of, shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: More bobs than these are shown as an image rather than as lines.
_MOST_STRIPS = 8
#: Width of the close-ups of a run [small-angle periods].
_CLOSE_UP_PERIODS = 3.0


@styled
def lambda_figure(posterior: Posterior, draws: int = 100) -> Figure:
    """The posterior of λ, and σ(t) over draws with exp(−λt); for two bobs or more."""
    prediction = posterior.predict(count=draws)
    return _synchronization_figure(prediction, posterior.newton_exponent())


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
    right.fill_between(prediction.t, *bands["ci95"], color=SKY, alpha=0.45, linewidth=0, label="95 %")
    right.fill_between(prediction.t, *bands["ci68"], color=BLUE, alpha=0.6, linewidth=0, label="68 %")
    right.plot(prediction.t, bands["median"], color=BLACK, linewidth=1.0, label="median σ(t)")
    if found["median"] is not None:
        _show_decay(right, prediction.t, found["median"])
    _sigma_axes(right, prediction.t)
    cradle, angle = prediction.cradle, prediction.release.lead(prediction.cradle)[1]
    gaps = cradle.gaps
    delta = f"δ = {gaps[0]:.3g}" if np.ptp(gaps) == 0.0 else f"δ = {gaps.min():.3g} to {gaps.max():.3g}"
    right.set_title(f"{cradle.bobs} bobs, {delta}, released at {angle:.3g} rad".replace("-", "−"))
    right.legend(loc="upper right")
    return figure


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
    axes.set_xlabel(rf"λ [s$^{{-1}}$], mean over {WINDOW[0]:g} to {WINDOW[1]:g} s")
    axes.set_ylabel("probability density [s]")
    axes.set_xlim(low - margin, high + margin)
    axes.set_ylim(0.0, 1.28 * counts.max())
    axes.ticklabel_format(axis="x", useOffset=False)
    axes.locator_params(axis="x", nbins=5)
    axes.legend(loc="upper right")


def _show_decay(axes: Axes, t: np.ndarray, rate: float) -> None:
    axes.plot(t, np.exp(-rate * t), color=RED, linestyle=(0, (5, 2)), label=r"exp(−$\lambda t$)")


def _sigma_axes(axes: Axes, t: np.ndarray) -> None:
    axes.set_yscale("log")
    axes.set_ylim(FLOOR, 2.0)
    axes.set_xlim(t[0], t[-1])
    axes.set_xlabel("time [s]")
    axes.set_ylabel("σ")
    quiet_grid(axes)


@styled
def run_figure(run: Trajectory) -> Figure:
    """θ(t) of each bob, first and last swings, σ(t) with exp(−λt), and where the energy went."""
    from matplotlib.figure import Figure

    bobs = run.cradle.bobs
    strips = min(bobs, _MOST_STRIPS) if bobs <= _MOST_STRIPS else 4
    upper = 0.7 + max(1.6, 0.62 * strips)
    figure = Figure(figsize=(10.0, upper + 3.0), layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=(upper, 3.0))
    _show_motion(top, run)
    axes = bottom.subplots(1, 3 if run.ledger is not None else 2, width_ratios=(1.0, 1.0, 1.35)[: 2 + (run.ledger is not None)])
    _show_close_up(axes[0], run)
    if bobs > 1 and len(run.t) > 1:
        _show_sigma(axes[1], run)
    else:
        axes[1].plot(run.t, np.rad2deg(np.abs(run.theta[:, 0])), color=BLUE, linewidth=0.6)
        axes[1].set(title="amplitude", xlabel="time [s]", ylabel="|θ| [°]")
    if run.ledger is not None:
        _show_energy(axes[2], run)
    return figure


def _show_motion(figure, run: Trajectory) -> None:
    """θ(t): a strip for each bob, or an image where there are many."""
    bobs = run.cradle.bobs
    degrees = np.rad2deg(run.theta)
    limit = float(np.max(np.abs(degrees), initial=0.0)) * 1.05 or 1.0
    if bobs > _MOST_STRIPS:
        axes = figure.subplots()
        extent = (run.t[0], run.t[-1], 0.5, bobs + 0.5)
        image = axes.imshow(degrees.T, aspect="auto", origin="lower", extent=extent, cmap="RdBu", vmin=-limit, vmax=limit)
        axes.set(xlabel="time [s]", ylabel="bob", title="angle of each bob")
        figure.colorbar(image, ax=axes, label="θ [°]", pad=0.01)
        return
    strips = figure.subplots(bobs, 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for i, (axes, style) in enumerate(zip(strips, bob_styles(bobs), strict=True)):
        axes.plot(run.t, degrees[:, i], color=style["color"], linewidth=0.7)
        axes.set_ylabel(f"$θ_{{{i + 1}}}$ [°]")
        axes.set_ylim(-limit, limit)
        axes.set_xlim(run.t[0], run.t[-1])
        quiet_grid(axes)
    strips[0].set_title("angle of each bob")
    strips[-1].set_xlabel("time [s]")


def _show_close_up(axes: Axes, run: Trajectory) -> None:
    """The end bobs at first and at last, on one clock."""
    length = min(_CLOSE_UP_PERIODS * run.cradle.period, run.t[-1] - run.t[0])
    ends = sorted({0, run.cradle.bobs - 1})
    styles = list(bob_styles(run.cradle.bobs))
    for shift, start in ((1.0, run.t[0]), (-1.0, run.t[-1] - length)):
        inside = (run.t >= start) & (run.t <= start + length)
        for i in ends:
            style = styles[i] | ({"linestyle": "--"} if i else {"linestyle": "-"})
            axes.plot(run.t[inside] - start, np.rad2deg(run.theta[inside, i]) + shift, **style)
    axes.set(title="first and last swings", xlabel="time since start of window [s]", ylabel="θ [°]")


def _show_sigma(axes: Axes, run: Trajectory) -> None:
    """σ(t) and exp(−λt)."""
    try:
        values, rate = run.sigma(), run.newton_exponent()
    except ValueError as problem:  # too sparse for the envelopes
        axes.text(0.5, 0.5, str(problem), ha="center", va="center", wrap=True, transform=axes.transAxes)
        return
    axes.plot(run.t, values, color=BLUE, label="σ(t)")
    if np.isfinite(rate):
        _show_decay(axes, run.t, rate)
        axes.set_title(f"λ = {rate:.4f} s$^{{-1}}$")
    _sigma_axes(axes, run.t)
    axes.legend(loc="upper right")


def _show_energy(axes: Axes, run: Trajectory) -> None:
    """What was released, stacked by where it is: still in motion, in the strings, taken by drag and impacts."""
    energy = run.energy()
    rest = energy.kinetic + energy.gravity
    parts = {
        "motion": rest - rest.min(),
        "strings": energy.strings - energy.strings.min(),
        "impacts": energy.impacts,
        "drag": energy.drag,
    }
    axes.stackplot(
        run.t, *(1e3 * part for part in parts.values()), colors=(BLUE, SKY, ORANGE, GREY), labels=parts, linewidth=0
    )
    axes.set_xlim(run.t[0], run.t[-1])
    axes.set(title="where the energy is", xlabel="time [s]", ylabel="energy [mJ]")
    axes.legend(loc="lower left", ncols=2)
