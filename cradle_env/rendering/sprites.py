"""The ball and the flash of an impact, pixel by pixel."""

from __future__ import annotations

import numpy as np

from cradle_env.rendering.palette import ORANGE, VERMILLION, YELLOW


def ball(radius: float) -> np.ndarray:
    """A steel ball lit from the upper left, (H, W, 4) uint8."""
    x, y, distance = _grid(radius)
    depth = np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))
    lit = np.maximum(-0.45 * x - 0.60 * y + 0.66 * depth, 0.0)
    bounced = 0.22 * np.maximum(y, 0.0) ** 3
    tone = 0.16 + 0.72 * lit**1.2 + bounced
    glint = np.maximum(-0.25 * x - 0.36 * y + 0.90 * depth, 0.0) ** 60
    steel = np.array([48, 56, 68]) + tone[..., None] * np.array([184, 182, 178]) + 90 * glint[..., None]
    return _rgba(steel, radius - distance + 0.5)


def flash(radius: float) -> np.ndarray:
    """A flash, white in the middle and orange outside, with eight rays, (H, W, 4) uint8."""
    x, y, distance = _grid(radius)
    far = np.clip(distance / radius, 0.0, 1.0)
    rays = np.cos(4.0 * np.arctan2(y, x)) ** 8
    opacity = np.maximum(np.exp(-((far / 0.4) ** 2)), (0.3 + 0.7 * rays) * (1.0 - far) ** 0.6)
    shades = zip((255, 255, 255), YELLOW, ORANGE, VERMILLION, strict=True)
    return _rgba(np.dstack([np.interp(far, [0.0, 0.2, 0.4, 1.0], shade) for shade in shades]), opacity)


def _grid(radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, y over the radius, and the distance [pixels] from the middle, of a square that holds a disc."""
    half = int(np.ceil(radius)) + 1
    y, x = np.mgrid[-half:half, -half:half] + 0.5
    return x / radius, y / radius, np.hypot(x, y)


def _rgba(colour: np.ndarray, opacity: np.ndarray) -> np.ndarray:
    return np.dstack([np.clip(colour, 0, 255), 255 * np.clip(opacity, 0, 1)]).round().astype(np.uint8)
