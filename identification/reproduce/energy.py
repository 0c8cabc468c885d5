"""Energy at synchronization, and where the rest of it went."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.figure
import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.plot_style import BLACK, BLUE, GREY, ORANGE, RED, SKY, quiet_grid
from cradle_env.release import Release
from cradle_env.simulation import simulate
from cradle_env.trajectory import Trajectory
from identification.reproduce.figure import BOBS, STANDARD_RELEASE, Claim, Figure, Study, Tables
from identification.sweep.quantities import synchronization_index

_MOST = 10
#: Drags [kg/s] for which the share of drag is found; 0.002 is the default, since the paper's b is not in its text.
_DRAGS = (0.0, 0.00025, 0.0005, 0.001, 0.002, 0.004)
_NEGLIGIBLE = 0.1
# Long enough for two bobs to synchronize [s], and for all relative motion to die without external loss.
_LONG, _VERY_LONG, _SMALL = 240.0, 600.0, 0.01
#: Growth of drag by a neighbour in touch (Fig. 2d) with which the end of synchronization is looked at.
_SLOPES = (0.0, 0.5, 1.0)


def _conserved(study: Study) -> dict[str, np.ndarray]:
    """E/E0 of models without external loss, after all relative motion has ceased."""
    bobs = np.arange(2, _MOST + 1)
    columns: dict[str, list[float]] = {"ho": [], "pendulum": []}
    for n in bobs:
        study.report(float(n / (3 * _MOST)), f"{n} bobs without external loss")
        for model, shares in columns.items():
            run = simulate(
                Cradle(bobs=int(n), model=model, b=0.0), Release(angle=_SMALL), times=np.array([0.0, _VERY_LONG])
            )
            energy = run.swing_energy()
            shares.append(float(energy[1] / energy[0]))
    return {"N": bobs, **{f"E/E0, {model}": np.array(shares) for model, shares in columns.items()}}


def _budget(run: Trajectory) -> tuple[float, ...]:
    """Time of synchronization [s], and the shares of E0 left then and taken by impacts, drag and strings; else nan."""
    k = synchronization_index(run)
    if k is None:
        return (np.nan,) * 5
    swing, energy = run.swing_energy(), run.energy()
    left, impacts, drag = swing[k] / swing[0], energy.impacts[k] / swing[0], energy.drag[k] / swing[0]
    return float(run.t[k]), left, impacts, drag, 1.0 - left - impacts - drag


_BUDGET = ("t_sync [s]", "left", "impacts", "drag", "strings")


def _data(study: Study) -> Tables:
    budgets, slopes = [], []
    for k, bobs in enumerate(BOBS):
        study.report((1 + k) / (2 + len(BOBS)), f"budget of {bobs} bobs")
        for b in _DRAGS:
            run = simulate(Cradle(bobs=bobs, b=b), STANDARD_RELEASE, _LONG, 120.0)
            budgets.append((bobs, b, *_budget(run)))
        for slope in _SLOPES:
            cradle = Cradle(bobs=bobs, effects={"group_drag": {"slope": slope, "range": 0.005}})
            run = simulate(cradle, STANDARD_RELEASE, _LONG, 120.0)
            slopes.append((bobs, slope, _budget(run)[0]))
    return {
        "conserved": _conserved(study),
        "budget": dict(zip(("N", "b [kg/s]", *_BUDGET), np.array(budgets).T, strict=True)),
        "group-drag": dict(zip(("N", "slope", "t_sync [s]"), np.array(slopes).T, strict=True)),
    }


def _draw(tables: Tables) -> matplotlib.figure.Figure:
    figure = matplotlib.figure.Figure(figsize=(10.0, 3.4), layout="constrained")
    a, b, c = figure.subplots(1, 3)
    table = tables["conserved"]
    n = table["N"]
    a.plot(n, 1.0 / n, color=BLACK, linewidth=0.8, label="1/N")
    a.plot(n, table["E/E0, ho"], "o", color=BLUE, label="harmonic, b = 0")
    a.plot(n, table["E/E0, pendulum"], "x", color=RED, label="pendulums, b = 0")
    table = tables["budget"]
    standard = np.isclose(table["b [kg/s]"], Cradle().b)
    a.plot(table["N"][standard], table["left"][standard], "^", color=ORANGE, label="strings and drag, at σ < 0.05")
    a.set(xlabel="N", ylabel="E$_{sync}$/E$_0$", title="(a) energy at synchronization", ylim=(0, None))
    a.legend()
    below = np.zeros(standard.sum())
    for part, colour in (("left", BLUE), ("impacts", ORANGE), ("strings", SKY), ("drag", GREY)):
        share = table[part][standard]
        b.bar([f"{bobs:.0f}" for bobs in table["N"][standard]], share, bottom=below, color=colour, label=part)
        below = below + share
    b.set(xlabel="N", ylabel="share of E$_0$", title="(b) at synchronization, b = 0.002 kg/s", ylim=(0, 1.35))
    b.legend(ncols=2, loc="upper center")
    for bobs, colour, dashes in zip(BOBS, (BLUE, RED, ORANGE), ("-", (0, (5, 1.5)), (0, (1, 1))), strict=True):
        rows = table["N"] == bobs
        c.plot(1e3 * table["b [kg/s]"][rows], _drag_share(tables, bobs)[1], "o", color=colour, linestyle=dashes,
               markersize=3.0, label=f"N = {bobs}")  # fmt: skip
    c.axhline(_NEGLIGIBLE, color=GREY, linestyle=":", linewidth=0.8)
    c.set(
        xlabel="b [10$^{-3}$ kg/s]",
        ylabel="drag's share of the loss",
        title="(c) until synchronization",
        ylim=(0, None),
    )
    c.legend()
    for axes in (a, c):
        quiet_grid(axes)
    return figure


def _drag_share(tables: Tables, bobs: int) -> tuple[np.ndarray, np.ndarray]:
    """b [kg/s], and the share of drag in the energy lost until synchronization."""
    table = tables["budget"]
    rows = table["N"] == bobs
    return table["b [kg/s]"][rows], table["drag"][rows] / (1.0 - table["left"][rows])


def _claims(tables: Tables) -> Sequence[Claim]:
    table = tables["conserved"]
    off = max(float(np.abs(table[f"E/E0, {model}"] * table["N"] - 1.0).max()) for model in ("ho", "pendulum"))
    budget = tables["budget"]
    standard = np.isclose(budget["b [kg/s]"], Cradle().b)
    left = ", ".join(
        f"{x:.3f} (N = {n:.0f})" for n, x in zip(budget["N"][standard], budget["left"][standard], strict=True)
    )
    shares = {bobs: _drag_share(tables, bobs) for bobs in BOBS}
    at_standard = [float(np.interp(Cradle().b, *shares[bobs])) for bobs in BOBS]
    limits = [float(np.interp(_NEGLIGIBLE, shares[bobs][1], shares[bobs][0])) for bobs in BOBS]
    group = tables["group-drag"]
    times = {bobs: group["t_sync [s]"][group["N"] == bobs] for bobs in BOBS}
    sooner = [bobs for bobs, t in times.items() if np.all(np.diff(t) < 0.0)]
    return (
        Claim.judge(
            "the energy at synchronization is 1/N of the initial energy",
            "4.1",
            bool(np.abs(budget["left"][standard] * budget["N"][standard] - 1.0).max() < 0.01),
            f"without external loss N E/E0 = 1 to {off:.1g}, N = 2 to {_MOST}; with strings and b = 0.002 kg/s what is"
            f" left at σ < 0.05 is {left}",
            "no string and no drag takes any",
            off < 1e-3,
        ),
        Claim.judge(
            "external damping is negligible until synchronization",
            "4.1",
            max(at_standard) < _NEGLIGIBLE,
            "drag's share of the loss at b = 0.002 kg/s: "
            + ", ".join(f"{100 * share:.0f} % (N = {bobs})" for bobs, share in zip(BOBS, at_standard, strict=True))
            + "; the paper's b is not in its text",
            f"b is below {1e3 * limits[0]:.2g}, {1e3 * limits[1]:.2g}, {1e3 * limits[2]:.2g}·10⁻³ kg/s (N = 2, 3, 5)"
            " and negligible means a tenth",
            True,
        ),
        Claim.judge(
            "drag that grows as bobs come together accelerates synchronization",
            "4.1",
            len(sooner) == len(BOBS),
            "σ < 0.05 from "
            + "; ".join(f"{', '.join(f'{x:.1f}' for x in t)} s (N = {n})" for n, t in times.items())
            + f" on, for growth by {', '.join(f'{s:g}' for s in _SLOPES)} per neighbour",
            f"N is {', '.join(map(str, sooner))}",
            bool(sooner),
        ),
    )


FIGURE = Figure("energy", "Energy at synchronization, and who takes the rest", _data, _draw, _claims)
