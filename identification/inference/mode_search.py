"""Search for the best mode of a posterior: random draws, early data, neighbouring modes of κ."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from cradle_env.threads import in_threads
from identification.inference.click_likelihood import LEAST_WEIGHT
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.laplace import Mode, laplace_approximation
from identification.inference.least_squares import (
    bounds,
    chi2_scale,
    cost,
    difference_jacobian,
    has_impact_order,
    refine,
    refine_each,
)
from identification.inference.likelihood import Likelihood
from identification.inference.noise_model import typical
from identification.inference.search_options import DEFAULT, SearchOptions
from identification.progress import Progress

#: Evaluations of each fit to early data: it need only show which mode is promising.
_EARLY_EVALUATIONS = 15
#: Evaluations of each fit of an early mode to all data.
_LATE_EVALUATIONS = 20
#: Evaluations of the last fit, whose Jacobian gives the covariance.
_FINAL_EVALUATIONS = 40
#: Points that are refined, of those at `SearchOptions.kappa_steps`, and evaluations of each.
_KAPPA_MODES, _KAPPA_EVALUATIONS = 3, 8
#: Relative gain in χ² from which on the search among the shallow modes of κ goes on from a better one.
_KAPPA_GAIN = 1e-3
#: A mode of κ may be right instead of the best if it is worse by this χ² at most, 3 standard deviations; it is looked
#: for from points along the valley that are worse by this much, and from so many modes at most.
_RIVAL, _PROMISING, _MOST_RIVALS = 9.0, 100.0, 10
#: Rounds at most of the search among the close modes of κ.
_CLOSE_KAPPA_ROUNDS = 5
#: Evaluations of each fit in such a round, and of the best of them.
_CLOSE_KAPPA_EVALUATIONS, _CLOSE_KAPPA_FINAL_EVALUATIONS = 5, 40
#: Refinements of runs of clicks at most, each weighted by the residuals of the last, and the part of a weight above
#: which another changes nothing: weights fall from a millisecond to the errors of timing, and false clicks drop out.
_REWEIGHTINGS, _SETTLED = 8, 0.9


def find_mode(
    likelihood: Likelihood, seed: int = 0, progress: Progress | None = None, options: SearchOptions = DEFAULT
) -> tuple[Likelihood, Mode]:
    """Find the best mode of a posterior.

    1. Compute χ² of the early data at random points of the search box.
    2. Refine the best points of all, and of each slice of κ, on the early data, and the best distinct modes of these on
       longer and longer early data.
    3. Refine the best distinct modes on all data.
    4. Try neighbouring values of κ around the best one, and refine it once more.
    5. Where errors of readings repeat, refine it with this tracking noise.
    6. Widen the covariance by the modes of κ beside it that are nearly as good.

    Returns (the likelihood, with the noise at the mode where the noise was unknown; the mode). Raises
    ImpossibleModelError if no point can be simulated over all data.
    """
    report = progress or (lambda *_: None)
    rng = np.random.default_rng(seed)
    stages = [
        Likelihood(likelihood.experiment, early_rows(likelihood, periods), likelihood.workers, likelihood.parameters)
        for periods in _early_lengths(likelihood, options)
    ]
    width = np.array([u.search for u in likelihood.unknowns])
    starts = likelihood.start() + width * rng.uniform(-1.0, 1.0, (options.draws, len(width)))
    starts[0] = likelihood.start()
    starts = np.clip(starts, *bounds(likelihood))
    report("search", 0.0, f"{options.draws} points")
    costs = np.array(in_threads(lambda z: cost(stages[0], z), list(starts), likelihood.workers))
    chosen = [starts[i] for i in _choose_starts(likelihood, starts, costs, options)]
    parts = len(chosen) + options.early_modes * (len(stages) - 1) + options.finished_modes + 2
    done = 0
    for k, early in enumerate(stages):
        refined = []
        for reached in refine_each(early, chosen, _EARLY_EVALUATIONS, options):
            done += 1
            report("search", done / parts, "refining on the early data")
            refined.append(reached)
        kept = options.early_modes if k < len(stages) - 1 else options.finished_modes
        chosen = _distinct_modes(likelihood, refined, options)[:kept]
    report("search", done / parts, "refining on all data")
    point, least = min(refine_each(likelihood, chosen, _LATE_EVALUATIONS, options), key=lambda pair: pair[1])
    if not math.isfinite(least):
        raise ImpossibleModelError(
            "no point of the search can be simulated over all data: state values nearer to the truth"
        )
    if "kappa" in likelihood.names:
        report("search", 0.9, "neighbouring modes of κ")
        # Weights of an unknown noise that begin far too large hide the differences between modes.
        likelihood = _reweight(likelihood, point)
        point, _ = search_kappa_modes(likelihood, point, cost(likelihood, point), options)
    likelihood, point = refit(likelihood, point, options)
    tracked = likelihood.with_tracking_noise(point)
    if tracked is not likelihood:
        likelihood, point = refit(tracked, point, options)
    J = difference_jacobian(likelihood, point, likelihood.residuals(point))
    mode = laplace_approximation(likelihood, point, J)
    if "kappa" in likelihood.names and not has_impact_order(likelihood.experiment.cradle):
        report("search", 0.93, "other modes of κ that may be right")
        mode = _with_rivals(likelihood, mode, options)
    return likelihood, mode


def _early_lengths(likelihood: Likelihood, options: SearchOptions) -> list[float]:
    """Lengths of the early data [small-angle periods], as long as the next one leaves out a part of the data."""
    longest, lengths = longest_run(likelihood), [options.early_periods]
    while lengths[-1] * options.early_growth < longest:
        lengths.append(lengths[-1] * options.early_growth)
    return lengths


def _choose_starts(
    likelihood: Likelihood, starts: np.ndarray, costs: np.ndarray, options: SearchOptions = DEFAULT
) -> list[int]:
    """Indices of the best of the starts (K, D) by their costs (K,), and of the best in each slice of κ.

    Modes of κ are narrow, and the other unknowns change the cost of a draw more than κ does.
    """
    best = np.argsort(costs)[: options.best_draws]
    if "kappa" not in likelihood.names:
        return [int(i) for i in best]
    slices = np.array_split(np.argsort(starts[:, likelihood.names.index("kappa")]), options.kappa_slices)
    return list(dict.fromkeys([*map(int, best), *(int(some[np.argmin(costs[some])]) for some in slices)]))


def _distinct_modes(
    likelihood: Likelihood, refined: list[tuple[np.ndarray, float]], options: SearchOptions
) -> list[np.ndarray]:
    """The refined points (D,), the best first, without those whose κ is that of a better one."""
    kept: list[np.ndarray] = []
    for point, _ in sorted(refined, key=lambda pair: pair[1]):
        if "kappa" in likelihood.names:
            k = likelihood.names.index("kappa")
            scale = 1.0 if likelihood.unknowns[k].log else abs(point[k])
            if any(abs(point[k] - other[k]) < options.mode_separation * scale for other in kept):
                continue
        kept.append(point)
    return kept


def _reweight(likelihood: Likelihood, point: np.ndarray) -> Likelihood:
    """The likelihood with the RMS residual at a point as weight of each run of unknown noise.

    Priors and readings then count in proportion.
    """
    weights = list(likelihood.noise_model.weights)
    for k, (run, rows) in enumerate(zip(likelihood.experiment.runs, likelihood.rows, strict=True)):
        if (run.noise is None or run.of_impacts) and rows.any():
            readings = run.readings[rows]
            residual = (likelihood.predict(point, k, rows)[0] - readings)[~np.isnan(readings)]
            residual = likelihood.noise_model.whiten_tracking(k, residual)
            is_guess = run.of_impacts and run.noise is None  # no estimate from the readings, as of a smooth motion
            least = LEAST_WEIGHT if is_guess else likelihood.noise_model.scales[k]
            weights[k] = max(typical(residual, run), least)
    return likelihood.with_noise(likelihood.noise_model.with_weights(weights))


def _best_kappa_neighbours(
    likelihood: Likelihood, point: np.ndarray, along: np.ndarray, steps: Sequence[float], count: int
) -> list[np.ndarray]:
    """The `count` points (D,) of least χ² of those at relative steps of κ from a point, within bounds; along: change of
    all unknowns (D,) per change of κ."""
    k = likelihood.names.index("kappa")
    neighbours = [
        np.clip(point + along * (step if likelihood.unknowns[k].log else step * point[k]), *bounds(likelihood))
        for step in steps
    ]
    costs = np.array(in_threads(lambda z: cost(likelihood, z), neighbours, likelihood.workers))
    return [neighbours[i] for i in np.argsort(costs)[:count]]


def _direction_of_kappa(likelihood: Likelihood, point: np.ndarray) -> np.ndarray:
    """Change of all unknowns (D,) per change of κ along which χ² rises least.

    A change of κ alone changes the length of the strings, and so the period: χ² then says nothing of the mode.
    """
    k = likelihood.names.index("kappa")
    J = difference_jacobian(likelihood, point, likelihood.residuals(point))
    size = np.linalg.norm(J, axis=0)
    size[size == 0.0] = 1.0
    J = J / size
    others = np.arange(len(point)) != k
    along = np.ones(len(point))
    along[others] = -np.linalg.lstsq(J[:, others], J[:, k], rcond=None)[0] * size[k] / size[others]
    return along


def search_kappa_modes(
    likelihood: Likelihood, point: np.ndarray, least: float, options: SearchOptions = DEFAULT
) -> tuple[np.ndarray, float]:
    """Move among the shallow modes of κ, 1 to 2 % apart, while χ² falls; (point (D,), χ²). least: χ² at the point."""
    while math.isfinite(least):
        along = _direction_of_kappa(likelihood, point)
        neighbours = _best_kappa_neighbours(likelihood, point, along, options.kappa_steps, _KAPPA_MODES)
        refined = refine_each(likelihood, neighbours, _KAPPA_EVALUATIONS, options)
        best, best_cost = min(refined, key=lambda pair: pair[1])
        if best_cost >= least - _KAPPA_GAIN * abs(least):
            return (best, best_cost) if best_cost < least else (point, least)
        point, least = best, best_cost
    return point, least


def _with_rivals(likelihood: Likelihood, best: Mode, options: SearchOptions) -> Mode:
    """The mode with a covariance that also covers the modes of κ, along the valley of χ², that may be right instead.

    The covariance is that of a mixture of normal distributions about the modes, all as wide as the best one.
    """
    k = likelihood.names.index("kappa")
    unit = 1.0 if likelihood.unknowns[k].log else abs(best.point[k])
    scale = chi2_scale(best.cost, likelihood.reading_slices()[-1].stop)
    found, tried = [(best.point, best.cost)], 0
    while tried < min(len(found), _MOST_RIVALS):
        point = found[tried][0]
        tried += 1
        neighbours = [
            neighbour
            for neighbour in _best_kappa_neighbours(
                likelihood, point, _direction_of_kappa(likelihood, point), options.kappa_steps, len(options.kappa_steps)
            )
            if cost(likelihood, neighbour) < best.cost + _PROMISING * scale
        ]
        for reached, chi2 in refine_each(likelihood, neighbours, _KAPPA_EVALUATIONS, options):
            apart = min(abs(reached[k] - other[k]) for other, _ in found)
            if chi2 < best.cost + _RIVAL * scale and apart > options.mode_separation * unit:
                found.append((reached, chi2))
    weights = np.exp([0.5 * (best.cost - chi2) / scale for _, chi2 in found])
    away = np.array([point - best.point for point, _ in found])
    between = (away.T * (weights / weights.sum())) @ away
    return dataclasses.replace(best, covariance=best.covariance + between)


def search_close_kappa_modes(likelihood: Likelihood, point: np.ndarray, options: SearchOptions = DEFAULT) -> np.ndarray:
    """Move among the modes of κ that lie 0.03 to 0.6 % apart, as those of many bobs do, while χ² falls; (D,)."""
    least, readings = cost(likelihood, point), likelihood.reading_slices()[-1].stop
    steps = (*options.close_kappa_steps, *(-step for step in options.close_kappa_steps))
    alone = np.eye(len(point))[likelihood.names.index("kappa")]
    for _ in range(_CLOSE_KAPPA_ROUNDS if math.isfinite(least) else 0):
        neighbours = _best_kappa_neighbours(likelihood, point, alone, steps, options.close_kappa_modes)
        refined = refine_each(likelihood, neighbours, _CLOSE_KAPPA_EVALUATIONS, options)
        best, _ = min(refined, key=lambda pair: pair[1])
        best, best_cost = refine(likelihood, best, _CLOSE_KAPPA_FINAL_EVALUATIONS, options)
        if best_cost > least - chi2_scale(least, readings):
            break
        point, least = best, best_cost
    return point


def refit(likelihood: Likelihood, point: np.ndarray, options: SearchOptions = DEFAULT) -> tuple[Likelihood, np.ndarray]:
    """Refine a point near its mode, runs of unknown noise weighted by their residuals; (likelihood, point (D,))."""
    has_clicks = any(run.of_impacts for run in likelihood.experiment.runs)
    for _ in range(_REWEIGHTINGS if has_clicks else 1):
        before = likelihood.noise_model.weights
        likelihood = _reweight(likelihood, point)
        point = refine(likelihood, point, _FINAL_EVALUATIONS, options)[0]
        if all(new > _SETTLED * old for new, old in zip(likelihood.noise_model.weights, before, strict=True)):
            break
    return likelihood, point


def longest_run(likelihood: Likelihood) -> float:
    """Length of the longest run that is fitted [small-angle periods]."""
    runs = zip(likelihood.experiment.runs, likelihood.rows, strict=True)
    longest = max((run.times[rows][-1] - run.fit_from for run, rows in runs if rows.any()), default=0.0)
    return longest / likelihood.experiment.cradle.period


def early_rows(likelihood: Likelihood, periods: float) -> list[np.ndarray]:
    """The rows, (T,) of bool for each run, within its first small-angle periods."""
    limit = periods * likelihood.experiment.cradle.period
    return [
        rows & (run.times <= run.fit_from + limit)
        for run, rows in zip(likelihood.experiment.runs, likelihood.rows, strict=True)
    ]
