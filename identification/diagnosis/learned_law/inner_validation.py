"""Prediction within the training part: a model fitted to the first two thirds of its time is held against the rest of
it. This extrapolates as the whole does, and never looks at what is held out."""

from __future__ import annotations

import dataclasses
import math

from identification.diagnosis.selection.fit_cache import fit_key
from identification.diagnosis.selection.searcher import Searcher, refine_to_mode
from identification.experiment.experiment import Experiment
from identification.experiment.train_test import training_rows
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.start_points import point_at

#: The part of the training time that is fitted.
_INNER = 2.0 / 3.0


def hold_out_last_third(experiment: Experiment) -> Experiment:
    """The training part alone, the last third of its time held out."""
    runs = []
    for run, rows in zip(experiment.runs, training_rows(experiment)[0], strict=True):
        if rows.any():
            times = run.times[rows]
            split = float(times[0] + _INNER * (times[-1] - times[0]))
            runs.append(dataclasses.replace(run, times=times, readings=run.readings[rows], lines=None, fit_to=split))
    return dataclasses.replace(experiment, runs=tuple(runs))


def validate_inner(fitted: FitResult, searcher: Searcher) -> tuple[FitResult, float]:
    """The model fitted to the first two thirds, and the gap of its prediction; inf where that ends before the readings
    do."""
    within = _fitted_within(fitted, searcher)
    try:
        return within, within.held_out_gap()
    except ImpossibleModelError:
        return within, math.inf


def _fitted_within(fitted: FitResult, searcher: Searcher) -> FitResult:
    """The model fitted to the first two thirds, from where it has its mode."""
    likelihood = searcher.likelihood(hold_out_last_third(fitted.experiment))
    key = fit_key("inner", likelihood.experiment, fitted.point.tolist())
    start = point_at(likelihood, fitted.values)
    return FitResult(likelihood, searcher.store.point(key, lambda: refine_to_mode(likelihood, start, thorough=True)))
