"""Search for the best mode of a posterior: random starts, early data, neighbouring modes of κ."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cradle_env.threads import in_threads
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.laplace import Mode, laplace_approximation
from identification.inference.least_squares import (
    MIN_BOBS_WITH_IMPACT_ORDER,
    bounds,
    chi2_scale,
    cost,
    difference_jacobian,
    refine,
    refine_each,
)
from identification.inference.likelihood import Likelihood
from identification.inference.noise_model import rms
from identification.progress import Progress

#: Points drawn over the search box; refined on the early data are the best of each of so many slices of κ, and so many
#: of the best of all; how far apart modes are in ln κ at least; how many of those found are refined on all data.
_DRAWS, _SLICES, _BEST, _APART, _FINISHED = 240, 12, 6, 2e-3, 2
#: The early data, in small-angle periods: over them the misfit is nearly convex in the stiffness of the strings. Where
#: how the strings begin is unknown too, over fewer; then so many of the best modes go on to twice as many periods.
_EARLY_PERIODS = 8.0
_FREE_PERIODS, _GOING_ON = (2.0, 4.0), (10, 5)
#: Relative steps of κ at which its shallow modes, 1–2 % apart, are looked for around the best point.
_KAPPA_STEPS = (-0.06, -0.045, -0.03, -0.02, -0.01, 0.01, 0.02, 0.03, 0.045, 0.06)
#: Relative steps of κ at which modes are looked for that lie nearer, as those of many bobs do, how many of them are
#: followed, and how often; evaluations on the way, and of the best of them.
_CLOSE_KAPPA_STEPS = (0.0003, 0.0007, 0.0015, 0.003, 0.006)
_TRIED, _CLIMBS, _WAY, _END = 4, 5, 5, 40


def find_mode(likelihood: Likelihood, seed: int = 0, progress: Progress | None = None) -> tuple[Likelihood, Mode]:
    """(the likelihood, with the noise that the mode leaves where it was unknown; its best mode).

    Random points in the search box are scored on the early data. The best of all and of each slice of κ are refined on
    the early data, the modes found there on all data, and then neighbouring values of κ are tried around the winner.
    """
    report = progress or (lambda *_: None)
    rng = np.random.default_rng(seed)
    free = any(run.state == "free" for run in likelihood.experiment.runs)
    stages = [
        Likelihood(likelihood.experiment, early_rows(likelihood, periods), likelihood.workers, likelihood.parameters)
        for periods in ((*_FREE_PERIODS, _EARLY_PERIODS) if free else (_EARLY_PERIODS,))
    ]
    width = np.array([u.search for u in likelihood.unknowns])
    starts = likelihood.start() + width * rng.uniform(-1.0, 1.0, (_DRAWS, len(width)))
    starts[0] = likelihood.start()
    starts = np.clip(starts, *bounds(likelihood))
    report("search", 0.0, f"{_DRAWS} points")
    costs = np.array(in_threads(lambda z: cost(stages[0], z), list(starts), likelihood.workers))
    chosen = [starts[i] for i in _choose_starts(likelihood, starts, costs)]
    parts = len(chosen) + (sum(_GOING_ON) if free else 0) + _FINISHED + 2
    refined, done = [], 0
    for early, going_on in zip(stages, (*_GOING_ON, 0), strict=False):
        refined = []
        for reached in refine_each(early, chosen, 15):
            done += 1
            report("search", done / parts, "refining on the early data")
            refined.append(reached)
        refined.sort(key=lambda pair: pair[1])
        chosen = [point for point, _ in refined[:going_on]]
    chosen = _distinct_modes(likelihood, refined)[:_FINISHED]
    several = "kappa" in likelihood.names and likelihood.experiment.cradle.bobs >= MIN_BOBS_WITH_IMPACT_ORDER
    if several and refined[0][1] > stages[-1].reading_slices()[-1].stop:  # not clearly the right one
        report("search", done / parts, "neighbouring modes of κ on the early data")
        chosen = [search_close_kappa_modes(stages[-1], point) for point in chosen]
    report("search", (done + 1) / parts, "refining on all data")
    point, least = min(refine_each(likelihood, chosen, 20), key=lambda pair: pair[1])
    if not math.isfinite(least):
        raise ImpossibleModelError(
            "no point of the search can be simulated over all data: state values nearer to the truth"
        )
    if "kappa" in likelihood.names:
        report("search", 0.9, "neighbouring modes of κ")
        point, least = search_kappa_modes(likelihood, point, least)
    likelihood = _reweight(likelihood, point)
    point = refine(likelihood, point, 40)[0]
    return likelihood, laplace_approximation(
        likelihood, point, difference_jacobian(likelihood, point, likelihood.residuals(point))
    )


def _choose_starts(likelihood: Likelihood, starts: np.ndarray, costs: np.ndarray) -> list[int]:
    """Which of the starts (K, D): the best of all, and the best in each slice of κ, whose modes are narrow while the
    other unknowns count for more in a draw."""
    best = np.argsort(costs)[:_BEST]
    if "kappa" not in likelihood.names:
        return [int(i) for i in best]
    slices = np.array_split(np.argsort(starts[:, likelihood.names.index("kappa")]), _SLICES)
    return list(dict.fromkeys([*map(int, best), *(int(some[np.argmin(costs[some])]) for some in slices)]))


def _distinct_modes(likelihood: Likelihood, refined: list[tuple[np.ndarray, float]]) -> list[np.ndarray]:
    """The points (D,) of several modes, the best first, those in κ once each."""
    kept: list[np.ndarray] = []
    for point, _ in sorted(refined, key=lambda pair: pair[1]):
        if "kappa" in likelihood.names:
            k = likelihood.names.index("kappa")
            scale = 1.0 if likelihood.unknowns[k].log else abs(point[k])
            if any(abs(point[k] - other[k]) < _APART * scale for other in kept):
                continue
        kept.append(point)
    return kept


def _reweight(likelihood: Likelihood, point: np.ndarray) -> Likelihood:
    """The likelihood, runs of unknown noise weighted by what the point leaves, so that priors count in proportion."""
    weights = list(likelihood.noise_model.weights)
    for k, (run, rows) in enumerate(zip(likelihood.experiment.runs, likelihood.rows, strict=True)):
        if run.noise is None and rows.any():
            residual = likelihood.predict(point, k, rows)[0] - run.readings[rows]
            weights[k] = max(rms(residual), likelihood.noise_model.scales[k])
    return likelihood.with_noise(likelihood.noise_model.with_weights(weights))


def best_kappa_neighbours(
    likelihood: Likelihood, point: np.ndarray, steps: Sequence[float], count: int
) -> list[np.ndarray]:  # fmt: skip
    """Of the points (D,) at relative steps of κ from a point, within bounds, the `count` with the least χ²."""
    k = likelihood.names.index("kappa")
    rungs = []
    for step in steps:
        rung = point.copy()
        rung[k] += step if likelihood.unknowns[k].log else step * point[k]
        rungs.append(np.clip(rung, *bounds(likelihood)))
    costs = np.array(in_threads(lambda z: cost(likelihood, z), rungs, likelihood.workers))
    return [rungs[i] for i in np.argsort(costs)[:count]]


def search_kappa_modes(likelihood: Likelihood, point: np.ndarray, least: float) -> tuple[np.ndarray, float]:
    """The better of the point and what its neighbours in κ lead to."""
    while True:
        rungs = best_kappa_neighbours(likelihood, point, _KAPPA_STEPS, 3)
        best, best_cost = min(refine_each(likelihood, rungs, 8), key=lambda pair: pair[1])
        if not best_cost < least - 1e-3 * abs(least):  # nor where nothing can be simulated
            return (best, best_cost) if best_cost < least else (point, least)
        point, least = best, best_cost


def search_close_kappa_modes(likelihood: Likelihood, point: np.ndarray) -> np.ndarray:
    """The best mode that fine steps of κ lead to, on and on; (D,)."""
    so_far, readings = cost(likelihood, point), likelihood.reading_slices()[-1].stop
    for _ in range(_CLIMBS if math.isfinite(so_far) else 0):
        rungs = best_kappa_neighbours(
            likelihood, point, (*_CLOSE_KAPPA_STEPS, *(-rung for rung in _CLOSE_KAPPA_STEPS)), _TRIED
        )
        best, least = min(refine_each(likelihood, rungs, _WAY), key=lambda pair: pair[1])
        best, least = refine(likelihood, best, _END)
        if least > so_far - chi2_scale(so_far, readings):
            break
        point, so_far = best, least
    return point


def refit(likelihood: Likelihood, point: np.ndarray) -> tuple[Likelihood, np.ndarray]:
    """(the likelihood, runs of unknown noise weighted by what the point leaves; the mode near the point, (D,))."""
    likelihood = _reweight(likelihood, point)
    return likelihood, refine(likelihood, point, 40)[0]


def early_rows(likelihood: Likelihood, periods: float = _EARLY_PERIODS) -> list[np.ndarray]:
    """The rows of the first periods of each run."""
    limit = periods * likelihood.experiment.cradle.period
    return [
        rows & (run.times <= run.fit_from + limit)
        for run, rows in zip(likelihood.experiment.runs, likelihood.rows, strict=True)
    ]
