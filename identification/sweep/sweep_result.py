"""The result of a sweep."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from identification.sweep.store import BLOCK, IMPOSSIBLE, Plan, reason_kind
from identification.sweep.tables import write_table


class SweepResult:
    """A finished sweep.

    `swept[name]` is a quantity as an array of the shape of the grid, with a last axis of T times for a series. It is
    nan at points that cannot be simulated.

    Parameters
    ----------
    plan : Plan
        The grid, the quantities and the times.
    rows : ndarray of shape (points,)
        One structured row for each point, in C order of the grid.
    reasons : sequence of (int, str)
        For each kind of impossible point, the index of its first one and the reason.
    """

    def __init__(self, plan: Plan, rows: np.ndarray, reasons: Sequence[tuple[int, str]]) -> None:
        self.plan, self.rows, self.reasons = plan, rows, tuple(reasons)

    def __getitem__(self, name: str) -> np.ndarray:
        column = self.rows[name]
        return np.array(column).reshape(self.plan.grid.shape + column.shape[1:])

    def problems(self, start: int, stop: int) -> list[str]:
        """Reasons why points start to stop (flat indices) are impossible, without numbers; "" for possible points."""
        kinds = ["", "", *(reason_kind(reason) for _, reason in self.reasons)]
        return [kinds[status] for status in self.rows[start:stop]["status"]]

    def failures(self) -> dict[str, int]:
        """Count the impossible points by reason; each reason is that of its first point."""
        counts: Counter[int] = Counter()
        for start in range(0, len(self.rows), BLOCK):
            counts.update(self.rows[start : start + BLOCK]["status"].tolist())
        numbered = sorted((at, reason, IMPOSSIBLE + k) for k, (at, reason) in enumerate(self.reasons))
        return {reason: counts[status] for _, reason, status in numbered if counts[status]}

    def save(self, path: str | Path) -> Path:
        """Write the sweep as a table.

        Parameters
        ----------
        path : path
            Ends in .csv, .parquet (needs pyarrow) or .nc (netCDF, in the shape of the grid).

        Returns
        -------
        Path
            The path of the file.

        Raises
        ------
        ValueError
            If the ending is another one, or pyarrow is not installed.
        """
        return write_table(self, Path(path))
