"""Speeds before and after impacts, and contact durations, from tables and from recordings of the bobs."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cradle_env.cradle import Cradle
from identification.apparatus.columns import SPEEDS, TIMES, Column, Columns, digest_of, name_and_unit, read_columns
from identification.apparatus.impacts.flights import speeds_of
from identification.apparatus.recordings import read_motion
from identification.experiment.column_meaning import parse_label
from identification.experiment.recording import Recording, find_delimiter, is_content, split_header
from identification.experiment.text_encoding import decode
from identification.experiment.zipped_table import is_zip
from identification.storage.files import ExperimentError, read_bytes

_MOST_BOBS = 9
_SPEED, _TIME = Column(SPEEDS, needed=False), Column(TIMES, needed=False)
_LAST = tuple(f"v{n}" for n in range(2, _MOST_BOBS + 1))
_KNOWN = {
    **{name: _SPEED for last in ("v1", *_LAST) for name in (last, f"{last}_sd")},
    "v": _SPEED,
    "v_sd": _SPEED,
    "duration": _TIME,
    "duration_sd": _TIME,
}
_EXPECTED = (
    "neither speeds nor durations; the header names v1 [m/s],v3 [m/s] (the last of three bobs), or"
    " v [m/s],duration [us], or theta_1 [rad], theta_2 [rad], … of a recording"
)


@dataclass(frozen=True, eq=False)
class Passed:
    """Impacts on a line of bobs at rest: speed of the first before and of the last after (K,) [m/s], each with its
    standard deviation, nan where nobody states it."""

    file: str
    bobs: int
    before: np.ndarray
    before_sd: np.ndarray
    after: np.ndarray
    after_sd: np.ndarray


@dataclass(frozen=True, eq=False)
class Durations:
    """Contacts of two bobs: speed (K,) [m/s] and duration (K,) [s], each with its standard deviation, or nan."""

    file: str
    speed: np.ndarray
    speed_sd: np.ndarray
    duration: np.ndarray
    duration_sd: np.ndarray


def read_impacts(
    paths: Sequence[str | Path], cradle: Cradle
) -> tuple[list[Passed], list[Durations], list[str], str]:  # fmt: skip
    """What files hold, by their columns, how recordings were read, and the SHA-256 over all."""
    if not paths:
        raise ValueError("no file is given; name a table of speeds, of durations, or a recording of the bobs")
    passed, durations, remarks, digests = [], [], [], []
    for path in map(Path, paths):
        labels = _labels(path)
        if any(map(parse_label, labels)) or not any(name_and_unit(label)[0] in _KNOWN for label in labels):
            recording, understood = _read_recording(path, labels)
            remarks += understood
            before, before_sd, after, after_sd = speeds_of(recording, cradle)
            values = (np.array([value]) for value in (before, before_sd, after, after_sd))
            passed.append(Passed(str(path), recording.readings.shape[1], *values))
            digests.append(hashlib.sha256(recording.data).hexdigest())
            continue
        columns = read_columns(path, _KNOWN)
        digests.append(columns.digest)
        last = [name for name in _LAST if name in columns]
        if "v1" in columns and len(last) == 1:
            rows = np.column_stack([_column(columns, name) for name in ("v1", "v1_sd", last[0], f"{last[0]}_sd")])
            rows = _checked(path, rows, ("v1", last[0]))
            passed.append(Passed(str(path), int(last[0][1:]), *rows.T))
        elif "v" in columns and "duration" in columns:
            rows = np.column_stack([_column(columns, name) for name in ("v", "v_sd", "duration", "duration_sd")])
            durations.append(Durations(str(path), *_checked(path, rows, ("v", "duration")).T))
        else:
            raise ExperimentError(f"{path}: {_EXPECTED}")
    return passed, durations, remarks, digest_of(digests)


def _labels(path: Path) -> list[str]:
    """Those of the first line with content; none of a ZIP file."""
    data = read_bytes(path)
    text = "" if is_zip(data) else decode(str(path), data)[0]
    header = next((line for line in text.split("\n") if is_content(line)), "")
    return split_header(header, find_delimiter(header))


def _read_recording(path: Path, labels: Sequence[str]) -> tuple[Recording, tuple[str, ...]]:
    try:
        return read_motion(path)
    except ExperimentError:
        if any(labels) and not any(map(parse_label, labels)):
            raise ExperimentError(f"{path}: {_EXPECTED}") from None
        raise


def _column(columns: Columns, name: str) -> np.ndarray:
    return columns[name] if name in columns else np.full(len(next(iter(columns.numbers.values()))), np.nan)


def _checked(path: Path, rows: np.ndarray, names: tuple[str, str]) -> np.ndarray:
    """The rows in which both quantities are there; ExperimentError for what is not above 0."""
    rows = rows[~np.isnan(rows[:, [0, 2]]).any(axis=1)]
    if not len(rows):
        raise ExperimentError(f"{path}: no row with both {names[0]} and {names[1]}; add the measured ones")
    for k, name in ((0, names[0]), (1, f"{names[0]}_sd"), (2, names[1]), (3, f"{names[1]}_sd")):
        bad = np.flatnonzero(rows[:, k] <= 0.0)
        if len(bad):
            raise ExperimentError(f"{path}: {name} is {rows[bad[0], k]:g} in SI units; it must be greater than 0")
    return rows
