"""Films, frame by frame: containers through PyAV, folders of images through Pillow."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from cradle_env.errors import check_range
from identification.apparatus.columns import digest_of
from identification.storage.files import ExperimentError
from identification.storage.stamps import sha256_of

_IMAGES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})


def import_av() -> ModuleType:
    """PyAV; ExperimentError that names the extra where it is missing."""
    try:
        import av
    except ImportError:
        raise ExperimentError("PyAV is not installed; run `pip install 'newtons-cradle[video]'`") from None
    return av


@dataclass(frozen=True)
class Film:
    """A film, whose frames may be read as often as needed; no more than one of them is held at a time.

    path: of a file, or of a folder of images in the order of their names. slow_motion: by which factor it plays more
    slowly than what it shows. rate: frames per second as played, instead of the times in the container; needed for a
    folder.

    Raises ExperimentError for a film that cannot be read, when it is read.
    """

    path: Path
    slow_motion: float = 1.0
    rate: float | None = None

    def __post_init__(self) -> None:
        check_range("slow_motion", self.slow_motion, "", 1e-3, 1e4)
        if self.rate is not None:
            check_range("rate", self.rate, "frames/s", 0.1, 1e6)
        if not self.path.exists():
            raise ExperimentError(f"{self.path}: no such file; check the name and the folder")
        if self.path.is_dir() and self.rate is None:
            raise ExperimentError(f"{self.path}: a folder of images has no times; state --rate, frames per second")

    def gray(self) -> Iterator[tuple[float, np.ndarray]]:
        """Times [s] as the cradle's clock has them, and brightness (H, W) of 0 to 255."""
        return self._frames("gray")

    def colour(self) -> Iterator[tuple[float, np.ndarray]]:
        """Likewise with pictures (H, W, 3)."""
        return self._frames("rgb24")

    def count(self) -> int | None:
        """How many frames there are, as far as the container says."""
        if self.path.is_dir():
            return len(self._images())
        av = import_av()
        with self._opened(av) as container:
            stream = container.streams.video[0]
            if stream.frames:
                return stream.frames
            if container.duration and stream.average_rate:
                return round(container.duration / av.time_base * float(stream.average_rate))
        return None

    def _frames(self, kind: str) -> Iterator[tuple[float, np.ndarray]]:
        size, last = None, -np.inf
        source = self._from_folder(kind) if self.path.is_dir() else self._from_container(kind)
        for number, (time, picture) in enumerate(source):
            size = size or picture.shape
            if picture.shape != size:
                raise ExperimentError(
                    f"{self.path}: frame {number + 1} is {picture.shape[1]} × {picture.shape[0]} pixels, others are"
                    f" {size[1]} × {size[0]}; keep frames of one size"
                )
            played = number / self.rate if self.rate else time
            if played <= last:
                raise ExperimentError(
                    f"{self.path}: frame {number + 1} is at {played:g} s, not after the one before; state --rate,"
                    " frames per second"
                )
            last = played
            yield played / self.slow_motion, picture
        if size is None:
            raise ExperimentError(f"{self.path}: holds no frame; check that it is a film")

    @property
    def digest(self) -> str:
        """SHA-256 of the film, or over those of the images of a folder."""
        return digest_of([sha256_of(file) for file in (self._images() if self.path.is_dir() else [self.path])])

    def _images(self) -> list[Path]:
        """In the order of the numbers in their names."""
        found = [file for file in self.path.iterdir() if file.suffix.lower() in _IMAGES]
        return sorted(found, key=lambda file: [int(part) if part.isdigit() else part.lower() for part in
                                               re.split(r"(\d+)", file.name)])  # fmt: skip

    def _from_folder(self, kind: str) -> Iterator[tuple[float, np.ndarray]]:
        from PIL import Image

        for number, file in enumerate(self._images()):
            try:
                with Image.open(file) as image:
                    yield float(number), np.asarray(image.convert("L" if kind == "gray" else "RGB"))
            except OSError:
                raise ExperimentError(f"{file}: cannot be read as an image; take it out of the folder") from None

    def _from_container(self, kind: str) -> Iterator[tuple[float, np.ndarray]]:
        av = import_av()
        with self._opened(av) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            try:
                for frame in container.decode(stream):
                    if frame.pts is None or frame.time_base is None:
                        if not self.rate:
                            raise ExperimentError(f"{self.path}: has frames without a time; state --rate")
                        time = 0.0
                    else:
                        time = float(frame.pts * frame.time_base)
                    picture = frame.to_ndarray(format=kind)
                    yield time, np.ascontiguousarray(np.rot90(picture, round(frame.rotation / 90.0)))
            except av.FFmpegError as problem:
                raise ExperimentError(f"{self.path}: is damaged ({problem.strerror}); export the film again") from None

    def _opened(self, av: ModuleType):
        try:
            container = av.open(str(self.path))
        except (av.FFmpegError, OSError) as problem:
            raise ExperimentError(f"{self.path}: cannot be read as a film ({problem.strerror})") from None
        if not container.streams.video:
            container.close()
            raise ExperimentError(f"{self.path}: holds no pictures; name a film")
        return container
