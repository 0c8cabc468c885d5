"""Recorded motion, and the parsing of rows of numbers, which all data files share."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from identification.storage.files import ExperimentError

#: SI value of each unit that a column may use; the default comes first.
UNITS = {
    "t": {"s": 1.0, "ms": 1e-3},
    "theta": {"rad": 1.0, "deg": math.pi / 180.0},
    "x": {"m": 1.0, "mm": 1e-3, "cm": 1e-2},
    "impacts": {"s": 1.0, "ms": 1e-3},
}


@dataclass(frozen=True, eq=False)
class Recording:
    """Content of a data file, in SI units.

    Parameters
    ----------
    name : str
        Name of the file.
    times : ndarray of shape (T,)
        Times [s], ascending.
    readings : ndarray of shape (T, N)
        Angles [rad] or displacements [m]; nan where missing. Of impacts, the times [s] in the column of bob 1: a
        click belongs to no bob.
    quantity : {"theta", "x", "impacts"}
        Angles, displacements, or instants of clicks.
    unit : str
        Unit of the readings in the file.
    scale : float
        SI value of that unit.
    labels : tuple of str, N of them
        Labels of the columns; "" for a bob without a column.
    lines : ndarray of int, shape (T, N)
        Line of each reading in the file, from 1; 0 if it has none.
    absolute : bool
        Whether x has one origin for all bobs, and not each bob's rest position.
    data : bytes
        The file.
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
        """Readings (T, N), less the median of each bob if they have one origin for all bobs."""
        if not self.absolute:
            return self.readings
        seen = [column[~np.isnan(column)] for column in self.readings.T]
        return self.readings - np.array([np.median(column) if len(column) else 0.0 for column in seen])


def is_content(line: str) -> bool:
    """Whether a line is neither blank, nor a comment, nor made of delimiters only."""
    return bool(line.strip(' \t,;"')) and not line.lstrip().startswith("#")


def find_delimiter(header: str) -> str:
    """Find the delimiter of a file in its header line: tab, semicolon or comma."""
    return next((d for d in "\t;" if d in header), ",")


def split_header(line: str, delimiter: str) -> list[str]:
    """Split a header line into fields without quotes; empty fields at its end are left out."""
    return [field.strip(' \t"') for field in line.rstrip(" " + delimiter).split(delimiter)]


def read_rows(
    name: str, lines: Sequence[str], where: range, labels: Sequence[str], delimiter: str, *, ragged: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Read rows of numbers.

    Parameters
    ----------
    name : str
        Name of the file, for errors.
    lines : sequence of str
        All lines of the file.
    where : range
        Indices, from 0, of the lines to read.
    labels : sequence of str
        Labels of the columns.
    delimiter : str
        If it is not the comma, decimal commas are accepted.
    ragged : bool
        Whether empty fields at the end of a row may be left out.

    Returns
    -------
    numbers : ndarray of shape (T, columns)
        nan where a field is empty.
    rows : ndarray of int, shape (T,)
        Line of each row, from 1.

    Raises
    ------
    ExperimentError
        If a field is not a finite number, a row has another number of fields, or there are no rows.
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
    """Make a row as long as the header. Raises ExperimentError if it has too many or too few fields for that."""
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
    """Raise ExperimentError if a time [s] is missing or is not after the one before."""
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
