"""Fig. 6: the synchronization parameter σ(t) and the Newton exponent λ at the standard set."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.figure
import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.plot_style import BLUE, RED, SKY, quiet_grid
from cradle_env.release import Release
from cradle_env.simulation import simulate
from cradle_env.synchronization import ENVELOPE_PERIODS, WINDOW
from identification.reproduce.figure import ANGLE, BOBS, Claim, Figure, Study, Tables

_STARTS = ("unstretched", "hanging")
#: What the standard set's "λ = 0.055" is, read as the Newton exponent [1/s].
PUBLISHED = 0.055


def _data(study: Study) -> Tables:
    columns: dict[str, np.ndarray] = {}
    rates = {f"{reading}, {start} start [1/s]": [] for reading in ("lambda", "exponential") for start in _STARTS}
    for bobs in BOBS:
        for start in _STARTS:
            run = simulate(Cradle(bobs=bobs), Release(angle=ANGLE, start=start), WINDOW[1])
            columns |= {"t [s]": run.t, f"sigma, N = {bobs}, {start} start": run.sigma()}
            rates[f"lambda, {start} start [1/s]"].append(run.newton_exponent())
            rates[f"exponential, {start} start [1/s]"].append(fit_decay_rate(run.t, run.sigma()))
    return {"sigma": columns, "lambda": {"N": np.array(BOBS), **{key: np.array(v) for key, v in rates.items()}}}


def fit_decay_rate(t: np.ndarray, sigma: np.ndarray) -> float:
    """Fit an exponential to σ by least squares; its rate [1/s] is another reading of the mean in λ."""
    from scipy.optimize import curve_fit

    inside = (t > WINDOW[0]) & (t <= WINDOW[1])
    (rate,), _ = curve_fit(lambda t, rate: np.exp(-rate * t), t[inside], sigma[inside], p0=(0.1,))
    return float(rate)


def _draw(tables: Tables) -> matplotlib.figure.Figure:
    figure = matplotlib.figure.Figure(figsize=(9.0, 5.2), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey="row")
    table = tables["sigma"]
    t = table["t [s]"]
    whole = t <= t[-1] - 0.5 * ENVELOPE_PERIODS * Cradle().period  # beyond, envelopes are cut off
    inside = whole & (t > WINDOW[0])
    for row, start in zip(panels, _STARTS, strict=True):
        for axes, bobs, rate in zip(row, BOBS, tables["lambda"][f"lambda, {start} start [1/s]"], strict=True):
            sigma = table[f"sigma, N = {bobs}, {start} start"]
            axes.plot(t[whole], sigma[whole], color=RED, label="σ")
            axes.plot(t, np.exp(-rate * t), color=RED, linestyle=(0, (5, 1.5)), label="exp(−λt)")
            axes.set(title=f"N = {bobs}, {start} start: λ = {rate:.4f} s$^{{-1}}$", ylim=(0.0, 1.02), xlim=(0, t[-1]))
            axes.tick_params(axis="y", labelcolor=RED)
            right = axes.twinx()
            right.spines["right"].set_visible(True)
            right.plot(t[inside], -np.log(sigma[inside]) / t[inside], color=BLUE, label="$t^{-1}$ ln σ$^{-1}$")
            right.axhline(rate, color=SKY, linestyle=":", linewidth=1.4, label="λ")
            right.set(ylim=(0.0, 0.2))
            right.tick_params(axis="y", labelcolor=BLUE, labelright=bobs == BOBS[-1])
            quiet_grid(axes)
            if bobs == BOBS[0]:
                axes.set_ylabel("σ", color=RED)
            if bobs == BOBS[-1]:
                right.set_ylabel("$t^{-1}$ ln σ$^{-1}$ and λ [s$^{-1}$]", color=BLUE)
            if start == _STARTS[0] and bobs == BOBS[0]:
                lines = [*axes.get_lines(), *right.get_lines()]
                right.legend(lines, [str(line.get_label()) for line in lines], loc="upper right")
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    return figure


def rms_deviation(t: np.ndarray, sigma: np.ndarray, rate: float) -> float:
    """σ − exp(−λt), root mean square within λ's window."""
    inside = (t > WINDOW[0]) & (t <= WINDOW[1])
    return float(np.sqrt(np.mean((sigma - np.exp(-rate * t))[inside] ** 2)))


def _claims(tables: Tables) -> Sequence[Claim]:
    table, rates = tables["sigma"], tables["lambda"]
    fitted = rates[f"exponential, {_STARTS[0]} start [1/s]"]
    first, other = (float(rates[f"lambda, {start} start [1/s]"][0]) for start in _STARTS)
    off = [
        rms_deviation(table["t [s]"], table[f"sigma, N = {bobs}, {_STARTS[0]} start"], rate)
        for bobs, rate in zip(BOBS, rates[f"lambda, {_STARTS[0]} start [1/s]"], strict=True)
    ]
    numbers = ", ".join(f"{x:.3f} (N = {bobs})" for x, bobs in zip(off, BOBS, strict=True))
    return (
        Claim.judge(
            f"λ = {PUBLISHED} 1/s at the standard set",
            "4.2",
            abs(first / PUBLISHED - 1.0) < 0.02,
            f"N = 2: λ = {first:.4f} from an unstretched string as the paper says, {other:.4f} from the hanging"
            f" length; the exponential nearest to σ(t), another reading of the mean, has {fitted[0]:.4f}",
            "it is read as λ of two bobs, and the start lies between the two",
            min(first, other) < PUBLISHED < max(first, other),
        ),
        Claim.judge(
            "exp(−λt) approximates the decay of σ",
            "4.2, Fig. 6",
            max(off) < 0.1,
            f"σ − exp(−λt), RMS over {WINDOW[0]:g}–{WINDOW[1]:g} s, where σ falls from 1: {numbers}",
        ),
    )


FIGURE = Figure("fig6", "σ(t) and λ at the standard set", _data, _draw, _claims)
