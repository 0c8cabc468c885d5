"""What a vector environment is given, checked before anything changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import error

from cradle_env.envs.settings import as_numbers
from cradle_env.errors import one_line


def checked_actions(actions: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Actions as float64 of this shape; InvalidAction unless all are finite numbers."""
    checked = as_numbers(actions)
    if checked.shape != shape:
        told = f"of shape {actions.shape} and type {actions.dtype}" if isinstance(actions, np.ndarray) else ""
        wanted = f"finite numbers of shape {shape}"
        raise error.InvalidAction(f"actions are {told or repr(actions)[:100]}; they must be {wanted}")
    if not np.isfinite(checked).all():
        k = indices(~np.isfinite(checked).all(axis=1))[0]
        raise error.InvalidAction(f"the action of environment {k} is {checked[k].tolist()}; it must be finite")
    return checked


def checked_seeds(seed: int | Sequence[int | None] | None, count: int) -> list[int | None]:
    """A seed for each environment: `seed` + i where it is a single one; ValueError where they are too few or many."""
    if seed is None:
        return [None] * count
    if isinstance(seed, int | np.integer):
        return [int(seed) + i for i in range(count)]
    seeds = list(seed)
    if len(seeds) != count:
        raise ValueError(f"{len(seeds)} seeds for {count} environments; give one each, or a single one")
    return seeds


def indices(which: Any) -> list[int]:
    """Where it is true."""
    return np.flatnonzero(which).tolist()


def mapping(given: Any, name: str = "each") -> dict[str, Any]:
    """A copy of it; TypeError if it is no mapping."""
    if not isinstance(given, Mapping):
        wanted = "a dictionary" if name == "options" else "one dictionary of settings for each environment"
        raise TypeError(f"{name} has {one_line(given)}; it must be {wanted}")
    return dict(given)


def checked_mask(mask: Any, count: int) -> np.ndarray:
    """The mask of a reset as a copy, all true where None; TypeError or ValueError unless it is one."""
    if mask is None:
        return np.ones(count, bool)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        raise TypeError(f"options['reset_mask'] is {one_line(mask)}; it must be a numpy array of {count} booleans")
    if mask.shape != (count,):
        raise ValueError(f"options['reset_mask'] has shape {mask.shape}; it must have shape ({count},)")
    if not mask.any():
        raise ValueError("options['reset_mask'] resets nothing; set at least one of it")
    return mask.copy()
