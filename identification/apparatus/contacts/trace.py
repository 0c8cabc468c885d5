"""Traces of an oscilloscope, read in blocks: memory does not grow with their length."""

from __future__ import annotations

import hashlib
import json
import wave
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cradle_env.errors import check_range
from identification.storage.files import ExperimentError

#: Samples in a block.
BLOCK = 1 << 20
#: Bytes of the header line of a raw file at most, and of a CSV that are read at a time.
_HEADER, _TEXT = 4096, 1 << 22
_SUFFIXES = ".csv, .npy, .wav, or .raw and .bin with a header line of JSON"
#: Departure of the sampling interval from the mean, from which on a CSV is not evenly sampled.
_UNEVEN = 0.01


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


def open_trace(path: Path, rate: float | None) -> Trace:
    """The trace in a file, by its suffix; rate [1/s] where the file does not state one, or a wrong one."""
    if rate is not None:
        check_range("rate", rate, "1/s", 0.0, above=True)
    readers = {".csv": _csv, ".txt": _csv, ".npy": _npy, ".wav": _wav, ".raw": _raw, ".bin": _raw}
    if path.suffix.lower() not in readers:
        raise ExperimentError(f"{path}: not a format that is read; export the trace as {_SUFFIXES}")
    if not path.is_file():
        raise ExperimentError(f"{path}: no such file; check the name and the folder")
    return readers[path.suffix.lower()](path, rate)


def _needed(path: Path, rate: float | None) -> float:
    if rate is None:
        raise ExperimentError(f"{path}: states no sampling rate; give --rate, as 2.5e9")
    return rate


def _npy(path: Path, rate: float | None) -> Trace:
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, OSError, EOFError) as problem:
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
    except (wave.Error, EOFError, OSError) as problem:
        raise ExperimentError(f"{path}: no WAV file of whole numbers ({problem}); export PCM") from None
    if channels != 1 or width not in (2, 4):
        raise ExperimentError(f"{path}: {channels} channels of {8 * width} bits; export one channel of 16 or 32 bits")

    def blocks() -> Iterator[np.ndarray]:
        with wave.open(str(path)) as file:
            while data := file.readframes(BLOCK):
                yield np.frombuffer(data, f"<i{width}") / float(1 << (8 * width - 1))

    return Trace(path, rate or float(stated), count, blocks())


def _csv(path: Path, rate: float | None) -> Trace:
    """Columns t [s] and V [V], or V alone; lines before the first number are a header."""
    with path.open("rb") as file:
        head = file.read(_TEXT).decode("utf-8", "replace")
    lines = head.replace("\r", "").split("\n")
    first = next((k for k, line in enumerate(lines) if _numbers(line) is not None), None)
    if first is None:
        raise ExperimentError(f"{path}: no line of numbers; expected t [s],V [V] and samples")
    rows = [row for line in lines[first : first + 2000] if (row := _numbers(line)) is not None]
    columns = len(rows[0])
    if columns not in (1, 2) or any(len(row) != columns for row in rows[:-1]):
        raise ExperimentError(f"{path}, line {first + 1}: {columns} columns; expected t [s],V [V], or V [V] alone")
    if columns == 2 and rate is None:
        times = np.array([row[0] for row in rows if len(row) == 2])
        rate = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 and times[-1] > times[0] else None
        if rate is None:
            raise ExperimentError(f"{path}: its times do not grow; give --rate, as 2.5e9")
        if np.abs(np.diff(times) * rate - 1.0).max() > _UNEVEN and len({*times}) == len(times):
            raise ExperimentError(f"{path}: not evenly sampled, or its times are rounded; give --rate, as 2.5e9")

    def blocks() -> Iterator[np.ndarray]:
        with path.open(encoding="utf-8", errors="replace") as file:
            for _ in range(first):
                file.readline()
            number = first
            while lines := file.readlines(_TEXT):
                volts = []
                for line in lines:
                    number += 1
                    if not line.strip():
                        continue
                    row = _numbers(line)
                    if row is None or len(row) != columns:
                        raise ExperimentError(f"{path}, line {number}: {line.strip()[:40]!r} is no sample")
                    volts.append(row[-1])
                if volts:
                    yield np.array(volts)

    return Trace(path, _needed(path, rate), None, blocks())


def _numbers(line: str) -> list[float] | None:
    text = line.strip()
    if not text or text.startswith("#"):
        return None
    if ";" in text or "\t" in text:
        text = text.replace(",", ".").replace(";", " ").replace("\t", " ")
    try:
        return [float(part) for part in text.replace(",", " ").split()]
    except ValueError:
        return None
