"""The shape that clicks of one recording share, and how well each candidate fits it: a matched filter.

A cradle, its place and the microphone stay where they are, so that all clicks and their first echoes look alike; steps,
stops of a voice and drums do not. The shape is that of the candidate which most others resemble, and the mean of these.
The instant is where the correlation with the shape is largest. Its standard deviation in noise is that of Cramér and
Rao, 1/(ρ β), with the signal-to-noise ratio ρ and the RMS bandwidth β of the shape (Kay, Fundamentals of Statistical
Signal Processing: Estimation Theory, section 3.11).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.apparatus.sound.candidates import BEFORE, Candidates

#: The part of a candidate that is compared, around its peak of power [s].
_FROM, _TO = -1.5e-3, 4e-3
#: By how much the peak of power may be off the click [s].
_LAG = 1.2e-3
#: Candidates that choose the shape, the loudest.
_CHOOSING = 120
#: Correlation from which on two of these are alike.
_ALIKE = 0.6
#: Rounds of aligning and averaging.
_ROUNDS = 3
#: Least part of the power of a candidate that counts as above the background.
_LEAST_ABOVE = 0.5
#: Points of a correlation for each sample.
_FINE = 8
#: Least standard deviation of an instant [s]: contacts last longer the slower the bobs, by 50 µs from 0.5 to 0.05 m/s.
_LEAST_SD = 20e-6


@dataclass(frozen=True, eq=False)
class Scores:
    """How each candidate fits the shape, (K,).

    instants [s] and their standard deviations; sizes: amplitudes in the whitened sound; snr: these over noise;
    likeness: of its power above the background, the part that has the shape, 0 to 1; amplitudes in full scales, and
    their standard deviations.
    """

    instants: np.ndarray
    instants_sd: np.ndarray
    sizes: np.ndarray
    snr: np.ndarray
    likeness: np.ndarray
    amplitudes: np.ndarray
    amplitudes_sd: np.ndarray


@dataclass(frozen=True, eq=False)
class Template:
    """The shape of the clicks: whitened, of norm 1, and plain, with a peak of 1; (L,) each; alike: how many candidates
    chose it."""

    whitened: np.ndarray
    plain: np.ndarray
    alike: int


def learn(candidates: Candidates, rate: float) -> Template:
    """The shape that most of the loudest candidates share."""
    power = (_core(candidates.whitened, rate) ** 2).sum(axis=1) / candidates.levels
    loud = np.sort(np.argsort(-power)[:_CHOOSING])
    snippets = candidates.whitened[loud].astype(float)
    cores = _core(snippets, rate)
    cores = cores / np.linalg.norm(cores, axis=1, keepdims=True)
    likeness = np.array([_correlate(snippets, core, rate)[1] for core in cores]) / _norm(snippets, rate)
    alike = likeness > _ALIKE
    middle = int(np.argmax(np.where(alike, likeness, 0.0).sum(axis=1)))
    members = np.flatnonzero(alike[middle])
    shape = cores[middle]
    for _ in range(_ROUNDS):
        lags, sizes = _correlate(snippets[members], shape, rate)
        cut = _cut(snippets[members], lags, rate)
        shape = sizes @ cut
        shape /= np.linalg.norm(shape)
    lags, sizes = _correlate(snippets[members], shape, rate)
    plain = sizes @ _cut(candidates.plain[loud[members]].astype(float), lags, rate)
    return Template(shape, plain / np.abs(plain).max(), len(members))


def score(candidates: Candidates, template: Template, rate: float) -> Scores:
    """How each candidate fits the shape."""
    whitened, plain = candidates.whitened.astype(float), candidates.plain.astype(float)
    lags, sizes = _correlate(whitened, template.whitened, rate)
    noise = np.sqrt(candidates.levels)
    snr = np.maximum(sizes, 0.0) / noise
    cut = _cut(whitened, lags, rate)
    power = (cut**2).sum(axis=1)
    above = np.maximum(power - _background(whitened, rate), _LEAST_ABOVE * power)
    likeness = np.clip(np.maximum(sizes, 0.0) ** 2 / above, 0.0, 1.0)
    frequency = 2.0 * np.pi * np.fft.rfftfreq(len(template.whitened), 1.0 / rate)
    spectrum = np.abs(np.fft.rfft(template.whitened)) ** 2
    bandwidth = float(np.sqrt((frequency**2 * spectrum).sum() / spectrum.sum()))
    onset = _onset(template.whitened)
    first = candidates.places + round(_FROM * rate) + onset
    own = template.plain @ template.plain
    amplitudes = _cut(plain, lags, rate) @ template.plain / own
    quiet = np.stack([_cut(plain, np.full(len(plain), -shift * rate), rate) @ template.plain / own
                      for shift in (5e-3, 6.3e-3, 7.7e-3)])  # fmt: skip
    spread = np.sqrt(np.mean(quiet**2, axis=0))
    return Scores(
        (first + lags) / rate,
        np.hypot(_LEAST_SD, 1.0 / (np.maximum(snr, 1e-3) * bandwidth)),
        np.maximum(sizes, 0.0),
        snr,
        likeness,
        amplitudes,
        spread,
    )


def _onset(shape: np.ndarray) -> int:
    """Where a shape begins: the first sample of a tenth of its largest."""
    return int(np.argmax(np.abs(shape) > 0.1 * np.abs(shape).max()))


def _span(rate: float) -> tuple[int, int]:
    """Where in a snippet the part that is compared begins, and its length."""
    return round((BEFORE + _FROM) * rate), round((_TO - _FROM) * rate)


def _core(snippets: np.ndarray, rate: float) -> np.ndarray:
    begin, length = _span(rate)
    return snippets[:, begin : begin + length]


def _norm(snippets: np.ndarray, rate: float) -> np.ndarray:
    return np.linalg.norm(_core(snippets, rate), axis=1)


def _background(snippets: np.ndarray, rate: float) -> np.ndarray:
    """Power (K,) of the background in a part that is compared, by what lies before it."""
    begin, length = _span(rate)
    return length * np.mean(snippets[:, : begin - round(_LAG * rate)] ** 2, axis=1)


def _correlate(snippets: np.ndarray, shape: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """(lag [samples], size (K,)) of the largest correlation of snippets (K, W) with a shape (L,), between samples."""
    begin, length = _span(rate)
    most = round(_LAG * rate)
    part = snippets[:, begin - most : begin + length + most]
    size = 1 << (part.shape[1] + length).bit_length()
    product = np.fft.rfft(part, size) * np.conj(np.fft.rfft(shape, size))
    padded = np.zeros((len(part), _FINE * size // 2 + 1), complex)
    padded[:, : product.shape[1]] = product
    fine = np.fft.irfft(padded, _FINE * size)[:, : 2 * most * _FINE + 1] * _FINE
    best = np.clip(np.argmax(fine, axis=1), 1, fine.shape[1] - 2)
    rows = np.arange(len(fine))
    low, top, high = (fine[rows, best + k] for k in (-1, 0, 1))
    bend = low - 2.0 * top + high
    shift = np.where(bend < 0.0, 0.5 * (low - high) / np.where(bend < 0.0, bend, 1.0), 0.0).clip(-0.5, 0.5)
    return (best + shift) / _FINE - most, top - 0.25 * (low - high) * shift


def _cut(snippets: np.ndarray, lags: np.ndarray, rate: float) -> np.ndarray:
    """The part (K, L) of snippets (K, W) that is compared, moved by lags (K,) [samples] between samples."""
    begin, length = _span(rate)
    width = snippets.shape[1]
    turn = np.exp(2j * np.pi * np.outer(lags, np.fft.rfftfreq(width)))
    return np.fft.irfft(np.fft.rfft(snippets) * turn, width)[:, begin : begin + length]
