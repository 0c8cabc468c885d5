"""How the drag on a bob grows with the number of bobs that swing together: the law of the effect group_drag."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from identification.experiment.constraint import neighbours


@dataclass(frozen=True, eq=False)
class GroupLaw:
    """b_n = b (1 + slope · 2 (n − 1)/n): each bob has 2 (n − 1)/n neighbours in touch on average.

    b, slope: with their covariance (2, 2); p: probability of a worse agreement with the b_n, nan for two groups.
    """

    b: float
    slope: float
    covariance: np.ndarray
    p: float

    def at(self, bobs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(b_n, standard deviation) [kg/s] of groups of these sizes."""
        more = neighbours(bobs)
        slopes = np.stack([1.0 + self.slope * more, self.b * more])
        spread = np.sqrt(np.einsum("ik,ij,jk->k", slopes, self.covariance, slopes))
        return self.b * (1.0 + self.slope * more), spread


def group_law(groups: Mapping[int, tuple[float, float]]) -> GroupLaw | None:
    """Of (b_n, standard deviation) [kg/s] by n; None for one group."""
    if len(groups) < 2:
        return None
    bobs = np.array([*groups])
    values, spreads = np.array([*groups.values()]).T
    basis = np.column_stack([np.ones(len(bobs)), neighbours(bobs)]) / spreads[:, None]
    covariance = np.linalg.inv(basis.T @ basis)
    b, growth = covariance @ basis.T @ (values / spreads)
    squares, free = float(np.sum((basis @ [b, growth] - values / spreads) ** 2)), len(bobs) - 2
    p = float(chdtrc(free, squares)) if free else np.nan
    if free:
        covariance = covariance * max(1.0, squares / free)
    turn = np.array([[1.0, 0.0], [-growth / b**2, 1.0 / b]])
    return GroupLaw(float(b), float(growth / b), turn @ covariance @ turn.T, p)
