"""Read tables of motion in the many forms that programs and people write.

`Experiment.load` reads only the strict form (`csv_file`). `cradle new` reads other forms with `read_table`, reports how
it read them, and writes the strict form.
"""

from __future__ import annotations

import csv
import dataclasses
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from identification.experiment.column_meaning import find_unit, parse_label, same_label, scale_of
from identification.experiment.csv_file import parse_recording
from identification.experiment.plausibility import StatedUnits, resolve_units
from identification.experiment.recording import UNITS, Recording, is_content
from identification.experiment.row_order import sort_rows
from identification.experiment.table_columns import ColumnAssignment, Columns, assign_columns, quote_labels
from identification.experiment.text_encoding import decode
from identification.experiment.tracker_file import is_tracker, read_tracker
from identification.experiment.zipped_table import unzip_table
from identification.storage.files import ExperimentError, read_bytes

#: Delimiters in the order in which they are tried; " " means any white space.
_DELIMITERS = ("\t", ";", ",", "|", " ")
#: Number of lines with content that may be the header.
_TOP = 50
#: Most columns that are reported.
_SHOWN = 10
#: Words for a missing reading, in lower case.
_MISSING = frozenset(["", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "?", "missing"])
_NUMBER = re.compile(r"[-+\u2212]?[.,]?\d.*")


@dataclass(frozen=True)
class Table:
    """A table that was read.

    Parameters
    ----------
    recording : Recording
        The content.
    understood : tuple of str
        How the table was read, a line each.
    strict : bool
        Whether the file is in the strict form, so that an experiment can name it.
    """

    recording: Recording
    understood: tuple[str, ...]
    strict: bool


@dataclass(frozen=True)
class _Header:
    """The line of the labels, from 0, and the line of their units, if there is one."""

    line: int
    delimiter: str
    labels: list[str]
    units_line: int | None
    assigned: ColumnAssignment


def read_table(path: Path, columns: Columns | None = None) -> Table:
    """Read a table of motion in any common encoding, with any delimiter and order of rows.

    Parameters
    ----------
    path : Path
        The file.
    columns : Columns, optional
        Which columns to read, and their units; determined from the labels if omitted. A unit that nobody states is
        the default one or, if that is impossible, follows from the readings and the period of the swing.

    Returns
    -------
    Table

    Raises
    ------
    ExperimentError
        If the file is unusable or ambiguous; the message names the option that resolves the ambiguity.
    """
    columns = columns or Columns()
    name, data = unzip_table(path.name, read_bytes(path))
    text, encoding = decode(name, data)
    lines = text.split("\n")
    if is_tracker(lines) and not columns.any:
        recording = read_tracker(name, lines, None, data)
        stated = StatedUnits(None, recording.unit)
        understood = [
            f"x_{bob} [{recording.unit}] is {label}" for bob, label in enumerate(recording.labels, 1) if label
        ]
    else:
        recording, understood, stated = _read_columns(name, lines, data, columns)
    changed, changes = resolve_units(recording, stated, columns)
    understood = [*([] if encoding == "UTF-8" else [f"encoding: {encoding}"]), *understood, *changes]
    if changed is recording and encoding == "UTF-8" and not columns.any and name == path.name:
        try:
            return Table(parse_recording(name, text, data), tuple(understood), True)
        except ExperimentError:
            pass  # not in the strict form
    return Table(changed, tuple(understood), False)


def mirror_signs(recording: Recording) -> Recording:
    """Change the sign of all readings, as for a camera on the other side."""
    return dataclasses.replace(recording, readings=-recording.readings)


