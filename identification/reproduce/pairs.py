"""Beyond the paper: λ over β × δ and over β × γ."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.figure
import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.plot_style import quiet_grid
from identification.reproduce.figure import BEYOND, STANDARD_RELEASE, Claim, Figure, Study, Table, Tables
from identification.reproduce.resonance import linear_ratio

_BETA = (0.08, 0.26)
_SECOND = {"delta": ("δ", -4e-3, 4e-3), "gamma": ("γ", 1e-3, 0.05)}
#: By number of bobs, how many values of β there are for one asked, and of the second parameter.
_DENSITY = {2: (1.0, 0.125), 5: (0.4, 0.0625)}


def _data(study: Study) -> Tables:
    tables = {}
    for name, (_, low, high) in _SECOND.items():
        for bobs, densities in _DENSITY.items():
            many, few = (max(8, round(study.values * share)) for share in densities)
            beta, second = np.linspace(*_BETA, many), np.linspace(low, high, few)
            swept = study.sweep(
                f"beta-{name}-N{bobs}", {"beta": beta, name: second}, Cradle(bobs=bobs), STANDARD_RELEASE
            )
            columns = {
                f"lambda at {name} = {value:.6g} [1/s]": column
                for value, column in zip(second, swept["lambda"].T, strict=True)
            }
            tables[f"beta-{name}-N{bobs}"] = {"beta": beta, **columns}
    return tables


def second_values(table: Table) -> np.ndarray:
    """The values of the second parameter, from the labels of its columns."""
    return np.array([float(label.split()[4]) for label in list(table)[1:]])


def _draw(tables: Tables) -> matplotlib.figure.Figure:
    figure = matplotlib.figure.Figure(figsize=(10.0, 7.0), layout="constrained")
    panels = figure.subplots(len(_SECOND), len(_DENSITY))
    for row, (name, (symbol, *_)) in zip(panels, _SECOND.items(), strict=True):
        for axes, bobs in zip(row, _DENSITY, strict=True):
            table = tables[f"beta-{name}-N{bobs}"]
            second = second_values(table)
            rate = np.array([table[label] for label in list(table)[1:]])
            low, high = np.nanquantile(rate, (0.005, 0.995))
            image = axes.pcolormesh(table["beta"], second, rate, cmap="cividis", vmin=low, vmax=high, rasterized=True)
            axes.set(title=f"N = {bobs}", xlabel="β", ylabel=symbol)
            figure.colorbar(image, ax=axes, extend="both").set_label("λ [s$^{-1}$]")
            _mark_ratios(axes, table["beta"])
            quiet_grid(axes, axis="both")
            axes.grid(False)
    return figure


def _mark_ratios(axes, beta: np.ndarray) -> None:
    """Ticks at the top where the linearised radial frequency is a whole multiple of the angular one."""
    ratio = linear_ratio(beta)
    orders = np.arange(int(np.ceil(ratio.min())), int(ratio.max()) + 1)
    top = axes.secondary_xaxis("top")
    top.set_xticks(np.interp(-orders, -ratio, beta), [str(n) for n in orders], fontsize=7.0)
    top.set_xlabel("ω$_r$/ω$_θ$", fontsize=7.5)


def _claims(tables: Tables) -> Sequence[Claim]:
    words, kept = [], []
    for name, (symbol, *_) in _SECOND.items():
        table = tables[f"beta-{name}-N2"]
        ridge = (table["beta"] > 0.135) & (table["beta"] < 0.155)  # n = 7
        at = np.array([table["beta"][ridge][np.argmax(table[label][ridge])] for label in list(table)[1:]])
        kept.append(float(np.mean(np.abs(at - np.median(at)) < 2e-3)))
        words.append(
            f"over {symbol} the peak of n = 7 stays within 0.002 of β = {np.median(at):.4f} in"
            f" {100 * kept[-1]:.0f} % of the rows"
        )
    return (
        Claim.judge(
            "the resonances in β stand whatever δ and γ are",
            BEYOND,
            min(kept) > 0.9,
            "N = 2: " + "; ".join(words),
            "one does not go far from the standard set",
            min(kept) > 0.4,
        ),
    )


FIGURE = Figure("pairs", "λ over β × δ and β × γ", _data, _draw, _claims)
