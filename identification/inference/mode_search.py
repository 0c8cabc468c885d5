"""The best point of a posterior, found globally, and its Gaussian neighbourhood."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from cradle_env.simulation import SimulationError
from cradle_env.threads import each_in_threads, in_threads
from identification.experiment.experiment import Experiment
from identification.experiment.run import Run
from identification.inference.likelihood import Likelihood, rms

#: Points drawn over the search box; refined on the early data are the best of each of so many slices of κ, and so many
#: of the best of all; how far apart modes are in ln κ at least; how many of those found are refined on all data.
_DRAWS, _SLICES, _BEST, _APART, _FINISHED = 240, 12, 6, 2e-3, 2
#: The early data, in small-angle periods: over them the misfit is nearly convex in the stiffness of the strings. Where
#: how the strings begin is unknown too, over fewer; then so many of the best modes go on to twice as many periods.
_EARLY_PERIODS = 8.0
_FREE_PERIODS, _GOING_ON = (2.0, 4.0), (10, 5)
#: Relative steps of κ at which its shallow modes, 1–2 % apart, are looked for around the best point.
_LADDER = (-0.06, -0.045, -0.03, -0.02, -0.01, 0.01, 0.02, 0.03, 0.045, 0.06)
#: Relative steps of κ at which modes are looked for that lie nearer, as those of many bobs do, how many of them are
#: followed, and how often; evaluations on the way, and of the best of them.
_RUNGS = (0.0003, 0.0007, 0.0015, 0.003, 0.006)
_TRIED, _CLIMBS, _WAY, _END = 4, 5, 5, 40
#: The residual [sigma] of every reading at an impossible point.
_IMPOSSIBLE = 1e4
#: Gain in χ², over what a reading leaves, at which least squares ends.
_GAIN = 1e-3
#: The number of bobs from which on their impacts have an order that may flip, so that readings jump.
SEVERAL = 3
#: A step that changes the residuals otherwise than foretold by less than this part of the change leaves derivatives
#: good enough to be corrected by it alone.
_FORETOLD = 0.3

Progress = Callable[[str, float, str], None]


@dataclass(frozen=True)
class Mode:
    """A mode of the posterior: point (D,) and covariance (D, D) in sampled coordinates, sum of squared residuals."""

    point: np.ndarray
    covariance: np.ndarray
    cost: float


def find_mode(likelihood: Likelihood, seed: int = 0, progress: Progress | None = None) -> Mode:
    """The best mode: random draws over the search box scored on the early data, the best of all and of each slice of κ
    refined on it, the modes so found on all data, and neighbouring values of κ tried around the winner."""
    tell = progress or (lambda *_: None)
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
    tell("search", 0.0, f"{_DRAWS} points")
    costs = np.array(in_threads(lambda z: cost(stages[0], z), list(starts), likelihood.workers))
    chosen = [starts[i] for i in _worth_refining(likelihood, starts, costs)]
    parts = len(chosen) + (sum(_GOING_ON) if free else 0) + _FINISHED + 2
    refined, done = [], 0
    for early, going_on in zip(stages, (*_GOING_ON, 0), strict=False):
        refined = []
        for reached in refined_from(early, chosen, 15):
            done += 1
            tell("search", done / parts, "refining on the early data")
            refined.append(reached)
        refined.sort(key=lambda pair: pair[1])
        chosen = [point for point, _ in refined[:going_on]]
    chosen = _distinct(likelihood, refined)[:_FINISHED]
    several = "kappa" in likelihood.names and likelihood.experiment.cradle.bobs >= SEVERAL
    if several and refined[0][1] > stages[-1].parts()[-1].stop:  # not clearly the right one
        tell("search", done / parts, "neighbouring modes of κ on the early data")
        chosen = [climb(stages[-1], point) for point in chosen]
    tell("search", (done + 1) / parts, "refining on all data")
    point, least = min(refined_from(likelihood, chosen, 20), key=lambda pair: pair[1])
    if not math.isfinite(least):
        raise SimulationError("no point of the search can be simulated over all data: state values nearer to the truth")
    if "kappa" in likelihood.names:
        tell("search", 0.9, "neighbouring modes of κ")
        point, least = climb_ladder(likelihood, point, least)
    _reweigh(likelihood, point)
    point = refine(likelihood, point, 40)[0]
    return mode_at(likelihood, point, jacobian(likelihood, point, likelihood.residuals(point)))


def _worth_refining(likelihood: Likelihood, starts: np.ndarray, costs: np.ndarray) -> list[int]:
    """Which of the starts (K, D): the best of all, and the best in each slice of κ, whose modes are narrow while the
    other unknowns count for more in a draw."""
    best = np.argsort(costs)[:_BEST]
    if "kappa" not in likelihood.names:
        return [int(i) for i in best]
    slices = np.array_split(np.argsort(starts[:, likelihood.names.index("kappa")]), _SLICES)
    return list(dict.fromkeys([*map(int, best), *(int(some[np.argmin(costs[some])]) for some in slices)]))


def _distinct(likelihood: Likelihood, refined: list[tuple[np.ndarray, float]]) -> list[np.ndarray]:
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


def _reweigh(likelihood: Likelihood, point: np.ndarray) -> None:
    """Sets the weight of runs with unknown noise to what the point leaves, so that priors count as they should."""
    for k, (run, rows) in enumerate(zip(likelihood.experiment.runs, likelihood.rows, strict=True)):
        if run.noise is None and rows.any():
            residual = likelihood.predict(point, k, rows)[0] - run.readings[rows]
            likelihood.weighing[k] = max(rms(residual), likelihood.noise[k])


def best_rungs(
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


def climb_ladder(likelihood: Likelihood, point: np.ndarray, least: float) -> tuple[np.ndarray, float]:
    """The better of the point and what its neighbours in κ lead to."""
    while True:
        rungs = best_rungs(likelihood, point, _LADDER, 3)
        best, best_cost = min(refined_from(likelihood, rungs, 8), key=lambda pair: pair[1])
        if not best_cost < least - 1e-3 * abs(least):  # nor where nothing can be simulated
            return (best, best_cost) if best_cost < least else (point, least)
        point, least = best, best_cost


def climb(likelihood: Likelihood, point: np.ndarray) -> np.ndarray:
    """The best mode that fine steps of κ lead to, on and on; (D,)."""
    so_far, readings = cost(likelihood, point), likelihood.parts()[-1].stop
    for _ in range(_CLIMBS if math.isfinite(so_far) else 0):
        rungs = best_rungs(likelihood, point, (*_RUNGS, *(-rung for rung in _RUNGS)), _TRIED)
        best, least = min(refined_from(likelihood, rungs, _WAY), key=lambda pair: pair[1])
        best, least = refine(likelihood, best, _END)
        if least > so_far - unit(so_far, readings):
            break
        point, so_far = best, least
    return point


def refit(likelihood: Likelihood, point: np.ndarray) -> np.ndarray:
    """The mode near a point, (D,)."""
    _reweigh(likelihood, point)
    return refine(likelihood, point, 40)[0]


def early_rows(likelihood: Likelihood, periods: float = _EARLY_PERIODS) -> list[np.ndarray]:
    """The rows of the first periods of each run."""
    limit = periods * likelihood.experiment.cradle.period
    return [
        rows & (run.times <= run.fit_from + limit)
        for run, rows in zip(likelihood.experiment.runs, likelihood.rows, strict=True)
    ]


def bounds(likelihood: Likelihood) -> tuple[np.ndarray, np.ndarray]:
    """Sampled coordinates between which the search stays; both (D,)."""
    low = np.array([math.log(u.low) if u.log else u.low for u in likelihood.unknowns])
    high = np.array([math.log(u.high) if u.log else u.high for u in likelihood.unknowns])
    inset = np.where(np.isfinite(high - low), 1e-9 * (high - low), 0.0)
    return low + inset, high - inset


def safe_residuals(likelihood: Likelihood, point: np.ndarray, length: int | None = None) -> np.ndarray:
    """Residuals, or huge ones where the point is impossible."""
    try:
        return likelihood.residuals(point)
    except (SimulationError, ValueError):
        if length is None:
            raise
        return np.full(length, _IMPOSSIBLE)


def cost(likelihood: Likelihood, point: np.ndarray) -> float:
    """Sum of squared residuals at a point; infinite where it is impossible."""
    try:
        found = float(np.sum(likelihood.residuals(point) ** 2))
    except (SimulationError, ValueError):
        return math.inf
    return math.inf if math.isnan(found) else found


def unit(chi2: float, readings: int) -> float:
    """What one unit of χ² is worth: 1, or the χ² that each reading leaves where that is more. Differences far below
    what a model leaves say nothing about it."""
    return max(1.0, chi2 / max(readings, 1))


def steps(likelihood: Likelihood) -> np.ndarray:
    """Finite-difference steps of the coordinates, (D,): small against what is known of each."""
    found = []
    for u in likelihood.unknowns:
        if u.log:
            found.append(1e-4)
        elif not math.isnan(u.sd):
            found.append(1e-2 * u.sd)
        else:
            found.append(1e-3 * u.search if u.search > 0.0 else 1e-5)
    return np.array(found)


def jacobian(likelihood: Likelihood, point: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Derivatives of the residuals (R, D), by one-sided differences that stay within the bounds."""
    high = bounds(likelihood)[1]
    width = steps(likelihood)
    width = np.where(point + width > high, -width, width)
    moved = point + np.diag(width)
    columns = in_threads(lambda z: safe_residuals(likelihood, z, len(base)), list(moved), likelihood.workers)
    return (np.array(columns) - base).T / width


