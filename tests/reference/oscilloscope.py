"""An oscilloscope across R_a: traces of contacts that are known, for the decoder to be tested on.

Nothing of the package is used. Resistors of 11, 22, 44 … Ω between neighbours in series, each shorted while the two
touch, and 22 Ω across the oscilloscope.
"""

import numpy as np
from scipy.signal import lfilter

STEP, SHUNT, RATE, BANDWIDTH = 11.0, 22.0, 2.5e9, 250e6
SUPPLY = 5.0


def schedule(contacts, pairs, mean, gap, seed=0, together=0.3):
    """[(pair from 0, start, end)] [samples], of random contacts; a share of them begins while another lasts."""
    rng = np.random.default_rng(seed)
    found, now = [], 2.0 * gap
    while len(found) < contacts:
        length = mean * rng.uniform(0.6, 1.6)
        pair = int(rng.integers(pairs))
        found.append((pair, now, now + length))
        if pairs > 1 and rng.random() < together and len(found) < contacts:
            other = (pair + 1 + int(rng.integers(pairs - 1))) % pairs
            found.append((other, now + 0.35 * length, now + length * rng.uniform(1.4, 1.8)))
        now = max(end for _, _, end in found[-2:]) + gap * rng.uniform(1.0, 2.0)
    return [(pair, round(start), round(end)) for pair, start, end in found], int(now + 2 * gap)


def trace(
    found, pairs, samples, *, noise=0.0, gain=1.0, offset=0.0, closing=0.0, opening=0.0, bits=0, rate=RATE,
    bandwidth=BANDWIDTH, seed=0,
):  # fmt: skip
    """Volts (samples,): the resistors of pairs in touch are shorted from start to end, whole samples. closing, opening:
    time constants [samples] with which resistances go and come; noise [V], RMS, has passed the same filter."""
    resistance = np.full(samples, SHUNT)
    fine = np.arange(samples, dtype=float)
    for pair in range(pairs):
        own = np.zeros(samples)
        for other, start, end in found:
            if other == pair:
                a, b = int(start) - 2, min(samples, int(end) + 40 + int(20 * opening))
                t = fine[a:b]
                up, down = (
                    -np.expm1(-np.maximum(t - at, 0.0) / constant) if constant else (t >= at).astype(float)
                    for at, constant in ((start, closing), (end, opening))
                )
                own[a:b] += up - down
        resistance += STEP * 2.0**pair * (1.0 - own)
    volts = gain * SUPPLY * SHUNT / resistance + offset
    pole = np.exp(-2.0 * np.pi * bandwidth / rate)
    rng = np.random.default_rng(seed)
    white = rng.standard_normal(samples) * np.sqrt((1.0 + pole) / (1.0 - pole))  # so that noise is its RMS afterwards
    volts = lfilter([1.0 - pole], [1.0, -pole], volts, zi=[pole * volts[0]])[0]
    volts = volts + noise * lfilter([1.0 - pole], [1.0, -pole], white)
    if bits:
        step = 1.2 * SUPPLY * gain / 2**bits
        volts = step * np.round(volts / step)
    return volts
