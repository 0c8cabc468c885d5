"""`gym.make_vec("NewtonCradle-v0", num_envs=K)`: many cradles in one kernel call, on all cores by threads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NoReturn

import numpy as np
from gymnasium import error, logger
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from cradle_env.envs.episodes import Episodes, check_status, shown
from cradle_env.envs.fixed_settings import FixedSettings
from cradle_env.envs.newton_cradle import NewtonCradleEnv
from cradle_env.envs.rows import Row, refuse_to_set
from cradle_env.envs.settings import Settings
from cradle_env.envs.spaces import action_space, observation_space
from cradle_env.envs.state import State, check_state
from cradle_env.envs.vector_arguments import checked_actions, checked_mask, checked_seeds, indices, mapping
from cradle_env.envs.view import View, check_render_mode
from cradle_env.errors import one_line
from cradle_env.mechanics.control_interval import OVER, REWARD, SYNCHRONIZED
from cradle_env.threads import cores

_LIST = "rgb_array_list"


class NewtonCradleVectorEnv(FixedSettings, VectorEnv):
    """`num_envs` cradles, bit for bit what `SyncVectorEnv` makes of as many `NewtonCradleEnv` with equal seeds.

    settings: as for `NewtonCradleEnv`. each: settings of single environments over these, one mapping for each; they
    may not change the spaces. autoreset_mode: "NextStep", "SameStep" or "Disabled". workers: threads, all cores
    where omitted. max_episode_steps: control intervals after which an episode is truncated, if not by `duration`.
    render_mode "rgb_array_list" keeps the pictures of every step until `render` hands them out, those of the last
    episode alone.
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
        for name, value in (("num_envs", num_envs), ("workers", workers)):
            whole = isinstance(value, int | np.integer) and value >= 1
            if not whole and (name == "num_envs" or value is not None):
                raise ValueError(f"{name} is {one_line(value)}; it must be a whole number, at least 1")
        if not isinstance(max_episode_steps, int | np.integer | None):
            raise TypeError(f"max_episode_steps is {one_line(max_episode_steps)}; it must be a whole number, or None")
        if each is not None and len(each) != num_envs:
            raise ValueError(f"each has {len(each)} settings; there are {num_envs} environments")
        self.num_envs = int(num_envs)
        self.settings = Settings.of(**settings)
        #: Settings of each cradle.
        self.each_settings = (
            [self.settings] * num_envs
            if each is None
            else [Settings.of(**{**settings, **mapping(own)}) for own in each]
        )
        if render_mode == "human":
            raise ValueError('render_mode is "human"; a window shows one cradle, so choose "rgb_array" or "ansi"')
        self.render_mode = _LIST if render_mode == _LIST else check_render_mode(render_mode, NewtonCradleEnv.metadata)
        modes = [mode.value for mode in AutoresetMode]
        if not isinstance(autoreset_mode, AutoresetMode) and autoreset_mode not in modes:
            raise ValueError(f"autoreset_mode is {one_line(autoreset_mode)}; choose one of {', '.join(modes)}")
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        fps = max(1, round(1.0 / self.settings.control_interval))
        self.metadata = {**NewtonCradleEnv.metadata, "render_fps": fps, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space = observation_space(self.settings)
        self.single_action_space = action_space(self.settings)
        for own in self.each_settings:
            if observation_space(own) != self.single_observation_space or action_space(own) != self.single_action_space:
                raise ValueError(
                    "each: bobs, actions, length, gravity, duration, dtype and a camera must be the same for all"
                )
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._limit = max_episode_steps if max_episode_steps is not None and max_episode_steps > 0 else np.inf
        self._episodes = Episodes(self.num_envs, self.settings)
        self._random: list[np.random.Generator | None] = [None] * self.num_envs
        self._seeds = [-1] * self.num_envs
        self._steps = np.zeros(self.num_envs, int)
        self._over = np.zeros(self.num_envs, bool)
        self._ready = False
        # Those whose reward is a function.
        self._rewarding = [k for k, own in enumerate(self.each_settings) if not isinstance(own.reward, str)]
        workers = min(workers or cores(), self.num_envs)
        self._steppers = [self._episodes.stepper() for _ in range(workers)]
        self._pool: ThreadPoolExecutor | None = None
        mode = "rgb_array" if render_mode == _LIST else render_mode
        self._views = [] if mode is None else [View(mode, fps, own) for own in self.each_settings]
        self._frames: list[list[np.ndarray]] = [[] for _ in self._views]

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begins all episodes, or those of options["reset_mask"] (K,) bool; environment i has the seed `seed` + i."""
        if self.closed:
            raise error.ClosedEnvironmentError("this environment is closed; make another")
        seeds = checked_seeds(seed, self.num_envs)
        options = mapping({} if options is None else options, "options")
        which = checked_mask(options.pop("reset_mask", None), self.num_envs)
        if not self._ready and not which.all():
            raise error.ResetNeeded(f"there are no episodes {indices(~which)} yet; reset all of them first")
        for k in indices(which):
            if seeds[k] is not None:
                self._random[k], self._seeds[k] = seeding.np_random(seeds[k])
            self._begin(k, options)
        self._over[which] = False
        self._ready = True
        return self._episodes.seen().astype(self.settings.dtype), self._infos(which)

    def _begin(self, k: int, options: Mapping[str, Any] | None = None) -> None:
        """Puts episode k before its release."""
        settings, posterior = self.each_settings[k].for_episode(options)
        cradle, angle = settings.drawn(self._generator(k), posterior)
        ready, self._ready = self._ready, False  # a refusal leaves no episode
        self._episodes.begin(k, settings, cradle, angle)
        self._read(k)
        self._ready = ready
        self._steps[k] = 0
        if self._views:
            self._views[k].begin()
            if self.render_mode == _LIST:
                self._frames[k] = [self._draw(k)]

    def _read(self, k: int) -> None:
        """The camera of environment k, if it has one, reads the angles."""
        noise = self.each_settings[k].camera_noise
        if noise is not None:
            self._episodes.read(k, noise, self._generator(k))

    def _generator(self, k: int) -> np.random.Generator:
        """The random numbers of environment k, seeded by chance if they have not been."""
        random = self._random[k]
        if random is None:
            random, self._seeds[k] = seeding.np_random()
            self._random[k] = random
        return random

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One control interval of every environment that is not to be reset first."""
        if not self._ready:
            self._refuse()
        self._episodes.actions[:] = checked_actions(actions, self._episodes.actions.shape)
        if self.autoreset_mode is AutoresetMode.DISABLED and self._over.any():
            raise error.ResetNeeded(f"episodes {indices(self._over)} are over; reset them with options reset_mask")
        waiting = indices(self._over)
        before = {k: self._episodes.info(k) for k in self._rewarding}
        self._advance(waiting)
        for k in waiting:
            self._begin(k)

        report, moved = self._episodes.report, ~self._over
        rewards = np.where(moved, report[:, REWARD], 0.0)
        for k in self._rewarding:
            if moved[k]:
                rewards[k] = float(self.each_settings[k].reward(before[k], self._episodes.info(k)))  # type: ignore[operator]
        if self.settings.camera_noise is not None:
            for k in indices(moved):
                self._read(k)
        self._steps[moved] += 1
        for k, view in enumerate(self._views):
            if moved[k]:
                view.follow(float(report[k, 0]), float(report[k, 3]))
                if self.render_mode == _LIST:
                    self._frames[k].append(self._draw(k))
        terminated = moved & (report[:, SYNCHRONIZED] > 0.0)
        truncated = moved & ((report[:, OVER] > 0.0) | (self._steps >= self._limit))
        self._over = terminated | truncated
        last: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any():
            final = np.full(self.num_envs, None, dtype=object)
            seen = self._episodes.seen().astype(self.settings.dtype)
            for k in indices(self._over):
                final[k] = seen[k].copy()
            last = {
                "final_obs": final,
                "_final_obs": self._over.copy(),
                "final_info": self._infos(self._over),
                "_final_info": self._over.copy(),
            }
            for k in indices(self._over):
                self._begin(k)
            self._over = np.zeros(self.num_envs, bool)
        seen = self._episodes.seen().astype(self.settings.dtype)
        return seen, rewards, terminated, truncated, {**last, **self._infos()}

    def _advance(self, waiting: list[int]) -> None:
        """Steps all episodes but those waiting, each thread a part of them."""
        bounds = np.linspace(0, self.num_envs, len(self._steppers) + 1).astype(int)

        def work(thread: int) -> int:
            lo, end = bounds[thread], bounds[thread + 1]
            failed = 0
            for hi in [*(k for k in waiting if lo <= k < end), end]:
                failed = self._steppers[thread].step(lo, hi) or failed
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
            k = indices(self._episodes.episodes["status"] != 0)[0]
            check_status(int(self._episodes.episodes["status"][k]), float(self._episodes.report[k, 0]))

    def _infos(self, which: np.ndarray | None = None) -> dict[str, Any]:
        """The infos of all environments, or of some, in Gymnasium's way: an array and a mask for every key."""
        infos: dict[str, Any] = {}
        for name, column in shown(self._episodes.report.T).items():
            values = column.copy()
            infos[name] = values if which is None else np.where(which, values, 0.0)
            infos[f"_{name}"] = np.ones(self.num_envs, bool) if which is None else which.copy()
        return infos

    def render(self) -> tuple[Any, ...] | None:
        """The pictures of all environments; impacts are not marked."""
        if not self._views:
            logger.warn('nothing to render: make the environment with render_mode="human", "rgb_array" or "ansi"')
            return None
        return tuple(self.picture(k) for k in range(self.num_envs))

    def picture(self, k: int) -> Any:
        """The picture of cradle k, or those since it was last asked for."""
        if not self._ready:
            self._refuse()
        if self.render_mode != _LIST:
            return self._draw(k)
        frames, self._frames[k] = self._frames[k], []
        return frames

    def _draw(self, k: int) -> Any:
        return self._views[k].render(self._episodes, k, self._episodes.info(k))

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """What each cradle has, or returns, under a name of a single environment, see `Row`."""
        found = [getattr(Row(self, k), name) for k in range(self.num_envs)]
        return tuple(value(*args, **kwargs) if callable(value) else value for value in found)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """`call`, as other vector environments name it for attributes."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> NoReturn:
        """Refuse: AttributeError."""
        refuse_to_set(name, values)

    def get_state(self) -> State:
        """The whole state of all environments; `set_state` puts it back."""
        arrays = (*self._episodes.arrays(), self._steps, self._over)
        return State(
            settings=tuple(own.lasting for own in self.each_settings),
            cradles=tuple(self._episodes.of),
            arrays=tuple(array.copy() for array in arrays),
            random=[None if random is None else random.bit_generator.state for random in self._random],
            seeds=list(self._seeds),
            ready=self._ready,
        )

    def set_state(self, state: State) -> None:
        """Goes on from a state, bit for bit; ValueError if it is of other environments."""
        if self.closed:
            self._refuse()
        check_state(state, self.each_settings, self._episodes, 2)
        *arrays, steps, over = state.arrays
        self._episodes.restore(tuple(arrays), state.cradles)
        self._steps, self._over, self._seeds = steps.copy(), over.copy(), list(state.seeds)
        for k, saved in enumerate(state.random):
            if saved is None:
                self._random[k] = None
            else:
                self._generator(k).bit_generator.state = saved
                self._seeds[k] = state.seeds[k]
        self._ready = state.ready
        for view in self._views:
            view.begin()

    def _refuse(self) -> NoReturn:
        if self.closed:
            raise error.ClosedEnvironmentError("this environment is closed; make another")
        raise error.ResetNeeded("there are no episodes; call reset first")

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Seeds of the environments."""
        self.np_random  # noqa: B018  seeds those that have none
        return tuple(self._seeds)

    @property
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Random generators of the environments."""
        return tuple(self._generator(k) for k in range(self.num_envs))

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