def refine(likelihood: Likelihood, point: np.ndarray, evaluations: int) -> tuple[np.ndarray, float]:
    """(point, sum of squared residuals) that least squares reaches in at most so many evaluations; (start, inf) where
    it cannot begin."""
    low, high = bounds(likelihood)
    inside = np.clip(point, low, high)
    try:
        first = likelihood.residuals(inside)
    except (SimulationError, ValueError):
        return inside, math.inf
    length, cost_before = len(first), math.inf
    if not len(inside):
        return inside, cost(likelihood, inside)
    descent = _Descent(likelihood, inside, first)
    while True:
        found = least_squares(
            descent.residuals,
            inside,
            descent.derivatives,  # type: ignore[arg-type]  # a function, which SciPy's stubs do not know of
            (low - 1e-12, high + 1e-12),
            x_scale=steps(likelihood),
            max_nfev=evaluations,
            xtol=1e-8,
            ftol=_GAIN / max(length, 1),
        )
        inside, evaluations = found.x, evaluations - found.nfev
        if evaluations <= 0 or descent.fresh or cost_before - found.cost < _GAIN / max(length, 1) * found.cost:
            return found.x, 2.0 * float(found.cost)
        cost_before = found.cost  # corrected derivatives may have ended it: once more, with new ones
        descent = _Descent(likelihood, found.x, found.fun)


