"""From the samples of a trace to the states of the circuit, one after the other, and the instants between them.

1. A running mean over so many samples that neighbouring levels stand 8 of its standard deviations apart.
2. Runs near one level that last longer than an edge are plateaus; what lies between two of different levels is an edge.
3. Each edge is located on the samples themselves, by least squares with the correlation of the noise: a step through
   the one pole of a bandwidth, or a resistance that changes exponentially, as that of a slow contact. Which of the
   two, and its time constant, closing and opening edges tell apart, on the first ones.
4. Gain and offset of the oscilloscope are fitted to the means of all plateaus, and the states read again with them.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from identification.apparatus.contacts.circuit import Circuit
from identification.apparatus.contacts.edge import Edge, edge_shape
from identification.apparatus.contacts.trace import BLOCK, Trace
from identification.progress import Progress
from identification.storage.files import ExperimentError

#: Standard deviations of the running mean between neighbouring levels, and samples that it may take at most.
_APART, _MOST_MEAN = 8.0, 4096
#: Samples in a part from which the noise is taken, more than its correlation; and the share of parts that is quiet.
_LAG, _QUIET = 64, 0.8
#: Time constants after which an edge is over.
_SETTLED = 6.0
#: Height of an edge over the noise of a sample, from which on it tells the time constant.
_CLEAR = 8.0
#: How much gain and offset, over the highest level, of an oscilloscope may depart from 1 and 0: standard deviations.
_GAIN, _OFFSET = 0.02, 0.01
#: Edges of each kind on which its time constant is measured.
_PILOTS = 40
#: A plateau is ambiguous from this part of the way from its level to the nearest other one on.
_BETWEEN = 0.3


@dataclass(frozen=True, eq=False)
class Plateau:
    """Samples that stand at one level: from `start` to `end` [samples] with their mean [V]."""

    start: float
    end: float
    start_sd: float
    end_sd: float
    mean: float
    count: int


@dataclass(frozen=True, eq=False)
class Decoded:
    """The states (K,) of a trace, from starts to ends (K,) [s], each with its standard deviation, and whether each
    state is ambiguous; gain and offset [V] of the oscilloscope; noise [V] of a sample; constants: of closing and
    opening edges [s]; means (K,) [V]."""

    states: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    starts_sd: np.ndarray
    ends_sd: np.ndarray
    ambiguous: np.ndarray
    means: np.ndarray
    gain: float
    offset: float
    noise: float
    constants: tuple[float, float]
    rate: float
    samples: int


def decode(trace: Trace, circuit: Circuit, progress: Progress = lambda *_: None) -> Decoded:
    """Reads a trace in one pass; ExperimentError where its noise drowns the levels."""
    order = np.argsort(circuit.levels)
    levels = circuit.levels[order]
    reader = _Reader(levels)
    for block in trace:
        reader.take(block)
        share = reader.seen / trace.count if trace.count else 0.0
        progress("decode", share, f"{reader.seen / 1e6:.3g} million samples, {len(reader.plateaus)} states")
    plateaus = reader.finish(trace.path)
    means = np.array([plateau.mean for plateau in plateaus])
    counts = np.array([plateau.count for plateau in plateaus], dtype=float)
    gain, offset = _calibrated(means, counts, levels, reader.shown)
    distance = np.abs((gain * levels + offset)[None, :] - means[:, None])
    places = np.argmin(distance, axis=1)
    nearest = distance[np.arange(len(means)), places]
    spacing = np.array([np.min(np.abs(np.delete(levels, k) - levels[k])) for k in places]) * gain
    return Decoded(
        order[places],
        np.array([plateau.start for plateau in plateaus]) / trace.rate,
        np.array([plateau.end for plateau in plateaus]) / trace.rate,
        np.array([plateau.start_sd for plateau in plateaus]) / trace.rate,
        np.array([plateau.end_sd for plateau in plateaus]) / trace.rate,
        nearest > _BETWEEN * spacing,
        means,
        gain,
        offset,
        reader.noise,
        (reader.constants[1] / trace.rate, reader.constants[-1] / trace.rate),
        trace.rate,
        reader.seen,
    )


def _calibrated(means: np.ndarray, counts: np.ndarray, levels: np.ndarray, shown: np.ndarray) -> tuple[float, float]:
    """Gain and offset with which the plateaus stand at levels: both where two levels or more are seen. shown: the
    levels by those of the first block."""
    gain, offset = map(float, np.polyfit(levels, shown, 1))
    for _ in range(5):
        places = np.argmin(np.abs((gain * levels + offset)[None, :] - means[:, None]), axis=1)
        true, weights = levels[places], np.sqrt(counts)
        if len({*places}) < 2:
            break
        basis = np.column_stack([true, np.ones(len(true))]) * weights[:, None]
        gain, offset = map(float, np.linalg.lstsq(basis, means * weights, rcond=None)[0])
    return gain, offset


class _Reader:
    """Blocks in, plateaus out; keeps the samples since the last plateau, and no others."""

    def __init__(self, levels: np.ndarray):
        self.levels, self.plateaus = levels, []
        self.shown, self.correlation = levels, 0.0
        self.seen, self.noise, self.constants = 0, 0.0, {1: 1.0, -1: 1.0}
        self.slow = {1: False, -1: False}
        self._pilots: dict[int, list[tuple[bool, float]]] = {1: [], -1: []}
        self._mean = self._least = 0
        self._kept, self._first = np.empty(0), 0  # samples, and the number of their first
        self._open: list[float] | None = None  # start, start_sd, sum and count of the plateau that goes on

    def take(self, block: np.ndarray) -> None:
        """Takes the next samples."""
        if not self._mean:
            self._prepare(block)
            self._learn(block)
        samples = np.concatenate([self._kept, block])
        self.seen += len(block)
        done = self._split(samples)
        self._kept, self._first = samples[done:].copy(), self._first + done

    def _learn(self, block: np.ndarray) -> None:
        """Measures the edges on the first block: slow ones must not pass for plateaus of the levels between."""
        probe = copy.deepcopy(self)
        probe._split(block)
        self.constants, self.slow, self._pilots = probe.constants, probe.slow, probe._pilots
        self._least += int(_SETTLED * max(self.constants.values()))

    def finish(self, path: Path) -> list[Plateau]:
        """All plateaus; the last one ends with the trace."""
        if self._open is None:
            raise ExperimentError(f"{path}: no level of the circuit lasts; check --supply, --bobs and the file")
        start, start_sd, total, count = self._open
        self.plateaus.append(Plateau(start, float(self.seen), start_sd, 0.0, total / count, int(count)))
        return self.plateaus

    def _prepare(self, block: np.ndarray) -> None:
        if len(block) < 4 * _LAG:
            raise ExperimentError(f"the trace has {len(block)} samples; too few to tell its noise")
        self.noise, self.correlation = _noise(block, float(np.ptp(self.levels)))
        correlated = (1.0 + self.correlation) / (1.0 - self.correlation)
        gap = float(np.diff(self.levels).min())
        needed = (_APART * self.noise / gap) ** 2 * correlated
        if needed > _MOST_MEAN:
            raise ExperimentError(
                f"noise of {self.noise:.3g} V drowns levels that are {gap:.3g} V apart: {needed:.3g} samples would have"
                " to be averaged; use a higher supply, fewer bobs, or larger steps of resistance"
            )
        self._mean = max(4, int(np.ceil(needed)))
        self._least = 3 * self._mean + 16
        smooth = block[: len(block) // self._mean * self._mean].reshape(-1, self._mean).mean(axis=1)
        self.shown = _likely(smooth[:: max(1, len(smooth) // 2000)], self.levels, gap)

    def _split(self, samples: np.ndarray) -> int:
        """Finds the plateaus of samples; how many of them are done with."""
        m = self._mean
        if len(samples) < 2 * self._least:
            return 0
        sums = np.concatenate([[0.0], np.cumsum(samples)])
        smooth = (sums[m:] - sums[:-m]) / m  # of samples k .. k + m - 1
        place = np.searchsorted(0.5 * (self.shown[1:] + self.shown[:-1]), smooth)
        changes = np.flatnonzero(np.diff(place)) + 1
        starts, ends = np.append(0, changes), np.append(changes, len(place))
        long = np.flatnonzero(ends - starts >= self._least)
        if not len(long):
            if len(samples) > 8 * BLOCK:
                raise ExperimentError(
                    "no level of the circuit lasts; check the supply, the number of bobs, and the file"
                )
            return 0
        runs = [(int(starts[k]), int(ends[k]) + m - 1, int(place[starts[k]])) for k in long]  # of samples
        kept = max(runs[-1][0], runs[-1][1] - self._least - m - 4)  # of the last plateau, which goes on
        for k, (first, last, level) in enumerate(runs):
            if self._open is None:
                self._open = [float(self._first), 0.0, 0.0, 0.0]
            elif k and runs[k - 1][2] != level:
                self._edge(samples, runs[k - 1], runs[k])
            begin, end = first + m, max(first + m, kept + m if k == len(runs) - 1 else last - m)
            self._open[2] += float(sums[end] - sums[begin])
            self._open[3] += end - begin
        return kept

    def _edge(self, samples: np.ndarray, before: tuple[int, int, int], after: tuple[int, int, int]) -> None:
        """Ends the open plateau at the edge between two runs (first sample, last, level), and opens the next."""
        m, direction = self._mean, 1 if after[2] > before[2] else -1
        around = 2 * m + 8 + int(8.0 * self.constants[direction])
        left = max(before[0], min(before[1], after[0]) - around)
        right = min(after[1], max(before[1], after[0] + m) + around)
        piece, side = samples[left:right], max(4, m)
        low, high = float(np.mean(piece[:side])), float(np.mean(piece[-side:]))
        if len(self._pilots[direction]) < _PILOTS and abs(high - low) > _CLEAR * self.noise:
            self._pilots[direction].append(edge_shape(piece, low, high, self.correlation))
            kinds = [kind for kind, _ in self._pilots[direction]]
            self.slow[direction] = bool(np.mean(kinds) > 0.5)
            agreed = [c for kind, c in self._pilots[direction] if kind == self.slow[direction]]
            self.constants[direction] = float(np.median(agreed))
        shape = Edge(self.constants[direction], self.slow[direction], low, high, self.correlation)
        onset, sd = shape.onset(piece, self.noise)
        place = self._first + left + onset
        assert self._open is not None
        start, start_sd, total, count = self._open
        self.plateaus.append(Plateau(start, place, start_sd, sd, total / count if count else low, int(max(count, 1))))
        self._open = [place, sd, 0.0, 0.0]


def _noise(block: np.ndarray, span: float) -> tuple[float, float]:
    """(standard deviation of a sample [V], correlation of successive ones), from the quieter parts of a block; span:
    of the levels [V]."""
    parts = block[: len(block) // _LAG * _LAG].reshape(-1, _LAG)
    variances = parts.var(axis=1, ddof=1)
    quiet = parts[variances <= np.quantile(variances, _QUIET)]
    variance = float(quiet.var(axis=1, ddof=1).mean())
    steps = np.diff(quiet, axis=1)
    correlation = 1.0 - float(np.mean(steps**2)) / (2.0 * variance) if variance > 0.0 else 0.0
    moves = np.abs(steps[steps != 0.0])
    grain = float(moves.min()) / np.sqrt(12.0) if len(moves) else 0.0  # of a converter of a few bits
    return max(float(np.hypot(np.sqrt(variance), grain)), 1e-6 * span), float(np.clip(correlation, 0.0, 0.95))


def _likely(smooth: np.ndarray, levels: np.ndarray, gap: float) -> np.ndarray:
    """The levels as the oscilloscope shows them: with the gain and offset at which they come nearest to the smoothed
    samples (K,), of those that an oscilloscope may have."""
    best, found = np.inf, levels
    for gain in 1.0 + _GAIN * np.linspace(-3.0, 3.0, 49):
        for offset in np.arange(-3.0 * _OFFSET, 3.0 * _OFFSET + 1e-9, min(0.1 * gap / levels[-1], 0.01)) * levels[-1]:
            shown = gain * levels + offset
            near = np.clip(np.searchsorted(0.5 * (shown[1:] + shown[:-1]), smooth), 0, len(shown) - 1)
            away = np.minimum(((smooth - shown[near]) * _APART / gap) ** 2, 25.0)  # some samples lie on edges
            score = float(away.sum()) + ((gain - 1.0) / _GAIN) ** 2 + (offset / (_OFFSET * levels[-1])) ** 2
            if score < best:
                best, found = score, shown
    return found


def intervals(decoded: Decoded, pairs: int) -> Iterator[tuple[int, int, int]]:
    """(pair from 0, first state, last state) of each contact, in order of its start: states are those of `decoded`."""
    found = []
    for pair in range(pairs):
        closed = (decoded.states >> pair & 1).astype(bool)
        changes = np.flatnonzero(np.diff(np.concatenate([[False], closed, [False]]).astype(int)))
        found += [(pair, int(a), int(b) - 1) for a, b in changes.reshape(-1, 2)]
    yield from sorted(found, key=lambda one: (one[1], one[0]))
