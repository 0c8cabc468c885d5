"""Recordings of sound, read in blocks through libsndfile: memory does not grow with their length."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from identification.storage.files import ExperimentError

#: Samples in a block.
_BLOCK = 1 << 18
#: Lowest sampling rate [1/s]: below, little of a click is left between 1.5 kHz and half the rate.
_LEAST_RATE = 8000


def import_soundfile() -> ModuleType:
    """soundfile; ExperimentError that names the extra where it is missing."""
    try:
        import soundfile
    except (ImportError, OSError):  # OSError: the package is there, the library libsndfile is not
        raise ExperimentError("soundfile is not installed; run `pip install 'newtons-cradle[audio]'`") from None
    return soundfile


@dataclass(frozen=True)
class Sound:
    """A recording: samples a second, and how many there are (None where the container does not say).

    Raises ExperimentError for a file that cannot be read, when it is opened or read.
    """

    path: Path
    rate: int
    count: int | None

    @classmethod
    def open(cls, path: Path) -> Sound:
        """The recording in a file."""
        soundfile = import_soundfile()
        if not path.is_file():
            raise ExperimentError(f"{path}: no such file; check the name and the folder")
        try:
            info = soundfile.info(str(path))
        except soundfile.LibsndfileError as problem:
            raise ExperimentError(
                f"{path}: cannot be read as sound ({problem.error_string}); export WAV, FLAC, OGG or MP3"
            ) from None
        if info.samplerate < _LEAST_RATE:
            raise ExperimentError(
                f"{path}: {info.samplerate} samples a second; a click needs {_LEAST_RATE} or more, 44100 are usual"
            )
        return cls(path, int(info.samplerate), int(info.frames) if 0 < info.frames < 1 << 60 else None)

    def blocks(self) -> Iterator[np.ndarray]:
        """Samples (K,) in order, the mean of all channels, full scale 1."""
        soundfile = import_soundfile()
        try:
            with soundfile.SoundFile(str(self.path)) as file:
                while len(block := file.read(_BLOCK, dtype="float32", always_2d=True)):
                    mono = block.mean(axis=1, dtype=float)
                    if not np.isfinite(mono).all():
                        raise ExperimentError(f"{self.path}: holds samples that are no numbers; export it again")
                    yield mono
        except soundfile.LibsndfileError as problem:
            raise ExperimentError(f"{self.path}: is damaged ({problem.error_string}); export it again") from None