def refined_from(
    likelihood: Likelihood, points: Sequence[np.ndarray], evaluations: int
) -> Iterator[tuple[np.ndarray, float]]:  # fmt: skip
    """What `refine` reaches from each of several points, side by side: much of a descent is one simulation after
    another."""
    return each_in_threads(lambda point: refine(likelihood, point, evaluations), points, likelihood.workers)


class _Descent:
    """Residuals and their derivatives at the points of a descent. Derivatives are taken by differences, a simulation
    for each unknown, only where readings may jump or the last step did not do about what they foretold; else that step
    corrects them (Broyden 1965). fresh: whether the last are by differences."""

    def __init__(self, likelihood: Likelihood, start: np.ndarray, residuals: np.ndarray):
        self.likelihood, self.fresh = likelihood, True
        self.width = steps(likelihood)
        self._seen = start.copy(), residuals
        self._at: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Those at a point, (R,); where they were asked for last, at once."""
        if not np.array_equal(self._seen[0], point):
            self._seen = point.copy(), safe_residuals(self.likelihood, point, len(self._seen[1]))
        return self._seen[1]

    def derivatives(self, point: np.ndarray) -> np.ndarray:
        """Those at a point, (R, D)."""
        value = self.residuals(point)
        J = self._corrected(point, value)
        self.fresh = J is None
        if J is None:
            J = jacobian(self.likelihood, point, value)
        self._at = point.copy(), value, J
        return J

    def _corrected(self, point: np.ndarray, value: np.ndarray) -> np.ndarray | None:
        """The last derivatives, corrected in the direction of the step since; None where that went astray."""
        if self._at is None or self.likelihood.experiment.cradle.bobs >= SEVERAL:
            return None
        last, before, J = self._at
        step, change = point - last, value - before
        unforeseen = change - J @ step
        if np.linalg.norm(unforeseen) >= _FORETOLD * np.linalg.norm(change):
            return None
        scaled = step / self.width
        return J + np.outer(unforeseen, scaled / self.width) / (scaled @ scaled)


def mode_at(likelihood: Likelihood, point: np.ndarray, J: np.ndarray) -> Mode:
    """The mode at a point, with its covariance, from derivatives J of the residuals (R, D); unknown noise goes to the
    RMS of the residuals that are left."""
    residuals, parts = likelihood.residuals(point), likelihood.parts()
    least, weight = float(np.sum(residuals**2)), np.ones(len(residuals))
    point = point.copy()
    for k, part in enumerate(parts):
        name = f"noise@{k + 1}"
        if name in likelihood.names and part.stop > part.start:
            scale = max(rms(residuals[part]), 1e-3)
            weight[part] = 1.0 / scale
            point[likelihood.names.index(name)] = math.log(likelihood.weighing[k] * scale)
    information = (J * weight[:, None] ** 2).T @ J
    for i, u in enumerate(likelihood.unknowns):
        if u.name.startswith("noise@"):
            part = parts[int(u.name.partition("@")[2]) - 1]
            information[i, i] = 2.0 * (part.stop - part.start)
        # What the data leave open is as wide as its bounds allow.
        open_width = min(u.high - u.low, 10.0 * max(u.search, abs(u.start), 1e-3)) if not u.log else 5.0
        information[i, i] += 1.0 / open_width**2
    return Mode(point, well_conditioned(np.linalg.inv(information)), least)


def well_conditioned(covariance: np.ndarray) -> np.ndarray:
    """The covariance (D, D), symmetric and positive: correlations closer to 1 than rounding allows are cut off."""
    sd = np.sqrt(np.maximum(np.abs(np.diag(covariance)), 1e-300))
    correlation = 0.5 * (covariance + covariance.T) / np.outer(sd, sd)
    values, vectors = np.linalg.eigh(correlation)
    return np.outer(sd, sd) * ((vectors * np.maximum(values, 1e-9)) @ vectors.T)


def training_rows(experiment: Experiment) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """(rows to train on, rows held out), one (T,) of bool per run each.

    Held out is what lies beyond fit_to; where no run states it, the last of several runs if nothing of it is unknown
    but its noise and how exactly it was released, else the last third in time of each.
    """
    runs = experiment.runs
    if any(run.held_out.any() for run in runs):
        return [run.fitted for run in runs], [run.held_out for run in runs]
    if len(runs) > 1 and runs[-1].state == "release" and runs[-1].rest == "known":
        train = [run.fitted for run in runs[:-1]] + [np.zeros_like(runs[-1].fitted)]
        return train, [np.zeros_like(run.fitted) for run in runs[:-1]] + [runs[-1].fitted]
    ends = [_two_thirds(run) for run in runs]
    return (
        [run.fitted & (run.times <= end) for run, end in zip(runs, ends, strict=True)],
        [run.fitted & (run.times > end) for run, end in zip(runs, ends, strict=True)],
    )


def _two_thirds(run: Run) -> float:
    """The time [s] at which two thirds of what may be fitted of a run are over."""
    seen = run.times[run.fitted]
    return float(seen[0] + 2.0 / 3.0 * (seen[-1] - seen[0]))
