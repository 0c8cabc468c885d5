"""Check readings by themselves: the period of the swing, impossible units, the origin, and the sign."""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass

import numpy as np

from cradle_env.cradle import Cradle
from identification.experiment.column_meaning import TABLE_UNITS, scale_of
from identification.experiment.recording import Recording
from identification.experiment.table_columns import Columns, quote_labels
from identification.storage.files import ExperimentError

#: Shortest period of a cradle [s], with strings of 2.5 mm.
_SHORTEST = 0.1
#: Longest period of a cradle [s], with strings of 100 m.
_LONGEST = 20.0
#: Most readings that the periodogram uses.
_MOST = 2**14
#: Fewest readings for a periodogram.
_LEAST = 32
#: Fewest swings in the readings.
_SWINGS = 2.0
#: Fewest readings per swing.
_PER_SWING = 6.0
#: Smallest part of the variance in the band of the swing; white noise has less than a fourth of it there.
_SHARE = 0.4
#: Half width of the band of the swing, as a part of its frequency.
_BAND = 0.15
#: Steps of the periodogram per frequency resolution, 1/duration.
_FINER = 8
#: Largest angle [rad] and displacement [m] that are accepted; a larger one has the wrong unit.
_FARTHEST = {"theta": 2.0 * math.pi, "x": 2.0}
#: Units that a file may have used instead of a larger one, the likeliest first.
_INSTEAD = {"theta": ("deg", "mrad"), "x": ("mm", "cm", "um")}
#: Largest displacement of a pendulum over its length, with a margin for the error of the length.
_OF_LENGTH = 1.1
#: Times that begin later than this [s], 12 days, are those of a clock.
_CLOCK = 1e6
#: Readings have another origin if they stay away from 0 by this part of the widest swing.
_AWAY = 0.3
#: Bobs cannot pass each other: readings are mirrored if bobs approach this many times as far as they separate.
_PASSED = 4.0


@dataclass(frozen=True)
class StatedUnits:
    """The units of times and readings that a file states; None if it states none."""

    time: str | None
    readings: str | None


def swing_period(recording: Recording) -> float | None:
    """Estimate the period [s] of the bob that swings widest, from the peak of its periodogram.

    The error is a few per cent. At least 2 swings with 6 readings each are needed. Returns None if there is no clear
    peak.
    """
    moved = recording.displacements()
    widths = _widths(moved)
    if not len(widths) or not np.nanmax(widths, initial=0.0) > 0.0:
        return None
    bob = int(np.nanargmax(widths))
    seen = np.flatnonzero(~np.isnan(moved[:, bob]))[:_MOST]
    t, x = recording.times[seen], moved[seen, bob]
    if len(t) < _LEAST:
        return None
    x = np.interp(np.linspace(t[0], t[-1], len(t)), t, x)
    window = np.hanning(len(t))  # reduces the bias of the peak by the ends
    x = window * (x - np.average(x, weights=window))
    power = np.abs(np.fft.rfft(x, _FINER * len(t))) ** 2
    swings = np.arange(len(power)) / _FINER  # number of swings in the readings
    power[(swings < _SWINGS) | (swings > len(t) / _PER_SWING)] = 0.0
    peak = swings[int(np.argmax(power))]
    near = power[np.abs(swings - peak) <= max(_BAND * peak, 2.0)].sum()
    whole = 0.5 * _FINER * len(t) * np.square(x).sum()  # Parseval, positive frequencies
    return float((t[-1] - t[0]) / peak) if near > _SHARE * whole else None


def pendulum_length(period: float) -> float:
    """Length r0 [m] of the pendulum with this small-angle period 2π √(r0/g) [s].

    >>> round(pendulum_length(1.0), 3)
    0.248
    """
    return Cradle.gravity * (period / (2.0 * math.pi)) ** 2


def resolve_units(recording: Recording, stated: StatedUnits, columns: Columns) -> tuple[Recording, list[str]]:
    """Correct units and origin of a recording if the readings show them to be wrong.

    A unit that nobody states is replaced if it is impossible and another is possible. An impossible unit in the file
    is an error that names the option to use. A unit that the user states is kept.

    Parameters
    ----------
    recording : Recording
        In SI units, converted from the units of `stated`, or from the default units where none is stated.
    stated : StatedUnits
        Units in the file.
    columns : Columns
        Units that the user states.

    Returns
    -------
    recording : Recording
        The corrected recording.
    changes : list of str
        What was changed, a line each.

    Raises
    ------
    ExperimentError
        If a unit is wrong and the user must state the right one.
    """
    recording, told = _resolve_time_unit(recording, stated, columns)
    if recording.times[0] > _CLOCK:
        told.append(f"times are counted from the first row, {recording.times[0]:.6f} s")
        recording = dataclasses.replace(recording, times=recording.times - recording.times[0])
    period = swing_period(recording)
    if period is not None and not recording.absolute and _off_centre(recording):
        recording = dataclasses.replace(recording, absolute=True)
        told.append("the origin is not where the bobs rest: the median of each bob is taken as its rest position")
    recording, of_size = _resolve_reading_unit(recording, stated, columns, period)
    if period is not None:
        told.append(f"a swing takes {period:.3g} s: that of a pendulum of {pendulum_length(period):.2g} m")
    return recording, [*of_size, *told]


