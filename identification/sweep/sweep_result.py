"""What a sweep gives back."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from identification.sweep.store import BLOCK, IMPOSSIBLE, Plan, reason_kind
from identification.sweep.tables import write_table


class SweepResult:
    """A finished sweep. swept[name]: a quantity in the shape of the grid, for a series (…, T); nan where impossible."""

    def __init__(self, plan: Plan, rows: np.ndarray, reasons: Sequence[tuple[int, str]]) -> None:
        self.plan, self.rows, self.reasons = plan, rows, tuple(reasons)

    def __getitem__(self, name: str) -> np.ndarray:
        column = self.rows[name]
        return np.array(column).reshape(self.plan.grid.shape + column.shape[1:])

    def problems(self, start: int, stop: int) -> list[str]:
        """What is wrong with each of the points from one flat index to another, numbers left out; "" if nothing is."""
        kinds = ["", "", *(reason_kind(reason) for _, reason in self.reasons)]
        return [kinds[status] for status in self.rows[start:stop]["status"]]

    def failures(self) -> dict[str, int]:
        """How many points are impossible, by reason; each reason is told as it is at the first of them."""
        counts: Counter[int] = Counter()
        for start in range(0, len(self.rows), BLOCK):
            counts.update(self.rows[start : start + BLOCK]["status"].tolist())
        numbered = sorted((at, reason, IMPOSSIBLE + k) for k, (at, reason) in enumerate(self.reasons))
        return {reason: counts[status] for _, reason, status in numbered if counts[status]}

    def save(self, path: str | Path) -> Path:
        """Writes a table, by its ending: .csv, .parquet (needs pyarrow) or .nc (netCDF, in the shape of the grid)."""
        return write_table(self, Path(path))
