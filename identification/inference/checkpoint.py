"""The chains on disk: chain.h5 in emcee's HDF format. A kill or a full disk leaves the last complete file."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import emcee
import h5py
import numpy as np

from cradle_env import hdf5_files
from identification.inference.laplace import Mode, regularize_covariance
from identification.inference.likelihood import Likelihood
from identification.inference.low_rank_noise import LowRankNoise
from identification.inference.noise_model import NoiseModel
from identification.inference.search_options import DEFAULT, SearchOptions
from identification.storage.files import ExperimentError, write_file
from identification.storage.provenance import program_hash
from identification.storage.schema import check_schema

#: Separate ensembles: R̂ needs chains that do not move by each other's positions.
ENSEMBLES = 2
_REMEDY = "it is not a chain that can be resumed; remove it, or choose another --out"


@dataclass(frozen=True)
class Chains:
    """Samples of E ensembles of W walkers over S steps.

    Parameters
    ----------
    chain : ndarray of shape (E, S, W, D)
        Sampled coordinates.
    log_density : ndarray of shape (E, S, W)
        Log posterior density, up to a constant.
    newton_exponent : ndarray of shape (E, S, W)
        λ [1/s]; nan if it is not defined.
    """

    chain: np.ndarray
    log_density: np.ndarray
    newton_exponent: np.ndarray


class Checkpoint:
    """The chains on disk: chain.h5, in emcee's HDF format, one group per ensemble.

    A stretch of sampling works on a copy in memory, which then replaces the file. So a kill or a full disk leaves the
    last complete file.

    Parameters
    ----------
    path : Path
        The file, which may be missing.
    likelihood : Likelihood
        The density that is sampled.
    seed : int
        Seed of all random numbers.
    options : SearchOptions
        Options of the search and the sampler.
    """

    def __init__(self, path: Path, likelihood: Likelihood, seed: int, options: SearchOptions = DEFAULT):
        self.path, self.likelihood, self.seed, self.options = path, likelihood, seed, options

    def _program(self) -> str:
        """Fingerprint of what makes the chains: the program, and its options unless they are the default ones."""
        hashed = program_hash(self.likelihood.experiment.cradle.composition)
        if self.options == DEFAULT:
            return hashed
        return hashlib.sha256(f"{hashed} {self.options}".encode()).hexdigest()[:16]

    def exists(self) -> bool:
        """Whether there are chains of this inference to resume.

        Raises ExperimentError if the file holds chains of other data, unknowns, seed, program or options.
        """
        if not self.path.exists():
            return False
        known = self._read_attributes()
        if known["inputs"] != self.likelihood.experiment.digest or known["names"] != self.likelihood.names:
            raise ExperimentError(
                f"{self.path}: holds chains of other data or unknowns; choose another --out, or remove the file"
            )
        if known["seed"] != self.seed:
            raise ExperimentError(
                f"{self.path}: holds chains of seed {known['seed']}, not {self.seed}; use that seed, choose another "
                "--out, or remove the file"
            )
        if known.get("program") != self._program():
            raise ExperimentError(
                f"{self.path}: holds chains by another version of the program, by other search options,"
                " or with another declaration of an effect; use the same, choose another --out, or remove the file"
            )
        return True

    def _read_attributes(self) -> dict[str, Any]:
        """Read and check the attributes of the file. Raises ExperimentError, with the field, if it is damaged."""
        try:
            with hdf5_files.opened(self.path) as file:
                known = hdf5_files.attributes(file)
                check_schema(known, "chain", self.path, _REMEDY)
                # Chains of another experiment have other shapes; `exists` reports them as such.
                if known["names"] == self.likelihood.names and known["inputs"] == self.likelihood.experiment.digest:
                    self._check_arrays(file, len(known["inflations"]))
        except hdf5_files.UnreadableError as problem:
            raise ExperimentError(f"{problem}; {_REMEDY}") from None
        return known

    def _check_arrays(self, file: Any, runs: int) -> None:
        D, W = len(self.likelihood.unknowns), walker_count(self.likelihood)
        modes, jumps = hdf5_files.group(file, "modes"), hdf5_files.group(file, "jumps")
        if "0" not in modes or not all(name.isdigit() for name in modes):
            raise hdf5_files.UnreadableError(f"{self.path}: modes must be numbered by steps, from 0 on")
        for name in modes:
            mode = hdf5_files.group(modes, name)
            for key, shape in (("point", (D,)), ("covariance", (D, D)), ("cost", ())):
                hdf5_files.numbers(mode, key, shape)
        if len(jumps) not in (0, runs):
            raise hdf5_files.UnreadableError(f"{self.path}: jumps has {len(jumps)} runs; expected {runs}")
        for k in range(len(jumps)):
            of_run = hdf5_files.group(jumps, str(k + 1))
            run, rows = self.likelihood.experiment.runs[k], self.likelihood.rows[k]
            readings = int(np.count_nonzero(~np.isnan(run.readings[rows])))
            directions = hdf5_files.numbers(of_run, "directions", (readings, None))
            hdf5_files.numbers(of_run, "sizes", (directions.shape[1],))
        for k in range(ENSEMBLES):
            name = f"ensemble_{k + 1}"
            if name not in file:
                continue
            ensemble = hdf5_files.group(file, name)
            known = hdf5_files.attributes(ensemble)
            check_schema(known, "chain-ensemble", f"{self.path}: {name}", _REMEDY)
            if known["iteration"]:
                if known.get("has_blobs") is not True:
                    raise hdf5_files.UnreadableError(f"{self.path}: {name}.has_blobs is not true: λ is missing")
                steps = len(hdf5_files.numbers(ensemble, "chain", (None, W, D)))
                hdf5_files.numbers(ensemble, "log_prob", (steps, W))
                hdf5_files.numbers(ensemble, "blobs", (steps, W))
                if known["iteration"] > steps:
                    raise hdf5_files.UnreadableError(
                        f"{self.path}: {name} has {steps} steps; expected {known['iteration']}"
                    )

    def begin(self, mode: Mode, impact_order: Sequence[LowRankNoise], inflations: Sequence[float]) -> None:
        """Write a file without steps.

        Parameters
        ----------
        mode : Mode
            The mode from which sampling starts.
        impact_order : sequence of LowRankNoise
            Impact-order noise of each run; empty if there is none.
        inflations : sequence of float
            Inflation of χ² of each run; see `NoiseModel`.
        """
        with self._edited_copy(new=True) as image, _open(image, "w") as file:
            file.attrs["inputs"] = self.likelihood.experiment.digest
            file.attrs["names"] = self.likelihood.names
            file.attrs["program"] = self._program()
            file.attrs["seed"] = self.seed
            file.attrs["inflations"] = list(inflations)
            _write_mode(file, 0, mode)
            file.create_group("jumps")
            for k, of_run in enumerate(impact_order):
                file[f"jumps/{k + 1}/directions"], file[f"jumps/{k + 1}/sizes"] = of_run.directions, of_run.sizes

    @contextmanager
    def _edited_copy(self, new: bool = False) -> Iterator[io.BytesIO]:
        """Yield a copy of the file in memory, and replace the file by it if no error occurs."""
        with io.BytesIO(b"" if new else self.path.read_bytes()) as image:
            yield image
            write_file(self.path, image.getvalue())

    def noise_model(self) -> NoiseModel:
        """The noise model of the chains."""
        known = self.likelihood.with_tracking_noise(self.mode(0).point).noise_model
        known = known.with_impact_order(self.impact_order())
        return known.with_inflations(self.inflations())

    def inflations(self) -> list[float]:
        """Inflation of χ² of each run; see `NoiseModel`."""
        with _open(self.path, "r") as file:
            return [float(value) for value in file.attrs["inflations"]]

    def impact_order(self) -> list[LowRankNoise]:
        """Impact-order noise of each run; empty if there is none."""
        with _open(self.path, "r") as file:
            known = file["jumps"]
            parts = [known[f"{k + 1}"] for k in range(len(known))]
            return [LowRankNoise(part["directions"][:], part["sizes"][:]) for part in parts]

    def mode(self, step: int) -> Mode:
        """The mode about which a step proposes points: that of the fit, or the one last adapted to the chains."""
        with _open(self.path, "r") as file:
            latest = file[f"modes/{max(int(name) for name in file['modes'] if int(name) <= step)}"]
            return Mode(latest["point"][:], latest["covariance"][:], float(latest["cost"][()]))

    def adapt(self, step: int) -> None:
        """From this step on, propose about mean and covariance of the second half of the present chains."""
        D = len(self.likelihood.unknowns)
        points = self.read().chain[:, step // 2 : step].reshape(-1, D)
        covariance = regularize_covariance(np.cov(points.T).reshape(D, D))
        with self._edited_copy() as image, _open(image, "a") as file:
            if str(step) not in file["modes"]:
                _write_mode(file, step, Mode(points.mean(axis=0), covariance, 0.0))

    @contextmanager
    def backends(self) -> Iterator[list[emcee.backends.HDFBackend]]:
        """Yield emcee's backend of each ensemble, on a copy that replaces the file if no error occurs."""
        with self._edited_copy() as image:
            yield [MemoryBackend(image, f"ensemble_{k + 1}") for k in range(ENSEMBLES)]

    def steps(self) -> int:
        """Number of steps that all ensembles have taken."""
        return count_kept_steps(self.path)

    def read(self) -> Chains:
        """Read the samples of all ensembles."""
        steps = self.steps()
        parts = []
        for k in range(ENSEMBLES):
            backend: Any = emcee.backends.HDFBackend(str(self.path), name=f"ensemble_{k + 1}")
            parts.append((backend.get_chain()[:steps], backend.get_log_prob()[:steps], backend.get_blobs()[:steps]))
        chain, log_density, blobs = (np.array(group) for group in zip(*parts, strict=True))
        return Chains(chain, log_density, blobs.reshape(log_density.shape))


