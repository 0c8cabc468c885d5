"""The circuit that tells contacts apart (Lee & Hong, section 2.2), and the voltages that it can show.

A source, a resistor between each two neighbours, and the resistor R_a across the oscilloscope stand in series. Two bobs
that touch short the resistor between them. With resistors of 11, 22, 44, … Ω the resistance is a binary number of the
pairs that do not touch, so that each voltage stands for one state. The paper states the 11 Ω, the 22 Ω of R_a and the
binary sequence; that they stand in series is this project's reading of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cradle_env.errors import check_range

#: Ω: of the smallest resistor, and across the oscilloscope (Table 2).
STEP, SHUNT = 11.0, 22.0
#: Pairs at most: beyond, levels are closer than an oscilloscope of 8 bits resolves.
_MOST_PAIRS = 8


@dataclass(frozen=True)
class Circuit:
    """supply [V]; resistances [Ω] between bobs i and i + 1, in order; shunt [Ω], across the oscilloscope."""

    supply: float
    resistances: tuple[float, ...]
    shunt: float = SHUNT

    def __post_init__(self) -> None:
        check_range("supply", self.supply, "V", 0.0, above=True)
        check_range("shunt", self.shunt, "Ω", 0.0, above=True)
        if not 1 <= len(self.resistances) <= _MOST_PAIRS:
            raise ValueError(f"{len(self.resistances)} resistances are given; there must be 1 to {_MOST_PAIRS}")
        for resistance in self.resistances:
            check_range("resistance", resistance, "Ω", 0.0, above=True)

    @classmethod
    def binary(cls, bobs: int, supply: float, step: float = STEP, shunt: float = SHUNT) -> Circuit:
        """That of the paper: step, 2 step, 4 step, … Ω."""
        check_range("bobs", bobs, "", 2, _MOST_PAIRS + 1)
        return cls(supply, tuple(step * 2.0**k for k in range(bobs - 1)), shunt)

    @property
    def levels(self) -> np.ndarray:
        """Voltage over R_a [V] of each state; bit p of a state's number is whether bobs p + 1 and p + 2 touch."""
        states = np.arange(2 ** len(self.resistances))
        open_ = 1 - (states[:, None] >> np.arange(len(self.resistances)) & 1)
        return self.supply * self.shunt / (self.shunt + open_ @ np.array(self.resistances))


def joined(state: int, pairs: int) -> int:
    """The most bobs that touch one another in a state, 1 where none do.

    >>> joined(0b011, 3), joined(0b101, 3), joined(0, 3)
    (3, 2, 1)
    """
    most = run = 1
    for pair in range(pairs):
        run = run + 1 if state >> pair & 1 else 1
        most = max(most, run)
    return most


def touching(state: int, pairs: int) -> Sequence[int]:
    """Pairs, from 1, that touch in a state."""
    return [pair + 1 for pair in range(pairs) if state >> pair & 1]
