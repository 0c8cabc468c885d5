"""Candidates for clicks: where the whitened sound rises suddenly above what came before it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import percentile_filter
from scipy.signal import fftconvolve, find_peaks

from identification.apparatus.sound.whitening import Whitened

#: Length over which power is averaged [s]: about that of a click.
_SMOOTH = 1e-3
#: The power before a click is that which the preceding time passes for a quarter: this long and ending so long before
#: [s]. In it are pulses of a voice, which come every 5 to 10 ms, and the echo of a louder click.
_BEFORE, _GUARD, _QUANTILE = 0.1, 4e-3, 75.0
#: How often that power is looked at [s].
_STEP = 1e-3
#: Power over that before, from which on a peak is a candidate: noise alone passes it a few times a second.
_RISE = 2.2
#: Least time between candidates [s], and how many of them are kept in a second, the best.
_APART, _MOST = 8e-3, 12
#: What is kept around a candidate [s].
BEFORE, AFTER = 10e-3, 12e-3
#: Length of what is searched at a time [s].
_CHUNK = 4.0


@dataclass(frozen=True, eq=False)
class Candidates:
    """Peaks of power: places (K,) [samples], levels (K,): power before them over that of the background, at least 1;
    whitened, plain (K, W): the sound around them, W from `BEFORE` to `AFTER`."""

    places: np.ndarray
    levels: np.ndarray
    whitened: np.ndarray
    plain: np.ndarray


def find_candidates(stretches: Iterable[Whitened], rate: float) -> Candidates:
    """The candidates of a recording, in order of time."""
    before, after = round(BEFORE * rate), round(AFTER * rate)
    found = [_in_chunk(*chunk, rate, before, after) for chunk in _chunks(stretches, rate)]
    return Candidates(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _chunks(stretches: Iterable[Whitened], rate: float) -> Iterator[tuple[int, np.ndarray, int, int]]:
    """(first sample, sound (2, K), where to search from and to), with what lies around."""
    around = round((_BEFORE + _GUARD + BEFORE + AFTER) * rate)
    parts, held, start = [np.zeros((2, around))], around, -around
    for stretch in stretches:
        own = np.stack([stretch.whitened, stretch.plain])[:, max(0, -stretch.start) :]
        parts.append(own)
        held += own.shape[1]
        if held > _CHUNK * rate + 2 * around:
            sound = np.concatenate(parts, axis=1)
            yield start, sound, around, held - around
            parts, start = [sound[:, -2 * around :]], start + held - 2 * around
            held = 2 * around
    sound = np.concatenate([*parts, np.zeros((2, around))], axis=1)
    yield start, sound, around, sound.shape[1] - around


def _in_chunk(start: int, sound: np.ndarray, first: int, last: int, rate: float, before: int, after: int) -> tuple:
    width, step = round(_SMOOTH * rate), round(_STEP * rate)
    bell = np.hanning(width + 2)[1:-1]
    power = fftconvolve(sound[0] ** 2, bell / bell.sum(), mode="same")
    coarse = power[::step]
    count = round(_BEFORE / _STEP)
    shift = count // 2 + round(_GUARD / _STEP)  # the filter is centred on what lies before
    level = percentile_filter(coarse, _QUANTILE, size=count, mode="nearest")
    level = np.concatenate([np.full(shift, level[0]), level[:-shift]])
    middle = np.median(coarse[coarse > 0.0]) if (coarse > 0.0).any() else 1.0
    level = np.maximum(np.repeat(level, step)[: len(power)] / middle, 1.0)
    rise = power / (middle * level)
    peaks, _ = find_peaks(rise[first:last], height=_RISE, distance=round(_APART * rate))
    peaks += first
    seconds = (start + peaks) // round(rate)
    order = np.lexsort((-rise[peaks], seconds))
    rank = np.arange(len(peaks)) - np.searchsorted(seconds[order], seconds[order])
    peaks = np.sort(peaks[order][rank < _MOST])
    around = peaks[:, None] + np.arange(-before, after)
    return start + peaks, level[peaks], sound[0][around].astype(np.float32), sound[1][around].astype(np.float32)
