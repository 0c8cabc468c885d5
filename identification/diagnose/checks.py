"""What can be said of measured runs before any model is fitted: unusable ones are refused, doubtful ones told.

Refused (ValueError): readings in another unit than stated, too few of them, too short a time, too sparse a sampling.
Told: a bob, or all of them, unseen for a while; angles so small that their unit is in doubt.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from cradle_env.cradle import Cradle
from identification.experiment import Experiment
from identification.fit import training_rows
from identification.likelihood import Likelihood
from identification.recording import UNITS
from identification.runs import Run

#: Readings per unknown below which nothing can be said, and the unknowns that are counted at least.
_FEWEST, _UNKNOWNS = 5, 10
#: Small-angle periods that a training part must span, and readings that one must hold.
_SHORTEST, _DENSEST = 2.0, 6.0
#: Factors from the stated release beyond which readings must be in another unit: where the first period was seen, and
#: where the swing may have decayed before anything was.
_SEEN, _DECAYED = 2.0, 20.0
#: Degrees that no experiment stays below [rad].
_TINY = 0.01


def check_readings(experiment: Experiment) -> tuple[str, ...]:
    """What to know about the readings, one line each; ValueError for what cannot be diagnosed."""
    told: list[str] = []
    for run in experiment.runs:
        cradle = experiment.cradle_of(run)
        _check_unit(run, cradle)
        told += _unseen(run, cradle)
        largest = float(np.nanmax(np.abs(_angles(run, cradle))))
        if run.unit == "deg" and run.release is None and largest < _TINY:
            told.append(
                f"{run.file}: the largest angle is {math.degrees(largest):.2g} deg; if the file is in radians,"
                " write [rad] in its header"
            )
    _check_amount(experiment)
    return tuple(told)


def _angles(run: Run, cradle: Cradle) -> np.ndarray:
    """Angles (T, N) [rad] from where each bob rests, as far as the readings tell; nan where they are not used."""
    seen = np.where((run.fitted | run.held_out)[:, None], run.readings, np.nan)
    if run.rest == "free":
        known = np.flatnonzero(~np.isnan(seen).all(axis=0))
        seen[:, known] -= np.nanmedian(seen[:, known], axis=0)
    return dataclasses.replace(run, readings=seen).angles(cradle)


def _check_unit(run: Run, cradle: Cradle) -> None:
    """Refuses angles that no bob reaches, or that are far from the stated release."""
    angles = np.abs(_angles(run, cradle))
    row, bob = map(int, np.unravel_index(np.nanargmax(angles), angles.shape))
    largest = float(angles[row, bob])
    limit, bobs = (0.5 * math.pi, "a bob on strings") if cradle.has("radial_elasticity") else (math.pi, "a pendulum")
    if run.quantity == "theta" and largest > limit:
        raise ValueError(
            f"{run.file}, {run.place(row, bob)}, bob {bob + 1}: {_shown(largest, run)} is more than {bobs} swings"
            f" to, {_shown(limit, run)}; {_remedy(run, largest, 0.0, limit)}"
        )
    if run.release is None:
        return
    released = run.release.release.angles_of(cradle)
    lifted = np.flatnonzero(np.isfinite(released) & (released != 0.0))
    first = (run.times >= 0.0) & (run.times <= cradle.period)
    for bob in lifted:
        stated = abs(float(released[bob]))
        seen = ~np.isnan(angles[:, bob])
        if not seen.any():
            continue
        early = bool((seen & first).any() and seen[first].mean() > 0.5)
        factor = _SEEN if early else _DECAYED
        found = float(angles[seen & first if early else seen, bob].max())
        if not stated / factor <= found <= stated * factor:
            raise ValueError(
                f"{run.file}, bob {bob + 1}: it swings to {_shown(found, run)}, and its release is stated as"
                f" {stated:.4g} rad; {_remedy(run, found, 0.5 * stated, 2.0 * stated)}"
            )


def _shown(angle: float, run: Run) -> str:
    """An angle as it stands in the file, or, of displacements, as it is."""
    return f"{angle / run.scale:.4g} {run.unit}" if run.quantity == "theta" else f"{angle:.4g} rad"


def _remedy(run: Run, found: float, low: float, high: float) -> str:
    """What to do about angles of this size: a unit that would bring them between low and high [rad] is named."""
    for unit, scale in UNITS[run.quantity].items():
        if unit != run.unit and low < found * scale / run.scale < high:
            return f"it looks like {unit}: write [{unit}] in the header of {run.file}"
    return f"check the unit in the header of {run.file}, and the release, whose angles are in rad"


def _unseen(run: Run, cradle: Cradle) -> list[str]:
    """Times longer than a period in which a bob that is seen at other times is not, or none is."""
    inside = run.times >= run.fit_from
    inside &= run.times <= (math.inf if run.fit_to is None else run.fit_to)
    times, seen = run.times[inside], ~np.isnan(run.readings[inside])
    gaps = _gaps(times, np.any(seen, axis=1), cradle.period)
    told = [f"{run.file}: no bob is seen from {low:.4g} to {high:.4g} s" for low, high in gaps]
    for bob in np.flatnonzero(seen.any(axis=0)):
        told += [
            f"{run.file}: bob {bob + 1} is not seen from {low:.4g} to {high:.4g} s"
            for low, high in _gaps(times, seen[:, bob], cradle.period) if (low, high) not in gaps
        ]  # fmt: skip
    return told


def _gaps(times: np.ndarray, seen: np.ndarray | np.bool_, longest: float) -> list[tuple[float, float]]:
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
        raise ValueError(
            f"{readings} readings to fit are too few for a diagnosis of {unknowns} unknowns;"
            f" give {_FEWEST * unknowns} or more"
        )
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
