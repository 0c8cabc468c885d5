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
    return Box(rounded(low, -np.inf, settings.dtype), rounded(high, np.inf, settings.dtype), dtype=settings.dtype.type)


def of_camera(state: np.ndarray) -> np.ndarray:
    """What a camera shows of observations (..., 4 N + 3), and the spacer and the clock beside it: (..., N + 2)."""
    n = state.shape[-1] // 4
    return np.concatenate([state[..., n : 2 * n], state[..., 4 * n : 4 * n + 1], state[..., 4 * n + 2 :]], axis=-1)


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
