"""Resonances in β, explained: where the peaks of λ lie, and which ratio of angular to radial period each belongs to.

A bob loads its strings once a period, while it swings through, the other one half a period later: what drives their
difference in height has only odd harmonics of ω_θ. An impact of bobs at different heights is oblique; it pushes the
higher one up and the lower one down, twice a period. An oscillator kicked so resonates wherever its frequency ω_r is a
multiple n of ω_θ. Odd n are driven by both, even n by the kicks alone. Either way the bobs ripple in antiphase, and
oblique impacts turn swing into ripple, which the strings take.
"""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.figure
import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.plot_style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, RED, quiet_grid
from cradle_env.release import Release
from cradle_env.simulation import simulate
from cradle_env.trajectory import Trajectory
from identification.reproduce.figure import ANGLE, BEYOND, Claim, Figure, Study, Table, Tables
from identification.reproduce.sweeps import ELASTIC
from identification.sweep import Quantity

#: 1/β, in which the peaks are evenly spaced; below, they run into each other.
RANGE = (4.4, 14.0)
ANGLES = (0.15, ANGLE, 0.4, 0.6)
#: A peak stands out by this share of what lies around it.
PROMINENCE = 0.03
# The impacts whose obliqueness counts are those of the first seconds [s].
_EARLY = 20.0
_RIPPLE_RATE = 960.0
_MAIN = "N = 2, hanging"


def _obliqueness(run: Trajectory) -> float:
    """Angle of the line of centres against the horizontal at the early impacts of bobs 1 and 2, RMS [rad]."""
    from scipy.interpolate import CubicSpline

    t = run.impacts["time"][(run.impacts["pair"] == 1) & (run.impacts["time"] < _EARLY)]
    z = -run.r[:, :2] * np.cos(run.theta[:, :2])
    step = np.asarray(CubicSpline(run.t, z[:, 1] - z[:, 0])(t))
    return float(np.sqrt(np.mean(step**2)) / (2.0 * run.cradle.radius))


def ripple_correlation(beta: float) -> float:
    """Correlation of the ripples of bobs 1 and 2 from 2 s on: 1 in phase, −1 in antiphase."""
    from scipy.ndimage import uniform_filter1d

    cradle = Cradle.from_groups(bobs=2, beta=beta)
    run = simulate(cradle, Release(angle=ANGLE, start="hanging"), _EARLY, _RIPPLE_RATE)
    one = round(_RIPPLE_RATE * beta * cradle.period)
    ripple = (run.r - uniform_filter1d(run.r, one, axis=0))[run.t > 2.0]
    return float(np.asarray(np.corrcoef(ripple[:, 0], ripple[:, 1]))[0, 1])


_QUANTITIES = ("lambda", Quantity("obliqueness", "φ", "rad", "of early impacts", _obliqueness))


def linear_ratio(beta: np.ndarray, hysteresis: bool = True) -> np.ndarray:
    """ω_r/ω_θ of a bob's small motion about where it hangs; the standard cradle at each β.

    Elastic strings hang at T = κ s. Strings with hysteresis wear in: repeated small loops between loading (stiffness κ)
    and unloading (2 T/s) close only at T = κ s/2, where both are equally stiff; there the bob hangs lower.
    """
    found = []
    for cradle in (Cradle.from_groups(bobs=1, beta=float(b)) for b in np.atleast_1d(beta)):
        a, unstretched = cradle.pivot_half_spacing, np.hypot(cradle.length, cradle.pivot_half_spacing)
        grip = 4.0 * cradle.length / unstretched
        stretch = cradle.mass * cradle.gravity / grip / cradle.kappa * (2.0 if hysteresis else 1.0)
        r = np.sqrt((unstretched + stretch) ** 2 - a**2)
        found.append(np.sqrt(grip * cradle.kappa * r**2 / (np.hypot(r, a) * cradle.mass * cradle.gravity)))
    return np.array(found)


def find_prominent_peaks(x: np.ndarray, y: np.ndarray, prominence: float = PROMINENCE) -> tuple[np.ndarray, np.ndarray]:
    """Positions and prominences of the peaks of y(x) whose prominence exceeds that share of the median of y.

    Where: the vertex of the parabola through the highest point and its neighbours.
    """
    from scipy.signal import find_peaks

    at, found = find_peaks(y, prominence=prominence * np.median(y))
    left, middle, right = y[at - 1], y[at], y[at + 1]
    shift = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return x[at] + shift * (x[1] - x[0]), found["prominences"]


