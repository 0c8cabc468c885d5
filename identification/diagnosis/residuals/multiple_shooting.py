"""Multiple shooting: a fit in windows of time, each with a start state of its own.

A missing force shows in the window where it acts, and does not change the later windows. Source: Bock (1983), Recent
advances in parameter identification techniques for ODE, in: Numerical Treatment of Inverse Problems, Birkhäuser.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from cradle_env.cradle import Cradle
from cradle_env.parameter_name import ParameterName
from cradle_env.threads import in_threads
from identification.diagnosis.residuals.windows import equal_edges
from identification.experiment.run import Run
from identification.inference.fit_result import FitResult, ResidualIndex
from identification.inference.least_squares import bounds, difference_steps, residuals_or_penalty
from identification.inference.likelihood import Likelihood, hanging_radius
from identification.inference.start_points import point_at
from identification.inference.unknowns import WORN_TENSION_RATIO, name_in_run

#: Width of a window [small-angle periods].
_WINDOW_PERIODS = 3.0
#: Evaluations of the fit of all start states.
_EVALUATIONS = 12
#: Effects with a state of their own, which a window does not infer.
_STATEFUL_EFFECTS = ("string_creep", "frame_compliance")


def can_be_segmented(cradle: Cradle) -> bool:
    """Whether the state of the bobs alone can start a window: not if an effect has a state of its own."""
    return not any(map(cradle.has, _STATEFUL_EFFECTS))


def fit_multiple_shooting(fitted: FitResult) -> FitResult:
    """The model refitted to its readings in windows.

    Each window starts from an inferred state near that of the fitted model. The first window of a run that begins with
    a release keeps the release. Offsets of the rest positions stay as fitted.
    """
    experiment, likelihood = fitted.experiment, fitted.likelihood
    runs: list[Run] = []
    origins: list[int] = []
    values = {name: value for name, value in fitted.values.items() if ParameterName.parse(name).run is None}
    for k, (run, rows) in enumerate(zip(experiment.runs, likelihood.rows, strict=True)):
        if not rows.any():
            continue
        edges = _segment_edges(run.times[rows], _WINDOW_PERIODS * fitted.cradle.period)
        states = _start_states(fitted, k, edges[:-1])
        rest = np.array([fitted.values.get(name_in_run("rest", k, i + 1), 0.0) for i in range(fitted.cradle.bobs)])
        for number, (low, high) in enumerate(itertools.pairwise(edges)):
            inside = rows & (run.times >= low) & (run.times < high)
            if not inside.any():
                continue
            part = {"times": run.times[inside], "readings": run.readings[inside] - rest, "lines": None}
            part |= {"rest": "known", "fit_to": None}
            window = len(runs)
            origins.append(k)
            if number == 0:
                runs.append(dataclasses.replace(run, **part))
                own = {ParameterName.parse(name): value for name, value in fitted.values.items()}
                values |= {str(name.in_run(window + 1)): value for name, value in own.items() if name.run == k + 1}
            else:
                runs.append(dataclasses.replace(run, **part, state="free", release=None, fit_from=low))
                values |= {
                    name_in_run(quantity, window, bob): value for (quantity, bob), value in states[number].items()
                }
    in_windows = dataclasses.replace(experiment, runs=tuple(runs))
    shooting = Likelihood(in_windows, None, likelihood.workers)
    low, high = bounds(shooting)
    start = point_at(shooting, values)
    length = len(shooting.residuals(start))
    solution = least_squares(
        lambda point: residuals_or_penalty(shooting, point, length),
        start,
        lambda point: _segment_jacobian(shooting, point),  # type: ignore[arg-type]  # a function, which SciPy's stubs do not know of
        (low - 1e-12, high + 1e-12),
        x_scale=difference_steps(shooting),
        max_nfev=_EVALUATIONS,
    )
    return MultipleShootingFit(shooting, solution.x, tuple(origins))


@dataclass(frozen=True, eq=False)
class MultipleShootingFit(FitResult):
    """A fit with a start state per window; origins: the run (from 0) of each window."""

    origins: tuple[int, ...]

    @functools.cached_property
    def jacobian(self) -> np.ndarray:
        """Derivatives of the residuals with respect to the sampled coordinates, (R + P, D)."""
        return _segment_jacobian(self.likelihood, self.point)


def _segment_jacobian(likelihood: Likelihood, point: np.ndarray) -> np.ndarray:
    """Derivatives of the residuals, (R + P, D), by finite differences of one unknown of all windows at once.

    A start state changes only the readings of its window and its own prior, so one simulation serves all windows.
    """
    base, width, run = likelihood.residuals(point), difference_steps(likelihood), ResidualIndex.of(likelihood).run
    priors = len(run) + np.cumsum([not math.isnan(u.sd) for u in likelihood.unknowns]) - 1
    names = [ParameterName.parse(name) for name in likelihood.names]
    together: dict[ParameterName, list[int]] = {}
    for i, name in enumerate(names):
        together.setdefault(name.in_run(None), []).append(i)
    J = np.zeros((len(base), len(point)))

    def change(places: list[int]) -> np.ndarray:
        moved = point.copy()
        moved[places] += width[places]
        return residuals_or_penalty(likelihood, np.clip(moved, *bounds(likelihood)), len(base)) - base

    changes = in_threads(change, list(together.values()), likelihood.workers)
    for places, changed in zip(together.values(), changes, strict=True):
        for i in places:
            of_run = names[i].run
            own = np.arange(len(run)) if of_run is None else np.flatnonzero(run == of_run - 1)
            own = own if math.isnan(likelihood.unknowns[i].sd) else np.append(own, priors[i])
            J[own, i] = changed[own] / width[i]
    return J


def _segment_edges(times: np.ndarray, width: float) -> np.ndarray:
    """Times [s] at which windows begin, then infinity; times (T,): of the readings [s]."""
    return np.append(equal_edges(times[0], times[-1], width)[:-1], np.inf)


def _start_states(fitted: FitResult, index: int, starts: np.ndarray) -> list[dict[tuple[str, int], float]]:
    """The model's state of run `index` at each time of `starts` [s], by the quantity and bob of a free start."""
    motion = fitted.likelihood.motion(fitted.values, index, starts)
    cradle = motion.cradle
    hanging = hanging_radius(
        cradle, np.full(cradle.bobs, WORN_TENSION_RATIO) if cradle.has("string_hysteresis") else None
    )
    states = []
    for row in range(len(starts)):
        state = {}
        for i in range(cradle.bobs):
            state |= {
                ("theta", i + 1): motion.theta[row, i],
                ("theta_dot", i + 1): motion.theta_dot[row, i],
                ("stretch", i + 1): motion.r[row, i] - hanging[i],
                ("r_dot", i + 1): motion.r_dot[row, i],
            }
        states.append(state)
    return states
