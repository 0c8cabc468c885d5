"""Figs. 7 and 8: σ(t) and λ against each of the four parameters."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.figure
import numpy as np

from cradle_env.cradle import STANDARD_BETA, Cradle
from cradle_env.plot_style import BLACK, BLUE, GREEN, GREY, RED, quiet_grid
from cradle_env.release import Release
from cradle_env.synchronization import ENVELOPE_PERIODS
from identification.reproduce.figure import ANGLE, BOBS, Study, Table, Tables
from identification.reproduce.impacts import PUBLISHED_ALPHA, PUBLISHED_N


@dataclass(frozen=True)
class Parameter:
    """A parameter of the sweeps: its range, its standard value, and a factor on the number of its values."""

    name: str
    symbol: str
    low: float
    high: float
    standard: float
    denser: int = 1

    def grid(self, values: int) -> np.ndarray:
        """Evenly spaced values: `values` of them, times the factor that resonances need."""
        return np.linspace(self.low, self.high, self.denser * values)


PARAMETERS = (
    Parameter("alpha", "α", 0.0, 0.2, PUBLISHED_ALPHA),
    Parameter("beta", "β", 0.06, 0.30, STANDARD_BETA, denser=2),
    Parameter("gamma", "γ", 5e-4, 0.05, ANGLE**2 / 6.0),
    Parameter("delta", "δ", -5e-3, 5e-3, 0.0),
)
#: δ close to 0, where λ is least.
ZOOM = Parameter("delta-zoom", "δ", -5e-4, 5e-4, 0.0)
STARTS = ("unstretched", "hanging")
ELASTIC = {"-string_hysteresis": {}}
OFF_RESONANCE = 0.097
#: Strings and starts for which λ is followed over γ: start, and what differs from the standard cradle. β = 0.114 is
#: next to the resonance of n = 9; OFF_RESONANCE lies between two.
GAMMA_VARIANTS = {
    "unstretched": ("unstretched", {}),
    "hanging": ("hanging", {}),
    "unstretched, elastic": ("unstretched", {"effects": ELASTIC}),
    "hanging, elastic": ("hanging", {"effects": ELASTIC}),
    "unstretched, off resonance": ("unstretched", {"beta": OFF_RESONANCE}),
    "hanging, off resonance": ("hanging", {"beta": OFF_RESONANCE}),
    "rigid": ("hanging", {"model": "pendulum"}),
}
COLOURS = dict(zip(BOBS, (BLUE, RED, GREEN), strict=True))
DASHES = dict(zip(BOBS, ("-", (0, (5, 1.5)), (0, (1, 1))), strict=True))
_TIMES = np.arange(0.0, 60.01, 0.25)
#: The least λ is at this δ, says the paper.
PUBLISHED_LEAST = -1.2e-4


def base(name: str, bobs: int, **fields) -> Cradle:
    """The standard cradle; with the paper's n if α is swept."""
    law = (PUBLISHED_ALPHA, PUBLISHED_N) if name == "alpha" else None
    return Cradle.from_groups(bobs=bobs, power_law=law, **fields)


def _axis(parameter: Parameter) -> str:
    return parameter.name.partition("-")[0]


def maps(study: Study) -> Tables:
    """σ over time and λ, a table for each parameter and number of bobs."""
    tables = {}
    for parameter in (*PARAMETERS, ZOOM):
        for bobs in BOBS:
            values, name = parameter.grid(study.values), f"{parameter.name}-N{bobs}"
            swept = study.sweep(
                name, {_axis(parameter): values}, base(parameter.name, bobs), quantities=("lambda", "sigma"),
                times=_TIMES,
            )  # fmt: skip
            # To four decimals, the tables are a third as large.
            sigma = np.round(swept["sigma"].T, 4)
            columns = {f"sigma at {t:g} s": column for t, column in zip(_TIMES, sigma, strict=True)}
            tables[name] = {parameter.name: values, "lambda [1/s]": swept["lambda"], **columns}
    return tables


