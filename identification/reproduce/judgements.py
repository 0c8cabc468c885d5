"""Figs. 7 and 8, and the claims about α, γ and δ that they support or refute."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cradle_env.cradle import STANDARD_BETA
from identification.reproduce.figure import BOBS, Claim, Figure, Tables
from identification.reproduce.impacts import PUBLISHED_N
from identification.reproduce.resonance import linear_ratio
from identification.reproduce.sweeps import (
    GAMMA_VARIANTS,
    OFF_RESONANCE,
    PUBLISHED_LEAST,
    STARTS,
    ZOOM,
    column,
    curves,
    draw_curves,
    draw_maps,
    maps,
    sigma_map,
)

#: λ over γ counts as saturated where it grows no more over the upper half than 1.5 times as much as 1 − e ~ vⁿ does.
_LEVEL = 1.5 * (2.0 ** (0.5 * PUBLISHED_N) - 1.0)
# Ranges over which ill-conditioned curves are averaged.
_WIDTH_ALPHA, _WIDTH_DELTA = 0.02, 3e-5
#: λ as near as this to the least is as good as least.
_FLAT = 0.005
#: Gaps that count as different from none.
_APART = 5e-4


def moving_average(values: np.ndarray, width: int) -> np.ndarray:
    """Moving average over a number of neighbouring values, without the ends."""
    return np.convolve(values, np.full(width, 1.0 / width), mode="valid")


def largest_fall(rate: np.ndarray) -> float:
    """Largest fall of a curve below an earlier value, relative to its range."""
    return float(np.max(np.maximum.accumulate(rate) - rate) / np.ptp(rate))


def monotone(tables: Tables) -> Claim:
    """λ rises with α."""
    table = tables["alpha"]
    alpha, words, falls, means = table["alpha"], [], [], []
    width = max(2, round(_WIDTH_ALPHA / (alpha[1] - alpha[0])))
    for bobs in BOBS:
        rates = [table[column(bobs, start)] for start in STARTS]
        falls.append(max(map(largest_fall, rates)))
        means.append(max(largest_fall(moving_average(rate, width)) for rate in rates))
        words.append(f"N = {bobs}: {rates[0][0]:.4f} to {rates[0][-1]:.4f}, falling back by {100 * falls[-1]:.2g} %")
    return Claim.judge(
        "λ rises monotonically with α",
        "4.2, Fig. 8a",
        max(falls) == 0.0,
        f"λ from α = 0 to {alpha[-1]:g}, and by how much of that it falls back on the way: {'; '.join(words)}",
        f"one averages over Δα = {_WIDTH_ALPHA:g} (it falls back by {100 * max(means):.1g} % then): where bobs in touch"
        " synchronize within seconds, λ is ill-conditioned",
        max(means) < 0.01,
    )


def growth(gamma: np.ndarray, rate: np.ndarray) -> float:
    """Relative growth of λ over the upper half of γ, from the medians of the middle and the last tenth."""
    tenth = len(gamma) // 10
    start = (len(gamma) - tenth) // 2
    return float(np.median(rate[-tenth:]) / np.median(rate[start : start + tenth]) - 1.0)


def saturation(tables: Tables) -> Claim:
    """Whether λ levels off with γ, and for which strings and starts."""
    table = tables["gamma"]
    grown = {
        variant: [growth(table["gamma"], table[column(bobs, variant)]) for bobs in BOBS] for variant in GAMMA_VARIANTS
    }
    level = [variant for variant, shares in grown.items() if np.abs(shares).max() < _LEVEL]
    standard, away = linear_ratio(np.array([STANDARD_BETA, OFF_RESONANCE]))
    words = "; ".join(
        f"{variant}: {', '.join(f'{100 * share:+.0f}' for share in shares)} %" for variant, shares in grown.items()
    )
    return Claim.judge(
        "λ saturates with γ",
        "4.2, Fig. 8c",
        len(level) == len(grown),
        f"ω_r/ω_θ = {standard:.2f} at the standard set,"
        f" {away:.2f} off resonance; growth of λ from γ = {0.5 * table['gamma'][-1]:.3f} to {table['gamma'][-1]:.3f}"
        f" (N = 2, 3, 5): {words}",
        f"strings and start are: {'; '.join(level)} (less than {100 * _LEVEL:.0f} % for all N)",
        bool(level),
    )


def find_minimum(delta: np.ndarray, rate: np.ndarray) -> tuple[float, float, float]:
    """δ of the least λ, that λ, and its relative excess at the paper's δ, averaged over a few values."""
    width = max(1, round(_WIDTH_DELTA / (delta[1] - delta[0])))
    mean, at = moving_average(rate, width), moving_average(delta, width)
    low = float(mean.min())
    return float(at[np.argmin(mean)]), low, float(np.interp(PUBLISHED_LEAST, at, mean)) / low - 1.0


