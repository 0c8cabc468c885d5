"""What the agent sees and sets."""

from __future__ import annotations

import math

import numpy as np
from gymnasium.spaces import Box

from cradle_env.envs.settings import Settings


def action_space(settings: Settings) -> Box:
    """One number in [−1, 1] for each of `settings.actions`."""
    return Box(-1.0, 1.0, (len(settings.actions),), np.float32)


def observation_space(settings: Settings) -> Box:
    """r, θ, dr/dt, dθ/dt of all bobs, δ, σ, time since the release, (4 N + 3,); of a camera θ, δ, time, (N + 2,)."""
    n, (r, r_dot, theta_dot) = settings.bobs, largest(settings)
    low, high = np.zeros(4 * n + 3), np.zeros(4 * n + 3)
    high[:n] = r
    for block, bound in enumerate((math.pi, r_dot, theta_dot), start=1):
        low[block * n : (block + 1) * n], high[block * n : (block + 1) * n] = -bound, bound
    low[4 * n], high[4 * n :] = -1.0, (1.0, 2.0, settings.duration)
    if settings.camera_noise is not None:
        low, high = of_camera(low), of_camera(high)
    middle, unit = scaling(settings)
    low, high = (low - middle) / unit, (high - middle) / unit
    return Box(rounded(low, -np.inf, settings.dtype), rounded(high, np.inf, settings.dtype), dtype=settings.dtype.type)


def of_camera(state: np.ndarray) -> np.ndarray:
    """What a camera shows of observations (..., 4 N + 3), and the spacer and the clock beside it: (..., N + 2)."""
    n = state.shape[-1] // 4
    return np.concatenate([state[..., n : 2 * n], state[..., 4 * n : 4 * n + 1], state[..., 4 * n + 2 :]], axis=-1)


def scaling(settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    """What observations are shown as differences from, and in units of: 0 and 1 but with `normalize_observations`.

    Units are 2 % of r0, the largest release angle θ0, 10 % of √(g r0), θ0 √(g/r0), half of `delta_range`, 1, and the
    duration; r is shown from r0 on, δ from the middle of its range, everything else from 0 on.
    """
    n = settings.bobs
    middle, unit = np.zeros(4 * n + 3), np.ones(4 * n + 3)
    if settings.normalize_observations:
        cradle, ends = settings.widest(), np.array(settings.delta_range)
        angle = settings.release_angle_range[1]
        if "release_angle" not in settings.actions:
            angle = float(np.max(settings.release_angle))
        middle[:n], middle[4 * n] = cradle.length, ends.mean()
        unit[:n], unit[n : 2 * n] = 0.02 * cradle.length, angle
        unit[2 * n : 3 * n] = 0.1 * math.sqrt(cradle.gravity * cradle.length)
        unit[3 * n : 4 * n] = angle * math.sqrt(cradle.gravity / cradle.length)
        unit[4 * n], unit[4 * n + 2] = 0.5 * (ends[1] - ends[0]), settings.duration
    return (middle, unit) if settings.camera_noise is None else (of_camera(middle), of_camera(unit))


def rounded(bound: np.ndarray, towards: float, dtype: np.dtype) -> np.ndarray:
    """A bound as `dtype`, rounded outwards where it is no such number."""
    cast = bound.astype(dtype)
    inside = cast < bound if towards > 0 else cast > bound
    return np.where(inside, np.nextafter(cast, dtype.type(towards)), cast)


def largest(settings: Settings) -> tuple[float, float, float]:
    """The largest r [m], dr/dt [m/s] and dθ/dt [rad/s] that an observation shows: far beyond any swing, which
    reaches 2 √(g r0) and 2 √(g/r0) at most; of the longest and of the shortest strings where these are a range."""
    cradle, shortest = settings.widest(), settings.narrowest().length
    speed, spin = math.sqrt(cradle.gravity * cradle.length), math.sqrt(cradle.gravity / shortest)
    return 2.0 * cradle.length, 4.0 * speed, 4.0 * spin
