"""CSV exports of oscilloscopes, recognised by their content: where the samples are, how they are written, their rate.

| maker | what stands beside the samples |
|---|---|
| Tektronix TDS, TBS | names and values in the first columns of the first rows; samples in the last two columns |
| Tektronix DPO, MSO | names and values in the first lines, then TIME,CH1 |
| Keysight InfiniiVision | x-axis,1 and second,Volt |
| Rigol DS1000Z | X,CH1,Start,Increment; the second line has the values of the last two, and samples are numbered |
| Rigol MSO5000, DHO | Time(s),CH1V |
| Siglent | names and values in the first lines, then Source,CH1 and Second,Volt |
| LeCroy | the model, segments and their times, then Time,Ampl |
| PicoScope | Time,Channel A and (ms),(mV) |

Units of the header count: PicoScope writes those that suit the screen.

Others are read if their lines end with numbers in the same columns. Source: public descriptions and parsers.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from identification.experiment.text_encoding import decode
from identification.storage.files import ExperimentError

#: Bytes from which the form of a file is determined, and characters that are read at a time.
_HEAD, _TEXT = 1 << 20, 1 << 22
#: Rows that show which columns hold samples, and how far apart these are.
_TYPICAL = 2000
#: Departure of the sampling interval from the mean, or from the stated one, from which on the times are wrong.
_UNEVEN = 0.01
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_INTERVAL = re.compile(rf"\"?sample interval\"?\W+(?:analog\W+)?({_NUMBER})", re.IGNORECASE)
#: Units of times in s and of voltages in V, and those of what is no trace of voltage against time.
_TIMES = {
    "s": 1.0,
    "sec": 1.0,
    "second": 1.0,
    "seconds": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "µs": 1e-6,
    "ns": 1e-9,
    "ps": 1e-12,
}
_VOLTS = {"v": 1.0, "volt": 1.0, "volts": 1.0, "mv": 1e-3, "uv": 1e-6, "µv": 1e-6, "kv": 1e3}
_FREQUENCIES = frozenset(["hz", "khz", "mhz", "ghz"])
_NO_VOLTS = frozenset(["db", "dbm", "dbv", "dbu", "a", "ma", "amp", "ampere", "w", "watt"])
_BRACKETS = re.compile(r".*[\[(]\s*([^\[()\]]*?)\s*[\])]\s*")
_SEGMENTS = re.compile(r"\"?segments\"?\W+(\d+)", re.IGNORECASE)


@dataclass(frozen=True)
class ScopeCsv:
    """How the samples of a file are written.

    Parameters
    ----------
    path : Path
        The file.
    encoding : str
        Codec of its text.
    delimiter : str
        Between columns; "" for white space. The decimal comma is read unless it is ",".
    first : int
        Line of the first sample, from 0.
    places : tuple of int
        Columns of a row that hold numbers.
    column : int
        That of the voltages.
    interval : float, optional
        Time from sample to sample [s]; None if neither the header nor a column tells.
    scale : float
        Voltage [V] of 1 in the file.
    clock : float, optional
        Time [s] of 1 in the first of `places`; None if that is no time, or is not to be looked at.
    """

    path: Path
    encoding: str
    delimiter: str
    first: int
    places: tuple[int, ...]
    column: int
    interval: float | None
    scale: float = 1.0
    clock: float | None = None

    def blocks(self) -> Iterator[np.ndarray]:
        """Voltages (K,) [V], some at a time. Raises ExperimentError for a line that is no sample, and for a gap."""
        with self.path.open(encoding=self.encoding, errors="replace", newline=None) as file:
            for _ in range(self.first):
                file.readline()
            number, times = self.first, []
            while lines := file.readlines(_TEXT):
                volts, times = [], times[-1:]
                for line in lines:
                    number += 1
                    if not line.strip("\x00 \t\r\n" + self.delimiter):
                        continue
                    row = _split(line, self.delimiter)
                    if any(place >= len(row) or _number(row[place], self.delimiter) is None for place in self.places):
                        raise ExperimentError(
                            f"{self.path}, line {number}: {line.strip()[:40]!r} is no sample; the file is damaged, or"
                            " more than one trace: export it again, one trace in a file"
                        )
                    volts.append(_number(row[self.column], self.delimiter))
                    times.append(_number(row[self.places[0]], self.delimiter))
                if volts:
                    self._check_times(np.array(times))
                    yield self.scale * np.array(volts)

    def _check_times(self, times: np.ndarray) -> None:
        """Raises ExperimentError where times (K,) are not those of evenly spaced samples; rounded times are."""
        if self.clock is None or self.interval is None or len(times) < 2:
            return
        ends = np.linspace(0, len(times) - 1, max(len(times) // _TYPICAL, 1) + 1).astype(int)
        for first, last in pairwise(ends):
            some = self.clock * times[first : last + 1]
            steps, expected = np.diff(some), (last - first) * self.interval
            rounded = steps[steps > 0.0].min(initial=np.inf)
            if abs(some[-1] - some[0] - expected) > _UNEVEN * expected + rounded:
                raise ExperimentError(
                    f"{self.path}: its times are not {self.interval:g} s apart between {some[0]:.9g} and"
                    f" {some[-1]:.9g} s, as at a gap or another segment; export a piece without gaps"
                )


def read_form(path: Path, channel: int | None = None, rate: float | None = None) -> ScopeCsv:
    """Find the samples in a CSV of an oscilloscope.

    Parameters
    ----------
    path : Path
        The file.
    channel : int, optional
        Which column of voltages to read, from 1. Needed if there are several.
    rate : float, optional
        Samples per second [1/s] that a user states: the times of the file are then not looked at.

    Returns
    -------
    ScopeCsv

    Raises
    ------
    ExperimentError
        If there are no samples, more than one segment or several channels, or if the times are wrong.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD)
    text, encoding = decode(str(path), head[: len(head) - len(head) % 2] if len(head) == _HEAD else head)
    lines = text.split("\n")
    if len(head) == _HEAD:
        lines.pop()
    delimiter, places, first = _find_samples(path, lines)
    header, row = lines[:first], _split(lines[first], delimiter)
    segments = next((int(found[1]) for line in header if (found := _SEGMENTS.match(line))), 1)
    if segments > 1:
        raise ExperimentError(f"{path}: holds {segments} segments; export one segment in a file")
    has_time = len(places) > 1
    stated, is_numbered = _stated_interval(lines[: first + 1], delimiter)
    voltages = places[1:] if has_time else places
    if channel is None and len(voltages) > 1:
        names = ", ".join(_labels(header, delimiter, voltages))
        raise ExperimentError(
            f"{path}, line {first + 1}: {len(row)} columns, {len(voltages)} of them channels ({names});"
            " say which to read: --channel 1"
        )
    if channel is not None and not 1 <= channel <= len(voltages):
        raise ExperimentError(f"{path}: there is no channel {channel}; it has {len(voltages)}, numbered from 1")
    column = voltages[(channel or 1) - 1]
    scale, clock, interval = _scale(path, header, delimiter, column), None, stated
    if has_time and not is_numbered and rate is None:
        clock = _clock(path, header, delimiter, places[0])
        rows = (_split(line, delimiter) for line in lines[first : first + _TYPICAL])
        found = [_number(one[places[0]], delimiter) for one in rows if len(one) > places[0]]
        interval = _interval(path, clock * np.array([time for time in found if time is not None]), stated)
    return ScopeCsv(path, _codec(encoding), delimiter, first, places, column, interval, scale, clock)


