"""`gym.make("NewtonCradle-v0")`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import gymnasium as gym
import numpy as np
from gymnasium import error

from cradle_env.episodes import INFO, OVER, REWARD, SYNCHRONIZED, Episodes, Stepper, check_status
from cradle_env.mechanics.control import BAD_ACTION
from cradle_env.settings import Settings
from cradle_env.spaces import action_space, observation_space


class NewtonCradleEnv(gym.Env[np.ndarray, np.ndarray]):
    """Newton's cradle."""

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array", "ansi"], "render_fps": 60}  # noqa: RUF012  as Gymnasium declares it

    def __init__(self, render_mode: str | None = None, **settings: Any) -> None:
        self.settings = Settings.of(**settings)
        self.render_mode = check_render_mode(render_mode, self.metadata)
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / self.settings.control_interval))}
        self.observation_space = observation_space(self.settings)
        self.action_space = action_space(self.settings)
        self._episodes = Episodes(1, self.settings)
        self._stepper = Stepper(self.settings.bobs)
        self._action = np.zeros((1, *self.action_space.shape))
        self._shape = (1, *self.observation_space.shape)
        self._dtype = self.settings.dtype
        self._reward = None if isinstance(self.settings.reward, str) else self.settings.reward
        self._info: dict[str, float] = {}
        self._ready, self._closed = False, False
        self._canvas = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begins an episode; `options` change settings for this one, see the class."""
        if self._closed:
            raise error.ClosedEnvironmentError("this environment is closed; make another")
        settings, posterior = self.settings.for_episode(options)
        super().reset(seed=seed)
        cradle, angle = settings.drawn(self.np_random, posterior)
        observation = np.empty(self._shape, self._dtype)
        self._episodes.begin(0, settings, cradle, angle, observation)
        self._ready = True
        self._info = self._shown()
        if self.render_mode == "human":
            self.render()
        return observation[0], self._info.copy()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One control interval."""
        if not self._ready:
            self._refuse()
        if not isinstance(action, np.ndarray) or action.shape != self._action.shape[1:]:
            action = self.settings.checked_action(action)
        self._action[0] = action
        observation = np.empty(self._shape, self._dtype)
        status = self._stepper.step(self._episodes, self._action, observation, 0, 1)
        if status:
            if status == BAD_ACTION:
                self.settings.checked_action(action)
            self._ready = False
            check_status(status, self._info["time"])
        row = self._episodes.report[0].tolist()
        info = dict(zip(INFO, row, strict=False))  # the first part of the report
        reward = row[REWARD] if self._reward is None else float(self._reward(self._info, info))
        self._info = info
        if self.render_mode == "human":
            self.render()
        return observation[0], reward, row[SYNCHRONIZED] > 0.0, row[OVER] > 0.0, info

    def render(self) -> Any:
        """A picture as (H, W, 3) uint8, a text, or a window, by `render_mode`."""

    def close(self) -> None:
        """Closes the window; no step afterwards."""
        self._ready, self._closed = False, True

    @property
    def impacts(self) -> np.ndarray:
        """Impacts of the last step: time [s], pair (i: bobs i and i + 1), speed [m/s], loss [J]."""
        return self._stepper.rows(int(self._info["impacts"]))

    def get_state(self) -> State:
        """The whole state, motion, hysteresis memory, random numbers and all; `set_state` puts it back."""
        return State(
            arrays=tuple(array.copy() for array in self._episodes.arrays()),
            random=[self.np_random.bit_generator.state],
            ready=self._ready,
        )

    def set_state(self, state: State) -> None:
        """Goes on from a state, bit for bit as its environment would have; ValueError if it is of another cradle."""
        if state.arrays[2].shape != self._episodes.state.shape:
            raise ValueError(f"the state is of {state.arrays[2].shape[1]} bobs; this cradle has {self.settings.bobs}")
        self._episodes.restore(state.arrays)
        self.np_random.bit_generator.state = state.random[0]  # type: ignore[assignment]
        self._info, self._ready = self._shown(), state.ready

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_canvas": None}

    def _shown(self) -> dict[str, float]:
        return dict(zip(INFO, self._episodes.report[0].tolist(), strict=False))  # the first part of the report

    def _refuse(self) -> NoReturn:
        if self._closed:
            raise error.ClosedEnvironmentError("this environment is closed; make another")
        raise error.ResetNeeded("call reset before step")


@dataclass(frozen=True)
class State:
    """A state of one environment or of many: the arrays of their episodes, their random numbers."""

    arrays: tuple[np.ndarray, ...]
    random: list[Mapping[str, Any] | None]
    ready: bool


def check_render_mode(mode: str | None, metadata: dict[str, Any]) -> str | None:
    """The mode, if there is such a one; ValueError otherwise."""
    if mode is not None and mode not in metadata["render_modes"]:
        raise ValueError(f"render_mode is {mode!r}; choose one of {', '.join(metadata['render_modes'])}")
    return mode
