"""Experiments: measured runs of a cradle, and what is known about them."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.release import Release
from identification.experiment.csv_file import csv_text, parse_recording, read_recording
from identification.experiment.experiment_file import FILE_NAME, experiment_text, read_experiment
from identification.experiment.recording import Recording
from identification.experiment.run import Prior, ReleaseInfo, Run, check_prior, check_run
from identification.storage.files import ExperimentError, read_text, resolve_beside, write_together


@dataclass(frozen=True, eq=False)
class Experiment:
    """Measured runs of one cradle, and what is known about them.

    cradle: with its model; what is to be inferred stands at where to start. runs: at least one. infer: priors of
    unknowns beside k_f, kappa and b (or of these), by field of Cradle or by "effect.parameter".
    unknown_effect_parameters: "effect.parameter" of those without a known value. path: of the experiment.toml that
    it was read from.

    Raises ValueError if these do not fit together.
    """

    cradle: Cradle
    runs: tuple[Run, ...]
    infer: Mapping[str, Prior] = field(default_factory=dict)
    unknown_effect_parameters: tuple[str, ...] = ()
    path: Path | None = None

    def __post_init__(self) -> None:
        if not self.runs:
            raise ValueError("an experiment needs at least one run")
        object.__setattr__(self, "runs", tuple(check_run(self.cradle, run) for run in self.runs))
        for name, prior in self.infer.items():
            check_prior(self.cradle, name, prior)
        deltas = {run.delta for run in self.runs}
        if "delta" in self.infer and (len(deltas) > 1 or isinstance(self.runs[0].delta, tuple)):
            told = " and ".join(map(str, deltas))
            raise ValueError(
                f"delta is to be inferred as one number of all runs, but they state {told}; leave it out of [infer] "
                "and infer spacer_offset.offset, by which gaps differ from what is stated"
            )
        object.__setattr__(self, "infer", MappingProxyType(dict(self.infer)))

    @functools.cached_property
    def digest(self) -> str:
        """SHA-256 over its files: as they were read or, if made or changed in Python, as they would be saved."""
        return _digest(*(text.encode() for text in self.texts().values()))

    @functools.cached_property
    def text(self) -> str:
        """Its experiment.toml, as it was read or would be saved."""
        return self.texts()[FILE_NAME]

    def with_source(self, digest: str, text: str | None = None) -> Experiment:
        """This experiment, as read from files of that digest, and with that text; what `dataclasses.replace` makes of
        it has its own."""
        vars(self)["digest"] = digest
        if text is not None:
            vars(self)["text"] = text
        return self

    def cradle_of(self, run: Run) -> Cradle:
        """The cradle with the δ of one run."""
        return self.cradle.replace(delta=run.delta)

    @classmethod
    def from_arrays(
        cls,
        cradle: Cradle,
        times: np.ndarray,
        readings: np.ndarray,
        release: Release | ReleaseInfo | None = None,
        **run,
    ) -> Experiment:
        """An experiment of one run: times (T,) [s], readings (T, N) [rad or m]; more of it by the fields of `Run`."""
        info = ReleaseInfo(release) if isinstance(release, Release) else release
        return cls(cradle, (Run(times, readings, release=info, **run),))

    @classmethod
    def load(cls, path: str | Path) -> Experiment:
        """Reads an experiment.toml and the data it names; ExperimentError, one line, if they are unusable."""
        path = Path(path)
        text, data = read_text(path)
        return cls._parse(text, path, data, _in_folder(path.parent))

    @classmethod
    def parse(cls, text: str, path: str | Path) -> Experiment:
        """The experiment that a text describes, were it the file at `path`; ExperimentError if it is unusable."""
        path = Path(path)
        return cls._parse(text, path, text.encode(), _in_folder(path.parent))

    @classmethod
    def from_texts(cls, texts: Mapping[str, str]) -> Experiment:
        """The experiment of what `texts` gives, whose files are on no disk; ExperimentError if it is unusable."""

        def recording_of(file: str, bobs: int) -> Recording:
            if file not in texts:
                raise ValueError(f"there is no file {file!r} beside it; there are {', '.join(map(repr, texts))}")
            return parse_recording(file, texts[file], texts[file].encode(), bobs)

        text = texts[FILE_NAME]
        return cls._parse(text, None, text.encode(), recording_of)

    @classmethod
    def _parse(
        cls, text: str, path: Path | None, data: bytes, recording_of: Callable[[str, int], Recording]
    ) -> Experiment:
        name = FILE_NAME if path is None else path.name
        cradle, runs, infer, unknown, recorded = read_experiment(text, name, recording_of)
        return cls(cradle, runs, infer, unknown, path).with_source(_digest(data, *recorded), text)

    def save(self, directory: str | Path) -> Path:
        """Writes experiment.toml and its data into a folder, in SI units; the path of experiment.toml."""
        texts = self.texts()
        description = texts.pop(FILE_NAME)
        write_together(Path(directory), {**texts, FILE_NAME: description})
        return Path(directory) / FILE_NAME

    def texts(self) -> dict[str, str]:
        """The files of the experiment by name, experiment.toml first."""
        texts, runs = {FILE_NAME: ""}, []
        for i, run in enumerate(self.runs, 1):
            file, text = Path(Path(run.file).name.replace("\\", "_")), csv_text(run.times, run.readings, run.quantity)
            while texts.setdefault(str(file), text) != text:  # another folder's data of the same name
                file = file.with_stem(f"{file.stem}-{i}")
            runs.append(dataclasses.replace(run, file=str(file)))
        texts[FILE_NAME] = experiment_text(self.cradle, runs, self.infer, self.unknown_effect_parameters)
        return texts


def _in_folder(folder: Path) -> Callable[[str, int], Recording]:
    return lambda file, bobs: read_recording(resolve_beside(folder, file), bobs)


def _digest(*files: bytes) -> str:
    return hashlib.sha256(b"".join(hashlib.sha256(data).digest() for data in files)).hexdigest()


__all__ = ["Experiment", "ExperimentError", "Prior", "ReleaseInfo", "Run"]
