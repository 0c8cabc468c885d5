"""Sort the rows of a table by time, and join those of one instant."""

from __future__ import annotations

import itertools

import numpy as np

from identification.storage.files import ExperimentError

#: Two parts of a table, each in order of time, are two recordings if at least this many of their rows overlap in time.
_PART = 8


def sort_rows(
    name: str, times: np.ndarray, readings: np.ndarray, rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Sort rows by time and join the rows of one instant, which may repeat or complete each other.

    Parameters
    ----------
    name : str
        Name of the file, for errors.
    times : ndarray of shape (T,)
        Times [s].
    readings : ndarray of shape (T, N)
        nan where missing.
    rows : ndarray of int, shape (T,)
        Line of each row in the file.

    Returns
    -------
    times, readings, rows : ndarray
        The same, sorted, each instant once.
    changes : list of str
        What was changed, a line each.

    Raises
    ------
    ExperimentError
        If a time is missing, if rows of one instant contradict each other, or if the times start over.
    """
    done = []
    missing = np.flatnonzero(np.isnan(times))
    if len(missing):
        raise ExperimentError(f"{name}, line {rows[missing[0]]}: no time; each row needs one")
    back = np.flatnonzero(times[1:] < times[:-1])
    if len(back):
        _check_one_recording(name, times, rows, back + 1)
        order = np.argsort(times, kind="stable")
        done.append(f"sorted by time: line {rows[back[0] + 1]} is the first out of order")
        times, readings, rows = times[order], readings[order], rows[order]
    first = np.flatnonzero(np.r_[True, times[1:] > times[:-1]])
    if len(first) < len(times):
        readings = _join_rows(name, times, readings, rows, first)
        repeated = np.setdiff1d(np.arange(len(times)), first)
        what = f"{len(repeated)} row{'s' if len(repeated) > 1 else ''}"
        done.append(f"dropped {what} of an instant that another row has: line {rows[repeated].min()} is the first")
        times, rows = times[first], rows[first]
    return times, readings, rows, done


def _check_one_recording(name: str, times: np.ndarray, rows: np.ndarray, starts: np.ndarray) -> None:
    """Raise ExperimentError if parts of the table overlap in time: sorting would mix two recordings."""
    bounds = np.r_[0, starts, len(times)]
    latest = None
    for begin, end in itertools.pairwise(bounds):
        part = times[begin:end]
        if len(part) < _PART:
            continue
        if latest is not None:
            beside = min(np.sum(latest >= part[0]), np.sum(part <= latest[-1]))
            if beside >= _PART and part[0] <= latest[-1] and latest[0] <= part[-1]:
                raise ExperimentError(
                    f"{name}, line {rows[begin]}: the time starts over, {part[0]:g} s after {times[begin - 1]:g} s;"
                    " put each recording in a file of its own"
                )
        latest = part


def _join_rows(name: str, times: np.ndarray, readings: np.ndarray, rows: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Join the readings of each instant; first: index of the first row of each instant."""
    low, high = (f.reduceat(readings, first, axis=0) for f in (np.fmin, np.fmax))
    differ = np.argwhere(low < high)
    if len(differ):
        instant, bob = differ[0]
        end = first[instant + 1] if instant + 1 < len(first) else len(times)
        at = [i for i in range(first[instant], end) if not np.isnan(readings[i, bob])]
        other = next(i for i in at if readings[i, bob] != readings[at[0], bob])
        raise ExperimentError(
            f"{name}, lines {rows[at[0]]} and {rows[other]}: both at {times[at[0]]:.9g} s, with different readings of"
            f" bob {bob + 1}; keep one, write the times with more digits, or give each bob a column of its own"
        )
    return low
