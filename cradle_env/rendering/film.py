"""Films of frames: GIF by Pillow, MP4 by moviepy."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from cradle_env.errors import check_range
from cradle_env.rendering.dependencies import missing


def save_animation(frames: Iterable[np.ndarray], path: str | Path, fps: float = 30.0) -> None:
    """Writes frames (H, W, 3) uint8 as a film, .gif or .mp4, of `fps` frames a second; whole or not at all.

    Raises ValueError for other endings, DependencyNotInstalled for .mp4 where moviepy is missing.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in _WRITERS:
        raise ValueError(f"{path.name} is no film that can be written; it must end in {' or '.join(_WRITERS)}")
    # Theirs count hundredths of a second in two bytes, and are shown for 2 at least.
    check_range("fps", fps, "1/s", *((1.0 / 655.0, 50.0) if ending == ".gif" else (1e-3, np.inf)))
    part = path.with_name(f"{path.stem}.part{ending}")
    try:
        _WRITERS[ending](iter(frames), part, fps)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _write_gif(frames: Iterator[np.ndarray], path: Path, fps: float) -> None:
    from PIL import Image

    # One palette for all frames, from those of the first second: with palettes of their own, what rests would flicker.
    first = list(itertools.islice(frames, max(round(fps), 1)))
    if not first:
        raise ValueError("there are no frames to make a film of")
    palette = Image.fromarray(np.concatenate(first[::5])).quantize(255, dither=Image.Dither.NONE)

    def images():
        for k, frame in enumerate(itertools.chain(first, frames)):
            image = Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
            # GIF counts hundredths of a second: the frames' ends are rounded, so that the film as a whole is not.
            image.info["duration"] = 10 * (round(100 * (k + 1) / fps) - round(100 * k / fps))
            yield image

    film = images()
    next(film).save(path, save_all=True, append_images=film, loop=0)


def _write_mp4(frames: Iterator[np.ndarray], path: Path, fps: float) -> None:
    try:
        from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter
    except ImportError as error:
        raise missing("moviepy") from error
    first = next(frames, None)
    if first is None:
        raise ValueError("there are no frames to make a film of")
    with FFMPEG_VideoWriter(str(path), first.shape[1::-1], fps) as film:
        for frame in itertools.chain([first], frames):
            film.write_frame(frame)


_WRITERS = {".gif": _write_gif, ".mp4": _write_mp4}
