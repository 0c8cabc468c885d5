"""How far the bobs have synchronized, σ(t), and how fast, λ."""

from __future__ import annotations

import math

import numpy as np

#: Width of the centred window of the envelopes, in small-angle periods.
ENVELOPE_PERIODS = 1.05
#: λ averages over this stretch of time [s] and where σ exceeds this floor.
WINDOW = (1.0, 60.0)
FLOOR = 1e-3


def sigma(t: np.ndarray, theta_n: np.ndarray, theta0: float | np.ndarray, period: float) -> np.ndarray:
    """σ(t) = |E₊[θ_n] + E₋[θ_n]| / θ0 (Lee & Hong, section 4.2).

    t: (T,) evenly spaced [s]; theta_n: (..., T) angle of the lifted end bob [rad]; theta0: release angle [rad];
    period: small-angle period [s]. E₊ and E₋ are the running maximum and minimum over a centred window of 1.05
    periods, cut off at the ends of the record. Returns (..., T), nan where nothing was lifted.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    if len(t) < 2:
        raise ValueError(f"σ needs evenly spaced times; there {'is but one' if len(t) else 'are none'}")
    step = (t[-1] - t[0]) / (len(t) - 1)
    if step <= 0.0 or not np.allclose(np.diff(t), step, rtol=1e-6):
        raise ValueError("σ needs evenly spaced times; sample with sample_rate")
    half = half_window(period, step)
    upper = maximum_filter1d(theta_n, 2 * half + 1, axis=-1, mode="nearest")
    lower = minimum_filter1d(theta_n, 2 * half + 1, axis=-1, mode="nearest")
    lifted = np.where(np.asarray(theta0) == 0.0, np.nan, theta0)
    return np.abs(upper + lower) / lifted[..., None]


def half_window(period: float, step: float) -> int:
    """Half the envelopes' window in samples that are `step` [s] apart; ValueError where these are too few."""
    half = round(0.5 * ENVELOPE_PERIODS * period / step)
    if half < 8:
        raise ValueError(f"samples every {step:g} s are too sparse for the envelopes of a {period:g} s swing")
    return half


def window_of(t: np.ndarray) -> list[float]:
    """The stretch of times (T,) [s] over which λ is taken: `WINDOW`, or to the end of a shorter record."""
    return [WINDOW[0], float(min(WINDOW[1], t[-1]))]


def check_duration(duration: float, sample_rate: float = math.inf) -> None:
    """ValueError where a run of this duration [s], sampled at sample_rate [1/s], is too short for λ."""
    if duration <= WINDOW[0] or duration < WINDOW[0] + 1.0 / sample_rate - 1e-9:
        raise ValueError(
            f"duration is {duration:g} s; λ takes more than {WINDOW[0]:g} s by a sample, so simulate longer"
        )


def newton_exponent(t: np.ndarray, sigma: np.ndarray, window: tuple[float, float] = WINDOW) -> float | np.ndarray:
    """λ = ⟨t⁻¹ ln σ⁻¹⟩ [1/s] over window[0] < t ≤ window[1] where σ > 1e-3; nan where there is no such t.

    t: (T,) [s]; sigma: (..., T).
    """
    inside = (t > window[0]) & (t <= window[1])
    s = sigma[..., inside]
    use = s > FLOOR
    rate = -np.log(np.where(use, s, 1.0)) / t[inside]
    with np.errstate(invalid="ignore"):
        return np.sum(rate, axis=-1) / np.sum(use, axis=-1)
