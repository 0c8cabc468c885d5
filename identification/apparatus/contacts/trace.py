"""Traces of an oscilloscope, read in blocks: memory does not grow with their length."""

from __future__ import annotations

import hashlib
import json
import wave
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np

from cradle_env.errors import check_range
from identification.apparatus.contacts.scope_csv import read_form
from identification.storage.files import ExperimentError

#: Samples in a block.
BLOCK = 1 << 20
#: Bytes of the header line of a raw file at most.
_HEADER = 4096
#: First bytes of NumPy arrays, of WAV files, and of raw numbers behind a header of JSON.
_NPY, _WAV, _RAW = b"\x93NUMPY", b"RIFF", b"{"
#: First bytes of what makers store beside CSV: Tektronix .wfm and .isf, LeCroy .trc, Keysight .bin, and zipped files.
_FOREIGN = (b":WFM#", b"\x0f\x0f", b"\xf0\xf0", b":WFMP", b":CURV", b"#9", b"AG10", b"AG03", b"PK\x03\x04")


@dataclass
class Trace:
    """A trace of `count` samples (None: not known) at `rate` [1/s]; iterate over its blocks (K,) [V], once."""

    path: Path
    rate: float
    count: int | None
    source: Iterator[np.ndarray]
    digest: Any = field(default_factory=hashlib.sha256)

    def __iter__(self) -> Iterator[np.ndarray]:
        for block in self.source:
            if not np.isfinite(block).all():
                raise ExperimentError(f"{self.path}: holds samples that are missing or infinite; cut them out")
            self.digest.update(block.tobytes())
            yield block


def open_trace(path: Path, rate: float | None, channel: int | None = None) -> Trace:
    """The trace in a file, by its content.

    rate: samples per second, where the file does not state them, or wrong ones; channel: of a CSV with several, from 1.
    """
    if rate is not None:
        check_range("rate", rate, "1/s", 0.0, above=True)
    if not path.is_file():
        raise ExperimentError(f"{path}: no such file; check the name and the folder")
    with path.open("rb") as file:
        head = file.read(16)
    if head.startswith(_FOREIGN) or head[8:16] == b"WAVEDESC" or head[11:16] == b"WAVED":
        raise ExperimentError(f"{path}: a format of one maker that is not read; export the trace as CSV")
    for begin, reader in ((_NPY, _npy), (_WAV, _wav), (_RAW, _raw)):
        if head.startswith(begin):
            return reader(path, rate)
    return _csv(path, rate, channel)


def _needed(path: Path, rate: float | None) -> float:
    if rate is None:
        raise ExperimentError(f"{path}: states no sampling rate; give --rate, as 2.5e9")
    return rate


def _npy(path: Path, rate: float | None) -> Trace:
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, OSError, EOFError, SyntaxError, TokenError) as problem:  # a header is a Python literal
        raise ExperimentError(f"{path}: no NumPy array ({problem}); save the volts with np.save") from None
    if array.ndim != 1 or array.dtype.kind not in "iuf":
        raise ExperimentError(f"{path}: an array {array.shape} of {array.dtype}; save one row of volts")
    blocks = (np.asarray(array[k : k + BLOCK], dtype=float) for k in range(0, len(array), BLOCK))
    return Trace(path, _needed(path, rate), len(array), blocks)


def _raw(path: Path, rate: float | None) -> Trace:
    with path.open("rb") as file:
        line = file.readline(_HEADER)
    try:
        header = json.loads(line)
        kind, scale, offset = (
            np.dtype(header["dtype"]),
            float(header.get("scale", 1.0)),
            float(header.get("offset", 0.0)),
        )
        if kind.kind not in "iuf":
            raise ValueError(f"dtype {kind}")
    except (ValueError, TypeError, KeyError) as problem:
        raise ExperimentError(
            f"{path}: its first line is no header ({str(problem)[:60]}); it must be JSON such as"
            ' {"rate": 2.5e9, "dtype": "<i2", "scale": 1e-4, "offset": 0.0}, volts = scale · number + offset'
        ) from None
    size = path.stat().st_size - len(line)
    if size % kind.itemsize:
        raise ExperimentError(f"{path}: {size} bytes after the header, no whole number of {kind}; it is cut off")

    def blocks() -> Iterator[np.ndarray]:
        with path.open("rb") as file:
            file.seek(len(line))
            while len(numbers := np.fromfile(file, kind, BLOCK)):
                yield scale * numbers.astype(float) + offset

    return Trace(path, _needed(path, rate if rate is not None else header.get("rate")), size // kind.itemsize, blocks())


def _wav(path: Path, rate: float | None) -> Trace:
    try:
        with wave.open(str(path)) as file:
            width, channels, count, stated = (
                file.getsampwidth(), file.getnchannels(), file.getnframes(), file.getframerate(),
            )  # fmt: skip
    except (wave.Error, EOFError, OSError, RuntimeError) as problem:  # RuntimeError: a chunk ends beyond the file
        raise ExperimentError(f"{path}: no WAV file of whole numbers ({problem}); export PCM") from None
    if channels != 1 or width not in (2, 4):
        raise ExperimentError(f"{path}: {channels} channels of {8 * width} bits; export one channel of 16 or 32 bits")

    def blocks() -> Iterator[np.ndarray]:
        with wave.open(str(path)) as file:
            while data := file.readframes(BLOCK):
                whole = data[: len(data) // width * width]  # a file that is cut off may end within a sample
                yield np.frombuffer(whole, f"<i{width}") / float(1 << (8 * width - 1))

    return Trace(path, rate or float(stated), count, blocks())


def _csv(path: Path, rate: float | None, channel: int | None) -> Trace:
    form = read_form(path, channel, rate)
    stated = None if form.interval is None else 1.0 / form.interval
    return Trace(path, _needed(path, rate or stated), None, form.blocks())