def _data(study: Study) -> Tables:
    inverse = np.linspace(*RANGE, 2 * study.values)
    axes = {"beta": 1.0 / inverse}
    columns = {"1/beta": inverse, "beta": 1.0 / inverse}
    for bobs, start, effects in (
        (2, "hanging", {}), (2, "hanging", ELASTIC), (2, "unstretched", {}), (3, "hanging", {}), (5, "hanging", {}),
    ):  # fmt: skip
        name = f"N = {bobs}, {start}{', elastic' if effects else ''}"
        release = Release(angle=ANGLE, start=start)
        swept = study.sweep(name, axes, Cradle(bobs=bobs, effects=effects), release, _QUANTITIES)
        columns |= {f"lambda, {name} [1/s]": swept["lambda"], f"obliqueness, {name} [rad]": swept["obliqueness"]}
    angles = {"1/beta": inverse}
    for angle in ANGLES:
        swept = study.sweep(f"angle {angle}", axes, Cradle(bobs=2), Release(angle=angle, start="hanging"))
        angles[f"lambda, {angle} rad [1/s]"] = swept["lambda"]
    return {"sweep": columns, "angles": angles, "peaks": _locate_peaks(columns)}


def _locate_peaks(table: Table) -> dict[str, np.ndarray]:
    """The peaks of λ of two bobs: where, which n, and the linearised ratio there."""
    where, height = find_prominent_peaks(table["1/beta"], table[f"lambda, {_MAIN} [1/s]"])
    ratio = linear_ratio(1.0 / where)
    return {
        "beta": 1.0 / where,
        "1/beta": where,
        "omega_r over omega_theta": ratio,
        "n": np.rint(ratio),
        "prominence [1/s]": height,
        "correlation of ripples": np.array([ripple_correlation(1.0 / x) for x in where]),
    }


def _draw(tables: Tables) -> matplotlib.figure.Figure:
    figure = matplotlib.figure.Figure(figsize=(9.0, 8.2), layout="constrained")
    panels = figure.subplots(4, 1, sharex=True)
    table = tables["sweep"]
    x = table["1/beta"]
    for axes, name, key in ((panels[0], "λ [s$^{-1}$]", "lambda"), (panels[1], "φ [mrad]", "obliqueness")):
        for kind, colour, dashes in (("", BLUE, "-"), (", elastic", ORANGE, (0, (5, 1.5)))):
            label = f"{key}, {_MAIN}{kind} [{'1/s' if key == 'lambda' else 'rad'}]"
            words = "elastic strings" if kind else "strings with hysteresis"
            scale = 1.0 if key == "lambda" else 1e3
            axes.plot(x, scale * table[label], color=colour, linestyle=dashes, label=words)
        axes.set_ylabel(name)
    panels[0].set_title("(a) N = 2, hanging start: λ; dotted where ω$_r$ = n ω$_θ$ on worn-in strings")
    panels[0].legend(loc="upper right")
    panels[1].set_title(f"(b) obliqueness of the impacts of the first {_EARLY:g} s, RMS")
    for bobs, colour, dashes in ((2, BLUE, "-"), (3, RED, (0, (5, 1.5))), (5, GREEN, (0, (1, 1)))):
        rate = table[f"lambda, N = {bobs}, hanging [1/s]"]
        panels[2].plot(x, rate / np.median(rate), color=colour, linestyle=dashes, label=f"N = {bobs}")
    panels[2].set(title="(c) more bobs, hanging start", ylabel="λ over its median", ylim=(0.8, 2.0))
    panels[2].legend(loc="upper right", ncols=3)
    for angle, colour in zip(ANGLES, (GREY, BLUE, PURPLE, BLACK), strict=True):
        rate = tables["angles"][f"lambda, {angle} rad [1/s]"]
        panels[3].plot(x, rate / np.median(rate), color=colour, label=f"{angle} rad")
    panels[3].set(title="(d) release angles, N = 2", ylabel="λ over its median", ylim=(0.8, 3.0), xlabel="1/β")
    panels[3].legend(loc="upper right", ncols=2)
    worn = linear_ratio(1.0 / x)
    for axes in panels:
        for n in range(int(np.ceil(worn[0])), int(worn[-1]) + 1):
            axes.axvline(np.interp(n, worn, x), color=GREY, linestyle=":", linewidth=0.8)
        quiet_grid(axes)
        axes.set_xlim(*RANGE)
    top = panels[0].get_ylim()[1]
    for n in range(int(np.ceil(worn[0])), int(worn[-1]) + 1):
        panels[0].text(np.interp(n, worn, x), top, f" {n}", va="top", fontsize=7.5, color=BLACK)
    return figure


def _highest_near(where: np.ndarray, height: np.ndarray, ratio: np.ndarray, n: int) -> tuple[float, float]:
    """(1/β, prominence) of the highest peak whose ratio is within 0.3 of n; nan and 0 where there is none."""
    close = np.abs(ratio - n) < 0.3
    if not close.any():
        return np.nan, 0.0
    best = np.flatnonzero(close)[np.argmax(height[close])]
    return float(where[best]), float(height[best])


