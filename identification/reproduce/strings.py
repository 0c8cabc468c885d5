"""Fig. 4: force against displacement of one string (eq. 4), and of a string in a swinging cradle."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import matplotlib.figure
import numpy as np

from cradle_env.constitutive import string_tension
from cradle_env.cradle import Cradle
from cradle_env.plot_style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, RED, quiet_grid
from cradle_env.release import Release
from cradle_env.simulation import simulate
from identification.reproduce.figure import ANGLE, BEYOND, Claim, Figure, Study, Table, Tables

#: Largest tensions of the single cycles, and the range of the repeated ones [N]: below the paper's 3 N.
_SINGLE, _REPEATED, _CYCLES = (0.6, 1.2, 1.8, 2.4, 3.0), (0.5, 3.0), 6
# Points per leg; samples per second of a swinging cradle, enough for its string's turns.
_LEG, _RATE = 100, 4000.0
_COLOURS = (BLACK, RED, GREEN, BLUE, ORANGE, PURPLE)


def path_through(turns: Sequence[float], points: int = _LEG) -> np.ndarray:
    """A path of stretches along straight legs from 0 through turning points [m]; 1 + points per leg."""
    corners = [0.0, *turns]
    legs = [np.linspace(a, b, points + 1)[1:] for a, b in itertools.pairwise(corners)]
    return np.concatenate([[0.0], *legs])


def _repeated_path(cradle: Cradle) -> np.ndarray:
    """The path of cycles between two tensions; each leg turns when the tension is reached."""
    low, high = _REPEATED
    turns = [high / cradle.kappa]
    tension, stretch = high, turns[0]
    for _ in range(_CYCLES):
        lower = stretch * np.sqrt(low / tension)
        stretch = lower + (high - low) / cradle.kappa
        turns += [lower, stretch]
    return path_through(turns)


def _data(study: Study) -> Tables:
    cradle = Cradle(bobs=2)
    peaks = [force / cradle.kappa for force in _SINGLE]
    single = {f"cycle to {force} N": path_through([peak, 0.0]) for force, peak in zip(_SINGLE, peaks, strict=True)}
    columns: dict[str, np.ndarray] = {}
    for name, path in single.items():
        columns |= {f"{name}: stretch [m]": path, f"{name}: tension [N]": string_tension(cradle, path)}
    path = _repeated_path(cradle)
    run = simulate(cradle, Release(angle=ANGLE, start="hanging"), 60.0, _RATE)
    s = np.hypot(run.r[:, 1], cradle.pivot_half_spacing) - np.hypot(cradle.length, cradle.pivot_half_spacing)
    # The bob hung still before: its strings have been loaded once.
    tension = string_tension(cradle, np.concatenate([[0.0], s]))[1:]
    shown = run.t <= 4.0
    late = run.t >= 50.0
    return {
        "single": columns,
        "repeated": {"stretch [m]": path, "tension [N]": string_tension(cradle, path)},
        "cradle": {"t [s]": run.t[shown], "stretch [m]": s[shown], "tension [N]": tension[shown]},
        "worn": {
            "kappa [N/m]": np.array([cradle.kappa]),
            "T over kappa s at the start": tension[:1] / (cradle.kappa * s[:1]),
            "T over kappa s, mean after 50 s": np.array([np.mean(tension[late] / (cradle.kappa * s[late]))]),
        },
    }


def loop_loss(stretch: np.ndarray, tension: np.ndarray) -> float:
    """Share of the work of loading that a closed loop from zero dissipates."""
    work = 0.5 * np.diff(stretch) * (tension[1:] + tension[:-1])
    return float(work.sum() / work[work > 0.0].sum())


def _draw(tables: Tables) -> matplotlib.figure.Figure:
    figure = matplotlib.figure.Figure(figsize=(9.0, 3.4), layout="constrained")
    a, b, c = figure.subplots(1, 3)
    for force, colour in zip(_SINGLE, _COLOURS, strict=False):
        stretch, tension = _single(tables, force)
        a.plot(1e3 * stretch, tension, color=colour, label=f"{force} N")
    a.set_title("(a) one cycle, to several forces")
    a.legend(title="largest force")
    table = tables["repeated"]
    legs = np.arange(0, len(table["stretch [m]"]), 2 * _LEG)
    for k, start in enumerate(legs[:_CYCLES]):
        cycle = slice(start, start + 2 * _LEG + 1)
        b.plot(1e3 * table["stretch [m]"][cycle], table["tension [N]"][cycle], color=_COLOURS[k], label=f"{k + 1}")
    b.set_title("(b) repeated cycles")
    b.legend(title="cycle", loc="upper left", ncols=2)
    table = tables["cradle"]
    kappa = tables["worn"]["kappa [N/m]"][0]
    c.plot(1e3 * table["stretch [m]"], table["tension [N]"], color=BLUE, linewidth=0.7, label="string of bob 2")
    s = np.array([0.0, table["stretch [m]"].max()])
    for share, style in ((1.0, "-"), (0.5, "--")):
        label = "T = κ s" if share == 1.0 else "T = κ s/2"
        c.plot(1e3 * s, share * kappa * s, color=GREY, linestyle=style, linewidth=0.9, label=label)
    c.set_title("(c) in a cradle of two bobs, 4 s")
    c.legend(loc="upper left")
    for axes in (a, b, c):
        axes.set(xlabel="stretch s [mm]", ylabel="tension T of one string [N]", xlim=(0, None), ylim=(0, None))
        quiet_grid(axes)
    return figure


def _single(tables: Tables, force: float) -> tuple[np.ndarray, np.ndarray]:
    table: Table = tables["single"]
    return table[f"cycle to {force} N: stretch [m]"], table[f"cycle to {force} N: tension [N]"]


def _claims(tables: Tables) -> Sequence[Claim]:
    shares = [loop_loss(*_single(tables, force)) for force in _SINGLE]
    early, late = (float(tables["worn"][f"T over kappa s{when}"][0]) for when in (" at the start", ", mean after 50 s"))
    return (
        Claim.judge(
            "a full cycle of eq. 4 takes a third of the work of loading, whatever the force",
            BEYOND,
            bool(np.abs(np.array(shares) - 1.0 / 3.0).max() < 1e-3),
            f"share taken up to {_SINGLE[0]} to {_SINGLE[-1]} N: {min(shares):.4f} to {max(shares):.4f}",
        ),
        Claim.judge(
            "strings wear in: from T = κ s to T = κ s/2, where loading and unloading are equally stiff",
            BEYOND,
            abs(late - 0.5) < 0.03,
            f"T/κs of a string of bob 2: {early:.3f} at the start, {late:.3f} after 50 s",
        ),
    )


FIGURE = Figure("fig4", "The strings' force-displacement loops", _data, _draw, _claims)
