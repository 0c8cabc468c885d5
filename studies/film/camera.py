"""A camera that films a cradle: spheres seen through a lens, blur, noise, glare, and a codec.

Nothing of the measurement is used. The room has x along the row, y down and z away from the camera; each sphere is seen
as the cone of rays that meet it, so that its picture is the ellipse of a real lens.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Camera:
    """A camera at `distance` [m] from the plane of motion, its pictures `size` (width, height) pixels.

    focal: [pixels]; yaw, pitch, roll: [rad] by which it is turned from looking straight at the row; rate: [frames/s];
    exposure: part of a frame that the shutter is open; parts: instants that an exposure averages; noise: of a pixel, 1
    sigma of 255; bob, background: brightness; highlight: of a spot on each bob; texture: 1 sigma of a static pattern
    behind; glare: brightness of a veil over a part of the picture.
    """

    size: tuple[int, int] = (320, 160)
    focal: float = 640.0
    distance: float = 0.8
    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0
    rate: float = 60.0
    exposure: float = 0.25
    parts: int = 4
    noise: float = 2.0
    bob: float = 50.0
    background: float = 190.0
    highlight: float = 60.0
    texture: float = 0.0
    glare: float = 0.0
    drop: float = 0.27  # m, by which the camera looks below the pivots' line

    def rotation(self) -> np.ndarray:
        """From the room to the camera, (3, 3)."""
        cy, sy, cp, sp = np.cos(self.yaw), np.sin(self.yaw), np.cos(self.pitch), np.sin(self.pitch)
        cr, sr = np.cos(self.roll), np.sin(self.roll)
        about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
        about_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
        about_z = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
        return about_z @ about_x @ about_y

    def seen(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 2) [m], x along the row and y down from the pivots, in the camera's frame, (..., 3).

        The camera turns about the point that it looks at, in the middle of the row.
        """
        room = np.stack([points[..., 0], points[..., 1] - self.drop, np.zeros(points.shape[:-1])], axis=-1)
        return room @ self.rotation().T + np.array([0.0, 0.0, self.distance])

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Where points are in the picture, (..., 2) [pixels]; (0, 0) is the middle of the first pixel."""
        x, y, z = np.moveaxis(self.seen(points), -1, 0)
        middle = (np.array(self.size) - 1) / 2.0
        return np.stack([self.focal * x / z + middle[0], self.focal * y / z + middle[1]], axis=-1)


def film(
    camera: Camera,
    times: np.ndarray,
    centres: np.ndarray,
    radius: float,
    pivots: np.ndarray,
    seed: int = 0,
    hand: tuple[float, int] | None = None,
    hidden: tuple[float, float, int] | None = None,
) -> Iterator[np.ndarray]:
    """Frames (H, W) uint8. centres: (T, parts, N, 2) [m] at the instants that each exposure averages, in its order.

    pivots: (N, 2) [m]; hand: until when [s] a hand covers which bob; hidden: from when until when something covers
    which bob.
    """
    rng = np.random.default_rng(seed)
    width, height = camera.size
    y, x = np.mgrid[0:height, 0:width].astype(float)
    scenery = camera.background + _pattern(rng, camera.texture, (height, width))
    scenery = scenery + camera.glare * np.exp(
        -(((x - 0.7 * width) ** 2 + (y - 0.5 * height) ** 2) / (0.2 * width) ** 2)
    )
    for time, exposed in zip(times, centres, strict=True):
        total = np.zeros((height, width))
        for places in exposed:
            picture = scenery.copy()
            for bob, place in enumerate(places):
                _string(camera, picture, pivots[bob], place, x, y)
            for place in places:
                _sphere(camera, picture, place, radius, x, y)
            if hand is not None and time < hand[0]:
                _cover(camera, picture, places[hand[1]], 1.2 * radius, 140.0, x, y)
            if hidden is not None and hidden[0] <= time < hidden[1]:
                _cover(camera, picture, places[hidden[2]], 1.5 * radius, 120.0, x, y)
            total += picture
        seen = total / len(exposed) + camera.noise * rng.standard_normal((height, width))
        yield np.clip(np.rint(seen), 0, 255).astype(np.uint8)


def _pattern(rng: np.random.Generator, strength: float, shape: tuple[int, int]) -> np.ndarray:
    from scipy.ndimage import gaussian_filter

    if strength == 0.0:
        return np.zeros(shape)
    smooth = gaussian_filter(rng.standard_normal(shape), 3.0)
    return strength * smooth / smooth.std()


def _window(camera: Camera, at: np.ndarray, reach: float) -> tuple[slice, slice]:
    width, height = camera.size
    low = np.maximum(np.floor(at - reach), 0).astype(int)
    high = np.minimum(np.ceil(at + reach) + 1, (width, height)).astype(int)
    return slice(low[1], max(high[1], low[1])), slice(low[0], max(high[0], low[0]))


def _sphere(
    camera: Camera, picture: np.ndarray, place: np.ndarray, radius: float, x: np.ndarray, y: np.ndarray
) -> None:
    """A sphere, its edge as sharp as a pixel allows: a ray meets it where (d·c)² > |d|² (|c|² − R²)."""
    centre = camera.seen(place)
    size = camera.focal * radius / centre[2]
    at = camera.pixels(place)
    window = _window(camera, at, 1.1 * size + 3.0)
    if picture[window].size == 0:
        return
    middle = (np.array(camera.size) - 1) / 2.0
    u, v = (x[window] - middle[0]) / camera.focal, (y[window] - middle[1]) / camera.focal
    along = u * centre[0] + v * centre[1] + centre[2]
    rest = centre @ centre - radius**2
    inside = along**2 - (u**2 + v**2 + 1.0) * rest
    slope = np.hypot(2 * along * centre[0] - 2 * u * rest, 2 * along * centre[1] - 2 * v * rest) / camera.focal
    cover = np.clip(inside / np.maximum(slope, 1e-12) + 0.5, 0.0, 1.0)
    spot = (x[window] - at[0] + 0.3 * size) ** 2 + (y[window] - at[1] + 0.35 * size) ** 2
    shade = camera.bob + camera.highlight * np.exp(-spot / (0.25 * size) ** 2)
    picture[window] += cover * (shade - picture[window])


def _string(
    camera: Camera, picture: np.ndarray, pivot: np.ndarray, place: np.ndarray, x: np.ndarray, y: np.ndarray
) -> None:
    """A thread from the pivot to the bob, a third of a pixel wide."""
    top, end = camera.pixels(pivot), camera.pixels(place)
    row = np.arange(0, max(min(int(end[1]), picture.shape[0]), 0))
    column = top[0] + (end[0] - top[0]) * (row - top[1]) / (end[1] - top[1])
    first = np.floor(column).astype(int)
    for offset in (0, 1):
        share = 0.33 * (1.0 - np.abs(column - first - offset))
        good = (first + offset >= 0) & (first + offset < picture.shape[1])
        r, c = row[good], first[good] + offset
        picture[r, c] += share[good] * (60.0 - picture[r, c])


def _cover(
    camera: Camera, picture: np.ndarray, place: np.ndarray, size: float, level: float, x: np.ndarray, y: np.ndarray
) -> None:
    """A blob over a bob and to its right."""
    at = camera.pixels(place)
    reach = camera.focal * size / camera.distance
    picture[((x - at[0] - 0.4 * reach) / 1.6) ** 2 + (y - at[1]) ** 2 < reach**2] = level


def write_film(
    path: Path, frames: Iterable[np.ndarray], times: np.ndarray, codec: str = "libx264", crf: int = 23
) -> None:
    """A film with the frames' own times, to a sixtieth of a millisecond."""
    import av

    frames = iter(frames)
    first = next(frames)
    options = {
        "libx264": {"crf": str(crf), "preset": "veryfast"},
        "libvpx-vp9": {"crf": str(crf), "b": "0", "deadline": "realtime", "cpu-used": "8"},
    }
    rate = round(1.0 / np.median(np.diff(times)))
    # MPEG-4 knows no finer ticks than 1/65535 s; in AVI, frames shorter than 1/600 s must be ticks.
    tick = Fraction(1, 60000 if rate <= 600 else rate)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate)
        stream.width, stream.height = first.shape[1], first.shape[0]
        stream.pix_fmt = {"gif": "gray8", "ffv1": "gray", "mjpeg": "yuvj420p"}.get(codec, "yuv420p")
        stream.time_base = stream.codec_context.time_base = tick
        stream.options = options.get(codec, {})
        for time, picture in zip(times, itertools.chain([first], frames), strict=True):
            frame = av.VideoFrame.from_ndarray(picture, format="gray").reformat(format=stream.pix_fmt)
            frame.pts, frame.time_base = round(time / tick), tick
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def filmed(camera: Camera, times: np.ndarray) -> np.ndarray:
    """Instants [s] that exposures average, (T, parts): about the time of each frame."""
    share = (np.arange(camera.parts) + 0.5) / camera.parts - 0.5
    return times[:, None] + camera.exposure / camera.rate * share
