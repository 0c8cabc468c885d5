"""Points of a likelihood at given values of its unknowns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cradle_env.effects.declaration import Values
from identification.inference.least_squares import bounds
from identification.inference.likelihood import Likelihood


def point_at(likelihood: Likelihood, values: Mapping[str, float]) -> np.ndarray:
    """Return the point with these values of the unknowns, moved into their bounds; other unknowns keep their start."""
    point = likelihood.start()
    for i, u in enumerate(likelihood.unknowns):
        if u.name in values:
            point[i] = u.coordinate(values[u.name])
    return np.clip(point, *bounds(likelihood))


def flatten_values(name: str, values: Values) -> dict[str, float]:
    """Name the values of an effect: {"effect.key": value}.

    A key with several values gives "effect.key[i]" for each, and "effect.key[*]" for their mean.

    >>> flatten_values("spacer_offset", {"offset": [0.0, 0.002]})
    {'spacer_offset.offset[1]': 0.0, 'spacer_offset.offset[2]': 0.002, 'spacer_offset.offset[*]': 0.001}
    """
    found = {}
    for key, value in values.items():
        if isinstance(value, list | tuple):
            found |= {f"{name}.{key}[{i}]": one for i, one in enumerate(value, 1)}
            found[f"{name}.{key}[*]"] = sum(value) / len(value)
        else:
            found[f"{name}.{key}"] = value
    return found
