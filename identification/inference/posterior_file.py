"""Write and read posterior.nc: the samples of a calibration, for ArviZ and for `Posterior.load`."""

from __future__ import annotations

import dataclasses
import io
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cradle_env import hdf5_files
from identification.experiment.experiment import Experiment
from identification.inference.contributions import Contributions
from identification.inference.convergence import Convergence
from identification.inference.gap import Gap
from identification.inference.likelihood import Likelihood
from identification.inference.samples import FORMAT, Samples
from identification.inference.unknowns import SEARCH_WIDTHS
from identification.storage.files import ExperimentError, write_file
from identification.storage.schema import check_schema, parse_json

_REMEDY = "it is not a posterior of `cradle calibrate`"
#: Relative rounding error of a value that was exponentiated for the file and whose logarithm is taken when reading.
_ROUNDING = 1e-9
#: Largest plausible λ [1/s]: the mean of ln(1/σ)/t from 1 s on with σ > 0.001 is at most 7 1/s.
_MOST_LAMBDA = 10.0
#: Dimensions of the arrays. One ensemble is one chain, since its walkers move by each other's positions.
DIMENSIONS = ("chain", "draw")


def write_posterior(samples: Samples, path: Path) -> Path:
    """Write posterior.nc, whole or not at all."""
    import h5netcdf

    with io.BytesIO() as buffer:
        with h5netcdf.File(buffer, "w") as file:
            for name, known in variables(samples).items():
                group = _group(file, name, next(values.shape for values, _ in known.values()))
                for key, (values, unit) in known.items():
                    group.create_variable(key, DIMENSIONS, data=values).attrs["units"] = unit
            file["posterior"].attrs.update(attributes(samples))
        return write_file(path, buffer.getvalue())


def variables(samples: Samples) -> dict[str, dict[str, tuple[np.ndarray, str]]]:
    """Variables of posterior.nc by group and name: values (chains, draws), and their unit."""
    E, S, W, _ = samples.chain.shape
    flat = samples.chain.reshape(E, S * W, -1)
    posterior = {u.name: (np.asarray(u.value(flat[..., k])), u.unit) for k, u in enumerate(samples.unknowns)}
    if samples.newton_exponents is not None:
        posterior["lambda"] = (samples.newton_exponents.reshape(E, S * W), "1/s")
    return {"posterior": posterior, "sample_stats": {"lp": (samples.log_density.reshape(E, S * W), "1")}}


def _group(file: Any, name: str, shape: tuple[int, ...]) -> Any:
    group = file.create_group(name)
    for dimension, count in zip(DIMENSIONS, shape, strict=True):
        group.dimensions[dimension] = count
        group.create_variable(dimension, (dimension,), data=np.arange(count))
    return group


def attributes(samples: Samples) -> dict[str, Any]:
    """Attributes of posterior.nc from which `Posterior.load`, with the samples, makes the posterior again."""
    gap, told = samples.gap, samples.contributions
    by_bob = {part: values.tolist() for part, values in gap.rms.items()}
    return {
        "format": FORMAT,
        "walkers": samples.chain.shape[2],
        "seed": samples.seed,
        "experiment": json.dumps(samples.experiment.texts()),
        "inputs": samples.experiment.digest,
        "convergence": json.dumps(dataclasses.asdict(samples.convergence)),
        "inflations": list(samples.likelihood.noise_model.inflations),
        "gap": json.dumps([gap.train, gap.held_out, by_bob, gap.allowed]),
        "contributions": json.dumps(None if told is None else told.content()),
    }