def sigma_map(table: Table) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameter (P,), time (T,) [s] and σ (T, P) of a table of σ, without the end, where envelopes are incomplete."""
    labels = list(table)
    t = np.array([float(label.split()[2]) for label in labels[2:]])
    whole = t <= t[-1] - 0.5 * ENVELOPE_PERIODS * Cradle().period
    sigma = np.array([table[label] for label in labels[2:]])
    return table[labels[0]], t[whole], sigma[whole]


def draw_maps(tables: Tables) -> matplotlib.figure.Figure:
    """Fig. 7."""
    figure = matplotlib.figure.Figure(figsize=(11.0, 12.0), layout="constrained")
    panels = figure.subplots(len(PARAMETERS), len(BOBS), sharey=True)
    image = None
    for letter, parameter, row in zip("abcd", PARAMETERS, panels, strict=True):
        for bobs, axes in zip(BOBS, row, strict=True):
            values, t, sigma = sigma_map(tables[f"{parameter.name}-N{bobs}"])
            image = axes.pcolormesh(values, t, sigma, cmap="cividis", vmin=0.0, vmax=1.0, rasterized=True)
            axes.contour(values, t, sigma, levels=(0.05, 0.1, 0.2, 0.4, 0.6, 0.8), colors="white", linewidths=0.4)
            axes.axvline(parameter.standard, color=RED, linestyle=":", linewidth=0.8)
            axes.set(title=f"({letter}) N = {bobs}", xlabel=parameter.symbol)
            if bobs == BOBS[0]:
                axes.set_ylabel("time [s]")
    assert image is not None
    bar = figure.colorbar(image, ax=panels, shrink=0.4, pad=0.01)
    bar.set_label("σ (contours at 0.05, 0.1, 0.2, 0.4, 0.6, 0.8; dotted: the standard set)")
    return figure


def curves(study: Study) -> Tables:
    """λ, a table for each parameter."""
    tables: dict[str, dict[str, np.ndarray]] = {}
    for parameter in (*PARAMETERS, ZOOM):
        values = parameter.grid(study.values)
        columns = {parameter.name: values}
        for bobs in BOBS:
            columns[column(bobs)] = study.tables["fig7"][f"{parameter.name}-N{bobs}"]["lambda [1/s]"]
        variants = GAMMA_VARIANTS if parameter.name == "gamma" else {"hanging": ("hanging", {})}
        for variant, (start, fields) in variants.items():
            for bobs in BOBS:
                if variant != STARTS[0]:
                    swept = study.sweep(
                        f"{parameter.name}-N{bobs}-{variant}", {_axis(parameter): values},
                        base(parameter.name, bobs, **fields), Release(angle=ANGLE, start=start),
                    )  # fmt: skip
                    columns[column(bobs, variant)] = swept["lambda"]
        tables[parameter.name] = columns
    return tables


def column(bobs: int, variant: str = "unstretched") -> str:
    """The label of λ of so many bobs, of a start or one of GAMMA_VARIANTS."""
    return f"lambda, N = {bobs}, {variant} [1/s]"


def draw_curves(tables: Tables) -> matplotlib.figure.Figure:
    """Fig. 8."""
    figure = matplotlib.figure.Figure(figsize=(10.0, 7.0), layout="constrained")
    panels = figure.subplots(2, 2).ravel()
    for letter, parameter, axes in zip("abcd", PARAMETERS, panels, strict=True):
        _draw_curve(axes, tables[parameter.name], parameter)
        axes.set(title=f"({letter})", xlabel=parameter.symbol, ylabel="λ [s$^{-1}$]", ylim=(0.0, None))
        axes.axvline(parameter.standard, color=GREY, linestyle=":", linewidth=0.8)
    table, quiet = tables["gamma"], "hanging, off resonance"
    label = f"N = 2, hanging, β = {GAMMA_VARIANTS[quiet][1]['beta']}"
    panels[2].plot(table["gamma"], table[column(2, quiet)], color=BLACK, linewidth=0.8, label=label)
    panels[2].legend(handles=panels[2].get_lines()[-1:], loc="lower right")
    panels[0].legend(loc="upper left")
    inset, table = panels[3].inset_axes((0.34, 0.66, 0.36, 0.30)), tables[ZOOM.name]
    for bobs in BOBS:
        above = 100.0 * (table[column(bobs)] / table[column(bobs)].min() - 1.0)
        inset.plot(1e4 * table[ZOOM.name], above, color=COLOURS[bobs], linestyle=DASHES[bobs], linewidth=0.9)
    inset.axvline(1e4 * PUBLISHED_LEAST, color=BLACK, linewidth=0.7)
    inset.set_ylim(0.0, 5.0)
    inset.set_title("λ above its least [%] against 10$^4$ δ", fontsize=7.0)
    inset.tick_params(labelsize=6.5)
    panels[3].set_ylim(0.0, 1.9 * np.nanmax(tables["delta"][column(BOBS[-1])]))
    return figure


def _draw_curve(axes, table: Table, parameter: Parameter) -> None:
    for n in BOBS:
        for start, width in (("unstretched", 1.1), ("hanging", 0.6)):
            label = f"N = {n}, {start} start"
            axes.plot(
                table[parameter.name], table[column(n, start)], color=COLOURS[n], linestyle=DASHES[n], linewidth=width,
                label=label,
            )  # fmt: skip
    quiet_grid(axes)
