"""Frozen objects that hold read-only mappings, made fit for pickle by way of their fields."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping


def reduce_to_fields(instance) -> tuple:
    """What `__reduce__` of a frozen dataclass returns: its fields, from which `rebuild` makes it."""
    return rebuild, (type(instance), _plain(instance))


def rebuild(kind: type, fields: dict):
    """An object of this kind from its fields."""
    return kind(**fields)


def _plain(value):
    """A frozen dataclass or mapping as plain dictionaries."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if dataclasses.is_dataclass(value):
        return {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    return value
