"""The quantities that a sweep keeps of each run: λ and others."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cradle_env.errors import unknown_key
from cradle_env.release import Release
from cradle_env.synchronization import check_duration
from cradle_env.trajectory import Trajectory

#: Bobs are synchronized from the time at which σ stays below this value for a whole period.
SYNCHRONIZED_SIGMA = 0.05


@dataclass(frozen=True)
class Quantity:
    """A quantity that a sweep keeps of each run.

    Parameters
    ----------
    name, symbol, unit, meaning : str
        Name in tables, symbol and unit in pictures, and a short description.
    measure : callable
        measure(run) returns a number, or with `series` an array of the shape of run.t, (T,). To run in other processes
        it must be a function of a module. A sweep does not resume in its folder if this function was edited.
    series : bool
        Whether the quantity is a function of time.
    ledger : bool
        Whether `measure` needs the energy ledger, which doubles the time of a run.
    """

    name: str
    symbol: str
    unit: str
    meaning: str
    measure: Callable[[Trajectory], Any]
    series: bool = False
    ledger: bool = False


def _newton_exponent(run: Trajectory) -> float:
    _check_synchronizes(run)
    check_duration(run.t[-1])
    return run.newton_exponent()


def _sigma(run: Trajectory) -> np.ndarray:
    _check_synchronizes(run)
    return run.sigma()


def _check_synchronizes(run: Trajectory) -> None:
    assert isinstance(run.release, Release)
    run.release.check_synchronizes(run.cradle)


def synchronization_index(run: Trajectory) -> int | None:
    """Index of the first sample after which σ < 0.05 for a whole period; None if there is none."""
    below = np.concatenate([[0], np.cumsum(_sigma(run) < SYNCHRONIZED_SIGMA)])
    whole = math.ceil(run.cradle.period / (run.t[1] - run.t[0]))
    lasting = np.flatnonzero(below[whole:] - below[:-whole] == whole)
    return int(lasting[0]) if len(lasting) else None


def _synchronization_time(run: Trajectory) -> float:
    index = synchronization_index(run)
    return math.nan if index is None else float(run.t[index])


def _energy_share(run: Trajectory) -> float:
    index, energy = synchronization_index(run), run.swing_energy()
    return math.nan if index is None else float(energy[index] / energy[0])


def _impacts(run: Trajectory) -> float:
    return float(len(run.impacts))


def _overtaking_time(run: Trajectory) -> float:
    passed = np.flatnonzero((np.diff(run.x(), axis=1) < 0.0).any(axis=1))
    return float(run.t[passed[0]]) if len(passed) else math.nan


_ALL = (
    Quantity("lambda", "λ", "1/s", "Newton exponent: σ falls about as exp(−λt)", _newton_exponent),
    Quantity("sigma", "σ", "1", "distance from synchronization over time", _sigma, series=True),
    Quantity(
        "synchronization_time", "t_sync", "s", "time from which σ < 0.05 for a whole period", _synchronization_time
    ),
    Quantity(
        "energy_share",
        "share of energy left",
        "1",
        "energy of the swing at synchronization over that released",
        _energy_share,
        ledger=True,
    ),
    Quantity("overtaking_time", "t_over", "s", "first time at which a bob has jumped over its neighbour; σ means"
             " little after it", _overtaking_time),
    Quantity("impacts", "impacts", "1", "number of impacts, pair by pair", _impacts),
)  # fmt: skip
#: Quantities by name.
QUANTITIES = {quantity.name: quantity for quantity in _ALL}


def choose_quantities(quantities: Sequence[str | Quantity], taken: Sequence[str]) -> tuple[Quantity, ...]:
    """Look up the quantities that are given by name.

    Raises ValueError for an unknown name, no quantity, a quantity twice, or a name that is in `taken`.
    """
    found = []
    for asked in quantities:
        if isinstance(asked, str) and asked not in QUANTITIES:
            raise ValueError(unknown_key("quantity", asked, QUANTITIES))
        found.append(QUANTITIES[asked] if isinstance(asked, str) else asked)
    names = [quantity.name for quantity in found]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"the quantities are {', '.join(names) or 'none'}; name one or more, each once")
    for name in (*taken, "status", "problem", "time"):
        if name in names:
            raise ValueError(f"a quantity is named {name!r}, which is something else in a table; rename it")
    return tuple(found)
