"""A recorded force-displacement curve as legs between its turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from identification.apparatus.columns import FORCES, LENGTHS, TIMES, Column, digest_of, read_columns
from identification.storage.files import ExperimentError

_KNOWN = {"displacement": Column(LENGTHS), "force": Column(FORCES), "t": Column(TIMES, needed=False)}
#: A turn counts once the displacement has gone back by this share of its range: less is the noise of the machine.
_TURN = 0.02
#: Rows on each side of a turn that tell where it was.
_TURN_ROWS = 5
#: Rows that a curve, and a leg, need at least.
_LEAST_ROWS, _LEAST_LEG = 30, 5
#: Rows before the string is straight that tell the zero of the force.
_SLACK_ROWS = 5


@dataclass(frozen=True)
class Leg:
    """Rows first..last - 1 between two turns; loading: whether the displacement grows; rate: mean speed [m/s], nan
    without times; end: displacement [m] at which the machine turns after it, mostly between two rows."""

    first: int
    last: int
    loading: bool
    rate: float
    end: float


@dataclass(frozen=True, eq=False)
class Curve:
    """One file: displacement (T,) [m], force (T,) [N], time (T,) [s] or None, legs that begin with a loading one.

    straight: about where the string is straight [m]; slack: whether rows before that tell the zero of the force.
    """

    file: str
    displacement: np.ndarray
    force: np.ndarray
    time: np.ndarray | None
    legs: tuple[Leg, ...]
    straight: float
    slack: bool

    @property
    def noise(self) -> float:
        """Standard deviation of one force [N], from third differences within legs."""
        scatter = [np.diff(self.force[leg.first : leg.last], 3) for leg in self.legs]
        middle = np.median(np.abs(np.concatenate(scatter)))
        return float(middle / (0.6745 * np.sqrt(20.0)))


def read_curves(paths: Sequence[str | Path]) -> tuple[list[Curve], str]:
    """The curves of CSV files, and the SHA-256 over them."""
    if not paths:
        raise ValueError("no curve is given; name at least one CSV of displacement and force")
    curves, digests = [], []
    for path in map(Path, paths):
        columns = read_columns(path, _KNOWN)
        digests.append(columns.digest)
        time = columns["t"] if "t" in columns else None
        curves.append(curve_of(str(path), columns["displacement"], columns["force"], time))
    return curves, digest_of(digests)


def curve_of(file: str, displacement: np.ndarray, force: np.ndarray, time: np.ndarray | None) -> Curve:
    """The curve of arrays (T,), rows with a missing value left out."""
    seen = np.isfinite(displacement) & np.isfinite(force) & (True if time is None else np.isfinite(time))
    x, f, t = displacement[seen], force[seen], None if time is None else time[seen]
    if len(x) < _LEAST_ROWS:
        raise ExperimentError(f"{file}: {len(x)} rows with displacement and force; at least {_LEAST_ROWS} are needed")
    if t is not None and (np.diff(t) <= 0.0).any():
        row = int(np.argmax(np.diff(t) <= 0.0))
        raise ExperimentError(f"{file}: time does not grow after {t[row]:.9g} s; sort the rows by time")
    if np.ptp(x) == 0.0:
        raise ExperimentError(f"{file}: the displacement never changes; give a cycle of loading and unloading")
    legs = _legs(x, t)
    if not legs[0].loading:
        first = legs[1].first if len(legs) > 1 else len(x)
        if first > len(x) - _LEAST_ROWS:
            raise ExperimentError(
                f"{file}: the displacement only falls; it must grow as the string is loaded: turn its sign"
            )
        return curve_of(file, x[first:], f[first:], None if t is None else t[first:])
    rows = slice(legs[0].first, legs[0].last)
    top = np.quantile(f[rows], 0.98)
    steep = (f[rows] > 0.3 * top) & (f[rows] < 0.95 * top)
    if top <= 0.0 or steep.sum() < _LEAST_LEG:
        raise ExperimentError(f"{file}: the force does not grow as the string is loaded; turn the sign of the force")
    straight = _straight(x[rows], f[rows])
    return Curve(file, x, f, t, legs, straight, int(np.sum(x[rows] < straight)) >= _SLACK_ROWS)


def _straight(x: np.ndarray, f: np.ndarray) -> float:
    """Where a slack string becomes straight [m]: the bend of the broken line through a loading leg that fits best."""
    squares = []
    places = np.linspace(x.min(), x.min() + 0.7 * np.ptp(x), 141)
    for place in places:
        basis = np.column_stack([np.ones(len(x)), np.maximum(x - place, 0.0)])
        squares.append(np.sum((basis @ np.linalg.lstsq(basis, f, rcond=None)[0] - f) ** 2))
    return float(places[int(np.argmin(squares))])


def _legs(x: np.ndarray, t: np.ndarray | None) -> tuple[Leg, ...]:
    """Zigzag: a leg ends at its extreme once the displacement has turned back by the threshold."""
    threshold = _TURN * np.ptp(x)
    turns, extreme, direction = [0], 0, 0
    for i in range(1, len(x)):
        if direction == 0:
            if abs(x[i] - x[0]) > threshold:
                direction, extreme = int(np.sign(x[i] - x[0])), i
        elif direction * (x[i] - x[extreme]) > 0.0:
            extreme = i
        elif direction * (x[extreme] - x[i]) > threshold:
            turns.append(extreme + 1)
            direction, extreme = -direction, i
    rows = np.arange(float(len(x))) if t is None else t
    found = [_turn(x, rows, turn - 1) for turn in turns[1:]]
    turns = [0, *(last for last, _ in found), len(x)]
    ends = [*(end for _, end in found), float(x[-1])]
    legs = []
    for first, last, end in zip(turns[:-1], turns[1:], ends, strict=True):
        if last - first < _LEAST_LEG:
            continue
        move = x[last - 1] - x[first]
        rate = np.nan if t is None else abs(move) / (t[last - 1] - t[first])
        legs.append(Leg(first, last, bool(move > 0.0), float(rate), end))
    return tuple(legs)


def _turn(x: np.ndarray, t: np.ndarray, extreme: int) -> tuple[int, float]:
    """(first row after a turn, displacement [m] at the turn) near the row with the extreme displacement.

    A machine at constant speed turns where the straight lines through the rows before and after meet. If they do not
    meet between the neighbours of the extreme row, the machine slows down as it turns, and that row is the turn.
    """
    before, after = slice(max(extreme - _TURN_ROWS, 0), extreme), slice(extreme + 1, extreme + 1 + _TURN_ROWS)
    if len(x[before]) >= 2 and len(x[after]) >= 2:
        (up, a), (down, b) = (np.polyfit(t[part] - t[extreme], x[part], 1) for part in (before, after))
        instant = (b - a) / (up - down) if up != down else np.nan
        if t[extreme - 1] <= t[extreme] + instant <= t[extreme + 1]:
            return extreme + (instant >= 0.0), float(a + up * instant)
    return extreme + 1, float(x[extreme])
