"""Whitening: a recording over the spectrum of its background, so that music and hum no longer hide clicks.

Overlapping frames are divided by the amplitude that the background has at each frequency, the median over some frames
before and after. A tone fills few frequencies in many frames and is taken out; a click fills all frequencies in one or
two frames, of which the median knows nothing. This is the noise estimate of matched filters that search for short
signals in coloured noise: Allen et al., Phys. Rev. D 85, 122006 (2012), section V.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

#: The band that is searched [Hz]: below it rooms are loud, above it clicks are weak and codecs cut. _TOP: the most of
#: the sampling rate that its upper end may be. _EDGE: width of its edges, part of their frequency.
_LOW, _HIGH, _TOP, _EDGE = 1500.0, 12000.0, 0.45, 0.15
#: Length of a frame [s], about: a note lasts longer, and its tones are resolved.
_FRAME = 0.17
#: Frames before and after of which the background is the median: 0.7 s each way, longer than a click and its echo.
_AROUND = 8
#: Frames for which one background serves.
_TOGETHER = 4
#: Median of an exponentially distributed power, over its mean.
_MEDIAN = np.log(2.0)
#: Least amplitude of the background at a frequency, over that of a recording of 16 bits that is silent, and over the
#: median of all frequencies in the band: what a codec has cut is not to be raised.
_SILENCE, _LEAST = 2.0**-16, 0.01


@dataclass(frozen=True, eq=False)
class Whitened:
    """A stretch of a recording: whitened (K,), with a variance density of 1 in the band; plain (K,), the band alone;
    start: its first sample in the recording."""

    start: int
    whitened: np.ndarray
    plain: np.ndarray


def whiten(blocks: Iterable[np.ndarray], rate: float) -> Iterator[Whitened]:
    """Stretches of a recording, one after the other, of half a frame each."""
    size = 2 * round(0.5 * _FRAME * rate)
    half = size // 2
    window = np.sqrt(0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(size) + 0.5) / size))  # squares add up to 1
    band = _band(size, rate)
    inside = band > 0.5
    ahead: deque[np.ndarray] = deque(maxlen=2 * _AROUND + 1)
    spectra: deque[np.ndarray] = deque()
    gain, age, number = np.zeros(len(band)), 0, 0
    left = np.zeros((2, half))

    def emitted(spectrum: np.ndarray) -> Whitened:
        nonlocal left, number, gain, age
        if age % _TOGETHER == 0:
            gain = _gain(np.array(ahead), inside, size) * band
        age += 1
        both = np.fft.irfft(np.stack([spectrum * gain, spectrum * band]), size) * window
        done = left + both[:, :half]
        left = both[:, half:]
        number += 1
        return Whitened((number - 2) * half, done[0], done[1])

    for frame in _frames(blocks, size):
        spectrum = np.fft.rfft(frame * window)
        spectra.append(spectrum)
        ahead.append(np.abs(spectrum) ** 2)
        if len(spectra) > _AROUND:
            yield emitted(spectra.popleft())
    while spectra:
        yield emitted(spectra.popleft())


def _frames(blocks: Iterable[np.ndarray], size: int) -> Iterator[np.ndarray]:
    """Frames that overlap by half, the first half before the recording, the last half after it."""
    half = size // 2
    rest = np.zeros(half)
    for block in blocks:
        rest = np.concatenate([rest, block])
        while len(rest) >= size:
            yield rest[:size]
            rest = rest[half:]
    for _ in range(2):
        yield np.concatenate([rest, np.zeros(size)])[:size]
        rest = rest[half:]


def _band(size: int, rate: float) -> np.ndarray:
    frequency = np.fft.rfftfreq(size, 1.0 / rate)
    low, high = _LOW, min(_HIGH, _TOP * rate)
    rise = np.clip((frequency / low - 1.0 + _EDGE) / _EDGE, 0.0, 1.0)
    fall = np.clip((high - frequency) / (_EDGE * high) + 1.0, 0.0, 1.0) if high < _TOP * rate else frequency <= high
    return np.sin(0.5 * np.pi * rise) ** 2 * np.sin(0.5 * np.pi * np.minimum(fall, 1.0)) ** 2


def _gain(powers: np.ndarray, inside: np.ndarray, size: int) -> np.ndarray:
    """One over the amplitude of the background, by the power spectra (M, F) of frames around."""
    amplitude = np.sqrt(np.median(powers, axis=0) / (_MEDIAN * 0.5 * size))
    least = max(_LEAST * float(np.median(amplitude[inside])), _SILENCE)
    return 1.0 / np.maximum(amplitude, least)