def is_mirrored(recording: Recording) -> bool:
    """Whether bobs pass each other in the readings, and would not if all signs were changed."""
    moved = recording.displacements()
    columns = [column for column in moved.T if not np.isnan(column).all()]
    apart = np.concatenate([b - a for a, b in itertools.pairwise(columns)] or [np.empty(0)])
    apart = apart[~np.isnan(apart)]
    if len(apart) < _LEAST:
        return False
    closer, farther = np.quantile(apart, [0.01, 0.99])
    return bool(-closer > _PASSED * max(farther, 0.0) and -closer > 0.1 * np.nanmax(_widths(moved)))


def _widths(moved: np.ndarray) -> np.ndarray:
    """Highest less lowest reading of each bob, (N,); nan for a bob without readings."""
    seen = ~np.isnan(moved)
    high = np.max(moved, axis=0, where=seen, initial=-np.inf)
    low = np.min(moved, axis=0, where=seen, initial=np.inf)
    return np.where(seen.any(axis=0), high - low, np.nan)


def _off_centre(recording: Recording) -> bool:
    widest = np.nanmax(_widths(recording.readings))
    return any(
        np.nanmin(column) > _AWAY * widest or np.nanmax(column) < -_AWAY * widest
        for column in recording.readings.T
        if not np.isnan(column).all()
    )


def _resolve_time_unit(recording: Recording, stated: StatedUnits, columns: Columns) -> tuple[Recording, list[str]]:
    period = swing_period(recording)
    if period is None or _SHORTEST <= period <= _LONGEST or columns.time_unit or columns.rate:
        return recording, []
    now = stated.time or "s"
    of_unit = {unit: period * scale / scale_of(now) for unit, scale in TABLE_UNITS["t"].items()}
    fits = [unit for unit, found in of_unit.items() if _SHORTEST <= found <= _LONGEST]
    if not fits:
        return recording, [f"no cradle swings in {period:.3g} s: check the times"]
    (unit,) = fits
    swing = f"in {now} a swing would take {period:.4g} s, in {unit} {of_unit[unit]:.3g} s"
    if stated.time is not None:
        raise ExperimentError(
            f"{recording.name}: the times seem to be in {unit}, not in {now}: {swing}; add --unit {unit}, or --unit"
            f" {now} if they are right"
        )
    times = recording.times * (scale_of(unit) / scale_of(now))
    return dataclasses.replace(recording, times=times), [f"times are read in {unit}: {swing}"]


def _resolve_reading_unit(
    recording: Recording, stated: StatedUnits, columns: Columns, period: float | None
) -> tuple[Recording, list[str]]:
    moved = np.abs(np.nan_to_num(recording.displacements()))
    row, bob = map(int, np.unravel_index(np.argmax(moved), moved.shape))
    largest, quantity = float(moved[row, bob]), recording.quantity
    now, si, farthest = columns.reading_unit or stated.readings, next(iter(TABLE_UNITS[quantity])), _FARTHEST[quantity]
    limit = "a full turn" if quantity == "theta" else f"{farthest:g} m"
    told = []
    if now is None and quantity == "theta" and largest > (0.5 * math.pi if moved.shape[1] > 1 else farthest):
        recording = dataclasses.replace(recording, readings=recording.readings * scale_of("deg"))
        told = [f"angles are read in deg: in rad they would reach {largest:.4g}"]
        largest, now = largest * scale_of("deg"), "deg"
    elif now is None:
        told = [f"no unit is stated: readings are read in {si}, up to {largest:.3g}; --unit states another"]
        if quantity == "x" and period is not None:
            farthest = min(farthest, _OF_LENGTH * pendulum_length(period))
            limit = f"the pendulum of {pendulum_length(period):.2g} m that swings in {period:.3g} s"
    if largest <= farthest:
        return recording, told
    now, in_file = now or si, largest / scale_of(now or si)
    fit = [
        unit for unit in _INSTEAD[quantity] if in_file * scale_of(unit) <= farthest and scale_of(unit) < scale_of(now)
    ]
    remedy = f"add --unit {' or '.join(fit)}" if fit else "check the unit"
    if fit and quantity == "x":
        remedy += ', or of pixels their size, as --unit "0.44 mm"'
    raise ExperimentError(
        f"{recording.name}, line {recording.lines[row, bob]}, column {quote_labels([recording.labels[bob]])}:"
        f" {in_file:.6g} {now} is beyond {limit}; {remedy}"
    )
