"""Which candidates are clicks: a regular sequence first, then what is loud and no echo.

The impacts of a cradle come once in half a swing. The sequence of candidates that are about half a swing apart, or a
few of these, is found by dynamic programming; of them weak ones count, too. Any other candidate must be loud, have the
shape of the others, and be no echo: louder than what a room leaves of a click before it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.apparatus.sound.template import Scores
from identification.experiment.click_groups import first_of_group, without_echoes

#: Least signal-to-noise ratio and likeness of a click in the sequence, and of any other.
_REGULAR, _REGULAR_LIKENESS = 4.0, 0.2
_LOUD, _LOUD_LIKENESS = 8.0, 0.6
#: Half swings that are looked for [s]: strings of 6 cm to 1.7 m. The grain of the search [s].
_SHORTEST, _LONGEST, _GRAIN = 0.25, 1.3, 4e-3
#: Pairs of loud clicks that must be this half swing apart, for a sequence to be looked for; and the share of the
#: most frequent distance from which on a shorter one is taken.
_PAIRS, _SHARE = 5, 0.6
#: By how much a step may differ from a whole number of half swings, and its standard deviation, over half a swing.
_OFF, _OFF_SD = 0.012, 0.004
#: Half swings without a click in a step, and what each costs; what a candidate costs; its most gain [log-likelihood].
_MISSED, _MISSED_COST, _COST, _GAIN = 8, 2.0, 6.0, 60.0
#: Clicks before and after by which one is judged, and by how much it may be off these [s]: new strings
#: shorten the first half swing by 1.5 ms.
_NEIGHBOURS, _OFF_LINE = 5, 2.0e-3


@dataclass(frozen=True, eq=False)
class Selection:
    """The clicks among the candidates: which (K,) of them, in order of time; regular (K,): of the sequence; half_swing
    [s]: its step, nan where no sequence was found."""

    which: np.ndarray
    regular: np.ndarray
    half_swing: float


def select(scores: Scores) -> Selection:
    """The clicks among candidates."""
    able = (scores.snr >= _REGULAR) & (scores.likeness >= _REGULAR_LIKENESS)
    loud = (scores.snr >= _LOUD) & (scores.likeness >= _LOUD_LIKENESS)
    half_swing = _half_swing(scores.instants[_without_echoes(scores, loud, np.zeros(len(loud), bool))])
    chain = np.zeros(len(able), bool)
    if half_swing == half_swing:
        chain[_sequence(scores, np.flatnonzero(able), half_swing)] = True
    kept = _without_echoes(scores, loud | chain, chain)
    places = np.array(
        [first_of_group(scores.instants, scores.sizes, int(k), loud | chain) for k in np.flatnonzero(kept)], int
    )
    regular = chain[kept]
    places, order = np.unique(places, return_index=True)
    return Selection(places, regular[order], half_swing)


def _without_echoes(scores: Scores, able: np.ndarray, certain: np.ndarray) -> np.ndarray:
    """Which of the able candidates (K,) are neither echoes nor in a dead time; certain ones first, then the loudest."""
    rank = np.lexsort((-scores.sizes, ~certain))
    return without_echoes(scores.instants, scores.sizes, rank[able[rank]])


def _half_swing(instants: np.ndarray) -> float:
    """The time [s] by which most clicks are apart; nan where there is none."""
    apart = (instants[None, :] - instants[:, None]).ravel()
    apart = apart[(apart > _SHORTEST) & (apart < _LONGEST)]
    if len(apart) < _PAIRS:
        return np.nan
    near = np.abs(apart[:, None] - np.arange(_SHORTEST, _LONGEST, _GRAIN)) < _GRAIN
    counts = near.sum(axis=0)
    if counts.max() < _PAIRS:
        return np.nan
    chosen = int(np.flatnonzero(counts >= max(_PAIRS, _SHARE * counts.max()))[0])
    window = slice(chosen, chosen + 3)
    return float(np.median(apart[near[:, chosen + int(np.argmax(counts[window]))]]))


def _sequence(scores: Scores, able: np.ndarray, half_swing: float) -> np.ndarray:
    """Those of the able candidates that are a regular sequence."""
    instants = scores.instants[able]
    gain = np.minimum(0.5 * scores.snr[able] ** 2, _GAIN) - _COST
    best, back = gain.copy(), np.full(len(able), -1)
    for k in range(len(able)):
        first = np.searchsorted(instants, instants[k] - (_MISSED + 1) * half_swing)
        apart = (instants[k] - instants[first:k]) / half_swing
        steps = np.round(apart)
        off = np.abs(apart - steps)
        total = best[first:k] - 0.5 * (off / _OFF_SD) ** 2 - _MISSED_COST * (steps - 1.0)
        total = np.where((steps >= 1.0) & (off < _OFF), total, -np.inf)
        if len(total) and total.max() > 0.0:
            back[k] = first + int(np.argmax(total))
            best[k] = gain[k] + total.max()
    chain, k = [], int(np.argmax(best)) if len(best) else -1
    while k >= 0:
        chain.append(k)
        k = int(back[k])
    chain = np.array(chain[::-1], int)
    return able[chain[_in_line(instants[chain], half_swing)]]


def _in_line(instants: np.ndarray, half_swing: float) -> np.ndarray:
    """Which instants (K,) of a sequence are where the line through their neighbours has them."""
    if len(instants) < 4:
        return np.ones(len(instants), bool)
    number = np.concatenate([[0.0], np.cumsum(np.round(np.diff(instants) / half_swing))])
    off = np.zeros(len(instants))
    for k in range(len(instants)):
        near = np.arange(max(0, k - _NEIGHBOURS), min(len(instants), k + _NEIGHBOURS + 1))
        near = near[near != k]
        steps, left = number[near] - number[k], instants[near] - instants[k]
        pairs = [(left[j] - left[i]) / (steps[j] - steps[i]) for i in range(len(near)) for j in range(i)]
        off[k] = np.median(left - np.median(pairs) * steps)  # Theil and Sen's line: one that is off bends it little
    return np.abs(off) < np.maximum(_OFF_LINE, 6.0 * 1.4826 * np.median(np.abs(off)))
