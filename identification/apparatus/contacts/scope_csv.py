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

import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from identification.experiment.text_encoding import decode
from identification.storage.files import ExperimentError

#: Bytes from which the form of a file is determined, and characters that are read at a time.
_HEAD, _TEXT = 1 << 20, 1 << 22
#: Rows that show which columns hold samples, and how far apart these are; rows beside which facts may stand.
_TYPICAL, _FACTS = 2000, 40
#: Departure of the sampling interval from the mean, or from the stated one, from which on the times are wrong.
_UNEVEN = 0.01
#: Longest step of the first times over the shortest, unless times repeat.
_LONGER = 1.5
#: Times that are alike in a row, at most.
_MOST_ALIKE = 1 << 20
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_INTERVAL = re.compile(rf"\"?sample interval\"?\W+(?:analog\W+)?({_NUMBER})", re.IGNORECASE)
#: Units in small letters: a prefix, and what is measured. Prefixes of frequencies and levels do not matter.
_PREFIXES = {
    "p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3,
    "pico": 1e-12, "nano": 1e-9, "micro": 1e-6, "milli": 1e-3, "kilo": 1e3,
}  # fmt: skip
_MEASURED = {
    "time": "s|secs?|seconds?", "voltage": "v|volts?", "frequency": "[kmg]?hz|hertz", "level": "db[a-zµ]*",
    "current": "a|amperes?", "power": "w|watts?",
}  # fmt: skip
_UNITS = {kind: re.compile(rf"({'|'.join(_PREFIXES)})({names})") for kind, names in _MEASURED.items()}
#: A unit in a label: in brackets, or behind its last separator, as in t/ms and Time_ms; or all of it.
_BRACKETS = re.compile(r"[\[(]\s*([^\[()\]]*?)\s*[\])]")
_LAST_WORD = re.compile(r"[\s/,_]([^\s/,_]+)$")
#: Lines of a header that state the units of a trace by name.
_STATED_UNITS = re.compile(r"\"?(horizontal|vertical) units?\"?\W+(?:ch\d+\W+)?([a-zµ]+)", re.IGNORECASE)
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
        Voltage [V] of the number 1 in the file.
    clock : float, optional
        Time [s] of the number 1 in the first of `places`; None if that is no time, or if the user states the rate.
    spacing : float
        Time from sample to sample [s] by the first times.
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
    spacing: float = math.nan

    def blocks(self) -> Iterator[np.ndarray]:
        """Voltages (K,) [V], some at a time. Raises ExperimentError for a line that is no sample, and for a gap."""
        with self.path.open(encoding=self.encoding, errors="replace", newline=None) as file:
            for _ in range(self.first):
                file.readline()
            number, unchanged = self.first, np.zeros(0)
            while lines := file.readlines(_TEXT):
                volts, times = [], []
                for line in lines:
                    number += 1
                    if not line.strip("\x00 \t\r\n" + self.delimiter):
                        continue
                    row = _split(line, self.delimiter)
                    if any(place >= len(row) or _number(row[place], self.delimiter) is None for place in self.places):
                        raise ExperimentError(self._no_sample(number, line))
                    volts.append(_number(row[self.column], self.delimiter))
                    if self.clock is not None:
                        times.append(_number(row[self.places[0]], self.delimiter))
                if self.clock is not None:
                    unchanged = self._check_times(np.concatenate([unchanged, self.clock * np.array(times)]))
                if volts:
                    yield self.scale * np.array(volts)

    def _no_sample(self, number: int, line: str) -> str:
        remedy = "the file is damaged, or more than one trace: export it again, one trace in a file"
        if "∞" in line:
            remedy = "the voltage was out of range: record it again in a larger one"
        return f"{self.path}, line {number}: {line.strip()[:40]!r} is no sample; {remedy}"

    def _check_times(self, times: np.ndarray) -> np.ndarray:
        """Raises ExperimentError unless times (K,) [s] grow by `spacing` from sample to sample.

        Times with few digits repeat. Between two changes they grow by as much as the samples in between last, to one
        sample. Returns the times since the last change, which the next ones follow.
        """
        steps = np.diff(times)
        changes = np.concatenate([[0], np.flatnonzero(steps != 0.0) + 1])
        written, samples = np.diff(times[changes]), np.diff(changes)
        # The first time may have begun earlier. Where digits are lost, a change may be late by half of the new step.
        off = np.abs(written - samples * self.spacing) > 1.5 * self.spacing + 0.5 * np.abs(written)
        off &= (changes[:-1] > 0) | (written < 0.0) | (written > samples * self.spacing)
        if not np.isfinite(times).all() or off.any() or len(times) - changes[-1] > _MOST_ALIKE:
            at = times[changes[int(np.argmax(off))]] if off.any() else times[-1]
            raise ExperimentError(
                f"{self.path}: behind {at:.9g} s its times are not {self.spacing:g} s apart, as at a gap or another"
                " segment; export a piece without gaps, or give --rate if it has none"
            )
        return times[changes[-1] :]


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
    stated, is_numbered = _stated_interval(lines[: first + 1], delimiter)
    has_time = len(places) > 1
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
    scale, clock, spacing = _unit(path, lines, first, delimiter, column, "voltage"), None, math.nan
    if has_time and not is_numbered and rate is None:
        clock = _unit(path, lines, first, delimiter, places[0], "time")
        rows = (_split(line, delimiter) for line in lines[first : first + _TYPICAL])
        found = [_number(one[places[0]], delimiter) for one in rows if len(one) > places[0]]
        spacing = _spacing(path, clock * np.array([time for time in found if time is not None]), stated)
    interval = spacing if stated is None and clock is not None else stated
    return ScopeCsv(path, _codec(encoding), delimiter, first, places, column, interval, scale, clock, spacing)


