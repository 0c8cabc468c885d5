"""A film over the film: circles, strings and numbers of the bobs, by which one sees whether they were found."""

from __future__ import annotations

import time as clock
from fractions import Fraction
from pathlib import Path

import numpy as np

from identification.apparatus.video.frames import Film, import_av
from identification.apparatus.video.geometry import Geometry
from identification.apparatus.video.tracking import Tracks
from identification.progress import Progress

#: Colours of the bobs in turn (Okabe & Ito), and of one that is missing.
_COLOURS = ((230, 159, 0), (86, 180, 233), (0, 158, 115), (240, 228, 66), (204, 121, 167))
_MISSING = (213, 94, 0)


def write_overlay(path: Path, film: Film, tracks: Tracks, lie: Geometry, progress: Progress = lambda *_: None) -> None:
    """Writes it as MP4, at the times of the film as played."""
    from PIL import Image, ImageDraw

    av = import_av()
    pivots, tick, began = lie.pivots(), Fraction(1, 90000), clock.monotonic()
    played = (tracks.times - tracks.times[0]) * film.slow_motion
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=max(round(1.0 / np.median(np.diff(played))), 1))
        stream.pix_fmt, stream.options = "yuv420p", {"preset": "veryfast", "crf": "23"}
        stream.time_base = stream.codec_context.time_base = tick
        for number, (_, picture) in enumerate(film.colour()):
            height, width = (size // 2 * 2 for size in picture.shape[:2])  # the codec wants even sizes
            if number == 0:
                stream.width, stream.height = width, height
            image = Image.fromarray(picture[:height, :width])
            draw = ImageDraw.Draw(image)
            for bob, (x, y) in enumerate(tracks.places[number]):
                colour = _COLOURS[bob % len(_COLOURS)]
                if np.isnan(x):
                    draw.text((2 + 60 * bob, 2), f"{bob + 1} missing", fill=_MISSING)
                    continue
                radius = tracks.radii[number, bob]
                draw.line((*pivots[bob], x, y), fill=colour)
                draw.ellipse((x - radius, y - radius, x + radius, y + radius), outline=colour)
                draw.text((x - 3, y - 5), str(bob + 1), fill=colour)
                draw.text((x - radius, y + radius + 2), f"{tracks.scatter[number, bob]:.2f}", fill=colour)
            frame = av.VideoFrame.from_image(image)
            frame.pts, frame.time_base = round(played[number] / tick), tick
            container.mux(stream.encode(frame))
            if number % 20 == 0:
                rate = (number + 1) / max(clock.monotonic() - began, 1e-9)
                progress("overlay", number / len(tracks.times), f"{rate:.0f} frames/s")
        container.mux(stream.encode())