class MemoryBackend(emcee.backends.HDFBackend):
    """emcee's backend on a file in memory, so that a full disk makes one write fail and not h5py midway."""

    def __init__(self, image: io.BytesIO, name: str) -> None:
        super().__init__(image, name=name)

    @property
    def initialized(self) -> bool:
        """Whether the ensemble has taken a step."""
        with self.open() as file:
            return self.name in file


def _open(file: Path | io.BytesIO, mode: str) -> Any:
    """Open an HDF5 file; untyped, since only the code that wrote it knows its content."""
    return h5py.File(file, mode)


def count_kept_steps(path: Path) -> int:
    """Number of steps that all ensembles in a chain.h5 have taken; 0 if there is no file."""
    if not path.is_file():
        return 0
    with _open(path, "r") as file:
        groups = [file.get(f"ensemble_{k + 1}") for k in range(ENSEMBLES)]
        return min(int(g.attrs["iteration"]) if g is not None else 0 for g in groups)


def _write_mode(file: Any, step: int, mode: Mode) -> None:
    for name in ("point", "covariance", "cost"):
        file[f"modes/{step}/{name}"] = getattr(mode, name)


def walker_count(likelihood: Likelihood) -> int:
    """Number of walkers of an ensemble: even, and more than twice the number of unknowns, as the moves require."""
    return max(16, 2 * len(likelihood.unknowns) + 4)
