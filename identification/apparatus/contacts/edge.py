"""Where an edge of a trace begins: a step through one pole, or a contact that conducts slowly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Time constants that are tried [samples].
_CONSTANTS = np.geomspace(0.05, 200.0, 40)
#: Part of a sample, or of a third of the time constant, to which an edge is located.
_FINE = 0.05
#: What is not known of the shape of a slow edge, as a part of its time constant.
_UNSURE = 0.1


@dataclass(frozen=True)
class Edge:
    """An edge from low to high [V]: a step through one pole, or, if slow, a resistance that changes exponentially (the
    voltage goes as one over it); both with a time constant [samples]. correlation: of successive noise."""

    constant: float
    slow: bool
    low: float
    high: float
    correlation: float

    def of(self, shifts: np.ndarray, length: int) -> np.ndarray:
        """(shifts, length): the edge beginning at each shift [samples]."""
        s = -np.expm1(-np.maximum(np.arange(length)[None, :] - shifts[:, None], 0.0) / self.constant)
        if self.slow:
            s = s * self.low / (self.high + (self.low - self.high) * s)
        return self.low + (self.high - self.low) * s

    def cost(self, piece: np.ndarray, shifts: np.ndarray) -> np.ndarray:
        """Sum of squares of what the edge leaves, freed of its correlation, at each shift."""
        left = self._whitened(piece[None, :] - self.of(shifts, len(piece)))
        return np.einsum("ij,ij->i", left, left)

    def _whitened(self, rows: np.ndarray) -> np.ndarray:
        return rows[:, 1:] - self.correlation * rows[:, :-1]

    def near(self, piece: np.ndarray) -> np.ndarray:
        """Shifts about where a step of no width fits best."""
        white = self._whitened(piece[None, :] - 0.5 * (self.low + self.high))[0]
        place = int(np.argmin(np.cumsum(np.sign(self.high - self.low) * white))) + 1
        reach = 8.0 + 3.0 * self.constant
        return np.arange(place - reach, place + reach, max(0.5, 0.25 * self.constant))

    def onset(self, piece: np.ndarray, noise: float) -> tuple[float, float]:
        """Where the edge begins, in samples of the piece, and the standard deviation of that."""
        shifts = self.near(piece)
        best = float(shifts[np.argmin(self.cost(piece, shifts))])
        width = max(1.0, 0.3 * self.constant)
        fine = best + width * np.arange(-1.0, 1.0 + 1e-9, _FINE)
        best = float(fine[np.argmin(self.cost(piece, fine))])
        either = self._whitened(self.of(np.array([best - 0.5, best + 0.5]), len(piece)))
        slope = float(np.linalg.norm(either[1] - either[0]))
        white = noise * np.sqrt(1.0 - self.correlation**2)
        # Where noise hides single samples of the step: the asymptotic variance of a change point, 26 (σ/Δ)⁴.
        hidden = np.sqrt(26.0) * (white / (abs(self.high - self.low) * (1.0 - self.correlation))) ** 2
        shape = _UNSURE * self.constant if self.slow else 0.0
        return best, float(np.sqrt((white / slope) ** 2 + hidden**2 + (0.5 * _FINE * width) ** 2 + shape**2))


def edge_shape(piece: np.ndarray, low: float, high: float, correlation: float) -> tuple[bool, float]:
    """(slow, time constant [samples]) with which an edge fits best."""

    def cost(slow: bool, constant: float) -> tuple[float, bool, float]:
        shape = Edge(float(constant), slow, low, high, correlation)
        return float(shape.cost(piece, shape.near(piece)).min()), slow, float(constant)

    tried = _CONSTANTS[_CONSTANTS < 0.25 * len(piece)]
    best = min(cost(slow, constant) for slow in (False, True) for constant in tried)
    step = _CONSTANTS[1] / _CONSTANTS[0]
    best = min(cost(best[1], constant) for constant in best[2] * step ** np.linspace(-1.0, 1.0, 15))
    return best[1], best[2]
