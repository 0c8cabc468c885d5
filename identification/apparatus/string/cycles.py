"""Each cycle of a curve by itself, without any law: its stiffness, and what it takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.apparatus.string.curve import Curve

#: Share of the largest force to which a full cycle comes down.
_EMPTY = 0.05
#: Rows before a turn that tell the force there.
_TIP_ROWS = 5


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


def cycles_of(curve: Curve, zero: tuple[float, float], play: tuple[float, float]) -> list[Cycle]:
    """The cycles of a curve whose force reads `zero` [N] on a slack string, by a machine with play [m], each with its
    standard deviation.

    While the machine takes up its play the force stays at its largest: that work is not the string's.
    """
    found = []
    for up, down in zip(curve.legs[::2], curve.legs[1::2], strict=False):
        x, f = curve.displacement[up.first : down.last], curve.force[up.first : down.last] - zero[0]
        loading = up.last - up.first
        tip = slice(loading - _TIP_ROWS, loading)
        peak = float(np.polyval(np.polyfit(x[tip] - up.end, f[tip], 1), 0.0))
        ends = (f[0] if up.first == 0 else np.mean(f[:2]), np.mean(f[-2:]))
        steep = (f[:loading] > 0.3 * peak) & (f[:loading] < 0.95 * peak)
        if steep.sum() < 5:
            continue
        slope, spread = np.polyfit(x[:loading][steep], f[:loading][steep], 1, cov="unscaled")
        # The turn is mostly between two rows.
        x, f = np.insert(x, loading, up.end), np.insert(f, loading, peak)
        area, area_sd = _integral(np.append(x, x[0]), np.append(f, f[0]), curve.noise)
        work, work_sd = _integral(x[: loading + 1], f[: loading + 1], curve.noise)
        found.append(
            Cycle(
                curve.file,
                len(found) + 1,
                peak,
                up.rate,
                (float(slope[0]), float(curve.noise * np.sqrt(spread[0, 0]))),
                (work, float(np.hypot(work_sd, zero[1] * np.ptp(x)))),
                (area + peak * play[0], float(np.hypot(area_sd, peak * play[1]))),
                bool(max(ends) < _EMPTY * peak),
            )
        )
    return found


def loss_share(cycles: list[Cycle]) -> tuple[float, float] | None:
    """(mean, standard deviation) of loss over work of loading of the full cycles; None where there is none."""
    full = [cycle for cycle in cycles if cycle.full]
    if not full:
        return None
    loss, loss_sd = np.array([cycle.loss for cycle in full]).T
    work, work_sd = np.array([cycle.work for cycle in full]).T
    shares = loss / work
    noises = shares * np.hypot(loss_sd / loss, work_sd / work)
    scatter = np.std(shares, ddof=1) / np.sqrt(len(shares)) if len(shares) > 1 else 0.0
    return float(np.mean(shares)), float(max(scatter, np.sqrt(np.sum(noises**2)) / len(shares)))


def _integral(x: np.ndarray, f: np.ndarray, noise: float) -> tuple[float, float]:
    """(∫ f dx, standard deviation) by the trapezoidal rule."""
    step = np.diff(x)
    weights = 0.5 * (np.append(step, 0.0) + np.append(0.0, step))
    return float(weights @ f), float(noise * np.sqrt(np.sum(weights**2)))
