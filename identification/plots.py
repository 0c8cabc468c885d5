"""Pictures of a calibration: the posterior, the data against it, and what is left.

Each function gives a Matplotlib Figure that belongs to no window; `style.png` turns it into a file.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cradle_env.simulation import in_threads
from identification.fit import training_rows
from identification.likelihood import rms
from identification.posterior import Posterior, statistics
from identification.run_plots import lambda_figure, prediction_figure, run_figure
from identification.runs import Run
from identification.style import BLACK, BLUE, GREY, ORANGE, RED, quiet_grid, styled
from identification.wording import mathtext, rounding_of, shown, unit_mathtext

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Samples that the corner plot shows, at most.
_CORNER_SAMPLES = 20000
#: Width of the close-ups of the fit [small-angle periods].
_CLOSE_UP_PERIODS = 2.5


@styled
def corner_figure(posterior: Posterior) -> Figure:
    """The joint posterior of the cradle's unknowns and λ: contours hold 68 and 95 %."""
    import corner
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator, ScalarFormatter

    columns, labels, titles = [], [], []
    for symbol, unit, samples in _physical(posterior):
        found = statistics(samples)
        rounding = rounding_of(found)
        columns.append(samples / 10.0**rounding.exponent)
        labels.append(mathtext(symbol) + unit_mathtext(unit, rounding.exponent))
        text = shown(found)
        titles.append(f"{text['median']} ± {text['sd']}")
    table = np.column_stack(columns)
    table = table[np.isfinite(table).all(axis=1)]
    table = table[:: max(1, len(table) // _CORNER_SAMPLES)]
    K = len(labels)
    figure = Figure(figsize=(1.9 + 1.55 * K, 1.9 + 1.55 * K))
    corner.corner(
        table, fig=figure, bins=32, smooth=1.0, color=BLUE, levels=(0.68, 0.95), plot_datapoints=False,
        fill_contours=True, max_n_ticks=3, hist_kwargs={"linewidth": 1.2},
        range=[_span(column) for column in table.T],
    )  # fmt: skip
    axes = np.array(figure.axes).reshape(K, K)
    for i, label in enumerate(labels):
        diagonal = axes[i, i]
        diagonal.set_title(f"{label.split(' [')[0]} = {titles[i]}", fontsize=8.5, loc="center")
        for q, dashes in zip(np.quantile(table[:, i], (0.16, 0.5, 0.84)), ("--", "-", "--"), strict=True):
            diagonal.axvline(q, color=BLACK, linewidth=0.8, linestyle=dashes)
        axes[-1, i].set_xlabel(label)
        if i:
            axes[i, 0].set_ylabel(label)
    for box in axes.ravel():
        for axis in (box.xaxis, box.yaxis):
            axis.set_major_locator(MaxNLocator(3, prune="both"))
            axis.set_major_formatter(ScalarFormatter(useOffset=False))
            axis.set_label_coords(*((0.5, -0.52) if axis is box.xaxis else (-0.52, 0.5)))
        box.tick_params(labelsize=7.5)
    for j in range(1, K):  # the diagonal's y is a count
        axes[j, j].set_yticks([])
    axes[0, 0].set_yticks([])
    figure.subplots_adjust(left=0.9 / (1.9 + 1.55 * K) + 0.06, bottom=0.9 / (1.9 + 1.55 * K) + 0.06,
                           right=0.98, top=0.95, wspace=0.08, hspace=0.08)  # fmt: skip
    return figure


def _physical(posterior: Posterior) -> list[tuple[str, str, np.ndarray]]:
    """(symbol, unit, samples) of the cradle's own unknowns, and of λ where there is one of each sample."""
    found = [(u.symbol, u.unit, posterior.samples(u.name)) for u in posterior.unknowns if not u.nuisance]
    if posterior.newton_exponents is not None and posterior.experiment.cradle.bobs > 1:
        found.append(("λ", "1/s", posterior.newton_exponents.ravel()))
    return found


def _span(samples: np.ndarray) -> tuple[float, float]:
    """What to show of one coordinate: all but the last 0.1 % at either end, and a margin."""
    low, high = np.quantile(samples, (0.001, 0.999))
    margin = 0.08 * (high - low) or 1e-6 * (abs(high) or 1.0)
    return float(low - margin), float(high + margin)


@styled
def fit_figure(posterior: Posterior, draws: int = 100) -> Figure:
    """Each bob's readings against the posterior's 95 % band: the whole record, and its first and last swings."""
    from matplotlib.figure import Figure

    panels = [(k, bob) for k, run in enumerate(posterior.experiment.runs) for bob in run.bobs_seen]
    height = 1.0 + 1.25 * len(panels)
    figure = Figure(figsize=(10.5, height), layout="constrained")
    rows = np.atleast_2d(figure.subplots(len(panels), 3, width_ratios=(2.2, 1.0, 1.0), squeeze=False))
    points = posterior.draws(draws)
    bands = {k: _band(posterior, k, points) for k in range(len(posterior.experiment.runs))}
    handles = []
    for (k, bob), (whole, early, late) in zip(panels, rows, strict=True):
        run = posterior.experiment.runs[k]
        times, quiet, noisy = bands[k]
        scale, unit = _display(run)
        length = _CLOSE_UP_PERIODS * posterior.experiment.cradle.period
        start, end = max(times[0], run.times[0]), times[-1]
        for axes in (whole, early, late):
            _shade_held_out(axes, posterior, k)
            reading = run.readings[:, bob - 1] / scale
            outer = axes.fill_between(times, *noisy[:, :, bob - 1] / scale, color=ORANGE, alpha=0.55, linewidth=0)
            inner = axes.fill_between(times, *quiet[:, :, bob - 1] / scale, color=BLUE, linewidth=0.9)
            (dots,) = axes.plot(run.times, reading, ".", color=BLACK, markersize=1.0 if axes is whole else 2.6)
            axes.margins(x=0)
            quiet_grid(axes)
            handles = [dots, inner, outer]
        whole.set_xlim(run.times[0], run.times[-1])
        early.set_xlim(start, min(start + length, end))
        late.set_xlim(max(end - length, start), end)
        name = f"{run.file}: " if len(posterior.experiment.runs) > 1 else ""
        whole.set_title(f"{name}bob {bob}")
        whole.set_ylabel(f"{mathtext(_letter(run) + f'_{bob}')} [{unit}]")
        for axes in (early, late):
            axes.tick_params(labelleft=False)
            axes.sharey(whole)
    for axes in rows[-1]:
        axes.set_xlabel("time [s]")
    rows[0][1].set_title("first swings")
    rows[0][2].set_title("last swings")
    labels = ["data", "model, 95 %", "model and noise, 95 %"]
    figure.legend(handles, labels, loc="outside upper right", ncols=3, markerscale=4)
    figure.supxlabel(f"{_shading(posterior)}.".capitalize(), fontsize=8.0, x=0.99, ha="right")
    return figure


def _letter(run: Run) -> str:
    return "θ" if run.quantity == "theta" else "x"


def _display(run: Run) -> tuple[float, str]:
    """(SI value, name) of the unit in which a run's readings are shown: that of its file, but mrad for rad."""
    return (1e-3, "mrad") if run.unit == "rad" else (run.scale, run.unit)


def _simulated(posterior: Posterior, index: int) -> np.ndarray:
    """Which rows of a run have a simulated counterpart, (T,) of bool."""
    run = posterior.experiment.runs[index]
    return run.times >= (run.fit_from if run.state == "free" else 0.0)


def _band(posterior: Posterior, index: int, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(times (T,), 95 % band of the readings without noise (2, T, N), and with it (2, T, N)) over points (K, D)."""
    likelihood, rows = posterior.likelihood, _simulated(posterior, index)
    draws = np.array(in_threads(lambda z: likelihood.predict(z, index, rows)[0], list(points), likelihood.workers))
    noise = np.array([likelihood.sigma_of(likelihood.values(z), index) for z in points])
    half_width = 1.96 * np.sqrt(draws.var(axis=0) + np.mean(noise**2))
    centre = draws.mean(axis=0)
    quiet = np.quantile(draws, (0.025, 0.975), axis=0)
    return posterior.experiment.runs[index].times[rows], quiet, np.stack([centre - half_width, centre + half_width])


def _shade_held_out(axes: Axes, posterior: Posterior, index: int) -> None:
    """Marks where a run's readings were held out."""
    run, held = posterior.experiment.runs[index], training_rows(posterior.experiment)[1][index]
    if held.any():
        start, end = run.times[held][[0, -1]]
        axes.axvspan(start, end, facecolor="#EEEEEE", edgecolor="none", zorder=0)
        axes.axvline(start, color=GREY, linewidth=0.8, linestyle=(0, (3, 2)), zorder=1)


def _shading(posterior: Posterior) -> str:
    """What the shading of `_shade_held_out` means."""
    if any(run.held_out.any() for run in posterior.experiment.runs):
        return "shaded: held out, predicted and not fitted"
    return "shaded: fitted here, and held out in the fit that measures the gap"


@styled
def residual_figure(posterior: Posterior) -> Figure:
    """Readings less the most probable model, over the noise: by bob and time, and against a normal distribution."""
    from matplotlib.figure import Figure
    from scipy.stats import norm

    runs = posterior.experiment.runs
    panels = [(k, bob) for k, run in enumerate(runs) for bob in run.bobs_seen]
    train, held = training_rows(posterior.experiment)
    residuals = [_residuals(posterior, k) for k in range(len(runs))]
    figure = Figure(figsize=(10.5, 1.1 + 1.25 * len(panels)), layout="constrained")
    rows = figure.subplots(len(panels), 2, width_ratios=(4.0, 1.0), squeeze=False)
    for (k, bob), (axes, side) in zip(panels, rows, strict=True):
        run, values = runs[k], residuals[k][:, bob - 1]
        counted = (train[k] | held[k]) & np.isfinite(values)
        limit = float(np.clip(1.2 * np.quantile(np.abs(values[counted]), 0.999), 4.0, 1e3)) if counted.any() else 4.0
        inside = np.clip(values, -limit, limit)
        _shade_held_out(axes, posterior, k)
        axes.plot(run.times[~counted], inside[~counted], ".", color=GREY, markersize=1.2)
        axes.plot(run.times[counted], inside[counted], ".", color=BLUE, markersize=1.8)
        for level, dashes in ((0.0, "-"), (-2.0, "--"), (2.0, "--")):
            axes.axhline(level, color=BLACK, linewidth=0.7, linestyle=dashes)
        axes.set_xlim(run.times[0], run.times[-1])
        name = f"{run.file}: " if len(runs) > 1 else ""
        parts = ((train[k] & counted, ""), (held[k] & counted, " in the shaded part"))
        said = ", ".join(f"{rms(values[part]):.2f}{where}" for part, where in parts if part.any())
        axes.set_title(f"{name}bob {bob}: RMS {said}")
        axes.set_ylabel("residual / noise")
        edges, grid = np.linspace(-limit, limit, 41), np.linspace(-limit, limit, 401)
        side.hist(inside[counted], edges, density=True, orientation="horizontal", color=BLUE, alpha=0.65)
        side.plot(norm.pdf(grid), grid, color=RED, linestyle="--")
        side.tick_params(labelleft=False)
        for box in (axes, side):
            box.set_ylim(-limit, limit)
    rows[0][1].set_title("dashed: N(0, 1)")
    rows[-1][0].set_xlabel("time [s]")
    rows[-1][1].set_xlabel("density")
    figure.supxlabel(f"Lines at 0 and ±2; {_shading(posterior)}.", fontsize=8.0, x=0.99, ha="right")
    return figure


def _residuals(posterior: Posterior, index: int) -> np.ndarray:
    """Readings of a run less the most probable model, over the noise (T, N); nan where there is no counterpart."""
    run, rows = posterior.experiment.runs[index], _simulated(posterior, index)
    values = np.full(run.readings.shape, np.nan)
    predicted, _ = posterior.likelihood.predict(posterior.best(), index, rows)
    values[rows] = (run.readings[rows] - predicted) / posterior.likelihood.noise[index]
    return values


__all__ = ["corner_figure", "fit_figure", "lambda_figure", "prediction_figure", "residual_figure", "run_figure"]
