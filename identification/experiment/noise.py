"""The noise of a run: as stated, or estimated from the readings without a model of the motion."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri, comb

from identification.experiment.run import Run

#: Orders of the differences; lower ones still contain the swing.
_ORDERS = range(3, 9)
#: Fewest differences for an estimate: the median of 10 independent values is uncertain by more than a third.
_FEWEST = 10
#: A higher order is used only if its estimate is below this part of the last one.
_LESS = 0.9
#: Two readings are not successive if their spacing differs from the median spacing by more than this part of it.
_UNEVEN = 0.2
#: A correlation counts if it exceeds its standard deviation for white noise by this factor.
_CORRELATED = 3.0


def noise_of(run: Run) -> float:
    """Standard deviation of one reading [rad or m], as stated or else as `estimate_noise` gives it."""
    return estimate_noise(run) if run.noise is None else run.noise


def noise_gap_bound(
    runs: Sequence[Run], rows: Sequence[np.ndarray], inflations: Sequence[float] | None = None
) -> float:  # fmt: skip
    """Return the 99 % bound of the gap, the RMS residual over the noise, of a correct model.

    The squares of n readings with autoregressive noise of correlation ρ have the variance of n (1 − ρ²)/(1 + ρ²)
    independent squares. Their mean then follows χ² of that many degrees of freedom.

    Parameters
    ----------
    runs : sequence of Run
        The runs.
    rows : sequence of ndarray of bool, each of shape (T,)
        For each run, the rows that count.
    inflations : sequence of float, optional
        For each run, (1 + ρ)/(1 − ρ) of its noise, as `chi2_inflation` gives it; 1 if omitted.

    Returns
    -------
    float
        1 if there are no readings.
    """
    counts = [int(np.sum(~np.isnan(run.readings[some]))) for run, some in zip(runs, rows, strict=True)]
    if not any(counts):
        return 1.0
    scatter = sum(n * (f**2 + 1.0) / (2.0 * f) for n, f in zip(counts, inflations or [1.0] * len(counts), strict=True))
    count = sum(counts) ** 2 / scatter
    return math.sqrt(chdtri(count, 0.01) / count)


def estimate_noise(run: Run) -> float:
    """Estimate the standard deviation of one reading [rad or m] from differences of successive readings.

    Differences of order k remove polynomials of degree k − 1, so they remove smooth motion. For white noise of
    standard deviation s their standard deviation is s √(2k over k). The order rises from 3 as long as the estimate
    falls. It uses the median absolute difference, which the few differences across impacts do not change.

    Not covered: noise that the instrument has smoothed. The estimate is then too small.

    Raises ValueError if there are too few readings, or if all differences are 0.
    """
    rows = run.fitted  # before that, a hand may hold the bobs
    scatter = [s for s in (_scatter(run.times[rows], column) for column in run.readings[rows].T) if s > 0.0]
    if not scatter:
        raise ValueError(f"{run.file}: the noise cannot be estimated from so few or such coarse readings; state noise")
    return float(np.mean(scatter))


def _scatter(times: np.ndarray, column: np.ndarray) -> float:
    """Estimate for one bob, from readings (T,) without missing ones in between; 0 if there are too few differences."""
    seen = np.isfinite(column)
    least, readings = 0.0, column[seen]
    apart = _interrupted(times[seen])
    for order in _ORDERS:
        if len(apart) < order + _FEWEST:
            break
        differences = np.diff(readings, order)[np.convolve(apart, np.ones(order), "valid") < 0.5]
        if len(differences) < _FEWEST:
            break
        found = float(np.median(np.abs(differences))) / (0.6745 * math.sqrt(comb(2 * order, order)))
        if least > 0.0 and not 0.0 < found < _LESS * least:
            break
        least = found
    return least


def _interrupted(times: np.ndarray) -> np.ndarray:
    """Whether each pair of successive times (T,) has a gap between them; shape (T − 1,)."""
    spacing = np.diff(times)
    return np.abs(spacing - np.median(spacing)) > _UNEVEN * np.median(spacing) if len(spacing) else spacing > 0.0


def estimate_correlation(series: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """Estimate the correlation ρ between the noise of successive readings of a run.

    ρ = 1 + 2 g with g the correlation of successive differences of the residuals. Differences contain almost nothing
    of a slow motion that the model may lack, so a misfit does not look like correlated noise. For white noise and M
    pairs of differences the standard deviation of ρ is √(2/M).

    Parameters
    ----------
    series : sequence of (ndarray, ndarray)
        Times (T,) [s] and residuals (T,) of each bob.

    Returns
    -------
    float
        0 if the noise cannot be distinguished from white noise.
    """
    products, squares, pairs = 0.0, 0.0, 0
    for times, residuals in series:
        steps, apart = np.diff(residuals), _interrupted(times)
        both = ~(apart[:-1] | apart[1:])
        first, second = steps[:-1][both], steps[1:][both]
        products += float(first @ second)
        squares += 0.5 * float(first @ first + second @ second)
        pairs += len(first)
    rho = 1.0 + 2.0 * products / squares if squares > 0.0 else 0.0
    # ρ of 1 or more means a smooth misfit, not noise.
    return rho if pairs >= _FEWEST and _CORRELATED * math.sqrt(2.0 / pairs) < rho < 1.0 else 0.0


def chi2_inflation(rho: float) -> float:
    """Inflation of χ² by autoregressive noise of correlation ρ: (1 + ρ)/(1 − ρ).

    A slow misfit in n such readings is as significant as in n (1 − ρ)/(1 + ρ) readings with white noise (the effective
    sample size).
    """
    return (1.0 + rho) / (1.0 - rho)
