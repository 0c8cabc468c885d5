"""The grid of possible runs, searched for the most informative ones to first order."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from identification.diagnosis.criteria import Criteria
from identification.diagnosis.next_experiment.planned_run import Instrument, PlannedRun, Setting
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.progress import Progress

#: Release angles of the grid [rad]: from where friction matters most to where a large swing does.
_ANGLES = (0.05, 0.1, 0.2, 0.4, 0.8, 1.2)
#: δ of the grid, besides the present one: bobs pressed together, just touching, and apart.
_DELTAS = (-0.002, 0.0, 0.002, 0.01)
#: Durations of the grid [s].
_DURATIONS = (15.0, 30.0, 60.0)
#: Release angles of the first look [rad]; it uses the first at which the models can be predicted in any run.
_FIRST_LOOK = (0.2, 0.1, 0.05, 0.4)
#: Pairs (bobs on the cradle, bobs lifted) that the whole grid is evaluated for.
_SHAPES = 2
#: Share of its information that a run must gain by being longer.
_LONGER = 0.1
#: Information that is enough: a longer run is not needed for more.
_ENOUGH = 1e4

#: Expected information of a planned run of a given duration [s]: one number per pair of models, or one for λ.
Information = Callable[[list[PlannedRun], float], np.ndarray]


def describe_run(setting: Setting, duration: float) -> str:
    """A run in a few words."""
    lifted = f", {setting.lifted} released" if setting.bobs > 1 else " released"
    bobs = f"{setting.bobs} bob{'s' if setting.bobs > 1 else ''}"
    delta = f", δ = {setting.delta}" if setting.bobs > 1 else ""
    return f"{bobs}{lifted} at {setting.angle:g} rad{delta}, {duration:g} s"


def search_grid(
    models: Sequence[FitResult],
    instrument: Instrument,
    information: Information,
    progress: Progress,
    criteria: Criteria,
) -> dict[Setting, tuple[float, np.ndarray]]:
    """Settings with their duration [s] and expected information, the most informative first.

    1. Every number of bobs on the cradle and lifted, at one angle and the present δ.
    2. All angles and δ with the best of these.
    """
    now, most = models[0].experiment.runs[0].delta, models[0].cradle.bobs
    fixed = "delta" in models[0].likelihood.names
    evaluated: dict[Setting, tuple[float, np.ndarray]] = {}

    def evaluate(settings: Sequence[Setting], stage: str) -> None:
        for k, setting in enumerate(settings):
            progress(stage, k / len(settings), describe_run(setting, _DURATIONS[-1]))
            if setting in evaluated:
                continue
            try:
                evaluated[setting] = _evaluate_setting(models, instrument, setting, information)
            except (
                ImpossibleModelError,
                np.linalg.LinAlgError,
            ):  # one of the models cannot be simulated in this setting
                continue

    shapes = [(n, k) for n in range(1, most + 1) for k in range(1, max(n, 2))]
    for angle in _FIRST_LOOK:
        evaluate([Setting(n, k, angle, _delta(now, n, most)) for n, k in shapes], "grid")
        if evaluated:
            break
    best = list(dict.fromkeys((s.bobs, s.lifted) for s in rank_settings(evaluated, criteria)))[:_SHAPES]
    grid = []
    for n, k in best:
        deltas = [_delta(now, n, most)] if n == 1 or fixed else [_delta(now, n, most), *_DELTAS]
        grid += [Setting(n, k, angle, delta) for angle in _ANGLES for delta in dict.fromkeys(deltas)]
    evaluate(grid, "grid, closer")
    return {setting: evaluated[setting] for setting in rank_settings(evaluated, criteria)}


def _delta(now: float | tuple[float, ...], bobs: int, most: int) -> float | tuple[float, ...]:
    """The present δ for a cradle of fewer bobs."""
    return now if bobs == most or not isinstance(now, tuple) else float(np.mean(now))


def rank_settings(evaluated: dict[Setting, tuple[float, np.ndarray]], criteria: Criteria) -> list[Setting]:
    """Settings by their smallest information over the pairs that any setting tells apart, or else over all pairs."""
    if not evaluated:
        return []
    apart = np.max([value for _, value in evaluated.values()], axis=0) >= criteria.equivalent_log_odds
    apart = apart if apart.any() else ~apart
    return sorted(evaluated, key=lambda setting: -float(evaluated[setting][1][apart].min()))


def _evaluate_setting(
    models: Sequence[FitResult], instrument: Instrument, setting: Setting, information: Information
) -> tuple[float, np.ndarray]:
    """(duration [s], information) of the shortest run that is nearly as informative as the longest predictable one."""
    run = instrument.run(setting, _DURATIONS[-1])
    planned = [PlannedRun(model, run) for model in models]
    predictable = min(model.predictable_duration for model in planned)
    values = [information(planned, duration) for duration in _DURATIONS if duration <= predictable]
    if not values:
        raise ImpossibleModelError(f"the models cannot predict this run beyond {predictable:g} s")
    wanted = min((1.0 - _LONGER) * values[-1].min(), _ENOUGH)
    k = next(k for k, value in enumerate(values) if value.min() >= wanted or k == len(values) - 1)
    return _DURATIONS[k], values[k]
