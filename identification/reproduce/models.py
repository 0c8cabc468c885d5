"""Figs. 3 and 5: what the linear model leaves out, and the angles that the nonlinear one gives."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.figure
import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.plot_style import BLACK, BLUE, GREY, ORANGE, RED, SKY, quiet_grid
from cradle_env.release import Release
from cradle_env.simulation import simulate
from cradle_env.trajectory import Trajectory
from identification.reproduce.figure import ANGLE, Claim, Figure, Study, Tables

_STARTS = {"unstretched": BLUE, "hanging": ORANGE}
# A close-up of the first swings, and one of the last [s].
_FIRST, _LAST = (0.0, 4.0), (56.0, 60.0)
_RATE = 240.0
_RIPPLE_RATE = 1000.0
#: A ripple of more than this share of the stretch itself is large.
_LARGE = 0.1


def _run(bobs: int, start: str = "unstretched", model: str = "nsp", rate: float = _RATE, until: float = 60.0):
    return simulate(Cradle(bobs=bobs, model=model), Release(angle=ANGLE, start=start), until, rate)


def stretch(run: Trajectory, bob: int) -> np.ndarray:
    """Stretch of the strings of a bob over their unstretched length, (T,) [1]."""
    cradle = run.cradle
    unstretched = np.hypot(cradle.length, cradle.pivot_half_spacing)
    return np.hypot(run.r[:, bob - 1], cradle.pivot_half_spacing) / unstretched - 1.0


def _shortcomings(study: Study) -> Tables:
    linear, full = (_run(2, model=model) for model in ("ho", "nsp"))
    close = {start: _run(2, start, rate=_RIPPLE_RATE, until=_FIRST[1]) for start in _STARTS}
    ripple = {
        f"stretch of bob {bob}, {start} start [1]": stretch(run, bob) for start, run in close.items() for bob in (2, 1)
    }
    return {
        "theta": {"t [s]": full.t, "theta_2, HO [rad]": linear.theta[:, 1], "theta_2, NSP [rad]": full.theta[:, 1]},
        "stretch": {"t [s]": close["hanging"].t, **ripple},
        "impacts": {f"{start} start [s]": run.impacts["time"][:4] for start, run in close.items()},
    }


def _draw_shortcomings(tables: Tables) -> matplotlib.figure.Figure:
    figure = matplotlib.figure.Figure(figsize=(9.0, 5.4), layout="constrained")
    top, bottom = figure.subplots(2, 2)
    table = tables["theta"]
    for axes, (low, high), title in zip(top, (_FIRST, _LAST), ("(a) first swings", "(a) last swings"), strict=True):
        seen = (table["t [s]"] >= low) & (table["t [s]"] <= high)
        for model, style in (("HO", {"color": RED, "linestyle": (0, (5, 1.5))}), ("NSP", {"color": BLACK})):
            axes.plot(table["t [s]"][seen], table[f"theta_2, {model} [rad]"][seen], label=model, **style)
        axes.set(title=f"{title}, N = 2", xlabel="time [s]", ylabel="$θ_2$ [rad]", xlim=(low, high))
    top[0].legend(loc="upper right", ncols=2, bbox_to_anchor=(1.0, 1.12))
    table = tables["stretch"]
    for axes, (start, colour) in zip(bottom, _STARTS.items(), strict=True):
        for bob, shade, width in ((1, GREY, 0.7), (2, colour, 1.1)):
            stretched = 100.0 * table[f"stretch of bob {bob}, {start} start [1]"]
            axes.plot(table["t [s]"], stretched, color=shade, linewidth=width, label=f"bob {bob}")
        for k, t in enumerate(tables["impacts"][f"{start} start [s]"]):
            axes.axvline(t, color=BLACK, linewidth=0.6, linestyle=":", label=None if k else "impacts")
        axes.set(title=f"(b) strings, {start} start", xlabel="time [s]", ylabel="stretch [%]", xlim=_FIRST)
    bottom[0].legend(loc="lower right", ncols=3)
    for axes in (*top, *bottom):
        quiet_grid(axes)
    return figure


def _ripple(tables: Tables, start: str) -> tuple[float, float, float]:
    """Of the stretch of bob 2's strings: peak to peak of its ripple in the flights before and after the second impact,
    a parabola of each taken out, and its mean after it [%]."""
    table, impacts = tables["stretch"], tables["impacts"][f"{start} start [s]"]
    t, s = table["t [s]"], 100.0 * table[f"stretch of bob 2, {start} start [1]"]
    flights = [(t > impacts[k]) & (t < impacts[k + 1]) for k in (0, 1)]
    before, after = (float(np.ptp(s[f] - np.polyval(np.polyfit(t[f], s[f], 2), t[f]))) for f in flights)
    return before, after, float(np.mean(s[flights[1]]))


def _shortcoming_claims(tables: Tables) -> Sequence[Claim]:
    table = tables["theta"]
    t, difference = table["t [s]"], table["theta_2, HO [rad]"] - table["theta_2, NSP [rad]"]
    early, late = (float(np.sqrt(np.mean(difference[(t >= a) & (t <= b)] ** 2))) for a, b in (_FIRST, _LAST))
    size = float(np.sqrt(np.mean(table["theta_2, NSP [rad]"][(t >= _LAST[0])] ** 2)))
    ripples = {start: _ripple(tables, start) for start in _STARTS}
    words = "; ".join(
        f"{start} start: {before:.2g} % before that impact, {after:.2g} % after it, about {mean:.2g} %"
        for start, (before, after, mean) in ripples.items()
    )
    large = [start for start, (_, after, mean) in ripples.items() if after > _LARGE * mean]
    return (
        Claim.judge(
            "the harmonic model fails in the long run",
            "3.3",
            late > 0.3 * size,
            f"θ2 of HO and NSP differ by {1e3 * early:.2g} mrad RMS in the first 4 s and by {1e3 * late:.3g} mrad in"
            f" the last, where the swing itself is {1e3 * size:.3g} mrad RMS",
        ),
        Claim.judge(
            "the strings of the second bob oscillate strongly after the second impact",
            "3.4, Fig. 3b",
            len(large) == len(ripples),
            f"their stretch, peak to peak: {words}",
            f"the bob starts {' or '.join(large)}, and strongly is more than {100 * _LARGE:.0f} % of the stretch",
            bool(large),
        ),
    )


def _angles(study: Study) -> Tables:
    two, three = (_run(bobs) for bobs in (2, 3))
    return {
        "theta": {
            "t [s]": two.t,
            "theta_2, N = 2 [rad]": two.theta[:, 1],
            "theta_3, N = 3 [rad]": three.theta[:, 2],
            "theta_2, N = 3 [rad]": three.theta[:, 1],
        }
    }


def _draw_angles(tables: Tables) -> matplotlib.figure.Figure:
    figure = matplotlib.figure.Figure(figsize=(9.0, 5.6), layout="constrained")
    table = tables["theta"]
    rows = figure.subplots(3, 2, width_ratios=(3.0, 1.2), sharey=True)
    for letter, label, (whole, close), colour in zip("abc", list(table)[1:], rows, (BLUE, BLUE, SKY), strict=True):
        symbol, _, bobs = label.removesuffix(" [rad]").partition(", ")
        for axes, (low, high) in ((whole, (0.0, 60.0)), (close, _FIRST)):
            axes.plot(table["t [s]"], table[label], color=colour, linewidth=0.8)
            axes.set(xlim=(low, high))
            quiet_grid(axes)
        whole.set(title=f"({letter}) {bobs}", ylabel=f"$θ_{symbol[-1]}$ [rad]")
    for axes in rows[-1]:
        axes.set_xlabel("time [s]")
    return figure


FIGURES = (
    Figure("fig3", "What the harmonic oscillators leave out", _shortcomings, _draw_shortcomings, _shortcoming_claims),
    Figure("fig5", "Angles of two and three bobs", _angles, _draw_angles),
)
