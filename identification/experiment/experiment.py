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
from identification.experiment.constraint import KINDS, Constraint
from identification.experiment.csv_file import csv_text
from identification.experiment.experiment_file import FILE_NAME, experiment_text, read_experiment
from identification.experiment.run import Prior, ReleaseInfo, Run, Tracking, check_prior, check_run
from identification.storage.files import ExperimentError, read_text, resolve_beside, write_together


@dataclass(frozen=True, eq=False)
class Experiment:
    """Measured runs of one cradle, and what is known about them.

    Parameters
    ----------
    cradle : Cradle
        The cradle with its model. Values of parameters to infer are starting values.
    runs : tuple of Run
        At least one. A run without δ takes that of the cradle.
    infer : mapping of str to Prior
        Priors by field of Cradle or by "effect.key". A field other than k_f, kappa and b is inferred only if it has
        a prior.
    unknown_effect_parameters : tuple of str
        Effect parameters that have no known value and are inferred, as "effect.key".
    path : Path, optional
        The experiment.toml from which the experiment was read.
    constraints : tuple of Constraint
        What instruments beside the runs say of the cradle.

    Raises
    ------
    ValueError
        If a run or a constraint does not fit the cradle, if a prior has an unknown name or allows impossible values, or
        if δ is to be inferred although the runs state several.

    Examples
    --------
    >>> import numpy as np
    >>> from cradle_env import Cradle, Release, simulate
    >>> cradle, release = Cradle(bobs=2, model="pendulum"), Release(angle=0.2)
    >>> run = simulate(cradle, release, duration=2.0, sample_rate=60.0)
    >>> experiment = Experiment.from_arrays(cradle, run.t, run.theta, release, noise=1e-3)
    >>> experiment.runs[0].readings.shape, experiment.runs[0].bobs_seen
    ((121, 2), (1, 2))
    """

    cradle: Cradle
    runs: tuple[Run, ...]
    infer: Mapping[str, Prior] = field(default_factory=dict)
    unknown_effect_parameters: tuple[str, ...] = ()
    path: Path | None = None
    constraints: tuple[Constraint, ...] = ()

    def __post_init__(self) -> None:
        if not self.runs:
            raise ValueError("an experiment needs at least one run")
        object.__setattr__(self, "runs", tuple(check_run(self.cradle, run) for run in self.runs))
        for name, prior in self.infer.items():
            check_prior(self.cradle, name, prior)
        deltas = {run.delta for run in self.runs}
        if "delta" in self.infer and (len(deltas) > 1 or isinstance(self.runs[0].delta, tuple)):
            stated = " and ".join(map(str, deltas))
            raise ValueError(
                f"delta is to be inferred as one number for all runs, but they state {stated}; leave it out of [infer]"
                " and infer spacer_offset.offset, which is added to the stated delta of each gap"
            )
        # In the order in which an experiment.toml is read.
        ordered = sorted(self.constraints, key=lambda constraint: KINDS.index(constraint.kind))
        object.__setattr__(self, "constraints", tuple(ordered))
        for constraint in self.constraints:
            try:
                constraint.check(self.cradle)
            except ValueError as problem:
                raise ValueError(f"{constraint.file}: {problem}") from None
        object.__setattr__(self, "infer", MappingProxyType(dict(self.infer)))

    @functools.cached_property
    def digest(self) -> str:
        """SHA-256 of its files as they were read or, if it was made in Python, as `save` would write them."""
        return _digest(*(text.encode() for text in self.texts().values()))

    @functools.cached_property
    def text(self) -> str:
        """Text of its experiment.toml as it was read or, if it was made in Python, as `save` would write it."""
        return self.texts()[FILE_NAME]

    def with_source(self, digest: str, text: str | None = None) -> Experiment:
        """Set digest and text to those of the files that the experiment was read from; return the experiment.

        Copies made by `dataclasses.replace` compute their own.
        """
        vars(self)["digest"] = digest
        if text is not None:
            vars(self)["text"] = text
        return self

    def cradle_of(self, run: Run) -> Cradle:
        """The cradle with the δ of a run."""
        return self.cradle if run.delta == self.cradle.delta else self.cradle.replace(delta=run.delta)

    @classmethod
    def from_arrays(
        cls,
        cradle: Cradle,
        times: np.ndarray,
        readings: np.ndarray,
        release: Release | ReleaseInfo | None = None,
        **run,
    ) -> Experiment:
        """Make an experiment of one run from arrays.

        Parameters
        ----------
        cradle : Cradle
            The cradle with its model.
        times : ndarray of shape (T,)
            Times [s], ascending, 0 at the release.
        readings : ndarray of shape (T, N)
            Angles [rad], or displacements [m] with quantity="x"; nan where missing.
        release : Release or ReleaseInfo, optional
            How the run was released; a Release counts as exactly known.
        **run
            Further fields of `Run`, such as noise=1e-3.

        Returns
        -------
        Experiment

        Raises
        ------
        ValueError
            If these do not fit together.
        """
        info = ReleaseInfo(release) if isinstance(release, Release) else release
        return cls(cradle, (Run(times, readings, release=info, **run),))

    @classmethod
    def load(cls, path: str | Path) -> Experiment:
        """Read an experiment.toml and the data files that it names.

        Parameters
        ----------
        path : str or Path
            The experiment.toml; data files are named relative to its folder.

        Returns
        -------
        Experiment

        Raises
        ------
        ValueError
            If a file is unusable. The message is one line with file, line, key or column, and remedy.
        """
        path = Path(path)
        text, data = read_text(path)
        return cls._parse(text, path, data, _in_folder(path.parent))

    @classmethod
    def parse(cls, text: str, path: str | Path) -> Experiment:
        """Parse the text of an experiment.toml as if it were the file at `path`, with errors as in `load`."""
        path = Path(path)
        return cls._parse(text, path, text.encode(), _in_folder(path.parent))

    @classmethod
    def from_texts(cls, texts: Mapping[str, str]) -> Experiment:
        """Parse an experiment from the texts of its files, by name, with errors as in `load`."""

        def read(file: str) -> tuple[str, bytes]:
            if file not in texts:
                raise ValueError(f"there is no file {file!r} beside it; there are {', '.join(map(repr, texts))}")
            return texts[file], texts[file].encode()

        text = texts[FILE_NAME]
        return cls._parse(text, None, text.encode(), read)

    @classmethod
    def _parse(cls, text: str, path: Path | None, data: bytes, read: Callable[[str], tuple[str, bytes]]) -> Experiment:
        fields, recorded = read_experiment(text, FILE_NAME if path is None else path.name, read)
        return cls(**fields, path=path).with_source(_digest(data, *recorded), text)

    def save(self, directory: str | Path) -> Path:
        """Write experiment.toml and its data files, in SI units.

        Parameters
        ----------
        directory : str or Path
            Created if missing; files of the same names are replaced.

        Returns
        -------
        Path
            That of experiment.toml.
        """
        texts = self.texts()
        description = texts.pop(FILE_NAME)
        write_together(Path(directory), {**texts, FILE_NAME: description})
        return Path(directory) / FILE_NAME

    def texts(self) -> dict[str, str]:
        """Texts of the files that `save` writes, by name, experiment.toml first."""
        texts, runs, constraints = {FILE_NAME: ""}, [], []

        def add(name: str, text: str, number: int) -> str:
            file = Path(name)
            while texts.setdefault(str(file), text) != text:  # data of the same name from another folder
                file = file.with_stem(f"{file.stem}-{number}")
            return str(file)

        for i, run in enumerate(self.runs, 1):
            name, text = Path(run.file).name.replace("\\", "_"), csv_text(run.times, run.readings, run.quantity)
            runs.append(dataclasses.replace(run, file=add(name, text, i)))
        for i, constraint in enumerate(self.constraints, 1):
            file = add(f"{constraint.kind}.json", constraint.text(), i)
            constraints.append(dataclasses.replace(constraint, file=file))
        texts[FILE_NAME] = experiment_text(
            self.cradle, runs, self.infer, self.unknown_effect_parameters, constraints
        )  # fmt: skip
        return texts


def _in_folder(folder: Path) -> Callable[[str], tuple[str, bytes]]:
    return lambda file: read_text(resolve_beside(folder, file))


def _digest(*files: bytes) -> str:
    return hashlib.sha256(b"".join(hashlib.sha256(data).digest() for data in files)).hexdigest()


__all__ = ["Constraint", "Experiment", "ExperimentError", "Prior", "ReleaseInfo", "Run", "Tracking"]