def _scale(path: Path, header: list[str], delimiter: str, column: int) -> float:
    """Voltage [V] of 1 in a column, by the units above it."""
    units = _units(header, delimiter, column)
    if strange := [unit for unit in units if unit in _NO_VOLTS]:
        raise ExperimentError(f"{path}: its samples are in {strange[0]}, not in V; export the voltage over R_a")
    return next((_VOLTS[unit] for unit in units if unit in _VOLTS), 1.0)


def _clock(path: Path, header: list[str], delimiter: str, column: int) -> float:
    """Time [s] of 1 in a column, by the units above it."""
    units = _units(header, delimiter, column)
    if strange := [unit for unit in units if unit in _FREQUENCIES]:
        raise ExperimentError(f"{path}: is a spectrum, against {strange[0]}; export the voltage against time")
    return next((_TIMES[unit] for unit in units if unit in _TIMES), 1.0)


def _units(header: list[str], delimiter: str, column: int) -> list[str]:
    """What may be the unit of a column, in small letters: what its labels have in brackets, or else they; last first.

    A letter alone may be the name of a channel, unless it is that of volts or seconds.
    """
    rows = [_split(line, delimiter) for line in reversed(header)]
    labels = [row[column].casefold().replace("\u03bc", "µ") for row in rows if len(row) > column]
    in_brackets = [_BRACKETS.fullmatch(label) for label in labels]
    units = [found[1] if found else label for label, found in zip(labels, in_brackets, strict=True)]
    return [unit for unit, label in zip(units, labels, strict=True) if len(label) > 1 or label in "sv"]