def spacing(tables: Tables) -> tuple[Claim, ...]:
    """λ is greater away from δ = 0, in both directions, and least at slightly negative δ."""
    table, zoom = tables["delta"], tables[ZOOM.name]
    delta = table["delta"]
    words, slower = [], []
    for bobs in BOBS:
        rate = table[column(bobs)]
        middle = float(np.interp(0.0, delta, rate))
        slower.append(np.count_nonzero(rate[np.abs(delta) >= _APART] <= middle))
        words.append(f"{rate[0]:.3f}, {middle:.3f}, {rate[-1]:.3f} (N = {bobs})")
    found = {
        (bobs, start): find_minimum(zoom[ZOOM.name], zoom[column(bobs, start)]) for bobs in BOBS for start in STARTS
    }
    listed = "; ".join(
        f"N = {bobs}, {start}: {low:.4f} at {1e4 * at:+.2f}, {100 * above:.2g} %"
        for (bobs, start), (at, low, above) in found.items()
    )
    flat = [f"N = {bobs}, {start}" for (bobs, start), (*_, above) in found.items() if above < _FLAT]
    return (
        Claim.judge(
            "δ ≠ 0 makes the cradle synchronize sooner, in either direction",
            "4.2, Fig. 8d",
            not any(slower),
            f"λ at δ = {delta[0]:g}, 0, {delta[-1]:g}: {'; '.join(words)}; of all |δ| ≥ {_APART:g},"
            f" {sum(slower)} are slower than δ = 0",
        ),
        Claim.judge(
            f"λ is least at δ ≈ {PUBLISHED_LEAST:g}, slightly negative",
            "4.2, Fig. 8d",
            all(abs(at - PUBLISHED_LEAST) < 5e-5 for at, *_ in found.values()),
            f"least λ [1/s] at δ [10⁻⁴], and how much more λ is at the paper's δ: {listed}",
            f"a flat minimum may be read off within {100 * _FLAT:g} % ({'; '.join(flat)})",
            bool(flat),
        ),
    )


def beating(tables: Tables) -> Claim:
    """σ(t) rises again for δ away from 0, not at δ = 0; from the tables of Fig. 7."""
    words, beats, still, delta = [], [], [], np.empty(0)
    for bobs in BOBS:
        delta, _, sigma = sigma_map(tables[f"delta-N{bobs}"])
        again = largest_rise(sigma)
        centre = float(again[np.argmin(np.abs(delta))])
        ends = [float(np.median(again[np.abs(delta - end) < 1e-3])) for end in (delta[0], delta[-1])]
        beats.append(min(ends) > 0.03)
        still.append(centre < 0.02)
        words.append(f"{ends[0]:.3f}, {centre:.3f}, {ends[1]:.3f} (N = {bobs})")
    return Claim.judge(
        "δ away from 0, in either direction, makes σ beat",
        "4.2, Fig. 7d",
        all(beats) and all(still),
        f"largest rise of σ above an earlier value at δ = {delta[0]:g}, 0, {delta[-1]:g}: {'; '.join(words)}",
        f"N is {', '.join(str(n) for n, a, b in zip(BOBS, beats, still, strict=True) if a and b)}",
        any(a and b for a, b in zip(beats, still, strict=True)),
    )


def largest_rise(sigma: np.ndarray) -> np.ndarray:
    """Largest rise of σ (T, ...) above an earlier value."""
    return (sigma - np.minimum.accumulate(sigma, axis=0)).max(axis=0)


def _curve_claims(tables: Tables) -> Sequence[Claim]:
    return monotone(tables), saturation(tables), *spacing(tables)


FIGURES = (
    Figure("fig7", "σ against time and α, β, γ, δ", maps, draw_maps, lambda tables: (beating(tables),)),
    Figure("fig8", "λ against α, β, γ, δ", curves, draw_curves, _curve_claims, needs=("fig7",)),
)
