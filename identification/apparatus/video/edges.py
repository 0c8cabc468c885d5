"""Centres of discs to a small part of a pixel, from where rays cross their edges.

The crossing of a ray is the mean of the places where its brightness changes from the level inside to that outside,
weighted by the change. It is linear in the picture: under motion blur it is the mean over the exposure, even where a
bob is stopped in the midst of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

_RAYS, _SAMPLES = 72, 19
#: Directions of the rays [rad], clockwise in the picture from its right.
ANGLES = 2.0 * np.pi * (np.arange(_RAYS) + 0.5) / _RAYS
#: Samples at either end of a ray whose mean is the level there.
_LEVEL = 3
#: Pixels on either side of an edge that belong to it in a sharp picture: the lens, the codec.
_SHARP = 2.5
#: Rays nearer to straight up than this [rad] may run along a string.
_STRING = 0.2
#: Least part of the rays that must cross an edge for a centre to be told.
_ENOUGH = 0.3
#: Standard deviations of a bob's radius in one frame about its own [pixels], and of the crossing of one ray.
RADIUS_SD, _RAY_SD = 0.03, 0.3


@dataclass(frozen=True, eq=False)
class Centres:
    """Of N bobs in one frame: places (N, 2), nan where they cannot be told; radii (N,), means over the rays; edges
    (N, rays), from the place to the edge along each ray, nan where it does not count; scatter (N,), the RMS distance of
    edges from the outline [pixels]; seen (N,), the part of the rays that cross an edge where it should be; level (N,),
    the median brightness just inside the edge; contrast (N,), by how much it is brighter outside."""

    places: np.ndarray
    radii: np.ndarray
    edges: np.ndarray
    scatter: np.ndarray
    seen: np.ndarray
    level: np.ndarray
    contrast: np.ndarray


def centres(
    picture: np.ndarray,
    places: np.ndarray,
    outlines: np.ndarray,
    sign: int,
    blur: np.ndarray,
    radius_sd: float = RADIUS_SD,
) -> Centres:
    """From places (N, 2) that are a few pixels off at most, nan for those not looked for. outlines: (N, rays), from the
    centre to the edge [pixels], known but for what is common to all rays, whose standard deviation is radius_sd; blur:
    (N, 2), by how much each moves while the shutter is open [pixels]."""
    outward = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)
    up = np.abs(np.mod(ANGLES - 1.5 * np.pi + np.pi, 2.0 * np.pi) - np.pi) < _STRING
    radius = outlines.mean(axis=1)
    half = np.minimum(_SHARP + 0.5 * np.abs(blur @ outward.T), 0.45 * radius[:, None])
    now, wider, left = places.copy(), np.zeros(len(places)), np.zeros(outlines.shape)
    scatter, seen = np.full(len(places), np.nan), np.zeros(len(places))
    level, contrast = np.full(len(places), np.nan), np.full(len(places), np.nan)
    for _ in range(3):
        usable = ~(up | _beside(now, outward, radius, outlines + half))
        edge, good, within, beyond = _crossings(picture, now, outward, outlines, half, sign)
        level, contrast = _medians(within, good), _medians(beyond - within, good)
        now, wider, left, scatter, seen = _fitted(now, outward, edge - outlines, good & usable, usable, radius_sd)
    lost = np.isnan(now[:, 0]) | (np.linalg.norm(now - places, axis=1) > 0.6 * radius)
    now[lost] = np.nan
    return Centres(now, radius + wider, outlines + left, scatter, seen, level, contrast)


def _medians(values: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Of each row's good ones, (N,); nan where there are none."""
    return np.array([np.median(row[ok]) if ok.any() else np.nan for row, ok in zip(values, good, strict=True)])


