"""`gym.make_vec("NewtonCradle-v0", num_envs=K)`: many cradles in one kernel call, on all cores by threads."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from gymnasium import error
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from cradle_env.env import NewtonCradleEnv, State, check_render_mode
from cradle_env.episodes import INFO, OVER, REWARD, SYNCHRONIZED, Episodes, check_status
from cradle_env.settings import Settings
from cradle_env.spaces import action_space, observation_space
from cradle_env.trajectory import IMPACT
from cradle_env.view import View


class NewtonCradleVectorEnv(VectorEnv):
    """`num_envs` cradles, bit for bit what `SyncVectorEnv` makes of as many `NewtonCradleEnv` with equal seeds.

    settings: as for `NewtonCradleEnv`. each: settings of single environments over these, one mapping for each; they
    may not change the spaces. autoreset_mode: "NextStep", "SameStep" or "Disabled". workers: threads, all cores
    where omitted. max_episode_steps: control intervals after which an episode is truncated, if not by `duration`.
    """

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        each: Sequence[Mapping[str, Any]] | None = None,
        workers: int | None = None,
        **settings: Any,
    ) -> None:
        if not isinstance(num_envs, int | np.integer) or num_envs < 1:
            raise ValueError(f"num_envs is {num_envs!r}; it must be a whole number, at least 1")
        if each is not None and len(each) != num_envs:
            raise ValueError(f"each has {len(each)} settings; there are {num_envs} environments")
        self.num_envs = int(num_envs)
        self.settings = Settings.of(**settings)
        self._each = [self.settings] * num_envs if each is None else [Settings.of(**settings, **own) for own in each]
        self.render_mode = check_render_mode(render_mode, NewtonCradleEnv.metadata)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**NewtonCradleEnv.metadata, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space = observation_space(self.settings)
        self.single_action_space = action_space(self.settings)
        for own in self._each:
            if observation_space(own) != self.single_observation_space or action_space(own) != self.single_action_space:
                raise ValueError("each: bobs, actions, length, gravity, duration and dtype must be the same for all")
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._limit = max_episode_steps if max_episode_steps is not None and max_episode_steps > 0 else np.inf
        self._episodes = Episodes(self.num_envs, self.settings)
        self._random: list[np.random.Generator | None] = [None] * self.num_envs
        self._seeds = [-1] * self.num_envs
        self._steps = np.zeros(self.num_envs, int)
        self._over = np.zeros(self.num_envs, bool)
        self._ready = False
        workers = min(workers or os.cpu_count() or 1, self.num_envs)
        self._steppers = [self._episodes.stepper() for _ in range(workers)]
        self._pool: ThreadPoolExecutor | None = None
        mode, fps = self.render_mode, NewtonCradleEnv.metadata["render_fps"]
        self._views = [] if mode is None else [View(mode, fps, own) for own in self._each]

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begins all episodes, or those of options["reset_mask"] (K,) bool; environment i has the seed `seed` + i."""
        if self.closed:
            raise error.ClosedEnvironmentError("this environment is closed; make another")
        seeds = [None] * self.num_envs if seed is None else seed
        seeds = [seeds + i for i in range(self.num_envs)] if isinstance(seeds, int | np.integer) else list(seeds)
        if len(seeds) != self.num_envs:
            raise ValueError(f"{len(seeds)} seeds for {self.num_envs} environments; give one each, or a single one")
        options = dict(options or {})
        which = _checked_mask(options.pop("reset_mask", None), self.num_envs)
        if not self._ready:
            self._observations = np.zeros(self.observation_space.shape, self.settings.dtype)  # type: ignore[arg-type]
        for k in _indices(which):
            if seeds[k] is not None:
                self._random[k], self._seeds[k] = seeding.np_random(seeds[k])
            self._begin(k, options)
        self._over[which] = False
        self._ready = True
        return self._observations.copy(), self._infos(which)

    def _begin(self, k: int, options: Mapping[str, Any] | None = None) -> None:
        """Puts episode k before its release, shown in `_observations`."""
        settings, posterior = self._each[k].for_episode(options)
        random = self._random[k]
        if random is None:
            random, self._seeds[k] = seeding.np_random()
            self._random[k] = random
        cradle, angle = settings.drawn(random, posterior)
        self._episodes.begin(k, settings, cradle, angle, self._observations)
        self._steps[k] = 0
        if self._views:
            self._views[k].begin()

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One control interval of every environment that is not to be reset first."""
        if not self._ready:
            if self.closed:
                raise error.ClosedEnvironmentError("this environment is closed; make another")
            raise error.ResetNeeded("call reset before step")
        actions = self._checked_actions(actions)
        if self.autoreset_mode is AutoresetMode.DISABLED and self._over.any():
            raise error.ResetNeeded(f"episodes {_indices(self._over)} are over; reset them with options reset_mask")
        waiting = _indices(self._over)
        custom = [k for k, own in enumerate(self._each) if not isinstance(own.reward, str)]
        before = {k: self._info(k) for k in custom}
        self._advance(actions, waiting)
        for k in waiting:
            self._begin(k)

        report, moved = self._episodes.report, ~self._over
        rewards = np.where(moved, report[:, REWARD], 0.0)
        for k in custom:
            if moved[k]:
                rewards[k] = float(self._each[k].reward(before[k], self._info(k)))  # type: ignore[operator]
        self._steps[moved] += 1
        for k, view in enumerate(self._views):
            if moved[k]:
                view.follow(self._info(k), np.zeros(0, IMPACT))
        terminated = moved & (report[:, SYNCHRONIZED] > 0.0)
        truncated = moved & ((report[:, OVER] > 0.0) | (self._steps >= self._limit))
        self._over = terminated | truncated
        last: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any():
            final = np.full(self.num_envs, None, dtype=object)
            for k in _indices(self._over):
                final[k] = self._observations[k].copy()
            last = {
                "final_obs": final,
                "_final_obs": self._over.copy(),
                "final_info": self._infos(self._over),
                "_final_info": self._over.copy(),
            }
            for k in _indices(self._over):
                self._begin(k)
            self._over = np.zeros(self.num_envs, bool)
        return self._observations.copy(), rewards, terminated, truncated, {**last, **self._infos()}

    def _checked_actions(self, actions: Any) -> np.ndarray:
        try:
            checked = np.ascontiguousarray(actions, dtype=float)
        except (TypeError, ValueError):
            checked = np.empty(0)
        if checked.shape != self.action_space.shape:
            raise error.InvalidAction(f"actions have shape {np.shape(actions)}; give numbers {self.action_space.shape}")
        outside = ~(np.abs(checked) <= 1.0).all(axis=1)
        if outside.any():
            k = _indices(outside)[0]
            raise error.InvalidAction(f"the action of environment {k} is {checked[k].tolist()}; it must be in [-1, 1]")
        return checked

    def _advance(self, actions: np.ndarray, waiting: list[int]) -> None:
        """Steps all episodes but those waiting, each thread a part of them."""
        bounds = np.linspace(0, self.num_envs, len(self._steppers) + 1).astype(int)

        def work(thread: int) -> int:
            lo, end = bounds[thread], bounds[thread + 1]
            failed = 0
            for hi in [*(k for k in waiting if lo <= k < end), end]:
                failed = self._steppers[thread].step(actions, self._observations, lo, hi) or failed
                lo = hi + 1
            return failed

        if len(self._steppers) == 1:
            failed = [work(0)]
        else:
            if self._pool is None:
                self._pool = ThreadPoolExecutor(len(self._steppers))
            failed = list(self._pool.map(work, range(len(self._steppers))))
        if any(failed):
            self._ready = False
            k = _indices(self._episodes.episodes["status"] != 0)[0]
            check_status(int(self._episodes.episodes["status"][k]), float(self._episodes.report[k, 0]))

    def _info(self, k: int) -> dict[str, float]:
        return dict(zip(INFO, self._episodes.report[k].tolist(), strict=False))

    def _infos(self, which: np.ndarray | None = None) -> dict[str, Any]:
        """The infos of all environments, or of some, in Gymnasium's way: an array and a mask for every key."""
        infos: dict[str, Any] = {}
        for column, name in enumerate(INFO):
            values = self._episodes.report[:, column].copy()
            infos[name] = values if which is None else np.where(which, values, 0.0)
            infos[f"_{name}"] = np.ones(self.num_envs, bool) if which is None else which.copy()
        return infos

    def render(self) -> tuple[Any, ...] | None:
        """The pictures of all environments; impacts are not marked."""
        if not self._views:
            return None
        return tuple(view.render(self._episodes, k, self._info(k)) for k, view in enumerate(self._views))

    def get_state(self) -> State:
        """The whole state of all environments; `set_state` puts it back."""
        return State(
            arrays=tuple(
                array.copy() for array in (*self._episodes.arrays(), self._observations, self._steps, self._over)
            ),
            random=[None if random is None else random.bit_generator.state for random in self._random],
            ready=self._ready,
        )

    def set_state(self, state: State) -> None:
        """Goes on from a state, bit for bit; ValueError if it is of other environments."""
        *arrays, observations, steps, over = state.arrays
        if arrays[2].shape != self._episodes.state.shape:
            raise ValueError(f"the state is of {len(arrays[2])} environments with {arrays[2].shape[1]} bobs each")
        self._episodes.restore(tuple(arrays))
        self._observations, self._steps, self._over = observations.copy(), steps.copy(), over.copy()
        for k, saved in enumerate(state.random):
            if saved is not None:
                self._random[k] = self._random[k] or seeding.np_random()[0]
                self._random[k].bit_generator.state = saved  # type: ignore[union-attr]
        self._ready = state.ready

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Seeds of the environments."""
        return tuple(self._seeds)

    @property
    def np_random(self) -> tuple[np.random.Generator | None, ...]:  # type: ignore[override]
        """Random generators of the environments."""
        return tuple(self._random)

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the threads, closes the windows."""
        for view in self._views:
            view.close()
        self._ready = False
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_pool": None}


def _indices(which: Any) -> list[int]:
    return np.flatnonzero(which).tolist()


def _checked_mask(mask: Any, count: int) -> np.ndarray:
    if mask is None:
        return np.ones(count, bool)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (count,):
        raise TypeError(f"options['reset_mask'] must be a numpy array of {count} booleans, got {mask!r}")
    if not mask.any():
        raise ValueError("options['reset_mask'] resets nothing; set at least one of it")
    return mask.copy()
