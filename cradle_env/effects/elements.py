"""Values of parameters by name, where an effect has one for each bob or gap: "offset[1]", or "offset[*]", all alike."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def element_of(key: str) -> tuple[str, int | None]:
    """("offset", 0) of "offset[1]": a parameter and which of its values, all of them alike for "[*]" (−1), or None
    for a parameter of one value."""
    name, bracket, which = key.partition("[")
    if not bracket:
        return name, None
    return name, -1 if which == "*]" else int(which[:-1]) - 1


def with_value(known: Mapping[str, Any], key: str, value: float) -> dict[str, Any]:
    """The values of an effect with one more: of "c2", of "offset[1]" among several, or of all alike, "offset[*]"."""
    name, element = element_of(key)
    if element is None:
        return {**known, name: value}
    several = list(known[name])
    several = [value] * len(several) if element < 0 else [*several[:element], value, *several[element + 1 :]]
    return {**known, name: several}
