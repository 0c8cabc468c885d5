"""Recordings of bobs that swing together, as one angle against time."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cradle_env.cradle import Cradle
from identification.apparatus.columns import digest_of
from identification.apparatus.recordings import read_motion
from identification.experiment.experiment import Experiment
from identification.experiment.noise import estimate_noise
from identification.experiment.run import Run
from identification.storage.files import ExperimentError

#: Periods that a ring-down needs at least: over fewer the drag is lost in the start values.
_LEAST_PERIODS = 6.0
#: RMS difference of two bobs over that of their swing, beyond which they do not swing together.
_APART = 0.1


@dataclass(frozen=True, eq=False)
class Swing:
    """One ring-down: the mean angle (T,) [rad] of `bobs` bobs that swing together, at times (T,) [s] from its first.

    cradle: one bob on strings, with the stated numbers; noise: standard deviation of one angle [rad], from successive
    readings alone; scatter: RMS departure of the bobs from their mean [rad], nan where one bob was seen.
    """

    file: str
    bobs: int
    cradle: Cradle
    times: np.ndarray
    angle: np.ndarray
    noise: float
    scatter: float


def read_swings(
    paths: Sequence[str | Path],
    cradle: Cradle,
    bobs: Sequence[int] | None,
    fit_from: float | None,
    fit_to: float | None,
) -> tuple[list[Swing], list[str], str]:
    """The ring-downs of files, how they were read, and the SHA-256 over them; see `measure_ringdown`."""
    if not paths:
        raise ValueError("no recording is given; name at least one CSV or experiment.toml")
    swings, remarks, digests, counts = [], [], [], list(bobs or ())
    recordings = [Path(path) for path in paths if Path(path).suffix != ".toml"]
    if counts and len(counts) != len(recordings):
        raise ValueError(
            f"{len(counts)} numbers of bobs are given for {len(recordings)} CSV files; give one for each, in order"
        )
    for path in map(Path, paths):
        if path.suffix == ".toml":
            experiment = Experiment.load(path)
            digests.append(experiment.digest)
            for run in experiment.runs:
                swings.append(_swing(run.file, experiment.cradle.bobs, experiment.cradle, run, fit_from, fit_to))
            continue
        recording, understood = read_motion(path)
        remarks += understood
        digests.append(hashlib.sha256(recording.data).hexdigest())
        seen = int(np.sum(~np.isnan(recording.readings).all(axis=0)))
        together = counts.pop(0) if counts else seen
        if not seen <= together <= 200:
            raise ValueError(f"{path}: readings of {seen} bobs, but {together} swing together; correct the number")
        run = Run(recording.times, recording.displacements(), recording.quantity, state="free", file=path.name)
        swings.append(_swing(str(path), together, cradle, run, fit_from, fit_to))
    return swings, remarks, digest_of(digests)


def one_bob(cradle: Cradle) -> Cradle:
    """A single bob of the cradle: all that a ring-down of bobs that swing together depends on."""
    return Cradle(
        bobs=1,
        length=cradle.length,
        pivot_half_spacing=cradle.pivot_half_spacing,
        mass=cradle.mass,
        radius=cradle.radius,
        kappa=cradle.kappa,
        gravity=cradle.gravity,
        b=0.0,
        model="nsp" if cradle.has("string_hysteresis") else "pendulum",
    )


def _swing(file: str, bobs: int, cradle: Cradle, run: Run, fit_from: float | None, fit_to: float | None) -> Swing:
    start = run.fit_from if fit_from is None else fit_from
    end = (np.inf if run.fit_to is None else run.fit_to) if fit_to is None else fit_to
    angles = run.angles(cradle)
    columns = ~np.isnan(angles).all(axis=0)
    angles = angles[:, columns]
    rows = (run.times >= start) & (run.times <= end) & ~np.isnan(angles).any(axis=1)
    if rows.sum() < 3:
        raise ExperimentError(
            f"{file}: {rows.sum()} rows with all {columns.sum()} bobs between {start:g} and {end:g} s;"
            " widen --fit-from and --fit-to, or leave out the column of a bob that is often lost"
        )
    times, seen = run.times[rows], angles[rows]
    seen = seen - np.median(seen, axis=0)  # each bob has a rest position of its own
    mean = seen.mean(axis=1)
    size = float(np.sqrt(np.mean(mean**2)))
    if size == 0.0:
        raise ExperimentError(f"{file}: the bobs do not move; give the recording of a ring-down")
    scatter = float(np.sqrt(np.mean((seen - mean[:, None]) ** 2))) if seen.shape[1] > 1 else np.nan
    if scatter > _APART * size:
        raise ExperimentError(
            f"{file}: the bobs do not swing together: they depart from their mean by {scatter:.2g} rad RMS, of"
            f" {size:.2g} rad; lift all of them alike, or keep the columns of those that do"
        )
    period = 2.0 * np.pi * np.sqrt(cradle.length / cradle.gravity)
    if times[-1] - times[0] < _LEAST_PERIODS * period:
        raise ExperimentError(
            f"{file}: lasts {times[-1] - times[0]:.3g} s from {start:.3g} s on, fewer than {_LEAST_PERIODS:g} swings of"
            f" {period:.3g} s; record longer, or correct the length of the strings"
        )
    noise = estimate_noise(Run(times, mean[:, None], state="free", file=file))
    return Swing(file, bobs, one_bob(cradle), times - times[0], mean, noise, scatter)
