"""Points of a likelihood at given values of its unknowns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cradle_env.effects.declaration import Values
from identification.inference.least_squares import bounds
from identification.inference.likelihood import Likelihood


def point_at(likelihood: Likelihood, values: Mapping[str, float]) -> np.ndarray:
    """The point of a likelihood at these values of its unknowns, elsewhere at its start; within bounds."""
    point = likelihood.start()
    for i, u in enumerate(likelihood.unknowns):
        if u.name in values:
            point[i] = u.coordinate(values[u.name])
    return np.clip(point, *bounds(likelihood))


def flatten_values(name: str, values: Values) -> dict[str, float]:
    """{"effect.key": value} of an effect's values; "effect.key[i]" where there are several, and their mean as "[*]"."""
    found = {}
    for key, value in values.items():
        if isinstance(value, list | tuple):
            found |= {f"{name}.{key}[{i}]": one for i, one in enumerate(value, 1)}
            found[f"{name}.{key}[*]"] = sum(value) / len(value)
        else:
            found[f"{name}.{key}"] = value
    return found
