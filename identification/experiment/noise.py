"""The noise of a run: as stated, or estimated from the readings alone, whatever the model."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import comb
from scipy.stats import chi2

from identification.experiment.run import Run

#: Orders of the differences, how many are enough, the share that the next must leave at most to be taken instead; and
#: the share of their spacing by which successive times may differ from it.
_ORDERS, _FEWEST, _LESS, _UNEVEN = range(3, 9), 10, 0.9, 0.2
#: How many times the scatter of white noise's own a correlation must be to count.
_CORRELATED = 3.0


def noise_of(run: Run) -> float:
    """Standard deviation of one reading [rad or m]: the stated one, or else the estimate."""
    return estimate_noise(run) if run.noise is None else run.noise


def noise_gap_bound(
    runs: Sequence[Run], rows: Sequence[np.ndarray], inflations: Sequence[float] | None = None
) -> float:  # fmt: skip
    """The RMS over the noise that noise alone passes once in a hundred times, in these rows (T,) of each run; 1 where
    there is no reading. inflations: of each run, 1 where omitted. Of noise that keeps ρ of itself n squares scatter as
    n (1 − ρ²)/(1 + ρ²) of white noise do."""
    counts = [int(np.sum(~np.isnan(run.readings[some]))) for run, some in zip(runs, rows, strict=True)]
    if not any(counts):
        return 1.0
    scatter = sum(n * (f**2 + 1.0) / (2.0 * f) for n, f in zip(counts, inflations or [1.0] * len(counts), strict=True))
    count = sum(counts) ** 2 / scatter
    return math.sqrt(chi2.isf(0.01, count) / count)


def estimate_noise(run: Run) -> float:
    """Standard deviation from differences of successive readings, which take out any smooth motion: third ones, and
    higher ones as long as these leave less.

    The median makes it blind to impacts. Readings smoothed by their instrument look less noisy than they are.
    """
    rows = run.fitted  # before, a hand may hold the bobs
    scatter = [s for s in (_scatter(run.times[rows], column) for column in run.readings[rows].T) if s > 0.0]
    if not scatter:
        raise ValueError(f"{run.file}: the noise cannot be estimated from so few or so coarse readings; state noise")
    return float(np.mean(scatter))


def _scatter(times: np.ndarray, column: np.ndarray) -> float:
    """That of one bob (T,); 0 where nothing can be said. A difference over a gap is not one of successive readings."""
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
    """Whether there is a gap between successive times (T,), (T − 1,)."""
    spacing = np.diff(times)
    return np.abs(spacing - np.median(spacing)) > _UNEVEN * np.median(spacing) if len(spacing) else spacing > 0.0


def estimate_correlation(series: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """ρ of the noise of successive readings, by the times (T,) and residuals (T,) of each bob of a run; 0 where they
    look white.

    It is 1 + 2 g, g the correlation of successive differences, which hold next to nothing of the slow motion that a
    model may lack. Of white noise its standard deviation is √(2/M), of M pairs.
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
    # What is as smooth as from 1 on is no noise.
    return rho if pairs >= _FEWEST and _CORRELATED * math.sqrt(2.0 / pairs) < rho < 1.0 else 0.0


def chi2_inflation(rho: float) -> float:
    """By how much noise that keeps ρ of itself from one reading to the next hides more of slow motion than white noise
    of its size does, as χ²: (1 + ρ)/(1 − ρ)."""
    return (1.0 + rho) / (1.0 - rho)
