"""Checks of the readings before any model is fitted.

The check refuses runs that cannot be diagnosed (ValueError): readings in another unit than stated, too few readings,
too short a run, too few readings per swing. It warns of gaps in the readings of one bob or of all bobs, and of angles
so small that their unit is in doubt.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from cradle_env.cradle import Cradle
from identification.diagnosis.criteria import DEFAULT_CRITERIA, Criteria
from identification.experiment.experiment import Experiment
from identification.experiment.run import Run
from identification.experiment.train_test import training_rows
from identification.experiment.unit_check import angles_from_rest, check_unit
from identification.inference.likelihood import Likelihood

#: Unknowns that are counted at least: an effect that is missing adds some.
_MIN_UNKNOWNS = 10
#: Largest angle [rad] of readings in degrees from which their unit is believed: no cradle swings less than 0.6 degrees.
_MIN_SWING = 0.01


def without_clicks(experiment: Experiment) -> tuple[Experiment, tuple[str, ...]]:
    """The runs of angles and displacements, and a warning for each run of clicks that is left out.

    An experiment of clicks alone is returned as it is; `check_readings` refuses it.
    """
    clicks = [run for run in experiment.runs if run.of_impacts]
    runs = tuple(run for run in experiment.runs if not run.of_impacts)
    if not clicks or not runs:
        return experiment, ()
    left_out = tuple(f"{run.file}: clicks are left out; a diagnosis is of angles and displacements" for run in clicks)
    return dataclasses.replace(experiment, runs=runs).with_source(experiment.digest), left_out


def check_readings(experiment: Experiment, criteria: Criteria = DEFAULT_CRITERIA) -> tuple[str, ...]:
    """Warnings about the readings, one line each. Raises ValueError for runs that cannot be diagnosed."""
    warnings: list[str] = []
    for run in experiment.runs:
        if run.of_impacts:
            raise ValueError(f"{run.file}: instants of clicks; a diagnosis needs angles or displacements")
        cradle = experiment.cradle_of(run)
        check_unit(run, cradle)
        warnings += _warn_of_missing_readings(run, cradle)
        largest = float(np.nanmax(np.abs(angles_from_rest(run, cradle))))
        if run.unit == "deg" and run.release is None and largest < _MIN_SWING:
            warnings.append(
                f"{run.file}: the largest angle is {math.degrees(largest):.2g} deg; if the file is in radians,"
                " write [rad] in its header"
            )
    _check_amount(experiment, criteria)
    return tuple(warnings)


def _warn_of_missing_readings(run: Run, cradle: Cradle) -> list[str]:
    """Warnings of intervals, longer than a period, without a reading of a bob or of all bobs."""
    inside = run.times >= run.fit_from
    inside &= run.times <= (math.inf if run.fit_to is None else run.fit_to)
    times, seen = run.times[inside], ~np.isnan(run.readings[inside])
    gaps = _long_gaps(times, np.any(seen, axis=1), cradle.period)
    warnings = [f"{run.file}: no bob is seen from {low:.4g} to {high:.4g} s" for low, high in gaps]
    for bob in np.flatnonzero(seen.any(axis=0)):
        warnings += [
            f"{run.file}: bob {bob + 1} is not seen from {low:.4g} to {high:.4g} s"
            for low, high in _long_gaps(times, seen[:, bob], cradle.period) if (low, high) not in gaps
        ]  # fmt: skip
    return warnings


def _long_gaps(times: np.ndarray, seen: np.ndarray | np.bool_, longest: float) -> list[tuple[float, float]]:
    """Intervals [s] without a reading that last longer than `longest` [s], between the first and the last time."""
    known = np.concatenate([times[:1], times[seen], times[-1:]])
    return [(known[i], known[i + 1]) for i in np.flatnonzero(np.diff(known) > longest)]


def _check_amount(experiment: Experiment, criteria: Criteria) -> None:
    """Refuses a training part with too few readings, of too short a time, or with too few readings per swing."""
    rows = training_rows(experiment)[0]
    needed = criteria.min_readings_per_unknown * max(len(Likelihood(experiment, rows).unknowns), _MIN_UNKNOWNS)
    readings = sum(
        int((~np.isnan(run.readings[inside])).sum()) for run, inside in zip(experiment.runs, rows, strict=True)
    )
    if readings < needed:
        raise ValueError(f"{readings} readings to fit are too few for a diagnosis; give {needed} or more")
    for run, inside in zip(experiment.runs, rows, strict=True):
        times, period = run.times[inside], experiment.cradle.period
        if not len(times):
            continue
        span, spacing = float(np.ptp(times)), float(np.median(np.diff(times)))
        if span < criteria.min_periods * period:
            raise ValueError(
                f"{run.file}: {span:.3g} s to fit are too few for a diagnosis, less than"
                f" {criteria.min_periods:g} swings of {period:.3g} s; record for longer, or move fit_from and fit_to"
            )
        if spacing > period / criteria.min_readings_per_period:
            raise ValueError(
                f"{run.file}: readings every {spacing:.3g} s are too few for a swing of {period:.3g} s;"
                f" give {criteria.min_readings_per_period:g} or more in each"
            )
