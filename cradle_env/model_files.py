"""Files that describe a model: a [model] table, and the posterior of a calibration."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from cradle_env import hdf5_files
from cradle_env.cradle import CRADLE_NUMBERS
from cradle_env.effects import MODELS, effect
from cradle_env.errors import one_line, unknown_key
from cradle_env.toml_reader import MOST_CHARACTERS, parse_toml


def read_model(path: Path) -> tuple[str, dict[str, dict[str, float]]]:
    """(base, effects) of the [model] table of a TOML file; ValueError, naming file and key, if it is not one."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            content = parse_toml(file.read(MOST_CHARACTERS + 1))
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror or error}; name a TOML file with a [model] table") from None
    except ValueError as error:
        raise ValueError(f"{path} is no TOML file: {error}") from None
    model = content.get("model")
    if not isinstance(model, dict):
        raise ValueError(f"{path} has no [model] table; write one, with base and effects")
    for key in model:
        if key not in ("base", "effects", "parameters"):
            raise ValueError(f"{path}: " + unknown_key("key of [model]", key, ("base", "effects", "parameters")))
    base = str(model.get("base", "nsp"))
    if base not in MODELS:
        raise ValueError(f"{path}: " + unknown_key("base", base, MODELS))
    named, parameters = model.get("effects", []), model.get("parameters", {})
    if not isinstance(named, list) or not all(isinstance(name, str) for name in named):
        raise ValueError(
            f'{path}: effects is {one_line(named)}; it must be a list of names, as effects = ["quadratic_drag"]'
        )
    if not isinstance(parameters, dict) or not all(isinstance(values, dict) for values in parameters.values()):
        raise ValueError(
            f"{path}: parameters is {one_line(parameters)}; write a table [model.parameters.EFFECT] of numbers"
        )
    effects: dict[str, dict[str, float]] = {}
    for name in (*named, *parameters):
        values = parameters.get(name, {})
        try:
            declared = effect(name.removeprefix("-"))
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        missing = [p.key for p in declared.parameters if p.key not in values]
        if missing and not name.startswith("-"):
            raise ValueError(
                f"{path}: effect {name} has no value for {', '.join(missing)}; state it in [model.parameters]"
            )
        effects[name] = dict(values)
    return base, effects


@functools.lru_cache(maxsize=8)
def _posterior(path: str, _changed: float) -> Mapping[str, np.ndarray]:
    try:
        with hdf5_files.opened(Path(path)) as file:
            group = hdf5_files.group(file, "posterior")
            draws = {
                name: np.ravel(hdf5_files.numbers(group, name))
                for name in group
                if name in (*CRADLE_NUMBERS, "delta") or "." in name
            }
    except hdf5_files.UnreadableError as problem:
        raise ValueError(
            f"{path} is no posterior of a calibration; name the posterior.nc that one has written ({problem})"
        ) from None
    if not draws:
        raise ValueError(f"{path} holds no parameter of a cradle")
    counts = {name: len(values) for name, values in draws.items()}
    if len(set(counts.values())) > 1 or 0 in counts.values():
        told = ", ".join(f"{count} of {name}" for name, count in counts.items())
        raise ValueError(f"{path} must hold equally many draws of all parameters, at least one; it has {told}")
    return MappingProxyType(draws)


def read_posterior(path: Any) -> Mapping[str, np.ndarray]:
    """Joint draws of a calibration, posterior.nc, by name of the parameter; each of shape (draws,)."""
    try:
        changed = Path(path).stat().st_mtime
    except (OSError, TypeError):
        raise ValueError(f"there is no file {str(path)!r}; name the posterior.nc of a calibration") from None
    return _posterior(str(path), changed)
