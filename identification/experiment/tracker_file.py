"""Read exports of the Tracker video-analysis program (https://opensourcephysics.github.io/tracker-website).

A line with the name of each mass, then a line of column names, then rows, separated by tabs:

    mass_A                         #multi:
    t       x       y                       mass A          mass B
    0.0     0.1     0.2            t        x       y       x       y
                                   0.0      0.1     0.2     0.3     0.2

Several such tables may follow one another. Only the column x of each mass is used.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from identification.experiment.recording import (
    UNITS,
    Recording,
    check_ascending,
    find_delimiter,
    is_content,
    read_rows,
    split_header,
)
from identification.storage.files import ExperimentError

_LABEL = re.compile(r"(t|x)\s*(?:[\[(]\s*(\S*?)\s*[\])])?", re.ASCII)


def is_tracker(lines: Sequence[str]) -> bool:
    """Whether the lines are a Tracker export: a line of names precedes the line of columns."""
    top = [line for line in lines[:50] if is_content(line)][:2]
    return any(line.startswith("#multi") for line in lines[:5]) or (
        len(top) == 2 and _kind(split_header(top[0], find_delimiter(top[0]))[0]) != "t" and _is_header(top[1])
    )


def read_tracker(name: str, lines: list[str], bobs: int | None, data: bytes) -> Recording:
    """Read a Tracker export. The number or letter at the end of a mass's name is the number of the bob."""
    headers = [i for i, line in enumerate(lines) if _is_header(line)]
    tracks: list[tuple[str, str, np.ndarray, np.ndarray, np.ndarray]] = []
    for k, top in enumerate(headers):
        named = next((i for i in range(top - 1, -1, -1) if is_content(lines[i])), None)
        end = len(lines)
        if k + 1 < len(headers):
            end = next(i for i in range(headers[k + 1] - 1, -1, -1) if is_content(lines[i]))
        if named is None or end <= top:
            raise ExperimentError(f"{name}, line {top + 1}: no line with the name of the mass above t x y; add one")
        tracks += _tracks(name, lines, lines[named], top, end)
    if not tracks:
        raise ExperimentError(f"{name}, line 1: a Tracker export without a line t x y; export t and x of each mass")
    units = {unit for _, unit, *_ in tracks}
    if len(units) > 1:
        raise ExperimentError(f"{name}, line 1: mixes the units {' and '.join(sorted(units))}; export all in one unit")
    unit = units.pop()
    numbers = _bob_numbers([mass for mass, *_ in tracks])
    for (mass, _, _, _, rows), bob in zip(tracks, numbers, strict=True):
        if bob > (bobs or 200):
            raise ExperimentError(
                f"{name}, line {rows[0]}, column x of {mass}: would be bob {bob} of {bobs or 200};"
                " name the masses after their bobs, 1 for the first, or set bobs under [cradle]"
            )
    times = np.unique(np.concatenate([t for _, _, t, _, _ in tracks]))
    readings = np.full((len(times), bobs or max(numbers)), np.nan)
    lines_of, labels = np.zeros(readings.shape, dtype=int), [""] * readings.shape[1]
    for (mass, _, t, x, rows), bob in zip(tracks, numbers, strict=True):
        i = np.searchsorted(times, t)
        readings[i, bob - 1], lines_of[i, bob - 1], labels[bob - 1] = x, rows, f"x of {mass}"
    return Recording(name, times, readings, "x", unit, UNITS["x"][unit], tuple(labels), lines_of, True, data)


def _kind(label: str) -> str:
    match = _LABEL.fullmatch(label)
    return match[1] if match else ""


def _is_header(line: str) -> bool:
    kinds = [_kind(label) for label in split_header(line, find_delimiter(line))]
    return kinds[0] == "t" and "x" in kinds


def _tracks(
    name: str, lines: list[str], names: str, top: int, end: int
) -> list[tuple[str, str, np.ndarray, np.ndarray, np.ndarray]]:
    """Read (mass, unit, times [s], x [m], lines) of each mass in one table; a mass may have its own column t."""
    delimiter = find_delimiter(lines[top])
    labels, masses = split_header(lines[top], delimiter), split_header(names, delimiter)
    table, rows = read_rows(name, lines, range(top + 1, end), labels, delimiter, ragged=True)
    tracks, clock = [], 0
    for i, label in enumerate(labels):
        if _kind(label) == "t":
            clock = i
        if _kind(label) != "x":
            continue
        mass = next((m for m in reversed(masses[: i + 1]) if m), "") or f"mass {len(tracks) + 1}"
        unit, second = (_unit(f"{name}, line {top + 1}", labels[c]) for c in (i, clock))
        seen = ~np.isnan(table[:, i])
        if not seen.any():
            raise ExperimentError(f"{name}, line {top + 1}, column x of {mass}: no readings; leave this mass out")
        t, x, at = table[seen, clock] * UNITS["t"][second], table[seen, i] * UNITS["x"][unit], rows[seen]
        check_ascending(name, t, at, f"t of {mass}")
        tracks.append((mass, unit, t, x, at))
    return tracks


def _unit(at: str, label: str) -> str:
    match = _LABEL.fullmatch(label)
    units = UNITS[match[1]] if match else {}
    unit = (match and match[2]) or next(iter(units))
    if unit not in units:
        raise ExperimentError(f"{at}, column {label}: unknown unit {unit!r}; use {' or '.join(units)}")
    return unit


def _bob_numbers(masses: list[str]) -> list[int]:
    """Number of the bob, from 1, of each mass.

    It is the number at the end of the name; else the letter A, B, ... at its end; else the order, if some have neither.
    """
    for ending, number in ((r"(?:^|.*\D)(\d{1,6})", int), (r"(?:.*[\s_])?([A-Za-z])", lambda c: ord(c.upper()) - 64)):
        found = [re.fullmatch(ending, mass, re.ASCII) for mass in masses]
        numbers = [number(match[1]) for match in found if match]
        if len(numbers) == len(masses) == len(set(numbers)) and min(numbers) >= 1:
            return numbers
    return list(range(1, len(masses) + 1))
