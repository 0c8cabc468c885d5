"""What can be said of measured runs before any model is fitted: unusable ones are refused, doubtful ones told.

Refused (ValueError): readings in another unit than stated, too few of them, too short a time, too sparse a sampling.
Told: a bob, or all of them, unseen for a while; angles so small that their unit is in doubt.
"""

from __future__ import annotations

import math

import numpy as np

from cradle_env.cradle import Cradle
from identification.experiment.experiment import Experiment
from identification.experiment.run import Run
from identification.experiment.train_test import training_rows
from identification.experiment.unit_check import angles_read, check_unit
from identification.inference.likelihood import Likelihood

#: Readings per unknown below which nothing can be said, and the unknowns that are counted at least.
_FEWEST, _UNKNOWNS = 5, 10
#: Small-angle periods that a training part must span, and readings that one must hold.
_SHORTEST, _DENSEST = 2.0, 6.0
#: Degrees that no experiment stays below [rad].
_TINY = 0.01


def check_readings(experiment: Experiment) -> tuple[str, ...]:
    """What to know about the readings, one line each; ValueError for what cannot be diagnosed."""
    warnings: list[str] = []
    for run in experiment.runs:
        cradle = experiment.cradle_of(run)
        check_unit(run, cradle)
        warnings += _warn_of_missing_readings(run, cradle)
        largest = float(np.nanmax(np.abs(angles_read(run, cradle))))
        if run.unit == "deg" and run.release is None and largest < _TINY:
            warnings.append(
                f"{run.file}: the largest angle is {math.degrees(largest):.2g} deg; if the file is in radians,"
                " write [rad] in its header"
            )
    _check_amount(experiment)
    return tuple(warnings)


def _warn_of_missing_readings(run: Run, cradle: Cradle) -> list[str]:
    """Times longer than a period in which a bob that is seen at other times is not, or none is."""
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
    """Intervals [s] without a reading that are longer than that, from the first of these times to the last."""
    known = np.concatenate([times[:1], times[seen], times[-1:]])
    return [(known[i], known[i + 1]) for i in np.flatnonzero(np.diff(known) > longest)]


def _check_amount(experiment: Experiment) -> None:
    """Refuses a training part of too few readings, too short a time, or too few readings in a swing."""
    rows = training_rows(experiment)[0]
    unknowns = max(len(Likelihood(experiment, rows).unknowns), _UNKNOWNS)
    readings = sum(
        int((~np.isnan(run.readings[inside])).sum()) for run, inside in zip(experiment.runs, rows, strict=True)
    )
    if readings < _FEWEST * unknowns:
        raise ValueError(f"{readings} readings to fit are too few for a diagnosis; give {_FEWEST * unknowns} or more")
    for run, inside in zip(experiment.runs, rows, strict=True):
        times, period = run.times[inside], experiment.cradle.period
        if not len(times):
            continue
        span, spacing = float(np.ptp(times)), float(np.median(np.diff(times)))
        if span < _SHORTEST * period:
            raise ValueError(
                f"{run.file}: {span:.3g} s to fit are too few for a diagnosis, less than {_SHORTEST:g} swings of"
                f" {period:.3g} s; record for longer, or move fit_from and fit_to"
            )
        if spacing > period / _DENSEST:
            raise ValueError(
                f"{run.file}: readings every {spacing:.3g} s are too few for a swing of {period:.3g} s;"
                f" give {_DENSEST:g} or more in each"
            )
