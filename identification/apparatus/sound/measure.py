"""Instants and amplitudes of the clicks in a recording of sound."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from identification.apparatus.measurement import Measurement, Value
from identification.apparatus.sound.candidates import find_candidates
from identification.apparatus.sound.reader import Sound
from identification.apparatus.sound.selection import select
from identification.apparatus.sound.template import Scores, Template, learn, score
from identification.apparatus.sound.whitening import whiten
from identification.experiment.click_groups import DEAD_TIME
from identification.number_format import format_number
from identification.progress import Progress
from identification.storage.files import ExperimentError
from identification.storage.stamps import sha256_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: The table of all clicks.
TABLE = "clicks.csv"
#: Clicks of a sequence from which on intervals and decay are told.
_FEWEST = 8
#: Standard deviation of a third difference of white noise over that of the noise.
_THIRD = np.sqrt(20.0)
#: Part of the clicks that may be doubtful, and part of the half swings that may have no click, without a warning.
_DOUBTFUL, _MISSING = 0.1, 0.1


@dataclass(frozen=True, eq=False)
class Clicks:
    """The clicks of a recording, in order of time, (K,) each.

    instants [s] from the beginning of the recording, and their standard deviations; amplitudes [full scale] and their
    standard deviations: about v^1.2 of the speed v of an impact; snr: signal-to-noise ratio in the whitened sound;
    likeness: part of a click's power that has the shape of all, 0 to 1; doubtful: outside the regular sequence.
    """

    instants: np.ndarray
    instants_sd: np.ndarray
    amplitudes: np.ndarray
    amplitudes_sd: np.ndarray
    snr: np.ndarray
    likeness: np.ndarray
    doubtful: np.ndarray

    def sequence(self, half_swing: float) -> tuple[np.ndarray, np.ndarray]:
        """(number, instant [s]) of each click of the regular sequence, numbers in half swings [s] from its first."""
        instants = self.instants[~self.doubtful]
        steps = np.round(np.diff(instants) / half_swing)
        return np.concatenate([[0.0], np.cumsum(steps)]), instants

    def text(self) -> str:
        """As clicks.csv has them."""
        head = "t [s],t_sd [s],amplitude,amplitude_sd,snr,likeness,doubtful"
        columns = (self.instants, self.instants_sd, self.amplitudes, self.amplitudes_sd, self.snr, self.likeness)
        rows = (
            f"{t:.7f},{sd:.2g},{size:.4g},{size_sd:.2g},{snr:.4g},{like:.3f},{int(doubt)}"
            for (t, sd, size, size_sd, snr, like), doubt in zip(zip(*columns, strict=True), self.doubtful, strict=True)
        )
        return "\n".join([head, *rows, ""])


@dataclass(frozen=True, eq=False)
class SoundMeasurement(Measurement):
    """The clicks of a recording; see `measure_sound`.

    clicks: what was found; rate [1/s] and duration [s] of the recording; half_swing [s]: step of the regular sequence,
    nan where there is none; template: the shape of a click; candidates: all that was considered.
    """

    kind: ClassVar[str] = "sound"
    caption: ClassVar[str] = (
        "Top left: amplitudes of the clicks, doubtful ones red. Top right: time from click to click of the regular"
        " sequence, over the half swings in it, less its median. Bottom left: the shape that the clicks share. Bottom"
        " right: signal-to-noise ratio and likeness to that shape of all candidates; grey ones are no clicks."
    )

    clicks: Clicks
    rate: int
    duration: float
    half_swing: float
    template: Template
    candidates: Scores

    def figure(self) -> Figure:
        """Amplitudes, intervals, shape and candidates."""
        from identification.apparatus.sound.figure import sound_figure

        return sound_figure(self)

    def files(self) -> Mapping[str, str | bytes | Path]:
        """clicks.csv: a row for each click."""
        return {TABLE: self.clicks.text()}

    def details(self) -> dict[str, Any]:
        """Counts, and what was used."""
        return {
            "rate_hz": self.rate,
            "duration_s": self.duration,
            "clicks": len(self.clicks.instants),
            "doubtful": int(self.clicks.doubtful.sum()),
            "candidates": len(self.candidates.instants),
            "half_swing_s": None if np.isnan(self.half_swing) else self.half_swing,
            "dead_time_s": DEAD_TIME,
        }


def measure_sound(recording: str | Path, *, progress: Progress = lambda *_: None) -> SoundMeasurement:
    """Find the clicks of a cradle in a recording of sound.

    Parameters
    ----------
    recording : path
        WAV, FLAC, OGG, MP3 or what else libsndfile reads, of 8000 samples a second or more; read in one pass.
    progress : callable, optional
        Called with a stage, the part that is done, and words.

    Returns
    -------
    SoundMeasurement

    Raises
    ------
    ValueError
        One line, for a recording that cannot be used, or in which nothing clicks.

    Examples
    --------
    >>> from identification.apparatus import measure_sound
    >>> measured = measure_sound("cradle.wav")  # doctest: +SKIP
    >>> measured.clicks.instants, measured.clicks.amplitudes  # doctest: +SKIP
    """
    sound, samples = Sound.open(Path(recording)), 0

    def blocks() -> Iterator[np.ndarray]:
        nonlocal samples
        for block in sound.blocks():
            samples += len(block)
            part = samples / sound.count if sound.count else 0.0
            progress("listen", part, f"{samples / sound.rate:.0f} s")
            yield block

    candidates = find_candidates(whiten(blocks(), sound.rate), sound.rate)
    if not len(candidates.places):
        raise ExperimentError(f"{recording}: nothing clicks in it; record nearer to the cradle")
    template = learn(candidates, sound.rate)
    scores = score(candidates, template, sound.rate)
    chosen = select(scores)
    if not len(chosen.which):
        raise ExperimentError(f"{recording}: no sound rises clearly above the background; record nearer to the cradle")
    has_sequence = not np.isnan(chosen.half_swing)
    which = chosen.which
    clicks = Clicks(
        scores.instants[which],
        scores.instants_sd[which],
        scores.amplitudes[which],
        scores.amplitudes_sd[which],
        scores.snr[which],
        scores.likeness[which],
        ~chosen.regular & has_sequence,
    )
    duration = samples / sound.rate
    values, missing = _values(clicks, chosen.half_swing) if has_sequence else ({}, 0)
    return SoundMeasurement(
        values,
        _findings(clicks, duration, chosen.half_swing, missing),
        _warnings(clicks, chosen.half_swing, missing),
        sha256_of(sound.path),
        0,
        clicks,
        sound.rate,
        duration,
        chosen.half_swing,
        template,
        scores,
    )


def _values(clicks: Clicks, half_swing: float) -> tuple[dict[str, Value], int]:
    """What the regular sequence says, and how many of its half swings have no click."""
    numbers, instants = clicks.sequence(half_swing)
    missing = int(numbers[-1]) + 1 - len(numbers)
    if len(numbers) < _FEWEST:
        return {}, missing
    line, covariance = np.polyfit(numbers, instants, 1, cov=True)
    third = np.diff(instants, 3)[np.convolve(np.diff(numbers) == 1.0, np.ones(3), "valid") > 2.5]
    values = {
        "half_swing": Value.normal(
            "T/2", "mean time from click to click", "s", float(line[0]), float(np.sqrt(covariance[0, 0])), 0.0
        )
    }
    if len(third) >= _FEWEST:
        scatter = float(np.median(np.abs(third))) / 0.6745 / _THIRD
        values["timing"] = Value.normal(
            "σ_t", "scatter of an instant about a smooth sequence", "s", scatter, scatter / np.sqrt(len(third)), 0.0
        )
    sizes = clicks.amplitudes[~clicks.doubtful]
    heard = sizes > 0.0
    slope, covariance = np.polyfit(instants[heard], np.log(sizes[heard]), 1, cov=True)
    values["amplitude_decay"] = Value.normal(
        "g", "rate at which amplitudes fall, mean over the recording", "1/s", -float(slope[0]),
        float(np.sqrt(covariance[0, 0])),
    )  # fmt: skip
    return values, missing


def _findings(clicks: Clicks, duration: float, half_swing: float, missing: int) -> tuple[str, ...]:
    count, doubtful = len(clicks.instants), int(clicks.doubtful.sum())
    words = [f"{count} click{'s' if count != 1 else ''} in {format_number(duration)} s."]
    if not np.isnan(half_swing):
        words.append(
            f"{count - doubtful} of them are a regular sequence, one each {format_number(half_swing)} s;"
            f" {missing} half swings between its first and last have no click."
        )
    words.append(
        f"Impacts less than {DEAD_TIME:g} s apart count as one click, and so do echoes: what is softer than"
        " a room leaves of a click."
    )
    return tuple(words)


def _warnings(clicks: Clicks, half_swing: float, missing: int) -> tuple[str, ...]:
    warnings = []
    count, doubtful = len(clicks.instants), int(clicks.doubtful.sum())
    if np.isnan(half_swing):
        warnings.append("no regular sequence was found: all clicks may be of something else than a cradle.")
    if doubtful > _DOUBTFUL * count:
        warnings.append(f"{doubtful} of {count} clicks are doubtful: they are not where the sequence has one.")
    if missing > _MISSING * (count - doubtful + missing):
        warnings.append(f"{missing} half swings have no click: the clicks are too soft, or other sounds too loud.")
    return tuple(warnings)
