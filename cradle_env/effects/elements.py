"""Values of an effect's parameters by name, where each bob or gap has its own: "offset[1]", or "offset[*]", all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cradle_env.parameter_name import ALL, ParameterName


def with_value(known: Mapping[str, Any], name: ParameterName, value: float) -> dict[str, Any]:
    """The values of an effect with one changed: of "c2", of "offset[1]" among several, or of all, "offset[*]"."""
    if name.element is None:
        return {**known, name.key: value}
    several = known.get(name.key)
    if not isinstance(several, Sequence):
        raise ValueError(f"{name}: {name.effect}.{name.key} has no values by number here; set {name.effect}.{name.key}")
    several = list(several)
    if name.element == ALL:
        return {**known, name.key: [value] * len(several)}
    if name.element > len(several):
        raise ValueError(f"{name}: {name.effect}.{name.key} has {len(several)} values; number them from 1")
    several[name.element - 1] = value
    return {**known, name.key: several}
