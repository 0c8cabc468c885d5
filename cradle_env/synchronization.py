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
    """Synchronization σ(t) = |E₊[θ_n] + E₋[θ_n]| / θ0: 1 as one bob swings against resting ones, 0 in unison.

    E₊ and E₋ are the running maximum and minimum over a centred window of 1.05 periods, cut off at the ends of the
    record.

    Parameters
    ----------
    t : ndarray, shape (T,)
        Evenly spaced times [s].
    theta_n : ndarray, shape (..., T)
        Angle of the lifted end bob [rad].
    theta0 : float or ndarray, shape (...)
        Its release angle [rad].
    period : float
        Small-angle period [s].

    Returns
    -------
    ndarray, shape (..., T)
        nan where theta0 is 0.

    Raises
    ------
    ValueError
        For times that are not evenly spaced, or too sparse for the envelopes.

    References
    ----------
    Lee & Hong, arXiv:2401.16693, section 4.2.

    Examples
    --------
    >>> t = np.arange(0.0, 10.0, 0.01)
    >>> swing = np.cos(2.0 * np.pi * t)
    >>> float(sigma(t, 0.1 * swing, 0.1, 1.0)[500].round(6)), float(sigma(t, 0.1 * swing.clip(0.0), 0.1, 1.0)[500])
    (0.0, 1.0)
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


def sigma_slope(
    t: np.ndarray, theta_n: np.ndarray, theta0: float, period: float, d_theta_n: np.ndarray, d_theta0: float
) -> np.ndarray:
    """Derivative (T,) of `sigma` by a parameter, from those of θ_n (T,) and θ0: the envelopes move with the samples
    that they touch. nan where one of these is not known."""
    half = half_window(period, (t[-1] - t[0]) / (len(t) - 1))

    def touched(x: np.ndarray) -> np.ndarray:
        padded = np.pad(x, half, constant_values=-np.inf)
        within = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
        return within.argmax(axis=-1) + np.arange(len(x)) - half

    highest, lowest = touched(theta_n), touched(-theta_n)
    both = theta_n[highest] + theta_n[lowest]
    slope = np.sign(both) * (d_theta_n[highest] + d_theta_n[lowest])
    return (slope - np.abs(both) / theta0 * d_theta0) / theta0


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
    """Newton exponent λ = ⟨t⁻¹ ln σ⁻¹⟩, the rate of synchronization: σ falls about as exp(−λt).

    Parameters
    ----------
    t : ndarray, shape (T,)
        Times [s].
    sigma : ndarray, shape (..., T)
        σ at these times.
    window : (float, float)
        The mean is over window[0] < t ≤ window[1] [s] where σ > 1e-3.

    Returns
    -------
    float or ndarray, shape (...)
        λ [1/s]; nan where no time is in the window with σ > 1e-3.

    References
    ----------
    Lee & Hong, arXiv:2401.16693, section 4.2.

    Examples
    --------
    >>> t = np.linspace(0.0, 60.0, 601)
    >>> round(float(newton_exponent(t, np.exp(-0.05 * t))), 6)
    0.05
    """
    inside = (t > window[0]) & (t <= window[1])
    s = sigma[..., inside]
    use = s > FLOOR
    rate = -np.log(np.where(use, s, 1.0)) / t[inside]
    with np.errstate(invalid="ignore"):
        return np.sum(rate, axis=-1) / np.sum(use, axis=-1)


def newton_exponent_slope(
    t: np.ndarray, sigma: np.ndarray, d_sigma: np.ndarray, window: tuple[float, float] = WINDOW
) -> float:
    """Derivative of `newton_exponent` by a parameter, from that of σ (T,)."""
    use = (t > window[0]) & (t <= window[1]) & (sigma > FLOOR)
    return float(np.mean(-d_sigma[use] / (sigma[use] * t[use]))) if use.any() else np.nan
