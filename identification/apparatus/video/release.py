"""How the motion in a film begins: bobs that are held still and let go, or a swing that is under way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.release import Release

#: Angles [rad] beyond which a bob that is still is held, and by which a held one may stir.
_HELD, _STIR = 0.03, 2e-3
#: Frames at least of stillness where bobs hang, and for which all are seen as a swing begins.
_FRAMES = 5
#: Errors of a release that a fit to the film takes from there, 1 sigma: [rad] and [s].
_ANGLE_SD, _TIME_SD = 2e-3, 5e-3


@dataclass(frozen=True, eq=False)
class Begin:
    """release: at `time` [s] of the film; None where none is seen, and bobs swing freely from `time` on."""

    release: Release | None
    time: float
    angle_sd: float = _ANGLE_SD
    time_sd: float = _TIME_SD


def begin(times: np.ndarray, theta: np.ndarray, r: np.ndarray, omega: float, cradle: Cradle) -> Begin:
    """From angles [rad] and distances [m], (T, N)."""
    bobs = theta.shape[1]
    whole = np.flatnonzero(np.isfinite(theta).all(axis=1))
    if len(whole) == 0:
        return Begin(None, float(times[0]))
    first = whole[0]
    held = [bob for bob in range(bobs) if _is_held(times[first:], theta[first:, bob], omega)]
    others = [bob for bob in range(bobs) if bob not in held]
    if not held or any(_still(theta[first:, bob]) < _FRAMES for bob in others):
        return Begin(None, float(times[_all_free(theta)]))
    count = min(_still(theta[first:, bob]) for bob in held)
    plateau = slice(first, first + count)
    angles = {bob + 1: float(np.nanmedian(theta[plateau, bob])) for bob in held}
    instant = float(
        np.median([_let_go(times, theta[:, bob], first + count - 1, omega, angles[bob + 1]) for bob in held])
    )
    start = _start(r, held, others, plateau, cradle)
    side = sorted(angles) == list(range(bobs - len(held) + 1, bobs + 1))
    alike = side and np.ptp(list(angles.values())) < _STIR and min(angles.values()) > 0.0
    if alike:
        return Begin(Release(angle=float(np.mean(list(angles.values()))), bobs=len(held), start=start), instant)
    return Begin(Release(angles=angles, start=start), instant)


def _still(theta: np.ndarray) -> int:
    """For how many frames a bob stays where it is."""
    moved = np.flatnonzero(np.abs(theta - theta[0]) > _STIR)
    return int(moved[0]) if len(moved) else len(theta)


def _is_held(times: np.ndarray, theta: np.ndarray, omega: float) -> bool:
    """Whether a bob that is out, and falls from there as from rest, was already there before it fell.

    A bob that only turns there was lower before, by as much as it is so long afterwards.
    """
    if abs(theta[0]) <= _HELD:
        return False
    early = np.abs(theta[times - times[0] < 0.5 * np.pi / omega])
    angle = theta[np.nanargmax(early)]
    fell = _let_go(times, theta, max(_still(theta) - 1, int(np.nanargmax(early))), omega, angle) - times[0]
    lower = abs(angle) * (1.0 - np.cos(omega * min(max(fell, 0.0), np.pi / omega)))
    return bool(lower > _STIR and abs(angle - theta[0]) < 0.5 * lower)


def _all_free(theta: np.ndarray) -> int:
    """From which frame on all bobs are seen for several frames, and those that are out have left where they were first
    seen: a hand may have held them there."""
    seen = np.isfinite(theta).all(axis=1)
    runs = np.convolve(seen, np.ones(_FRAMES), "valid") == _FRAMES
    first = int(np.argmax(runs)) if runs.any() else 0
    out = np.flatnonzero(np.abs(theta[first]) > _HELD)
    left = first + max((_still(theta[first:, bob]) for bob in out), default=0)
    return left if left < len(theta) else first


def _let_go(times: np.ndarray, theta: np.ndarray, last: int, omega: float, angle: float) -> float:
    """When a bob began to fall [s]: θ = θ_0 cos ω(t − t_0) over the first part of its way, where it is fast enough."""
    ahead = slice(last, last + max(int(np.ceil(0.2 * 2.0 * np.pi / omega / np.median(np.diff(times)))), _FRAMES))
    part = theta[ahead] / angle
    use = (part < 0.97) & (part > 0.3)
    if use.sum() < 2:
        return float(times[last])
    return float(np.median(times[ahead][use] - np.arccos(part[use]) / omega))


def _start(r: np.ndarray, held: list[int], others: list[int], plateau: slice, cradle: Cradle) -> str:
    """Whether the strings of held bobs are longer, hanging, or not, by half of what a bob's weight stretches them."""
    if not cradle.has("radial_elasticity"):
        return "unstretched"
    hanging = np.nanmedian(r[plateau][:, others]) if others else np.nanmedian(r)
    sag = cradle.mass * cradle.gravity / cradle.radial_stiffness
    return "unstretched" if np.nanmedian(r[plateau][:, held]) < hanging - 0.5 * sag else "hanging"