def _read_columns(
    name: str, lines: list[str], data: bytes, columns: Columns
) -> tuple[Recording, list[str], StatedUnits]:
    """Read the recording in SI units; return it with remarks for the user and the units that the file states."""
    header = _find_header(name, lines, columns)
    used = header.assigned
    places = [used.clock, *(place for place, _ in used.bobs.values())]
    numbers, rows = _read_numbers(name, lines, header, places)
    if used.clock_unit == "frame":
        assert columns.rate is not None
        times = numbers[:, 0] / columns.rate
    else:
        times = numbers[:, 0] * scale_of(used.clock_unit or "s")
    scales = [scale_of(unit) if unit else 1.0 for _, unit in used.bobs.values()]
    times, values, rows, sorting = sort_rows(name, times, numbers[:, 1:] * scales, rows)
    readings = np.full((len(times), max(used.bobs)), np.nan)
    labels = [""] * readings.shape[1]
    for column, (bob, (place, _)) in zip(values.T, used.bobs.items(), strict=True):
        readings[:, bob - 1], labels[bob - 1] = column, header.labels[place]
    lines_of = np.broadcast_to(rows[:, None], readings.shape)
    unit = next(iter(UNITS[used.quantity]))
    recording = Recording(name, times, readings, used.quantity, unit, 1.0, tuple(labels), lines_of, False, data)
    stated = next((unit for _, unit in used.bobs.values() if unit), None)
    return recording, [*_describe_columns(header), *used.notes, *sorting], StatedUnits(used.clock_unit, stated)


def _find_header(name: str, lines: list[str], columns: Columns) -> _Header:
    """Find the first line with labels of a time and a bob, or with all labels of the user; else the likeliest line."""
    content = [i for i, line in enumerate(lines) if is_content(line)]
    if not content:
        raise ExperimentError(f"{name}, line 1: empty; it needs a header line such as t [s],theta_1 [rad] and rows")
    wanted = [*([columns.time] if columns.time else []), *columns.bobs.values()]
    first = re.split(r"[\t;,|\s]", lines[content[0]].strip())[0].strip('"')
    numbers_first = _NUMBER.fullmatch(first) is not None
    top = content[:_TOP]
    if numbers_first:  # NumPy writes the header as a comment
        top = [i for i, line in enumerate(lines[: content[0]]) if line.strip("# \t")] or top
    best: tuple[tuple[bool, int], int, str, list[str]] = ((False, -1), 0, "", [])
    for i in top:
        line = lines[i].lstrip("# \t")
        for delimiter in [delimiter for delimiter in _DELIMITERS[:-1] if delimiter in line] or _DELIMITERS[-1:]:
            labels = _split_labels(line, delimiter)
            likeness = _score_labels(labels, wanted)
            if likeness > best[0]:
                best = likeness, i, delimiter, labels
        if best[0][0]:
            break
    (complete, _), line, delimiter, labels = best
    at = f"{name}, line {line + 1}"
    if numbers_first and not complete:
        raise ExperimentError(
            f"{name}, line {content[0] + 1}: begins with the number {first[:40]!r}; put a header line such as"
            " t [s],theta_1 [rad] before the data"
        )
    below = next((i for i in content if i > line), None)
    units = None if below is None else _read_units(lines[below], delimiter, len(labels))
    assigned = assign_columns(at, labels, units or [None] * len(labels), columns)
    return _Header(line, delimiter, labels, None if units is None else below, assigned)


def _score_labels(labels: Sequence[str], wanted: Sequence[str]) -> tuple[bool, int]:
    """Whether the labels contain all wanted ones (a time and a bob if none are wanted), and how many of them."""
    found = [any(same_label(label, name) for label in labels) for name in wanted]
    kinds = [meaning.quantity in ("t", "frame") for label in labels if (meaning := parse_label(label))]
    return all(found) if wanted else any(kinds) and not all(kinds), 2 * sum(found) + len(kinds)


def _split_labels(line: str, delimiter: str) -> list[str]:
    """Split a header line into labels. With white space as delimiter, a unit in brackets belongs to the word before."""
    labels = re.split(r"\s+(?![\[(])", line.strip()) if delimiter == " " else _split_fields(line, delimiter)
    while len(labels) > 1 and not labels[-1]:
        labels.pop()
    return labels


def _split_fields(line: str, delimiter: str) -> list[str]:
    """Split a line into fields without quotes."""
    if delimiter == " ":
        return line.split()
    if '"' not in line:
        return [field.strip() for field in line.split(delimiter)]
    try:
        return [
            field.strip() for field in next(csv.reader([line.strip(" ")], delimiter=delimiter, skipinitialspace=True))
        ]
    except csv.Error as problem:
        raise ExperimentError(f"{line[:40]!r}: cannot be split into fields ({problem}); check its quotes") from None


