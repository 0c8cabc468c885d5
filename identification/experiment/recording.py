"""Recorded motion, and the rows of numbers that all data files are made of."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from identification.storage.files import ExperimentError

#: SI value of each unit that a column may be in, the default first.
UNITS = {
    "t": {"s": 1.0, "ms": 1e-3},
    "theta": {"rad": 1.0, "deg": math.pi / 180.0},
    "x": {"m": 1.0, "mm": 1e-3, "cm": 1e-2},
}


@dataclass(frozen=True, eq=False)
class Recording:
    """What a file holds, in SI units.

    times (T,) [s], ascending; readings (T, N) [rad] or [m], nan where missing; quantity "theta" or "x"; unit of the
    readings in the file and scale, its SI value; labels (N,) of the columns as written, "" for a bob without one;
    lines (T, N), where each reading stands in the file, 0 for none; absolute: x is counted from one common origin, not
    from each bob's rest position; data: the file as it is.
    """

    name: str
    times: np.ndarray
    readings: np.ndarray
    quantity: str
    unit: str
    scale: float
    labels: tuple[str, ...]
    lines: np.ndarray
    absolute: bool
    data: bytes

    def displacements(self) -> np.ndarray:
        """The readings, those counted from a common origin less the median of each bob; (T, N)."""
        if not self.absolute:
            return self.readings
        seen = [column[~np.isnan(column)] for column in self.readings.T]
        return self.readings - np.array([np.median(column) if len(column) else 0.0 for column in seen])


def is_content(line: str) -> bool:
    """Whether a line holds something: not blank, not a comment, not delimiters only."""
    return bool(line.strip(' \t,;"')) and not line.lstrip().startswith("#")


def find_delimiter(header: str) -> str:
    """The delimiter of a file by its header line: tab, semicolon or comma."""
    return next((d for d in "\t;" if d in header), ",")


def split_header(line: str, delimiter: str) -> list[str]:
    """The fields of a header line, without quotes and the empty ones at its end."""
    return [field.strip(' \t"') for field in line.rstrip(" " + delimiter).split(delimiter)]


def read_rows(
    name: str, lines: Sequence[str], where: range, labels: Sequence[str], delimiter: str, *, ragged: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (T, columns), nan where missing, and the line of each row (T,), from the lines at `where`.

    Where the delimiter is not the comma, a decimal comma is read as a point. ragged: empty fields at the end of a
    row may be left out.
    """
    width, numbers, rows = len(labels), [], []
    for i in where:
        line = lines[i]
        if not is_content(line):
            continue
        if delimiter != ",":
            line = line.replace(",", ".")
        fields = line.split(delimiter)
        if len(fields) != width:
            fields = _fit_width(f"{name}, line {i + 1}", fields, labels, ragged)
        try:
            if "_" in line:  # Python reads 1_5 as 15
                raise ValueError
            numbers.append([float(field) if field else math.nan for field in fields])
        except ValueError:
            numbers.append([*_parse_numbers(f"{name}, line {i + 1}", fields, labels)])
        rows.append(i + 1)
    table = np.array(numbers, dtype=float).reshape(-1, width)
    infinite = np.argwhere(np.isinf(table))
    if len(infinite):
        row, column = infinite[0]
        raise ExperimentError(
            f"{name}, line {rows[row]}, column {labels[column]}: infinite; leave the field empty if it is missing"
        )
    if not rows:
        raise ExperimentError(f"{name}, line {len(lines)}: no rows of data; add them below the header line")
    return table, np.array(rows)


def _fit_width(at: str, fields: list[str], labels: Sequence[str], ragged: bool) -> list[str]:
    """A row with as many fields as there are columns, if it only lacks or exceeds by empty ones."""
    width = len(labels)
    if len(fields) > width and not any(field.strip() for field in fields[width:]):
        return fields[:width]
    if len(fields) < width and ragged:
        return fields + [""] * (width - len(fields))
    column = f", column {labels[len(fields)]}" if len(fields) < width else ""
    raise ExperimentError(
        f"{at}{column}: {len(fields)} fields where the header names {width} columns;"
        " a missing value is an empty field between its delimiters"
    )


def _parse_numbers(at: str, fields: list[str], labels: Sequence[str]) -> Iterator[float]:
    for field, label in zip(fields, labels, strict=True):
        field = field.strip(' \t"')
        try:
            if "_" in field:
                raise ValueError
            yield float(field) if field else math.nan
        except ValueError:
            raise ExperimentError(
                f"{at}, column {label}: {field[:40]!r} is not a number;"
                " write a number, or leave the field empty if the value is missing"
            ) from None


def check_ascending(name: str, times: np.ndarray, rows: np.ndarray, label: str) -> None:
    """Refuses a missing time, or one [s] that is not after the one before."""
    missing = np.flatnonzero(np.isnan(times))
    if len(missing):
        raise ExperimentError(f"{name}, line {rows[missing[0]]}, column {label}: no time; each row needs one")
    late = np.flatnonzero(times[1:] <= times[:-1])
    if len(late):
        i = late[0]
        what = "repeats" if times[i + 1] == times[i] else "runs back"
        raise ExperimentError(
            f"{name}, line {rows[i + 1]}, column {label}: time {what}, {times[i + 1]:.9g} s after {times[i]:.9g} s;"
            " rows must be in order of time, each instant once"
        )
