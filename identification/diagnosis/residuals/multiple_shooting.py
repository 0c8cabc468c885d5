"""A fitted model, window by window with start states of their own: a force shows where it acts, and not smeared over
all that follows."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from cradle_env.cradle import Cradle
from cradle_env.threads import in_threads
from identification.diagnosis.residuals.windows import equal_edges
from identification.experiment.run import Run
from identification.inference.fit_result import Fitted, Readings
from identification.inference.least_squares import bounds, safe_residuals, steps
from identification.inference.likelihood import Likelihood, hanging_radius
from identification.inference.start_points import placed
from identification.inference.unknowns import WORN

#: Width of a window [small-angle periods].
_WINDOW_PERIODS = 3.0
#: Evaluations of the fit of all start states.
_EVALUATIONS = 12
#: Effects with a state of their own, which a window does not infer.
_STATEFUL_EFFECTS = ("string_creep", "frame_compliance")


def can_be_segmented(cradle: Cradle) -> bool:
    """Whether a window can begin anew: with what goes on beside the motion of the bobs, none can."""
    return not any(map(cradle.has, _STATEFUL_EFFECTS))


def fit_multiple_shooting(fitted: Fitted) -> Fitted:
    """The model refitted to its readings cut into windows: each begins with a state of its own, inferred, near that
    of the model; the first of a run that begins with a release keeps it. Offsets of rest stay as fitted."""
    experiment, likelihood = fitted.experiment, fitted.likelihood
    runs: list[Run] = []
    origins: list[int] = []
    values = {name: value for name, value in fitted.values.items() if "@" not in name}
    for k, (run, rows) in enumerate(zip(experiment.runs, likelihood.rows, strict=True)):
        if not rows.any():
            continue
        edges = _segment_edges(run.times[rows], _WINDOW_PERIODS * fitted.cradle.period)
        states = _start_states(fitted, k, edges[:-1])
        rest = np.array([fitted.values.get(f"rest[{i + 1}]@{k + 1}", 0.0) for i in range(fitted.cradle.bobs)])
        for number, (low, high) in enumerate(itertools.pairwise(edges)):
            inside = rows & (run.times >= low) & (run.times < high)
            if not inside.any():
                continue
            cut = {"times": run.times[inside], "readings": run.readings[inside] - rest, "rest": "known", "fit_to": None,
                   "lines": None}  # fmt: skip
            at = f"@{len(runs) + 1}"
            origins.append(k)
            if number == 0:
                runs.append(dataclasses.replace(run, **cut))
                values |= {name.partition("@")[0] + at: value for name, value in fitted.values.items()
                           if name.endswith(f"@{k + 1}")}  # fmt: skip
            else:
                runs.append(dataclasses.replace(run, **cut, state="free", release=None, fit_from=low))
                values |= {name + at: value for name, value in states[number].items()}
    cut_up = dataclasses.replace(experiment, runs=tuple(runs))
    view = Likelihood(cut_up, None, likelihood.workers)
    low, high = bounds(view)
    start = placed(view, values)
    length = len(view.residuals(start))
    reached = least_squares(
        lambda point: safe_residuals(view, point, length),
        start,
        lambda point: _segment_jacobian(view, point),  # type: ignore[arg-type]  # a function, which SciPy's stubs do not know of
        (low - 1e-12, high + 1e-12),
        x_scale=steps(view),
        max_nfev=_EVALUATIONS,
    )
    return MultipleShootingFit(view, reached.x, tuple(origins))


@dataclass(frozen=True, eq=False)
class MultipleShootingFit(Fitted):
    """A fit with start states of each window, whose derivatives are all had at once; origins: the run of each."""

    origins: tuple[int, ...]

    @functools.cached_property
    def jacobian(self) -> np.ndarray:
        """Derivatives of the residuals with respect to the sampled coordinates, (R + P, D)."""
        return _segment_jacobian(self.likelihood, self.point)


def _segment_jacobian(likelihood: Likelihood, point: np.ndarray) -> np.ndarray:
    """`fit.jacobian`, the same quantity of all windows moved at once: each moves its own readings and prior alone."""
    base, width, run = likelihood.residuals(point), steps(likelihood), Readings.of(likelihood).run
    priors = len(run) + np.cumsum([not math.isnan(u.sd) for u in likelihood.unknowns]) - 1
    together: dict[str, list[int]] = {}
    for i, name in enumerate(likelihood.names):
        together.setdefault(name.partition("@")[0], []).append(i)
    J = np.zeros((len(base), len(point)))

    def change(places: list[int]) -> np.ndarray:
        moved = point.copy()
        moved[places] += width[places]
        return safe_residuals(likelihood, np.clip(moved, *bounds(likelihood)), len(base)) - base

    changes = in_threads(change, list(together.values()), likelihood.workers)
    for places, changed in zip(together.values(), changes, strict=True):
        for i in places:
            window = likelihood.names[i].partition("@")[2]
            own = np.flatnonzero(run == int(window) - 1) if window else np.arange(len(run))
            own = own if math.isnan(likelihood.unknowns[i].sd) else np.append(own, priors[i])
            J[own, i] = changed[own] / width[i]
    return J


def _segment_edges(times: np.ndarray, width: float) -> np.ndarray:
    """Where windows begin, and past the end of the last; readings (T,) [s]."""
    return np.append(equal_edges(times[0], times[-1], width)[:-1], np.inf)


def _start_states(fitted: Fitted, index: int, starts: np.ndarray) -> list[dict[str, float]]:
    """Of run `index` at each time [s], the model's state by the names of the unknowns of a free start."""
    motion = fitted.likelihood.motion(fitted.values, index, starts)
    cradle = motion.cradle
    hanging = hanging_radius(cradle, np.full(cradle.bobs, WORN) if cradle.has("string_hysteresis") else None)
    found = []
    for row in range(len(starts)):
        state = {}
        for i in range(cradle.bobs):
            state |= {
                f"theta[{i + 1}]": motion.theta[row, i],
                f"theta_dot[{i + 1}]": motion.theta_dot[row, i],
                f"stretch[{i + 1}]": motion.r[row, i] - hanging[i],
                f"r_dot[{i + 1}]": motion.r_dot[row, i],
            }
        found.append(state)
    return found