def _unit(path: Path, lines: list[str], first: int, delimiter: str, column: int, kind: str) -> float:
    """SI value of the number 1 in a column of times or voltages, by its label or by a line on units; 1 without these.

    lines: of the file; first: the first sample's, from 0. Tektronix writes units beside the first samples.
    """
    stated = [found for line in lines[: first + _FACTS] if (found := _STATED_UNITS.match(line))]
    words = [found[2] for found in stated if (found[1].casefold() == "horizontal") == (kind == "time")]
    rows = [row for line in lines[:first] if len(row := _split_labels(line, delimiter)) > column and row[column]]
    label = rows[-1][column] if rows else ""
    in_brackets = _BRACKETS.findall(label)
    for word in (*in_brackets, *_LAST_WORD.findall(label), label, *words):
        small = word.casefold().replace("\u03bc", "µ")
        if found := _UNITS[kind].fullmatch(small):
            return _PREFIXES[found[1]]
        is_unit = word in words or len(word) > 1  # A alone may be the name of a channel
        if is_unit and any(unit.fullmatch(small) for unit in _UNITS.values()):
            raise ExperimentError(f"{path}: has {word!r} where a {kind} should be; export the voltage against time")
    if kind == "time" and (unknown := [word for word in in_brackets if word.isalpha()]):
        raise ExperimentError(f"{path}: its times are in {unknown[0]!r}, an unknown unit; give --rate, as 2.5e9")
    return 1.0


def _split_labels(line: str, delimiter: str) -> list[str]:
    """Labels of a header line; none where it has a number. Between spaces, a unit in brackets belongs to its label."""
    line = line.strip("#% \t\r\n")
    labels = _split(line, delimiter) if delimiter else re.split(r"\s+(?![\[(])", line)
    return [] if any(_number(label, delimiter) is not None for label in labels) else labels


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


def _spacing(path: Path, times: np.ndarray, stated: float | None) -> float:
    """Time from sample to sample [s] of times (T,), which may have few digits and repeat."""
    steps = np.diff(times) if np.isfinite(times).all() else np.zeros(0)
    changes = np.flatnonzero(steps) + 1
    if (steps < 0.0).any() or not len(changes):
        raise ExperimentError(f"{path}: its times do not grow; give --rate, as 2.5e9")
    if len(changes) < 2:
        raise ExperimentError(f"{path}: its times are rounded too much; give --rate, as 2.5e9")
    if len(changes) == len(steps) and steps.max() > _LONGER * steps.min():  # times with few digits repeat
        raise ExperimentError(f"{path}: not evenly sampled, or its times are rounded; give --rate, as 2.5e9")
    found = float((times[changes[-1]] - times[changes[0]]) / (changes[-1] - changes[0]))
    if stated is not None and abs(found / stated - 1.0) > _UNEVEN:
        raise ExperimentError(
            f"{path}: states {stated:g} s between samples, but its times are {found:g} s apart; give --rate, as 2.5e9"
        )
    return found


def _labels(header: list[str], delimiter: str, places: tuple[int, ...]) -> Iterator[str]:
    """What a header calls these columns; their numbers if it does not."""
    rows = [_split(line, delimiter) for line in header]
    named = [row for row in rows if len(row) > max(places) and all(row[place] for place in places)]
    for number, place in enumerate(places, 1):
        yield named[0][place][:20] if named else str(number)


def _codec(encoding: str) -> str:
    return "utf-8-sig" if encoding == "UTF-8" else encoding
