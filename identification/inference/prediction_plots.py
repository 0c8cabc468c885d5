"""Figures of σ(t) and λ with their uncertainty. A figure belongs to no window; `plot_style.png` encodes it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cradle_env.plot_style import BLACK, BLUE, SKY, styled
from cradle_env.plotting import show_decay, sigma_axes, within_envelopes
from identification.inference.density import kernel_density
from identification.inference.statistics import statistics
from identification.number_format import format_statistics, rounding_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from identification.inference.posterior import Posterior
    from identification.inference.prediction import Prediction


@styled
def lambda_figure(posterior: Posterior, draws: int = 100) -> Figure:
    """Plot the posterior of λ, and σ(t) over draws with exp(−λt); for two or more bobs."""
    return _synchronization_figure(posterior.predict(count=draws), posterior.newton_exponent())


@styled
def prediction_figure(prediction: Prediction) -> Figure:
    """Plot σ(t) with its 68 and 95 % bands, and λ, of a prediction."""
    return _synchronization_figure(prediction, prediction.newton_exponent)


def _synchronization_figure(prediction: Prediction, rates: np.ndarray) -> Figure:
    from cradle_env.notebook_figure import NotebookFigure

    figure = NotebookFigure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.55))
    found = statistics(rates)
    _show_rates(left, rates[np.isfinite(rates)])
    bands = prediction.sigma_bands()
    seen = within_envelopes(prediction.t, prediction.cradle)
    t = prediction.t[seen]
    right.plot(t, bands["median"][seen], color=BLACK, linewidth=1.0, label="median σ(t)")
    right.fill_between(t, *bands["ci68"][:, seen], color=BLUE, alpha=0.6, linewidth=0, label="68 %")
    right.fill_between(t, *bands["ci95"][:, seen], color=SKY, alpha=0.45, linewidth=0, label="95 %")
    if found["median"] is not None:
        show_decay(right, prediction.t, found["median"])
    sigma_axes(right, prediction.t, float(bands["ci95"][0][seen].min()))
    bobs, angle = prediction.cradle.bobs, prediction.release.lead(prediction.cradle)[1]
    right.set_title(f"{bobs} bobs, {_delta(prediction.gaps)}, released at {angle:.3g} rad".replace("-", "−"))
    right.legend(loc="upper right")
    return figure


def _delta(gaps: np.ndarray) -> str:
    """Format δ of gaps (K, N − 1) over draws: one value with its uncertainty or, if gaps differ, the range."""
    medians = np.median(gaps, axis=0)
    if np.ptp(medians) > 0.0:
        return f"δ = {medians.min():.3g} to {medians.max():.3g}"
    if np.ptp(gaps[:, 0]) == 0.0:
        return f"δ = {medians[0]:.3g}"
    found = statistics(gaps[:, 0])
    text, scale = format_statistics(found), rounding_of(found).exponent
    return f"δ = ({text['median']} ± {text['sd']})" + (rf"$\,\times\,10^{{{scale}}}$" if scale else "")


def _show_rates(axes: Axes, rates: np.ndarray) -> None:
    """Plot the density of λ with its median and its 68 and 95 % intervals."""
    found = statistics(rates)
    if found["median"] is None or np.ptp(rates) == 0.0:
        axes.text(0.5, 0.5, "λ is not defined here", ha="center", va="center", transform=axes.transAxes)
        return
    low, high = np.quantile(rates, (0.001, 0.999))
    margin = 0.1 * (high - low)
    grid = np.linspace(low - margin, high + margin, 300)
    density = kernel_density(rates, grid)
    for interval, colour in (("ci95", SKY), ("ci68", BLUE)):
        axes.axvspan(*found[interval], color=colour, alpha=0.30, linewidth=0, label=f"{interval[2:]} %")
    axes.plot(grid, density, color=BLACK, linewidth=1.1)
    axes.axvline(found["median"], color=BLACK, linewidth=1.0, linestyle="--", label="median")
    text = format_statistics(found)
    scale = rounding_of(found).exponent
    factor = rf" $\times\,10^{{{scale}}}$" if scale else ""
    axes.set_title(f"λ = ({text['median']} ± {text['sd']}){factor} s$^{{-1}}$")
    axes.set_xlabel("λ [s$^{-1}$]")
    axes.set_ylabel("probability density [s]")
    axes.set_xlim(low - margin, high + margin)
    axes.set_ylim(0.0, 1.06 * density.max())
    axes.ticklabel_format(axis="x", useOffset=False)
    axes.locator_params(axis="x", nbins=4)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=3)  # below: the bands fill the panel
