"""The runs of a sweep on disk: rows of fixed size, written as runs finish, so that a kill loses no finished run."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cradle_env import __version__
from cradle_env.effects import effect
from cradle_env.parameter_name import ParameterName
from identification.storage.files import json_text, write_together
from identification.storage.provenance import fingerprint, program_hash
from identification.storage.schema import read_json
from identification.sweep.grid import Grid
from identification.sweep.quantities import Quantity

FORMAT = "cradle-sweep/1"
#: Values of `status` of a row; IMPOSSIBLE + k means the k-th reason.
PENDING, DONE, IMPOSSIBLE = 0, 1, 2
#: Rows read at a time.
BLOCK = 8192
_NUMBER = re.compile(r"-?\b\d[\d.]*(e[+-]?\d+)?")


def row_type(quantities: Sequence[Quantity], times: np.ndarray) -> np.dtype:
    """One run: its quantities, and last, so that no half-written row counts as done, its status."""
    values = [(q.name, "f8", (len(times),) if q.series else ()) for q in quantities]
    return np.dtype([*values, ("status", "u1")])


@dataclass(frozen=True)
class Plan:
    """A sweep: its grid, its quantities, and the times (T,) [s] of series."""

    grid: Grid
    quantities: tuple[Quantity, ...]
    times: np.ndarray
    duration: float
    sample_rate: float

    def digest(self) -> str:
        """SHA-256 of everything on which the results depend."""
        measures = [(q.name, fingerprint(q.measure)) for q in self.quantities]
        grid = self.grid
        swept = [effect(name.effect) for name in map(ParameterName.parse, grid.names) if name.effect]
        by = program_hash([*grid.cradle.composition, *swept])
        told = [FORMAT, by, grid.cradle, grid.release, measures, self.duration, self.sample_rate]
        sums = hashlib.sha256(repr(told).encode())
        for axis in grid.axes:
            for name, column in axis.columns.items():
                sums.update(f"{axis.name}/{name}/{len(column)}".encode() + column.tobytes())
        sums.update(self.times.tobytes())
        return sums.hexdigest()


class Store:
    """The rows of a sweep in a folder: `runs.npy`, one per point of the grid, and `plan.json`."""

    def __init__(self, folder: Path, plan: Plan) -> None:
        self.rows, self._plan = folder / "runs.npy", folder / "plan.json"
        self.dtype, self.count = row_type(plan.quantities, plan.times), len(plan.grid)
        self._digest = plan.digest()
        #: The first point of each kind of impossible points, and the reason.
        self.reasons: list[tuple[int, str]] = []
        folder.mkdir(parents=True, exist_ok=True)
        if self._plan.exists():
            self._resume()
        elif self.rows.exists():
            raise ValueError(f"{self.rows}: exists and is no result of a sweep; name another --out")
        else:
            self._write_plan()
        if not self.rows.exists():
            self._begin()

    def _begin(self) -> None:
        temporary = self.rows.with_name(".runs.npy.part")
        temporary.unlink(missing_ok=True)
        # The file is sparse: rows that are not yet written take no space.
        np.lib.format.open_memmap(temporary, mode="w+", dtype=self.dtype, shape=(self.count,))
        os.replace(temporary, self.rows)

    def _resume(self) -> None:
        found = read_json(self._plan, "sweep-plan", "it is damaged; name another --out, or remove it to start over")
        if found["inputs"] != self._digest:
            raise ValueError(f"{self._plan} is that of another sweep, or of another version; name another --out")
        self.reasons = [(at, reason) for at, reason in found["reasons"]]
        if self.rows.exists():
            self._check_rows()

    def _check_rows(self) -> None:
        remedy = f"name another --out, or remove both it and {self._plan}"
        if self.rows.is_symlink() or not self.rows.is_file():
            raise ValueError(f"{self.rows} is a link or no file, and would be written to; {remedy}")
        try:
            rows = self.open()
            whole = rows.shape == (self.count,) and rows.dtype == self.dtype
            known = max((int(rows[k : k + BLOCK]["status"].max()) for k in range(0, self.count, BLOCK)), default=0)
        except (OSError, ValueError, EOFError, SyntaxError, MemoryError):
            whole, known = False, 0
        if not whole or known >= IMPOSSIBLE + len(self.reasons):
            raise ValueError(f"{self.rows} is damaged; {remedy}")

    def _write_plan(self) -> None:
        content = {"format": FORMAT, "version": __version__, "inputs": self._digest, "reasons": self.reasons}
        write_together(self._plan.parent, {self._plan.name: json_text(content)})

    def remove(self) -> None:
        """Delete the files."""
        for file in (self.rows, self._plan):
            file.unlink()

    def open(self, mode: Any = "r") -> np.ndarray:
        """The rows, (count,), mapped from the disk; those touched stay in memory only as long as this is held."""
        return np.load(self.rows, mmap_mode=mode)

    def pending(self, size: int) -> Iterator[np.ndarray]:
        """Yield flat indices of the unfinished points, at most `size` at a time."""
        for start in range(0, self.count, BLOCK):
            todo = start + np.flatnonzero(self.open()[start : start + BLOCK]["status"] == PENDING)
            yield from (todo[k : k + size] for k in range(0, len(todo), size))

    def done(self) -> int:
        """Number of points that are simulated or impossible."""
        starts = range(0, self.count, BLOCK)
        return sum(int(np.count_nonzero(self.open()[start : start + BLOCK]["status"])) for start in starts)

    def write(self, indices: np.ndarray, rows: np.ndarray, problems: Mapping[int, str]) -> None:
        """Write the rows (n,) of the points (n,), and the reasons of impossible ones, by their place among the rows."""
        for k, problem in problems.items():
            rows["status"][k] = IMPOSSIBLE + self._reason(int(indices[k]), problem)
        # Not through a mapping of the file: where the disk is full, that kills the process. Of a row the status is
        # written last.
        begin: int = self.open().offset  # type: ignore[attr-defined]  # of a memmap
        with self.rows.open("rb+") as file:
            for stretch in np.split(np.arange(len(indices)), np.flatnonzero(np.diff(indices) != 1) + 1):
                file.seek(begin + int(indices[stretch[0]]) * self.dtype.itemsize)
                file.write(rows[stretch].tobytes())

    def _reason(self, index: int, problem: str) -> int:
        """Number of a kind of reason, which ignores its values; the first point is kept as an example."""
        kinds = [reason_kind(reason) for _, reason in self.reasons]
        if reason_kind(problem) not in kinds:
            self.reasons.append((index, problem))
            self._write_plan()
            return len(kinds)
        number = kinds.index(reason_kind(problem))
        if index < self.reasons[number][0]:
            self.reasons[number] = (index, problem)
            self._write_plan()
        return number


def reason_kind(problem: str) -> str:
    """A reason without its numbers."""
    return _NUMBER.sub("…", problem)
