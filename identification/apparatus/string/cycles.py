"""Each cycle of a curve by itself, without any law: its stiffness, and what it takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.apparatus.string.curve import Curve

#: Share of the largest force to which a full cycle comes down.
_EMPTY = 0.05


@dataclass(frozen=True)
class Cycle:
    """One loading leg and the unloading one after it.

    number: in its file, from 1; force: the largest [N]; rate: of loading [m/s]; stiffness: of loading above 30 % of
    the largest force [N/m]; work: of loading [J]; loss: ∮ F dx [J]; each with its standard deviation from the noise;
    full: whether the force comes down to zero before and after.
    """

    file: str
    number: int
    force: float
    rate: float
    stiffness: tuple[float, float]
    work: tuple[float, float]
    loss: tuple[float, float]
    full: bool


def cycles_of(curve: Curve, zero: float, play: float) -> list[Cycle]:
    """The cycles of a curve whose force reads `zero` [N] on a slack string, by a machine with play [m].

    While the machine takes up its play the force stays at its largest: that work is not the string's.
    """
    found = []
    for up, down in zip(curve.legs[::2], curve.legs[1::2], strict=False):
        x, f = curve.displacement[up.first : down.last], curve.force[up.first : down.last] - zero
        loading = up.last - up.first
        peak = float(np.mean(f[max(0, loading - 3) : loading + 1]))
        ends = (f[0] if up.first == 0 else np.mean(f[:2]), np.mean(f[-2:]))
        steep = (f[:loading] > 0.3 * peak) & (f[:loading] < 0.95 * peak)
        if steep.sum() < 5:
            continue
        slope, spread = np.polyfit(x[:loading][steep], f[:loading][steep], 1, cov="unscaled")
        area, area_sd = _integral(x, f, curve.noise, True)
        found.append(
            Cycle(
                curve.file,
                len(found) + 1,
                peak,
                up.rate,
                (float(slope[0]), float(curve.noise * np.sqrt(spread[0, 0]))),
                _integral(x[:loading], f[:loading], curve.noise, False),
                (area + peak * play, area_sd),
                bool(max(ends) < _EMPTY * peak),
            )
        )
    return found


def loss_share(cycles: list[Cycle]) -> tuple[float, float] | None:
    """(mean, standard deviation) of loss over work of loading of the full cycles; None where there is none."""
    full = [cycle for cycle in cycles if cycle.full]
    if not full:
        return None
    shares = np.array([cycle.loss[0] / cycle.work[0] for cycle in full])
    noises = np.array([cycle.loss[1] / cycle.work[0] for cycle in full])
    scatter = np.std(shares, ddof=1) / np.sqrt(len(shares)) if len(shares) > 1 else 0.0
    return float(np.mean(shares)), float(max(scatter, np.sqrt(np.sum(noises**2)) / len(shares)))


def _integral(x: np.ndarray, f: np.ndarray, noise: float, closed: bool) -> tuple[float, float]:
    """(∫ f dx, standard deviation) by the trapezoidal rule, back to its start if `closed`."""
    if closed:
        x, f = np.append(x, x[0]), np.append(f, f[0])
    step = np.diff(x)
    weights = 0.5 * (np.append(step, 0.0) + np.append(0.0, step))
    return float(weights @ f), float(noise * np.sqrt(np.sum(weights**2)))
