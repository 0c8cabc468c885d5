"""Read recorded motion from a CSV or a Tracker export, in SI units; write a CSV.

A CSV has one header line: `t` or `t [s]`, then `theta_i [rad]` or `x_i [m]` for each bob i seen. Empty fields and
`nan` are missing values; lines that begin with # are comments. Of impacts, a column `t [s]` holds the instants of
clicks; others, as `cradle measure sound` writes them, are not read.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from cradle_env.errors import unknown_key
from identification.experiment.recording import (
    UNITS,
    Recording,
    check_ascending,
    find_delimiter,
    is_content,
    read_rows,
    split_header,
)
from identification.experiment.tracker_file import is_tracker, read_tracker
from identification.storage.files import ExperimentError, read_text

_LABEL = re.compile(r"(t|(theta|x)_(\d{1,9}))\s*(?:\[\s*(\S*?)\s*\])?", re.ASCII)


def read_recording(path: Path, bobs: int | None = None, *, impacts: bool = False) -> Recording:
    """Read a CSV or a Tracker export.

    Parameters
    ----------
    path : Path
        The file.
    bobs : int, optional
        Number of bobs of the cradle; the highest bob in the file if omitted.
    impacts : bool
        Whether the file is a CSV of the instants of clicks.

    Returns
    -------
    Recording

    Raises
    ------
    ExperimentError
        If the file is unusable; the message names line and column.
    """
    return parse_recording(path.name, *read_text(path), bobs, impacts=impacts)


def parse_recording(name: str, text: str, data: bytes, bobs: int | None = None, *, impacts: bool = False) -> Recording:
    """Do the same for the text of a file that is already read; data: its bytes."""
    lines = text.split("\n")
    if impacts:
        return _read_impacts(name, lines, bobs or 1, data)
    if is_tracker(lines):
        return read_tracker(name, lines, bobs, data)
    return _read_csv(name, lines, bobs, data)


def _read_csv(name: str, lines: list[str], bobs: int | None, data: bytes) -> Recording:
    top = next((i for i, line in enumerate(lines) if is_content(line)), None)
    if top is None:
        raise ExperimentError(f"{name}, line 1: empty; it needs a header line such as t [s],theta_1 [rad] and rows")
    delimiter = find_delimiter(lines[top])
    labels = split_header(lines[top], delimiter)
    at = f"{name}, line {top + 1}"
    columns = [_parse_label(at, label, bobs) for label in labels]
    _check_columns(at, labels, columns)
    clock = next(i for i, (kind, *_) in enumerate(columns) if kind == "t")
    numbers, rows = read_rows(name, lines, range(top + 1, len(lines)), labels, delimiter)
    times = numbers[:, clock] * columns[clock][2]
    check_ascending(name, times, rows, labels[clock])
    quantity, _, scale, unit = next(column for column in columns if column[0] != "t")
    readings = np.full((len(times), bobs or max(bob for _, bob, *_ in columns)), np.nan)
    names = [""] * readings.shape[1]
    for i, (kind, bob, _, _) in enumerate(columns):
        if kind != "t":
            readings[:, bob - 1] = numbers[:, i] * scale
            names[bob - 1] = labels[i]
    lines_of = np.broadcast_to(rows[:, None], readings.shape)
    return Recording(name, times, readings, quantity, unit, scale, tuple(names), lines_of, False, data)


def _read_impacts(name: str, lines: list[str], bobs: int, data: bytes) -> Recording:
    top = next((i for i, line in enumerate(lines) if is_content(line)), None)
    if top is None:
        raise ExperimentError(f"{name}, line 1: empty; it needs a header line, t [s], and an instant in each row")
    delimiter = find_delimiter(lines[top])
    labels = split_header(lines[top], delimiter)
    at = f"{name}, line {top + 1}"
    clocks = [i for i, label in enumerate(labels) if (match := _LABEL.fullmatch(label)) and match[1] == "t"]
    if len(clocks) != 1:
        raise ExperimentError(f"{at}: {len(clocks)} columns t; a file of impacts has one, t [s], of clicks")
    _, _, scale, unit = _parse_label(at, labels[clocks[0]], None)
    numbers, rows = read_rows(name, lines, range(top + 1, len(lines)), labels, delimiter)
    times = numbers[:, clocks[0]] * scale
    check_ascending(name, times, rows, labels[clocks[0]])
    readings = np.full((len(times), bobs), np.nan)
    readings[:, 0] = times
    names = (labels[clocks[0]], *[""] * (bobs - 1))
    lines_of = np.broadcast_to(rows[:, None], readings.shape)
    return Recording(name, times, readings, "impacts", unit, scale, names, lines_of, False, data)


def _parse_label(at: str, label: str, bobs: int | None) -> tuple[str, int, float, str]:
    """Parse the label of a column into quantity, bob (0 for time), SI value of the unit, and unit."""
    match = _LABEL.fullmatch(label)
    if match is None:
        if re.fullmatch(r"[-+.\d]+(e[-+]?\d+)?", label, re.ASCII | re.IGNORECASE):
            raise ExperimentError(
                f"{at}: begins with the number {label!r}; put a header line such as t [s],theta_1 [rad] before the data"
            )
        known = ["t [s]", *(f"{q}_{i} [{u}]" for q, u in (("theta", "rad"), ("x", "m")) for i in range(1, 10))]
        raise ExperimentError(f"{at}: {unknown_key('column', label[:40], known)}")
    bob = int(match[3] or 0)
    if match[3] and not 1 <= bob <= (bobs or 200):
        raise ExperimentError(
            f"{at}, column {label}: there is no bob {bob}; bobs are numbered from 1 to"
            f" {bobs if bobs else '200'}; rename the column or set bobs under [cradle]"
        )
    quantity = match[2] or "t"
    units = UNITS[quantity]
    unit = next(iter(units)) if match[4] is None else match[4]
    if unit not in units:
        raise ExperimentError(
            f"{at}, column {label}: unknown unit {unit!r} of {quantity}; write it in {' or '.join(units)},"
            f" as in {match[1]} [{next(iter(units))}]"
        )
    return quantity, bob, units[unit], unit


def _check_columns(at: str, labels: list[str], columns: list[tuple[str, int, float, str]]) -> None:
    seen: dict[tuple[str, int], str] = {}
    for label, (kind, bob, _, _) in zip(labels, columns, strict=True):
        if (kind, bob) in seen:
            raise ExperimentError(f"{at}, column {label}: given twice; keep one column per bob, and one for t")
        seen[kind, bob] = label
    if ("t", 0) not in seen:
        raise ExperimentError(f"{at}: no column t; the first must be t [s], the time of each row")
    kinds = {column[0] for column in columns} - {"t"}
    if not kinds:
        raise ExperimentError(f"{at}: no column of a bob; add theta_1 [rad] or x_1 [m]")
    if len(kinds) > 1:
        raise ExperimentError(f"{at}: mixes theta and x columns; keep either theta or x for all bobs")
    units = {unit for kind, _, _, unit in columns if kind != "t"}
    if len(units) > 1:
        raise ExperimentError(f"{at}: mixes the units {' and '.join(sorted(units))}; give all bobs in one unit")


def csv_text(times: np.ndarray, readings: np.ndarray, quantity: str) -> str:
    """Format a CSV in SI units. It reads back to exactly the same numbers; nan becomes an empty field.

    times: (T,) [s]; readings: (T, N) [rad] or [m]; quantity: "theta", "x", or "impacts", of which the times alone are
    written.

    >>> print(csv_text(np.array([0.0, 0.5]), np.array([[0.2], [np.nan]]), "theta"))
    t [s],theta_1 [rad]
    0.0,0.2
    0.5,
    <BLANKLINE>
    """
    if quantity == "impacts":
        return "\n".join(["t [s]", *map(repr, times.tolist()), ""])
    unit = next(iter(UNITS[quantity]))
    header = ",".join(["t [s]", *(f"{quantity}_{i + 1} [{unit}]" for i in range(readings.shape[1]))])
    rows = (
        ",".join("" if value != value else repr(value) for value in row)
        for row in np.column_stack([times, readings]).tolist()
    )
    return "\n".join([header, *rows, ""])