def _find_samples(path: Path, lines: list[str]) -> tuple[str, tuple[int, ...], int]:
    """(delimiter, columns with numbers, index of the first such line) of the lines of a head."""
    content = [line for line in lines if line.strip()]
    sample = content[len(content) // 2 :][-_TYPICAL:]  # the second half: samples follow headers
    best: tuple[int, str, tuple[int, ...]] = (0, "", ())
    for delimiter in ("\t", ";", ",", ""):
        forms = Counter(_numbers_at(line, delimiter) for line in sample if delimiter in line)
        forms.pop((), None)
        if forms:
            places, count = forms.most_common(1)[0]
            best = max(best, (count, delimiter, places), key=lambda found: found[0])
    _, delimiter, places = best
    if not places:
        raise ExperimentError(f"{path}: no line of numbers; expected t [s],V [V] and samples")
    return delimiter, places, next(i for i, line in enumerate(lines) if {*places} <= {*_numbers_at(line, delimiter)})


def _numbers_at(line: str, delimiter: str) -> tuple[int, ...]:
    """The last columns of a line that hold numbers, up to the first one from the right that holds words."""
    row, places = _split(line, delimiter), []
    for place in reversed(range(len(row))):
        if _number(row[place], delimiter) is not None:
            places.append(place)
        elif row[place]:
            break
    return tuple(reversed(places))


def _split(line: str, delimiter: str) -> list[str]:
    return [field.strip(' \t\r\n"') for field in line.split(delimiter)] if delimiter else line.split()


def _number(field: str, delimiter: str) -> float | None:
    try:
        return float(field if delimiter == "," else field.replace(",", "."))
    except ValueError:
        return None


def _stated_interval(lines: list[str], delimiter: str) -> tuple[float | None, bool]:
    """(sampling interval [s] that a header states, whether samples are numbered instead of timed)."""
    for line, below in zip(lines, [*lines[1:], ""], strict=True):
        labels = [label.casefold() for label in _split(line, delimiter)]
        if "increment" in labels:
            row = _split(below, delimiter)
            place = labels.index("increment")
            found = _number(row[place], delimiter) if place < len(row) else None
            return found if found and found > 0.0 else None, True
        if match := _INTERVAL.match(line):
            return float(match[1]) or None, False
    return None, False


def _interval(path: Path, times: np.ndarray, stated: float | None) -> float:
    """The sampling interval [s] of times (T,); the stated one if they agree with it on average."""
    steps = np.diff(times) if np.isfinite(times).all() else np.zeros(0)
    mean = float(steps.mean()) if len(steps) else 0.0
    if mean <= 0.0 or (steps < 0.0).any():
        raise ExperimentError(f"{path}: its times do not grow; give --rate, as 2.5e9")
    if stated is not None:
        if abs(mean / stated - 1.0) > _UNEVEN:
            raise ExperimentError(
                f"{path}: states {stated:g} s between samples, but its times are {mean:g} s apart; give --rate, as"
                " 2.5e9"
            )
        return stated
    if np.abs(steps / mean - 1.0).max() > _UNEVEN and (steps > 0.0).all():  # rounded times repeat
        raise ExperimentError(f"{path}: not evenly sampled, or its times are rounded; give --rate, as 2.5e9")
    return mean


def _labels(header: list[str], delimiter: str, places: tuple[int, ...]) -> Iterator[str]:
    """What a header calls these columns; their numbers if it does not."""
    rows = [_split(line, delimiter) for line in header]
    named = [row for row in rows if len(row) > max(places) and all(row[place] for place in places)]
    for number, place in enumerate(places, 1):
        yield named[0][place][:20] if named else str(number)


def _codec(encoding: str) -> str:
    return "utf-8-sig" if encoding == "UTF-8" else encoding
