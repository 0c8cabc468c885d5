"""The chains on disk: chain.h5, in emcee's HDF format, whole after a kill and after a full disk."""

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
from identification.inference.noise_model import ImpactOrderNoise, NoiseModel
from identification.inference.search_options import DEFAULT, SearchOptions
from identification.storage.files import ExperimentError, write_file
from identification.storage.provenance import program_hash
from identification.storage.schema import check_schema

ENSEMBLES = 2
_REMEDY = "it is not a chain that can be resumed; remove it, or choose another --out"


@dataclass(frozen=True)
class Chains:
    """Sampled so far: chain (E, S, W, D), log_density (E, S, W), newton_exponent (E, S, W)."""

    chain: np.ndarray
    log_density: np.ndarray
    newton_exponent: np.ndarray


class Checkpoint:
    """The chains on disk: chain.h5, in emcee's HDF format, one group per ensemble.

    A stretch of sampling works on a copy in memory that then takes the file's place, so that a kill or a full disk
    leaves the last whole one.
    """

    def __init__(self, path: Path, likelihood: Likelihood, seed: int, options: SearchOptions = DEFAULT):
        self.path, self.likelihood, self.seed, self.options = path, likelihood, seed, options

    def _program(self) -> str:
        """What made the chains: the program, and its options where they are not the default ones."""
        hashed = program_hash(self.likelihood.experiment.cradle.composition)
        if self.options == DEFAULT:
            return hashed
        return hashlib.sha256(f"{hashed} {self.options}".encode()).hexdigest()[:16]

    def exists(self) -> bool:
        """Whether there are chains of this very inference to go on with; ExperimentError if of another."""
        if not self.path.exists():
            return False
        known = self._read_attributes()
        if known["inputs"] != self.likelihood.experiment.digest or known["names"] != self.likelihood.names:
            raise ExperimentError(
                f"{self.path}: holds chains of other data or unknowns; choose another --out, or remove the file"
            )
        if known["seed"] != self.seed:
            raise ExperimentError(
                f"{self.path}: holds chains of seed {known['seed']}, not {self.seed}; give that one, choose another "
                "--out, or remove the file"
            )
        if known.get("program") != self._program():
            raise ExperimentError(
                f"{self.path}: holds chains by another version of the program, by other search options,"
                " or of an effect from outside it; go on with that one, choose another --out, or remove the file"
            )
        return True

    def _read_attributes(self) -> dict[str, Any]:
        """What the file says of itself; ExperimentError, naming the field, if it is not whole."""
        try:
            with hdf5_files.opened(self.path) as file:
                known = hdf5_files.attributes(file)
                check_schema(known, "chain", self.path, _REMEDY)
                # Those of another experiment have other shapes, and are refused as such.
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
            raise hdf5_files.UnreadableError(f"{self.path}: jumps are of {len(jumps)} runs of {runs}")
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
                    raise hdf5_files.UnreadableError(f"{self.path}: {name} holds {steps} steps of {known['iteration']}")

    def begin(self, mode: Mode, impact_order: Sequence[ImpactOrderNoise], inflations: Sequence[float]) -> None:
        """A file without steps, with the mode from which sampling starts, the impact-order noise of each run, and by
        how much the noise of each is inflated."""
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
        """A copy of the file in memory to work on, which takes its place if all went well."""
        with io.BytesIO(b"" if new else self.path.read_bytes()) as image:
            yield image
            write_file(self.path, image.getvalue())

    def noise_model(self) -> NoiseModel:
        """The noise model of the chains."""
        known = self.likelihood.noise_model.with_impact_order(self.impact_order())
        return known.with_inflations(self.inflations())

    def inflations(self) -> list[float]:
        """By how much the noise of each run is inflated; see `NoiseModel`."""
        with _open(self.path, "r") as file:
            return [float(value) for value in file.attrs["inflations"]]

    def impact_order(self) -> list[ImpactOrderNoise]:
        """The impact-order noise of each run; none where that is not known."""
        with _open(self.path, "r") as file:
            known = file["jumps"]
            parts = [known[f"{k + 1}"] for k in range(len(known))]
            return [ImpactOrderNoise(part["directions"][:], part["sizes"][:]) for part in parts]

    def mode(self, step: int) -> Mode:
        """The mode about which points are proposed at a step: that of the fit, or as last adapted to the chains."""
        with _open(self.path, "r") as file:
            latest = file[f"modes/{max(int(name) for name in file['modes'] if int(name) <= step)}"]
            return Mode(latest["point"][:], latest["covariance"][:], float(latest["cost"][()]))

    def adapt(self, step: int) -> None:
        """Takes the mode from here on from the second half of the chains so far."""
        D = len(self.likelihood.unknowns)
        points = self.read().chain[:, step // 2 : step].reshape(-1, D)
        covariance = regularize_covariance(np.cov(points.T).reshape(D, D))
        with self._edited_copy() as image, _open(image, "a") as file:
            if str(step) not in file["modes"]:
                _write_mode(file, step, Mode(points.mean(axis=0), covariance, 0.0))

    @contextmanager
    def backends(self) -> Iterator[list[emcee.backends.HDFBackend]]:
        """emcee's view of each ensemble, on a copy of the file that takes its place if all went well."""
        with self._edited_copy() as image:
            yield [MemoryBackend(image, f"ensemble_{k + 1}") for k in range(ENSEMBLES)]

    def steps(self) -> int:
        """Steps that all ensembles have taken."""
        return count_kept_steps(self.path)

    def read(self) -> Chains:
        """All that was sampled by all ensembles."""
        steps = self.steps()
        parts = []
        for k in range(ENSEMBLES):
            backend: Any = emcee.backends.HDFBackend(str(self.path), name=f"ensemble_{k + 1}")
            parts.append((backend.get_chain()[:steps], backend.get_log_prob()[:steps], backend.get_blobs()[:steps]))
        chain, log_density, blobs = (np.array(group) for group in zip(*parts, strict=True))
        return Chains(chain, log_density, blobs.reshape(log_density.shape))


class MemoryBackend(emcee.backends.HDFBackend):
    """emcee's backend on a file in memory: on a full disk it is one write that fails, and not h5py halfway."""

    def __init__(self, image: io.BytesIO, name: str) -> None:
        super().__init__(image, name=name)

    @property
    def initialized(self) -> bool:
        """Whether the ensemble has taken a step."""
        with self.open() as file:
            return self.name in file


def _open(file: Path | io.BytesIO, mode: str) -> Any:
    """An HDF5 file; untyped, for what stands in it is known to whoever wrote it."""
    return h5py.File(file, mode)


def count_kept_steps(path: Path) -> int:
    """Steps that all ensembles in a chain.h5 have taken; 0 where there is none."""
    if not path.is_file():
        return 0
    with _open(path, "r") as file:
        groups = [file.get(f"ensemble_{k + 1}") for k in range(ENSEMBLES)]
        return min(int(g.attrs["iteration"]) if g is not None else 0 for g in groups)


def _write_mode(file: Any, step: int, mode: Mode) -> None:
    for name in ("point", "covariance", "cost"):
        file[f"modes/{step}/{name}"] = getattr(mode, name)


def walker_count(likelihood: Likelihood) -> int:
    """Walkers of one ensemble: more than twice the unknowns, as the moves demand, and even."""
    return max(16, 2 * len(likelihood.unknowns) + 4)