def _read_units(line: str, delimiter: str, width: int) -> list[str | None] | None:
    """Read the unit of each column from a row of units; None if the line is no such row."""
    fields = _split_fields(line, delimiter)
    units = [find_unit(field) for field in fields]
    if not any(units) or len(fields) > width or any(_NUMBER.fullmatch(field) for field in fields):
        return None
    return [unit or field or None for unit, field in zip(units, fields, strict=True)] + [None] * (width - len(fields))


def _read_numbers(name: str, lines: list[str], header: _Header, places: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Read the fields at these places: numbers (T, columns), nan where missing, and the line of each row (T,)."""
    width, numbers, rows = len(header.labels), [], []
    first = header.line if header.units_line is None else header.units_line
    for i in range(first + 1, len(lines)):
        if not is_content(lines[i]):
            continue
        fields = _split_fields(lines[i], header.delimiter)
        if len(fields) <= max(places) or (len(fields) > width and any(fields[width:])):
            _check_width(f"{name}, line {i + 1}", fields, header.labels, places)
        try:
            numbers.append([_parse_number(fields[place]) for place in places])
        except ValueError:
            raise ExperimentError(_not_a_number(f"{name}, line {i + 1}", fields, header.labels, places)) from None
        rows.append(i + 1)
    if not rows:
        raise ExperimentError(f"{name}, line {len(lines)}: no rows of data; add them below the header line")
    table = np.array(numbers)
    infinite = np.argwhere(np.isinf(table))
    if len(infinite):
        row, column = infinite[0]
        label = quote_labels([header.labels[places[column]]])
        raise ExperimentError(
            f"{name}, line {rows[row]}, column {label}: infinite; leave the field empty if it is missing"
        )
    return table, np.array(rows)


def _parse_number(field: str) -> float:
    """Parse a field with a decimal point or comma; nan for a word that means a missing value."""
    if field.lower() in _MISSING:
        return math.nan
    if "_" in field:  # Python reads 1_5 as 15
        raise ValueError
    return float(field.replace("\u2212", "-").replace(",", "."))


def _not_a_number(at: str, fields: Sequence[str], labels: Sequence[str], places: Sequence[int]) -> str:
    for place in places:
        try:
            _parse_number(fields[place])
        except ValueError:
            return (
                f"{at}, column {quote_labels([labels[place]])}: {fields[place][:40]!r} is not a number; write a number,"
                " leave the field empty if the value is missing, or put # before a line that is no row"
            )
    raise AssertionError("all fields are numbers")


def _check_width(at: str, fields: Sequence[str], labels: Sequence[str], places: Sequence[int]) -> None:
    """Raise ExperimentError for a row with more or fewer fields than columns.

    A comment with delimiters in the last column is allowed.
    """
    width = len(labels)
    if len(fields) > width and width - 1 not in places and not _NUMBER.fullmatch(fields[width - 1]):
        return
    remedy = "a missing value is an empty field between its delimiters"
    if len(fields) >= 2 * len(places) and len(fields) > width:
        remedy = "if the commas in its numbers are decimal, put semicolons or tabs between the columns"
    raise ExperimentError(f"{at}: {len(fields)} fields where the header names {width} columns; {remedy}")


def _describe_columns(header: _Header) -> list[str]:
    """Say in words what each column is."""
    used, labels = header.assigned, header.labels
    units = used.clock_unit if used.clock_unit != "frame" else "frames"
    found = [f"t {f'[{units}] ' if units else ''}is {quote_labels([labels[used.clock]])}"]
    for bob, (place, unit) in sorted(used.bobs.items()):
        found.append(f"{used.quantity}_{bob} {f'[{unit}] ' if unit else ''}is {quote_labels([labels[place]])}")
    if len(found) > _SHOWN:
        found[_SHOWN - 2 : -1] = ["..."]
    unseen = [str(bob) for bob in range(1, max(used.bobs)) if bob not in used.bobs]
    if unseen:
        found.append(f"no column of bob {', '.join(unseen)}")
    if used.ignored and any(labels[i] for i in used.ignored):
        found.append(f"ignored: {quote_labels([labels[i] for i in used.ignored])}")
    if header.line:
        found.append(f"header in line {header.line + 1}")
    if header.units_line is not None:
        found.append(f"units in line {header.units_line + 1}")
    return found