def _claims(tables: Tables) -> Sequence[Claim]:
    table, found = tables["sweep"], tables["peaks"]
    x, orders = table["1/beta"], np.arange(5, 14)
    off = found["omega_r over omega_theta"] - found["n"]
    listed = ", ".join(f"{b:.4f} (n = {n:.0f})" for b, n in zip(found["beta"], found["n"], strict=True))

    def at(label: str, rate_table: Table, hysteresis: bool = True) -> np.ndarray:
        where, height = find_prominent_peaks(x, rate_table[label])
        ratio = linear_ratio(1.0 / where, hysteresis)
        return np.array([_highest_near(where, height, ratio, int(n)) for n in orders])

    main = at(f"lambda, {_MAIN} [1/s]", table)
    elastic = at(f"lambda, {_MAIN}, elastic [1/s]", table, hysteresis=False)
    both = np.isfinite(main[:, 0] * elastic[:, 0])
    moved = (elastic - main)[both, 0]
    worn, new = (np.interp(orders, linear_ratio(1.0 / x, hysteresis), x) for hysteresis in (True, False))
    expected = (new - worn)[both]
    odd = np.flatnonzero(orders % 2 == 1)[1:-1]
    beside = np.maximum(main[odd - 1, 1], main[odd + 1, 1])
    others = ("N = 3, hanging", "N = 5, hanging", "N = 2, unstretched")
    apart = {other: at(f"lambda, {other} [1/s]", table)[:, 0] - main[:, 0] for other in others}
    apart = {other: difference[np.isfinite(difference)] for other, difference in apart.items()}
    narrow, wide = (at(f"lambda, {angle} rad [1/s]", tables["angles"])[odd, 0] for angle in (ANGLE, ANGLES[-1]))
    drift = (wide - narrow) / orders[odd]
    most = (ANGLE**2 - ANGLES[-1] ** 2) / 16.0
    count = len(found["n"])
    return (
        Claim.judge(
            "λ oscillates with β: radial and angular motion resonate",
            "4.2",
            count >= 3,
            f"two bobs, hanging start: peaks at β = {listed}",
        ),
        Claim.judge(
            "a peak lies where the radial frequency is a whole multiple n of the angular one",
            BEYOND,
            bool(np.abs(off).max() < 0.1),
            f"ω_r/ω_θ, linearised about where bobs hang on worn-in strings, at the {count} peaks: n"
            f" {off.mean():+.3f} on average, {np.abs(off).max():.3f} off at most (chance: 0.25 on average)",
        ),
        Claim.judge(
            "odd n are stronger than the even ones beside them: swings load both bobs' strings alike in even harmonics",
            BEYOND,
            bool(np.all(main[odd, 1] > beside)),
            "prominence in λ [10⁻³ 1/s]: "
            + ", ".join(f"{1e3 * height:.1f} (n = {n})" for n, height in zip(orders, main[:, 1], strict=True)),
        ),
        Claim.judge(
            "at resonance the two bobs ripple in antiphase",
            BEYOND,
            bool(np.all(found["correlation of ripples"] < -0.9)),
            "correlation of their ripples, "
            + ", ".join(
                f"{c:.2f} (n = {n:.0f})" for c, n in zip(found["correlation of ripples"], found["n"], strict=True)
            ),
        ),
        Claim.judge(
            "without hysteresis strings do not wear in, bobs hang higher, and each peak moves to larger 1/β",
            BEYOND,
            bool(np.all(moved > 0.0) and np.abs(moved - expected).max() < 0.05),
            "moved by "
            + ", ".join(f"{m:.3f}" for m in moved)
            + " (expected "
            + ", ".join(f"{e:.3f}" for e in expected)
            + ") for n = "
            + ", ".join(str(n) for n in orders[both]),
        ),
        Claim.judge(
            "neither the number of bobs nor the start moves a peak",
            BEYOND,
            all(len(d) > 0 and np.abs(d).max() < 0.1 for d in apart.values()),
            "; ".join(
                f"{other} start: {len(d)} of them, 1/β off those of {_MAIN} start by {np.abs(d).max():.3f} at most"
                for other, d in apart.items()
            ),
        ),
        Claim.judge(
            "wider swings take longer, so peaks move to smaller 1/β",
            BEYOND,
            bool(np.all(drift < 0.0) and np.all(drift > most)),
            f"from {ANGLE} to {ANGLES[-1]} rad the peaks of n = {', '.join(map(str, orders[odd]))} move by"
            f" {', '.join(f'{100 * d:.2f}' for d in drift)} % of n; the period at the release is longer by"
            f" {-100 * most:.2f} %, later by less",
        ),
    )


FIGURE = Figure("resonance", "Resonances in β, and the ratio each belongs to", _data, _draw, _claims)
