"""Figures of a calibration: the posterior, the data with the model, and the residuals.

Each function returns a Matplotlib Figure that belongs to no window: a notebook shows it, `plot_style.png` encodes it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cradle_env.plot_style import BLACK, BLUE, GREY, ORANGE, RED, SKY, quiet_grid, styled
from cradle_env.threads import in_threads
from identification.experiment.run import Run
from identification.experiment.train_test import training_rows
from identification.inference.arviz_data import without_arviz_notice
from identification.inference.noise_model import rms
from identification.inference.statistics import statistics
from identification.number_format import (
    escape_mathtext,
    format_ratio,
    format_statistics,
    mathtext,
    rounding_of,
    unit_mathtext,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from identification.inference.posterior import Posterior

#: Most samples in the corner plot.
_CORNER_SAMPLES = 20000
#: Panels in a row of marginal densities.
_ACROSS = 4
#: Bins of a marginal density: twice the cube root of about 1000 effective samples (Rice's rule).
_BINS = 20
#: Width of the close-ups of the fit [small-angle periods].
_CLOSE_UP_PERIODS = 2.5


@styled
def corner_figure(posterior: Posterior) -> Figure:
    """Plot the joint posterior of the cradle's unknowns and λ, with contours of 68 and 95 % probability."""
    from cradle_env.notebook_figure import NotebookFigure

    with without_arviz_notice():
        import corner

    columns, labels, titles = [], [], []
    for symbol, unit, samples in _cradle_samples(posterior):
        found = statistics(samples)
        rounding = rounding_of(found)
        columns.append(samples / 10.0**rounding.exponent)
        labels.append(mathtext(symbol) + unit_mathtext(unit, rounding.exponent))
        text = format_statistics(found)
        titles.append(f"{text['median']} ± {text['sd']}")
    table = np.column_stack(columns)
    table = table[np.isfinite(table).all(axis=1)]
    table = table[:: max(1, len(table) // _CORNER_SAMPLES)]
    K = len(labels)
    size = 1.3 + 1.6 * K
    figure = NotebookFigure(figsize=(size, size))
    corner.corner(
        table, fig=figure, bins=32, smooth=1.0, smooth1d=1.5, color=BLUE, levels=(0.68, 0.95), plot_datapoints=False,
        fill_contours=True, max_n_ticks=3, hist_kwargs={"linewidth": 1.2},
        range=[_view_interval(column) for column in table.T],
    )  # fmt: skip
    axes = np.array(figure.axes).reshape(K, K)
    for i, label in enumerate(labels):
        axes[i, i].set_title(f"{label.split(' [')[0]} = {titles[i]}", fontsize=8.5, loc="center")
        for q, dashes in zip(np.quantile(table[:, i], (0.16, 0.5, 0.84)), ("--", "-", "--"), strict=True):
            axes[i, i].axvline(q, color=BLACK, linewidth=0.8, linestyle=dashes)
        for j in range(K):
            _tidy(axes[i, j], label if j == 0 < i else "", labels[j] if i == K - 1 else "", i, j)
    margin = 0.85 / size
    figure.subplots_adjust(left=margin, bottom=margin, right=0.985, top=1.0 - 0.3 / size, wspace=0.08, hspace=0.08)
    return figure


@styled
def marginals_figure(posterior: Posterior) -> Figure:
    """Plot the posterior density of each of the cradle's unknowns and of λ, with 68 and 95 % intervals."""
    from matplotlib.ticker import MaxNLocator

    from cradle_env.notebook_figure import NotebookFigure

    unknowns = _cradle_samples(posterior)
    down = -(-len(unknowns) // _ACROSS)
    figure = NotebookFigure(figsize=(9.0, 2.0 * down), layout="constrained")
    panels = figure.subplots(down, _ACROSS, squeeze=False).ravel()
    for axes, (symbol, unit, samples) in zip(panels, unknowns, strict=False):
        found = statistics(samples)
        rounding, text = rounding_of(found), format_statistics(found)
        factor = 10.0**rounding.exponent
        for interval, colour in (("ci95", SKY), ("ci68", BLUE)):
            axes.axvspan(*(bound / factor for bound in found[interval]), color=colour, alpha=0.30, linewidth=0)
        counts, edges = np.histogram(samples / factor, _BINS, range=_view_interval(samples / factor), density=True)
        axes.stairs(counts, edges, color=BLACK, linewidth=1.1)
        axes.set_title(f"{mathtext(symbol)} = {text['median']} ± {text['sd']}")
        axes.set_xlabel(f"{mathtext(symbol)}{unit_mathtext(unit, rounding.exponent)}")
        axes.set(xlim=_view_interval(samples / factor), yticks=[], ylim=(0.0, None))
        axes.xaxis.set_major_locator(MaxNLocator(3))
        axes.ticklabel_format(axis="x", useOffset=False)
    for axes in panels[len(unknowns) :]:
        axes.set_visible(False)
    return figure


def _tidy(axes: Axes, y_label: str, x_label: str, row: int, column: int) -> None:
    """Keep ticks and labels only at the left and lower edge of a corner plot."""
    from matplotlib.ticker import FixedLocator, MaxNLocator, ScalarFormatter

    if column > row:
        axes.set_visible(False)
        return
    for axis, label, place in ((axes.xaxis, x_label, (0.5, -0.38)), (axes.yaxis, y_label, (-0.38, 0.5))):
        low, high = axis.get_view_interval()
        edge = 0.1 * (high - low)  # a label there would overlap the next panel or leave the figure
        ticks = MaxNLocator(4).tick_values(low, high)
        axis.set_major_locator(FixedLocator([tick for tick in ticks if low + edge < tick < high - edge]))
        axis.set_major_formatter(ScalarFormatter(useOffset=False))
        axis.set_label_text(label)
        axis.set_label_coords(*place)
    axes.tick_params(labelsize=7.5, labelrotation=30.0, labelbottom=bool(x_label), labelleft=bool(y_label))
    if row == column:
        axes.set_yticks([])


def _cradle_samples(posterior: Posterior) -> list[tuple[str, str, np.ndarray]]:
    """(symbol, unit, samples) of the cradle's unknowns, and of λ if each sample has one."""
    found = [(u.symbol, u.unit, posterior.samples(u.name)) for u in posterior.unknowns if not u.nuisance]
    if posterior.newton_exponents is not None and posterior.synchronizes:
        found.append(("λ", "1/s", posterior.newton_exponents.ravel()))
    return found


def _view_interval(samples: np.ndarray) -> tuple[float, float]:
    """Interval to show of one coordinate: the central 99.8 % and a margin."""
    low, high = np.quantile(samples, (0.001, 0.999))
    margin = 0.08 * (high - low) or 1e-6 * (abs(high) or 1.0)
    return float(low - margin), float(high + margin)


@styled
def fit_figure(posterior: Posterior, draws: int = 100) -> Figure:
    """Plot each bob's readings and the model: the whole record, its last swings, and these less the model's mean."""
    from cradle_env.notebook_figure import NotebookFigure

    runs = posterior.experiment.runs
    panels = [(k, bob) for k, run in enumerate(runs) for bob in run.bobs_seen]
    figure = NotebookFigure(figsize=(11.0, 1.1 + 1.3 * len(panels)), layout="constrained")
    rows = figure.subplots(len(panels), 3, width_ratios=(1.9, 1.0, 1.0), squeeze=False)
    points = posterior.draws(draws)
    bands = [_band(posterior, k, points) for k in range(len(runs))]
    handles = []
    for (k, bob), panel in zip(panels, rows, strict=True):
        run, (times, mean, quiet, noisy) = runs[k], bands[k]
        scale, unit = {"rad": (1e-3, "mrad"), "s": (1e-3, "ms")}.get(run.unit, (run.scale, run.unit))
        ahead, then = (run.times, times) if run.of_impacts else (0.0, 0.0)  # a line through all clicks hides the model
        reading, centre = (run.readings[:, bob - 1] - ahead) / scale, (mean[:, bob - 1] - then) / scale
        inner, outer = (quiet[:, :, bob - 1] - then) / scale, (noisy[:, :, bob - 1] - then) / scale
        less = reading - np.interp(run.times, times, centre, left=np.nan, right=np.nan)
        for axes, data, level in zip(panel, (reading, reading, less), (0.0, 0.0, centre), strict=True):
            _shade_held_out(axes, posterior, k)
            wide = axes.fill_between(times, *(outer - level), color=ORANGE, alpha=0.5, linewidth=0)
            whole = axes is panel[0]
            (dots,) = axes.plot(run.times, data, ".", color=BLACK, markersize=1.2 if whole else 3.2, zorder=2)
            narrow = axes.fill_between(times, *(inner - level), color=BLUE, linewidth=0.5 if whole else 1.0, zorder=3)
            handles = [dots, narrow, wide]
            quiet_grid(axes)
        end = times[-1]
        start = max(end - _CLOSE_UP_PERIODS * posterior.experiment.cradle.period, times[0])
        panel[0].set(xlim=(run.times[0], run.times[-1]), ylabel=f"{_symbol(run, bob)} [{unit}]")
        what = _what(run, bob)
        panel[0].set_title(f"{escape_mathtext(run.file)}: {what}" if len(runs) > 1 else what)
        for axes in panel[1:]:
            axes.set_xlim(start, end)
        close = (run.times >= start) & (run.times <= end) & np.isfinite(less)
        reach = 1.15 * max(np.max(np.abs(less[close]), initial=0.0), np.max(outer[1] - centre))
        panel[2].set_ylim(-reach, reach)
    for axes, title in zip(rows[0][1:], ("last swings", "last swings, less the model's mean"), strict=True):
        axes.set_title(title)
    for axes in rows[-1]:
        axes.set_xlabel("time [s]")
    labels = ["data", "model, 95 %", "model and noise, 95 %"]
    figure.legend(handles, labels, loc="outside upper right", ncols=3, markerscale=3)
    figure.supxlabel(f"{_shading_note(posterior).capitalize()}.", fontsize=8.0, x=0.99, ha="right")
    return figure


def _symbol(run: Run, bob: int) -> str:
    return "t − click" if run.of_impacts else mathtext(f"{'θ' if run.quantity == 'theta' else 'x'}_{bob}")


def _what(run: Run, bob: int) -> str:
    return "clicks" if run.of_impacts else f"bob {bob}"


def _simulated_rows(posterior: Posterior, index: int) -> np.ndarray:
    """Rows of a run that are simulated, (T,) of bool."""
    run = posterior.experiment.runs[index]
    return run.times >= (run.fit_from if run.state == "free" else 0.0)


def _band(posterior: Posterior, index: int, points: np.ndarray) -> tuple[np.ndarray, ...]:
    """Simulate at points (K, D): times (T,), mean (T, N), 95 % bands without noise (2, T, N) and with it (2, T, N)."""
    likelihood, rows = posterior.likelihood, _simulated_rows(posterior, index)
    draws = np.array(in_threads(lambda z: likelihood.predict(z, index, rows)[0], list(points), likelihood.workers))
    noise = np.array([likelihood.sigma_of(likelihood.values(z), index) for z in points])
    mean, half_width = draws.mean(axis=0), 1.96 * np.sqrt(draws.var(axis=0) + np.mean(noise**2))
    quiet = np.quantile(draws, (0.025, 0.975), axis=0)
    return posterior.experiment.runs[index].times[rows], mean, quiet, np.stack([mean - half_width, mean + half_width])


def _shade_held_out(axes: Axes, posterior: Posterior, index: int) -> None:
    """Shade the time in which a run's readings are held out."""
    run, held = posterior.experiment.runs[index], training_rows(posterior.experiment)[1][index]
    if held.any():
        start, end = run.times[held][[0, -1]]
        axes.axvspan(start, end, facecolor="#EEEEEE", edgecolor="none", zorder=0)
        axes.axvline(start, color=GREY, linewidth=0.8, linestyle=(0, (3, 2)), zorder=1)


def _shading_note(posterior: Posterior) -> str:
    """Explain the shading of `_shade_held_out`."""
    if any(run.held_out.any() for run in posterior.experiment.runs):
        return "shaded: held out, predicted and not fitted"
    return "shaded: fitted here, and held out in the fit that measures the gap"


@styled
def residual_figure(posterior: Posterior) -> Figure:
    """Plot readings less the most probable model, over the noise: by bob and time, and with a normal distribution."""
    from matplotlib.ticker import MaxNLocator
    from scipy.stats import norm

    from cradle_env.notebook_figure import NotebookFigure

    runs = posterior.experiment.runs
    panels = [(k, bob) for k, run in enumerate(runs) for bob in run.bobs_seen]
    train, held = training_rows(posterior.experiment)
    residuals = [_residuals(posterior, k) for k in range(len(runs))]
    figure = NotebookFigure(figsize=(10.5, 1.1 + 1.25 * len(panels)), layout="constrained")
    rows = figure.subplots(len(panels), 2, width_ratios=(4.0, 1.0), squeeze=False)
    for (k, bob), (axes, side) in zip(panels, rows, strict=True):
        run, values = runs[k], residuals[k][:, bob - 1]
        counted = (train[k] | held[k]) & np.isfinite(values)
        limit = max(4.0, 1.2 * float(np.quantile(np.abs(values[counted]), 0.999))) if counted.any() else 4.0
        inside = np.clip(values, -limit, limit)
        _shade_held_out(axes, posterior, k)
        axes.plot(run.times[~counted], inside[~counted], ".", color=GREY, markersize=1.2)
        axes.plot(run.times[counted], inside[counted], ".", color=BLUE, markersize=1.8)
        for level, dashes in ((0.0, "-"), (-2.0, "--"), (2.0, "--")):
            axes.axhline(level, color=BLACK, linewidth=0.7, linestyle=dashes)
        axes.set_xlim(run.times[0], run.times[-1])
        name = f"{escape_mathtext(run.file)}: " if len(runs) > 1 else ""
        parts = ((train[k] & counted, ""), (held[k] & counted, " in the shaded part"))
        values_by_part = ", ".join(f"{format_ratio(rms(values[part]))}{where}" for part, where in parts if part.any())
        axes.set_title(f"{name}{_what(run, bob)}, RMS {values_by_part}")
        axes.set_ylabel("residual / noise")
        edges, grid = np.linspace(-limit, limit, 33), np.linspace(-limit, limit, 401)
        counts, *_ = side.hist(
            inside[counted], edges, density=True, orientation="horizontal", color=BLUE, alpha=0.65
        )  # fmt: skip
        side.plot(norm.pdf(grid), grid, color=RED, linestyle="--")
        side.tick_params(labelleft=False)
        side.set_xlim(0.0, 1.25 * np.max(counts))
        side.xaxis.set_major_locator(MaxNLocator(2))
        for box in (axes, side):
            box.set_ylim(-limit, limit)
            box.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    rows[0][1].set_title("dashed: N(0, 1)")
    rows[-1][0].set_xlabel("time [s]")
    rows[-1][1].set_xlabel("density")
    figure.supxlabel(f"Lines at 0 and ±2; {_shading_note(posterior)}.", fontsize=8.0, x=0.99, ha="right")
    return figure


def _residuals(posterior: Posterior, index: int) -> np.ndarray:
    """Readings of a run less the most probable model, over the noise, (T, N); nan in rows that are not simulated."""
    run, rows = posterior.experiment.runs[index], _simulated_rows(posterior, index)
    values = np.full(run.readings.shape, np.nan)
    likelihood, best = posterior.likelihood, posterior.best()
    noise = likelihood.noise_model.scales[index]
    if run.of_impacts:  # no estimate from the readings
        noise = likelihood.sigma_of(likelihood.values(best), index)
    values[rows] = (run.readings[rows] - likelihood.predict(best, index, rows)[0]) / noise
    return values
