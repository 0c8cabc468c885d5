"""Films drawn at random: cradles, cameras and codecs over the range that people film with."""

from __future__ import annotations

import numpy as np

from studies.film.camera import Camera
from studies.film.made import Case

#: Frame rates [frames/s], and how often each is drawn.
RATES = {30: 0.4, 60: 0.25, 120: 0.15, 240: 0.1, 480: 0.05, 960: 0.05}
#: Containers and the codecs in them.
CODECS = {".mp4": "libx264", ".mov": "mpeg4", ".avi": "mjpeg", ".webm": "libvpx-vp9"}
#: Longest film [s], and most frames of one: those at more than 60 frames/s are shorter.
LONGEST, FRAMES = 20.0, 1200


def draw(seed: int, frames: int) -> tuple[Case, str]:
    """A film of at most `frames` frames and 20 s, and the ending of its name."""
    rng = np.random.default_rng([38, seed])
    rate = float(rng.choice([*RATES], p=[*RATES.values()]))
    duration = min(LONGEST, frames / rate)
    held = 0.3 if duration > 5.0 else 0.1 * duration
    zoom = float(rng.choice([0.75, 1.0, 1.5]))
    bright = rng.random() < 0.3
    camera = Camera(
        size=(round(160 * zoom) * 2, round(80 * zoom) * 2),
        focal=640.0 * zoom,
        yaw=rng.normal(0.0, 0.02),
        pitch=rng.normal(0.0, 0.02),
        roll=rng.normal(0.0, 0.01),
        rate=rate,
        exposure=rng.uniform(0.05, 0.5),
        noise=rng.uniform(1.0, 5.0),
        bob=rng.uniform(180.0, 220.0) if bright else rng.uniform(20.0, 80.0),
        background=rng.uniform(30.0, 80.0) if bright else rng.uniform(150.0, 220.0),
        highlight=rng.uniform(0.0, 30.0) if bright else rng.uniform(0.0, 100.0),
        texture=rng.uniform(0.0, 6.0),
        glare=rng.uniform(0.0, 30.0),
    )
    bobs = int(rng.integers(1, 6))
    end = int(rng.choice([1, bobs]))
    angle = rng.uniform(0.1, 0.24) * (1.0 if end == bobs else -1.0)
    hidden = None
    if rng.random() < 0.3:
        first = rng.uniform(0.3, 0.8) * duration
        hidden = (first, first + rng.uniform(0.02, 0.1) * duration, int(rng.integers(bobs)))
    hand = (0.8 * held, end - 1) if rng.random() < 0.3 else None
    delta = float(rng.choice([0.0, rng.uniform(0.0, 0.05)]))
    name = str(rng.choice([*CODECS]))
    case = Case(
        bobs, {end: angle}, duration, held, camera, delta=delta, seed=seed, codec=CODECS[name], hand=hand, hidden=hidden
    )
    return case, name