def _beside(places: np.ndarray, outward: np.ndarray, radius: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Which rays end on another bob, (N, rays)."""
    ends = places[:, None] + length[..., None] * outward
    apart = np.linalg.norm(ends[:, :, None] - places, axis=-1)
    apart[np.arange(len(places)), :, np.arange(len(places))] = np.inf
    return (apart < radius + 2.0).any(axis=2)


def _crossings(
    picture: np.ndarray, places: np.ndarray, outward: np.ndarray, outlines: np.ndarray, half: np.ndarray, sign: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """How far from the centre each ray crosses the edge, whether it does, the levels inside and outside, (N, rays)."""
    along = np.linspace(-1.0, 1.0, _SAMPLES)
    far = outlines[..., None] + half[..., None] * along
    points = places[:, None, None] + far[..., None] * outward[:, None]
    inside = ~np.isnan(points[..., 0, 0])
    at = np.nan_to_num(points, nan=-9.0)
    level = map_coordinates(picture, (at[..., 1], at[..., 0]), np.float32, order=1, mode="nearest")
    height, width = picture.shape
    ends = points[..., -1, :]
    inside &= (ends[..., 0] > 0) & (ends[..., 0] < width - 1) & (ends[..., 1] > 0) & (ends[..., 1] < height - 1)
    within, beyond = level[..., :_LEVEL].mean(axis=-1), level[..., -_LEVEL:].mean(axis=-1)
    contrast = sign * (beyond - within)
    share = (level - beyond[..., None]) / np.where(contrast == 0.0, 1.0, -sign * contrast)[..., None]
    # The trapezoidal rule from the middle of the inner level to that of the outer one.
    first, last = _LEVEL // 2, _SAMPLES - 1 - _LEVEL // 2
    part = share[..., first : last + 1]
    step = half * (along[1] - along[0])
    edge = outlines + half * along[first] + step * (part.sum(axis=-1) - 0.5 * (part[..., 0] + part[..., -1]))
    usual = np.median(contrast[inside], axis=None) if inside.any() else 0.0
    good = inside & (contrast > max(0.35 * usual, 6.0)) & (np.abs(edge - outlines) < half)
    return edge, good, within, beyond


def _fitted(
    places: np.ndarray,
    outward: np.ndarray,
    beyond: np.ndarray,
    good: np.ndarray,
    usable: np.ndarray,
    radius_sd: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Outlines moved and widened by least squares that outliers do not move (Tukey's biweight).

    beyond: (N, rays), by how much edges lie beyond the outlines. Returns places, by how much bobs are wider (N,),
    beyond as it is about the new places, nan where it does not count, scatter, and seen.
    """
    rays = np.concatenate([outward, np.ones((len(outward), 1))], axis=1)
    offset = np.where(good, beyond, 0.0)
    weight = good.astype(float)
    prior = np.diag([0.0, 0.0, (_RAY_SD / radius_sd) ** 2])
    shift, left = np.zeros((len(places), 3)), offset
    for _ in range(5):
        matrix = np.einsum("nr,ri,rj->nij", weight, rays, rays) + prior + 1e-9 * np.eye(3)
        pull = np.einsum("nr,ri->ni", weight * offset, rays)
        shift = np.linalg.solve(matrix, pull[..., None])[..., 0]
        left = offset - shift @ rays.T
        spread = np.array(
            [1.4826 * np.median(np.abs(row[ok])) if ok.any() else 1.0 for row, ok in zip(left, good, strict=True)]
        )
        share = left / (4.0 * np.maximum(spread, 0.05))[:, None]
        weight = good * np.clip(1.0 - share**2, 0.0, None) ** 2
    counted = weight > 0.05
    seen = counted.sum(axis=1) / np.maximum(usable.sum(axis=1), 1)
    scatter = np.sqrt(np.sum(counted * left**2, axis=1) / np.maximum(counted.sum(axis=1) - 3, 1))
    # The rays must reach around: with all on one side a centre is a guess.
    around = np.abs(np.einsum("nr,ri->ni", counted.astype(float), outward)).max(axis=1) / np.maximum(
        counted.sum(axis=1), 1
    )
    enough = (counted.sum(axis=1) > _ENOUGH * _RAYS * 0.6) & (seen > _ENOUGH) & (around < 0.6)
    found = np.where(enough[:, None], places + shift[:, :2], np.nan)
    return found, shift[:, 2], np.where(counted, left + shift[:, 2:], np.nan), scatter, seen
