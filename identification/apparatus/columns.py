"""Tables of an instrument: columns by name and unit, in SI units."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cradle_env.errors import unknown_key
from identification.experiment.recording import find_delimiter, is_content, read_rows, split_header
from identification.experiment.text_encoding import decode
from identification.storage.files import ExperimentError, read_bytes

TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "µm": 1e-6}
FORCES = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
SPEEDS = {"m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2}

_LABEL = re.compile(r"(.*?)\s*(?:[\[(]\s*(\S*?)\s*[\])])?\s*")


@dataclass(frozen=True)
class Column:
    """A column that a table may have: SI value of each of its units, the default first; needed: whether it must."""

    units: Mapping[str, float]
    needed: bool = True


@dataclass(frozen=True, eq=False)
class Columns:
    """What a table holds: numbers (T,) in SI units by column, nan where missing; digest: SHA-256 of the file."""

    numbers: Mapping[str, np.ndarray]
    digest: str

    def __contains__(self, name: str) -> bool:
        return name in self.numbers

    def __getitem__(self, name: str) -> np.ndarray:
        return self.numbers[name]


def read_columns(path: Path, known: Mapping[str, Column]) -> Columns:
    """Reads a CSV with a header line such as "displacement [mm],force [N]"; commas, semicolons or tabs between columns.

    Any common encoding; decimal commas where no comma is between columns. Raises ExperimentError, one line, for a
    column that is not known, is needed and missing, or has another unit.
    """
    data = read_bytes(path)
    text, _ = decode(str(path), data)
    lines = text.split("\n")
    top = next((i for i, line in enumerate(lines) if is_content(line)), None)
    example = ",".join(f"{name} [{next(iter(column.units))}]" for name, column in known.items())
    if top is None:
        raise ExperimentError(f"{path}: empty; it needs a header line such as {example}, and rows")
    delimiter = find_delimiter(lines[top])
    labels = split_header(lines[top], delimiter)
    scales: dict[str, tuple[int, float]] = {}
    for place, label in enumerate(labels):
        name, scale = _column(f"{path}, line {top + 1}", label, known, example)
        if name in scales:
            raise ExperimentError(f"{path}, line {top + 1}, column {label}: given twice; keep one")
        scales[name] = place, scale
    missing = [name for name, column in known.items() if column.needed and name not in scales]
    if missing:
        raise ExperimentError(f"{path}, line {top + 1}: no column {missing[0]}; expected a header line like {example}")
    numbers, _ = read_rows(str(path), lines, range(top + 1, len(lines)), labels, delimiter)
    found = {name: numbers[:, place] * scale for name, (place, scale) in scales.items()}
    return Columns(found, hashlib.sha256(data).hexdigest())


def name_and_unit(label: str) -> tuple[str, str | None]:
    """The name in a label, in small letters, and its unit if it states one.

    >>> name_and_unit("V1 [m/s]")
    ('v1', 'm/s')
    """
    match = _LABEL.fullmatch(label)
    return (match[1].strip().casefold(), match[2]) if match else (label, None)


def _column(at: str, label: str, known: Mapping[str, Column], example: str) -> tuple[str, float]:
    name, unit = name_and_unit(label)
    if name not in known:
        raise ExperimentError(f"{at}: {unknown_key('column', name[:40], known)}; expected a header line like {example}")
    units = known[name].units
    if unit is None:
        unit = next(iter(units))
    if unit not in units:
        raise ExperimentError(f"{at}, column {name}: unknown unit {unit!r}; write it in {', '.join(units)}")
    return name, units[unit]


def digest_of(digests: Sequence[str]) -> str:
    """SHA-256 over several files, by theirs."""
    return hashlib.sha256("".join(digests).encode()).hexdigest()
