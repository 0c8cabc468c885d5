"""Saved states of environments: what `get_state` returns and `set_state` takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.envs.episodes import EPISODE_ARRAYS, Episodes
from cradle_env.envs.settings import Settings
from cradle_env.errors import one_line


@dataclass(frozen=True)
class State:
    """A state of one environment or of many: their settings and cradles, the arrays of their episodes, their random
    numbers."""

    settings: tuple[Mapping[str, Any], ...]
    cradles: tuple[Cradle | None, ...]
    arrays: tuple[np.ndarray, ...]
    random: list[Mapping[str, Any] | None]
    seeds: list[int]
    ready: bool

    def repeated(self, count: int) -> State:
        """This state of a single environment as that of a vector environment of `count`, for planners that try many
        actions at once."""
        repeated = [np.repeat(array, count, axis=0) for array in self.arrays]
        episodes, more = repeated[:EPISODE_ARRAYS], repeated[EPISODE_ARRAYS:]
        if len(more) == 1:  # a scalar environment keeps its impacts
            more = [np.maximum(episodes[3]["steps"], 0), np.zeros(count, bool)]
        return State(
            settings=self.settings * count,
            cradles=self.cradles * count,
            arrays=(*episodes, *more),
            random=self.random * count,
            seeds=self.seeds * count,
            ready=self.ready,
        )


def check_state(state: State, settings: Sequence[Settings], episodes: Episodes, more: int) -> None:
    """TypeError unless it is a state, ValueError unless it is of environments of this kind, which has so many more
    arrays than those of its episodes, and with these settings."""
    if not isinstance(state, State):
        raise TypeError(f"the state is {state!r:.100}; it must be what get_state returns")
    if len(state.settings) != len(settings):
        raise ValueError(f"the state is of {len(state.settings)} environments; this is {len(settings)}")
    if len(state.arrays) != len(episodes.arrays()) + more:
        raise ValueError("the state is of a vector environment, or this is one; each takes those of its own kind")
    for theirs, own in zip(state.settings, settings, strict=True):
        for name, value in own.lasting.items():
            if theirs[name] != value:
                raise ValueError(
                    f"the state is of an environment with {name} {theirs[name]!r}; here it is {one_line(value)}"
                )
    for cradle in state.cradles:
        if cradle is not None:
            episodes.check_shown(cradle)
