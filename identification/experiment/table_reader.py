"""Tables of motion as programs and people write them, and what was understood of each.

`Experiment.load` reads the strict form alone (`csv_file`). `cradle new` reads more with `read_table`: it says what it
took for what, and writes the strict form.
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
from identification.storage.files import ExperimentError, read_bytes

#: Delimiters in the order in which they are tried; " " stands for any white space.
_DELIMITERS = ("\t", ";", ",", "|", " ")
#: Lines with content among which the header is looked for.
_TOP = 50
#: Columns that are told.
_SHOWN = 10
#: What stands for a missing reading, in lower case.
_MISSING = frozenset(["", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "?", "missing"])
_NUMBER = re.compile(r"[-+\u2212]?[.,]?\d.*")


@dataclass(frozen=True)
class Table:
    """What was read: a Recording, its data the file as it is; what was understood, a line each; strict: the file is in
    the strict form, and may stand in an experiment as it is."""

    recording: Recording
    understood: tuple[str, ...]
    strict: bool


@dataclass(frozen=True)
class _Header:
    """The line of the labels, from 0, and that of their units, None where there is none."""

    line: int
    delimiter: str
    labels: list[str]
    units_line: int | None
    assigned: ColumnAssignment


def read_table(path: Path, columns: Columns | None = None) -> Table:
    """Reads a table of motion: any encoding, delimiter and order of rows, columns by meaning or as `columns` says.

    Units that are not stated, and cannot be the default ones, are told from the readings and the period of the swing.

    Raises ExperimentError, one line, if the file is unusable or can be read in two ways; it says what settles that.
    """
    columns = columns or Columns()
    data = read_bytes(path)
    text, encoding = decode(path.name, data)
    lines = text.split("\n")
    if is_tracker(lines) and not columns.any:
        recording = read_tracker(path.name, lines, None, data)
        stated = StatedUnits(None, recording.unit)
        understood = [
            f"x_{bob} [{recording.unit}] is {label}" for bob, label in enumerate(recording.labels, 1) if label
        ]
    else:
        recording, understood, stated = _read_columns(path.name, lines, data, columns)
    changed, told = resolve_units(recording, stated, columns)
    understood = [*([] if encoding == "UTF-8" else [f"encoding: {encoding}"]), *understood, *told]
    if changed is recording and encoding == "UTF-8" and not columns.any:
        try:
            return Table(parse_recording(path.name, text, data), tuple(understood), True)
        except ExperimentError:
            pass  # not strict: that is what this reader is for
    return Table(changed, tuple(understood), False)


def mirror_signs(recording: Recording) -> Recording:
    """The recording seen from the other side: the signs of all readings are turned."""
    return dataclasses.replace(recording, readings=-recording.readings)


def _read_columns(
    name: str, lines: list[str], data: bytes, columns: Columns
) -> tuple[Recording, list[str], StatedUnits]:
    """The recording in SI units, what was understood, and the units that are stated, of time and of the readings."""
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
    """The first line that names a time and a bob, or all columns that the user names; else the likeliest."""
    content = [i for i, line in enumerate(lines) if is_content(line)]
    if not content:
        raise ExperimentError(f"{name}, line 1: empty; it needs a header line such as t [s],theta_1 [rad] and rows")
    wanted = [*([columns.time] if columns.time else []), *columns.bobs.values()]
    first = re.split(r"[\t;,|\s]", lines[content[0]].strip())[0].strip('"')
    numbers_first = _NUMBER.fullmatch(first) is not None
    top = content[:_TOP]
    if numbers_first:  # as NumPy writes it, behind a #
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
    """Whether labels name all that is wanted, else a time and a bob; and how many they name."""
    found = [any(same_label(label, name) for label in labels) for name in wanted]
    kinds = [meaning.quantity in ("t", "frame") for label in labels if (meaning := parse_label(label))]
    return all(found) if wanted else any(kinds) and not all(kinds), 2 * sum(found) + len(kinds)


def _split_labels(line: str, delimiter: str) -> list[str]:
    """The labels of a header line; between white space a unit in brackets belongs to what stands before."""
    labels = re.split(r"\s+(?![\[(])", line.strip()) if delimiter == " " else _split_fields(line, delimiter)
    while len(labels) > 1 and not labels[-1]:
        labels.pop()
    return labels


def _split_fields(line: str, delimiter: str) -> list[str]:
    """The fields of a line without their quotes."""
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
    """The unit of each column from a row of units; None if this is no such row."""
    fields = _split_fields(line, delimiter)
    units = [find_unit(field) for field in fields]
    if not any(units) or len(fields) > width or any(_NUMBER.fullmatch(field) for field in fields):
        return None
    return [unit or field or None for unit, field in zip(units, fields, strict=True)] + [None] * (width - len(fields))


def _read_numbers(name: str, lines: list[str], header: _Header, places: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """The fields at these places as numbers (T, columns), nan where missing, and the line of each row (T,)."""
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
    """A field as a number, with a decimal point or comma; nan if it says that the value is missing."""
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
    """Refuses a row with more or fewer fields than columns, but for a comment with delimiters in it at its end."""
    width = len(labels)
    if len(fields) > width and width - 1 not in places and not _NUMBER.fullmatch(fields[width - 1]):
        return
    remedy = "a missing value is an empty field between its delimiters"
    if len(fields) >= 2 * len(places) and len(fields) > width:
        remedy = "if the commas in its numbers are decimal, put semicolons or tabs between the columns"
    raise ExperimentError(f"{at}: {len(fields)} fields where the header names {width} columns; {remedy}")


def _describe_columns(header: _Header) -> list[str]:
    """What the columns are, in words."""
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
