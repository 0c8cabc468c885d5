"""Figures of a diagnosis: tests of the residuals, candidates, and the model before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cradle_env.plot_style import BLUE, GREEN, GREY, ORANGE, RED, quiet_grid, styled
from identification.diagnosis.learned_law.law_shape import LawShape
from identification.diagnosis.residuals.residual_tests import ResidualTest
from identification.diagnosis.selection.examined_model import ExaminedModel
from identification.experiment.train_test import training_rows
from identification.inference.fit_result import FitResult
from identification.number_format import escape_mathtext

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from identification.diagnosis.result import Diagnosis

#: Most bobs in the figure.
_MAX_BOBS = 5
#: Width of the close-up of the last swings [small-angle periods].
_CLOSE_UP_PERIODS = 4.0
#: Curves of a law in a row.
_LAW_COLUMNS = 3


def window_tests(examined: ExaminedModel) -> list[tuple[ResidualTest, float]]:
    """Tests of one bob in one window, in flight and near impacts, each with its −log10 p.

    The list is empty if there are too few readings.
    """
    scan = examined.residual_scan
    return [
        (test, value) for test, value in zip(scan.tests, scan.neg_log10_p, strict=True)
        if test.bob >= 0 and test.phase in ("flight", "impact")
    ]  # fmt: skip


@styled
def map_figure(examined: ExaminedModel) -> Figure:
    """Plot −log10 p of every window of every bob, in flight and near impacts. `window_tests` must not be empty."""
    from matplotlib.colors import SymLogNorm
    from matplotlib.figure import Figure

    tests = window_tests(examined)
    runs = sorted({test.run for test, _ in tests})
    bobs = sorted({test.bob for test, _ in tests})
    figure = Figure(figsize=(9.0, 0.9 + len(runs) * (0.7 + 0.42 * len(bobs))), layout="constrained")
    limit = float(np.quantile(examined.residual_scan.replicate_maxima, 0.95))
    most = max(2.0 * limit, float(np.quantile([v for _, v in tests], 0.98)))
    scale = SymLogNorm(2.0 * limit, vmin=0.0, vmax=most)
    grid = figure.subplots(len(runs), 1, squeeze=False)[:, 0]
    image = None
    for axes, k in zip(grid, runs, strict=True):
        labels = []
        for row, (bob, phase) in enumerate((bob, phase) for bob in bobs for phase in ("flight", "impact")):
            own = [(p, v) for p, v in tests if p.run == k and p.bob == bob and p.phase == phase]
            for test, value in own:
                image = axes.pcolormesh(
                    np.array(test.interval), np.array([row - 0.46, row + 0.46]), np.array([[value]]),
                    norm=scale, cmap="Greys",
                )  # fmt: skip
                if value > limit:
                    centre = 0.5 * sum(test.interval)
                    axes.plot(centre, row, marker="o", markersize=3.0, color=ORANGE, linestyle="")
            labels.append(f"bob {bob + 1}, {'in flight' if phase == 'flight' else 'at impacts'}")
        axes.set_yticks(range(len(labels)), labels)
        axes.set_ylim(len(labels) - 0.5, -0.5)
        axes.set_xlabel("time [s]")
        file = escape_mathtext(examined.fitted.experiment.runs[k].file)
        axes.set_title(f"{file}: dots exceed the maximum of 95 % of replicates")
    if image is not None:
        figure.colorbar(
            image, ax=list(grid), label="−log$_{10}$ p of one test", extend="max", fraction=0.04, format="%.2g"
        )
    return figure


@styled
def energy_figure(diagnosis: Diagnosis) -> Figure:
    """Plot the energy of the data less that of the base and the repaired model, by window, ± 1 standard deviation."""
    from matplotlib.figure import Figure

    models = (
        (diagnosis.base_name, RED, "o", diagnosis.repaired.examined[0]),
        ("repaired", GREEN, "s", diagnosis.repaired.last),
    )
    runs = sorted({excess.run for excess in models[0][-1].residual_scan.energy_excess})
    figure = Figure(figsize=(9.0, 0.7 + 2.1 * len(runs)), layout="constrained")
    for axes, run in zip(figure.subplots(len(runs), 1, squeeze=False)[:, 0], runs, strict=True):
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        for name, colour, marker, examined in models if diagnosis.repaired.steps else models[:1]:
            own = [excess for excess in examined.residual_scan.energy_excess if excess.run == run]
            axes.errorbar(
                [e.time for e in own], [1e6 * e.energy for e in own], [1e6 * e.sd for e in own],
                color=colour, marker=marker, markersize=4.0, linewidth=0.9, capsize=2.0, label=f"model {name}",
            )  # fmt: skip
        axes.set_xlabel("time [s]")
        axes.set_ylabel("data − model:\nenergy [µJ]")
        axes.set_title(escape_mathtext(diagnosis.experiment.runs[run].file))
        axes.legend()
        quiet_grid(axes)
    return figure


@styled
def candidates_figure(diagnosis: Diagnosis) -> Figure:
    """Plot by how much each candidate lowers χ²: predicted to first order, and after its refit."""
    from matplotlib.figure import Figure
    from scipy.special import chdtri

    first = diagnosis.repaired.examined[0]
    gained = {refit.candidate: refit.gain for refit in diagnosis.repaired.alone}
    rows = sorted(first.score_test.scores, key=lambda s: -max(gained.get(s.candidate, 0.0), s.gain))
    figure = Figure(figsize=(9.0, 0.9 + 0.26 * max(len(rows), 2)), layout="constrained")
    axes = figure.subplots()
    threshold = float(np.quantile(first.score_test.replicate_maxima, 0.95))
    for y, s in enumerate(rows):
        if s.directions:
            axes.plot(max(s.gain, 0.5), y, marker="o", color=BLUE, markersize=5.0, linestyle="")
        if s.candidate in gained:
            axes.plot(
                max(gained[s.candidate], 0.5), y, marker="D", color=RED, markersize=5.0, linestyle="", fillstyle="none"
            )
    axes.axvline(float(chdtri(1, 10.0**-threshold)), color=GREY, linestyle="--")
    axes.plot([], [], marker="o", color=BLUE, linestyle="", label="predicted to first order")
    axes.plot([], [], marker="D", color=RED, linestyle="", fillstyle="none", label="refitted")
    axes.plot([], [], color=GREY, linestyle="--", label="maximum of 95 % of replicates")
    axes.set_yticks(range(len(rows)), [s.candidate.label for s in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xscale("log")
    axes.set_xlim(left=0.4)
    axes.set_xlabel("χ² saved on the training part (values below 0.5 are drawn at 0.5)")
    axes.legend(loc="lower right")
    quiet_grid(axes, "x")
    return figure


@styled
def law_figure(shape: LawShape) -> Figure:
    """Plot the functions of a learned law with their 95 % bands, over the range of the data."""
    from matplotlib.figure import Figure

    curves = shape.curves()
    rows = -(-len(curves) // _LAW_COLUMNS)
    figure = Figure(figsize=(9.0, 2.6 * rows), layout="constrained")
    grid = figure.subplots(rows, _LAW_COLUMNS, squeeze=False).ravel()
    for axes, curve in zip(grid, curves, strict=False):
        ends = (np.clip(curve.y + sign * curve.band, *curve.within) for sign in (-1.0, 1.0))
        axes.fill_between(curve.x, *ends, color=BLUE, alpha=0.25, linewidth=0)
        axes.plot(curve.x, curve.y, color=BLUE, label="with the law")
        if curve.without is not None:
            axes.plot(curve.x, curve.without, color=GREY, linestyle="--", label="model without the law")
            axes.legend(loc="best")
        axes.set_title(curve.title.replace(": ", ":\n"))
        axes.set_xlabel(curve.x_label)
        axes.set_ylabel(curve.y_label)
        quiet_grid(axes)
    for axes in grid[len(curves) :]:
        axes.set_visible(False)
    return figure


@styled
def comparison_figure(diagnosis: Diagnosis) -> Figure:
    """Plot the last swings with the base and the repaired model, and the residuals over the whole run."""
    from matplotlib.figure import Figure

    before, after = diagnosis.base, diagnosis.last
    held_out = training_rows(before.experiment)[1]
    k = next((k for k, rows in enumerate(held_out) if rows.any()), 0)
    run = before.experiment.runs[k]
    bobs = [bob - 1 for bob in run.bobs_seen][:_MAX_BOBS]
    figure = Figure(figsize=(9.0, 0.8 + 2.3 * len(bobs)), layout="constrained")
    grid = figure.subplots(2 * len(bobs), 2, squeeze=False, width_ratios=(1.0, 1.7), sharex="col")
    rows = run.times >= run.fit_from
    t, models = run.times[rows], [_predict(fitted, k, rows) for fitted in (before, after)]
    close = t >= t[-1] - _CLOSE_UP_PERIODS * before.cradle.period
    unit, name = (1e3, "mrad") if run.quantity == "theta" else (1e3, "mm")
    titles = (diagnosis.base_name, "repaired")
    for j, bob in enumerate(bobs):
        for i, (model, colour, title) in enumerate(zip(models, (RED, GREEN), titles, strict=True)):
            left, right = grid[2 * j + i]
            left.plot(t[close], unit * run.readings[rows][close, bob], ".", color=GREY, markersize=2.5)
            left.plot(t[close], unit * model[close, bob], color=colour, linewidth=0.9)
            left.set_ylabel(f"bob {bob + 1}\n[{name}]")
            residual = (run.readings[rows][:, bob] - model[:, bob]) / before.likelihood.noise_model.scales[k]
            _plot_residuals(right, t, residual, colour)
            if held_out[k].any():
                right.axvspan(run.times[held_out[k]][0], t[-1], color=BLUE, alpha=0.08, linewidth=0)
            right.set_title(f"bob {bob + 1}, model {title}")
            left.set_title(f"last swings, model {title}")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    return figure


def _plot_residuals(axes: Axes, t: np.ndarray, residual: np.ndarray, colour: str) -> None:
    axes.plot(t, residual, color=colour, linewidth=0.5)
    axes.set_ylabel("residual\n[noise]")
    spread = float(np.nanmax(np.abs(residual), initial=4.0))
    axes.set_ylim(-1.05 * spread, 1.05 * spread)
    quiet_grid(axes)


def _predict(fitted: FitResult, index: int, rows: np.ndarray) -> np.ndarray:
    return fitted.likelihood.predict(fitted.point, index, rows)[0]