def read_posterior(path: Path, workers: int | None = None) -> Samples:
    """Read posterior.nc. Raises ExperimentError, with file and field, if it is not such a file."""
    try:
        with hdf5_files.opened(path) as file:
            samples, stats = hdf5_files.group(file, "posterior"), hdf5_files.group(file, "sample_stats")
            known = {name: _scalar(value) for name, value in hdf5_files.attributes(samples).items()}
            check_schema(known, "posterior", f"{path}: posterior", _REMEDY)
            likelihood = _likelihood(path, known, set(samples), workers)
            names = [u.name for u in likelihood.unknowns]
            log_density = hdf5_files.numbers(stats, "lp", (None, None))
            shape = log_density.shape
            found = {name: hdf5_files.numbers(samples, name, shape) for name in names}
            rates = hdf5_files.numbers(samples, "lambda", shape) if "lambda" in samples else None
    except hdf5_files.UnreadableError as problem:
        raise ExperimentError(f"{problem}; {_REMEDY}") from None
    W = known["walkers"]
    if 0 in shape or shape[1] % W:
        raise ExperimentError(
            f"{path}: posterior has {shape[0]} chains of {shape[1]} draws, impossible with {W} walkers; {_REMEDY}"
        )

    def shaped(values: np.ndarray) -> np.ndarray:
        return values.reshape(len(values), -1, W)

    if rates is not None and (np.abs(rates) > _MOST_LAMBDA).any():
        raise ExperimentError(f"{path}: posterior/lambda has values beyond {_MOST_LAMBDA:g} 1/s; {_REMEDY}")
    coordinates = []
    for u in likelihood.unknowns:
        values = found[u.name]
        # Rounding may move a value out of its bounds.
        slack = _ROUNDING * np.maximum(np.abs(values), 1.0 if not u.log else 0.0)
        if not ((values >= u.low - slack) & (values <= u.high + slack) & np.isfinite(values)).all():
            raise ExperimentError(f"{path}: posterior/{u.name} has values outside its bounds; {_REMEDY}")
        coordinates.append(shaped(np.log(values) if u.log else values))
    return Samples(
        likelihood,
        np.stack(coordinates, axis=-1),
        shaped(log_density),
        None if rates is None else shaped(rates),
        _convergence(path, known),
        _gap(path, known, likelihood.experiment.cradle.bobs),
        known["seed"],
        _contributions(path, known),
    )


def _scalar(value: Any) -> Any:
    """Convert a list of one number into the number, since netCDF has no scalar attributes."""
    return value[0] if isinstance(value, list) and len(value) == 1 else value


def _likelihood(path: Path, known: Mapping[str, Any], names: set[str], workers: int | None) -> Likelihood:
    """Make the likelihood of the experiment in the file."""
    at = f"{path}: posterior.experiment"
    texts = parse_json(known["experiment"], "posterior-experiment", at, _REMEDY)
    try:
        # The file has a rewritten copy of the experiment; the digest stays that of the calibrated files.
        experiment = Experiment.from_texts(texts).with_source(known["inputs"])
        likelihood = Likelihood(
            experiment, workers=workers, parameters=[name for name in SEARCH_WIDTHS if name in names]
        )
    except ValueError as problem:
        raise ExperimentError(f"{at}: {problem}") from None
    inflations = np.atleast_1d(known["inflations"]).tolist()
    if len(inflations) != len(experiment.runs):
        raise ExperimentError(
            f"{path}: posterior.inflations has {len(inflations)} values for {len(experiment.runs)} runs; {_REMEDY}"
        )
    if not likelihood.unknowns:
        raise ExperimentError(f"{path}: posterior has no unknown of its experiment; {_REMEDY}")
    return likelihood.with_noise(likelihood.noise_model.with_inflations(inflations))


def _convergence(path: Path, known: Mapping[str, Any]) -> Convergence:
    content = parse_json(known["convergence"], "posterior-convergence", f"{path}: posterior.convergence", _REMEDY)
    return Convergence(**{**content, "reasons": tuple(content["reasons"])})


def _contributions(path: Path, known: Mapping[str, Any]) -> Contributions | None:
    """None also for a file of an earlier version."""
    text = known.get("contributions", "null")
    content = parse_json(text, "posterior-contributions", f"{path}: posterior.contributions", _REMEDY)
    return None if content is None else Contributions.from_content(content)


def _gap(path: Path, known: Mapping[str, Any], bobs: int) -> Gap:
    at = f"{path}: posterior.gap"
    train, held_out, by_bob, *allowed = parse_json(known["gap"], "posterior-gap", at, _REMEDY)
    for part, values in by_bob.items():
        if len(values) != 1 + bobs:
            raise ExperimentError(f"{at}: {part} has {len(values)} values for {bobs} bobs; {_REMEDY}")
    rms = {part: np.array(values, dtype=float) for part, values in by_bob.items()}
    return Gap(train, held_out, rms, allowed[0] if allowed else math.nan)
