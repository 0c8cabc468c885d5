"""The cradles of the native vector environment one by one, under the names that a single environment has."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from cradle_env.envs.fixed_settings import check_no_setting
from cradle_env.envs.settings import SETTINGS, Settings
from cradle_env.errors import one_line

if TYPE_CHECKING:
    from cradle_env.envs.vector import NewtonCradleVectorEnv

_NAMES = ("settings", "np_random", "np_random_seed", "render_mode", "metadata", "spec", "observation_space",
          "action_space", "render")  # fmt: skip


class Row:
    """What `many` holds of cradle k. Nothing of it can be set."""

    def __init__(self, many: NewtonCradleVectorEnv, k: int) -> None:
        self._many, self._k = many, k

    @property
    def settings(self) -> Settings:
        """As this cradle was made."""
        return self._many.each_settings[self._k]

    @property
    def np_random(self) -> np.random.Generator:
        """Its random numbers."""
        return self._many.np_random[self._k]

    @property
    def np_random_seed(self) -> int:
        """Its seed."""
        return self._many.np_random_seed[self._k]

    @property
    def metadata(self) -> dict[str, Any]:
        """As of a single environment."""
        return {name: value for name, value in self._many.metadata.items() if name != "autoreset_mode"}

    def __getattr__(self, name: str) -> Any:
        if name in ("render_mode", "spec"):
            return getattr(self._many, name)
        if name in ("observation_space", "action_space"):
            return getattr(self._many, f"single_{name}")
        read = "a setting: see the attribute settings" if name in SETTINGS else f"none of {', '.join(_NAMES)}"
        raise AttributeError(f"{name} is {read}")

    def render(self) -> Any:
        """Its picture."""
        return self._many.picture(self._k)


def refuse_to_set(name: str, values: Any) -> NoReturn:
    """AttributeError: a single cradle is a row of arrays, of which nothing can be set."""
    check_no_setting(name, values)
    raise AttributeError(f"{name} cannot be set to {one_line(values)}: single cradles are rows of arrays")
