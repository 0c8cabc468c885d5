"""Beyond the paper: λ of two to ten bobs, one or more of them lifted."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.figure
import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.plot_style import BLACK, BLUE, GREEN, RED, quiet_grid
from cradle_env.release import Release
from identification.reproduce.figure import ANGLE, BEYOND, Claim, Figure, Study, Tables

_MOST, _LIFTED = 10, (1, 2, 3)
_STARTS = ("unstretched", "hanging")
#: λ is averaged over release angles within this share of the standard one: bobs in touch are ill-conditioned.
_SPREAD, _ANGLES = 0.01, 11


def _data(study: Study) -> Tables:
    bobs = np.arange(2, _MOST + 1)
    angles = ANGLE * np.linspace(1.0 - _SPREAD, 1.0 + _SPREAD, _ANGLES)
    columns = {"N": bobs.astype(float)}
    for start in _STARTS:
        for lifted in _LIFTED:
            enough = bobs[bobs > lifted]
            swept = study.sweep(
                f"{lifted} lifted, {start}", {"bobs": enough.astype(float), "release_angle": angles},
                Cradle(), Release(angle=ANGLE, bobs=lifted, start=start),
            )  # fmt: skip
            rates = np.full((len(bobs), _ANGLES), np.nan)
            rates[bobs > lifted] = swept["lambda"]
            columns[_label("lambda", lifted, start)] = rates.mean(axis=1)
            columns[_label("sd", lifted, start)] = rates.std(axis=1, ddof=1)
    return {"lambda": columns}


def _label(what: str, lifted: int, start: str) -> str:
    return f"{what}, {lifted} lifted, {start} [1/s]"


def fit_laws(bobs: np.ndarray, rate: np.ndarray) -> tuple[tuple[float, float], float, tuple[float, float], float]:
    """((intercept at N = 2, slope) [1/s], RMS [1/s]) of a line in N, ((factor [1/s], power), RMS) of a power of N."""
    from scipy.optimize import curve_fit

    def line(n: np.ndarray, at_two: float, slope: float) -> np.ndarray:
        return at_two + slope * (n - 2.0)

    def power(n: np.ndarray, factor: float, exponent: float) -> np.ndarray:
        return factor * n**exponent

    found = []
    for law, start in ((line, (0.05, 0.01)), (power, (0.04, 0.6))):
        best, _ = curve_fit(law, bobs, rate, p0=start)
        found += [tuple(map(float, best)), float(np.sqrt(np.mean((law(bobs, *best) - rate) ** 2)))]
    return tuple(found)  # type: ignore[return-value]


def _draw(tables: Tables) -> matplotlib.figure.Figure:
    figure = matplotlib.figure.Figure(figsize=(9.0, 3.6), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    table = tables["lambda"]
    for start, axes in zip(_STARTS, panels, strict=True):
        for lifted, colour, mark in zip(_LIFTED, (BLUE, RED, GREEN), "os^", strict=True):
            rate, sd = (table[_label(what, lifted, start)] for what in ("lambda", "sd"))
            axes.errorbar(table["N"], rate, sd, fmt=mark, color=colour, markersize=4.0, label=f"{lifted} lifted")
        bobs, rate = table["N"], table[_label("lambda", 1, start)]
        (at_two, slope), _, (factor, exponent), _ = fit_laws(bobs, rate)
        axes.plot(
            bobs, at_two + slope * (bobs - 2), color=BLACK, linewidth=0.8, label=f"{at_two:.3f} + {slope:.4f} (N − 2)"
        )
        axes.plot(
            bobs, factor * bobs**exponent, color=BLACK, linewidth=0.8, linestyle=":",
            label=f"{factor:.3f} N$^{{{exponent:.2f}}}$",
        )  # fmt: skip
        axes.set(xlabel="N", title=f"{start} start", ylim=(0, None))
        axes.legend(loc="upper left")
        quiet_grid(axes)
    panels[0].set_ylabel("λ [s$^{-1}$]")
    return figure


def _claims(tables: Tables) -> Sequence[Claim]:
    table = tables["lambda"]
    bobs = table["N"]
    words, grows = [], []
    for start in _STARTS:
        rate = table[_label("lambda", 1, start)]
        (at_two, slope), line_off, (factor, exponent), power_off = fit_laws(bobs, rate)
        grows.append(bool(np.all(np.diff(rate) > 0.0)))
        words.append(
            f"{start}: {at_two:.4f} + {slope:.4f} (N − 2) to {line_off:.4f} RMS, {factor:.4f} N^{exponent:.2f} to"
            f" {power_off:.4f}"
        )
    ratios = {
        lifted: table[_label("lambda", lifted, _STARTS[0])] / table[_label("lambda", 1, _STARTS[0])]
        for lifted in _LIFTED[1:]
    }
    listed = "; ".join(
        f"{lifted}: {', '.join(f'{x:.2f}' for x in ratio[np.isfinite(ratio)])} (N = {bobs[np.isfinite(ratio)][0]:.0f}"
        f" to {bobs[-1]:.0f})"
        for lifted, ratio in ratios.items()
    )
    two = ratios[2][np.isfinite(ratios[2])]
    return (
        Claim.judge(f"more bobs synchronize faster: λ grows with N to {_MOST}", BEYOND, all(grows), "; ".join(words)),
        Claim.judge(
            "two bobs lifted synchronize more slowly than one",
            BEYOND,
            bool(np.all(two < 1.0)),
            f"λ over that of one lifted, for so many lifted: {listed}",
            "N is large",
            bool(np.all(two[-3:] < 1.0)),
        ),
    )


FIGURE = Figure("numbers", "λ of up to ten bobs, and of several lifted", _data, _draw, _claims)
