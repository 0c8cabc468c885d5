"""The native vector environment for Stable-Baselines3: many cradles in one kernel call, as its `VecEnv`."""
# pyright: reportMissingImports=false

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.error import DependencyNotInstalled
from gymnasium.vector import AutoresetMode

import cradle_env  # noqa: F401  registers the environments

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise DependencyNotInstalled(
        "cradle_env.envs.sb3 needs Stable-Baselines3: pip install 'newtons-cradle[examples]'"
    ) from error


class CradleVecEnv(VecEnv):
    """`num_envs` cradles for an algorithm of Stable-Baselines3, stepped together on all cores.

    It returns what a `DummyVecEnv` of as many environments with equal seeds returns, bit for bit.

    Parameters
    ----------
    name : a registered environment that has a native vector environment, such as "NewtonCradleMedium-v0"; or such a
        vector environment, made with autoreset_mode="SameStep".
    num_envs : number of cradles, at least 1.
    **settings : as for `gym.make_vec(name)`. An episode that is over begins anew in the same step, as
        Stable-Baselines3 expects; another `autoreset_mode` is refused.

    Raises
    ------
    DependencyNotInstalled : on import, where Stable-Baselines3 is not installed.
    TypeError, ValueError : settings that the environment refuses; options that differ between cradles; another mode.
    AttributeError : `set_attr`, and what single cradles have not: they are rows of arrays, see `Row`.

    Examples
    --------
    ```python
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize
    from cradle_env.envs.sb3 import CradleVecEnv

    cradles = VecNormalize(VecMonitor(CradleVecEnv("NewtonCradleMedium-v0", num_envs=16)))
    model = PPO("MlpPolicy", cradles).learn(100_000)
    model.save("agent"), cradles.save("scales.pkl")
    ```
    """

    def __init__(self, name: str | Any = "NewtonCradle-v0", num_envs: int = 1, **settings: Any) -> None:
        if isinstance(name, str):
            settings = {"autoreset_mode": "SameStep", **settings}
            name = gym.make_vec(name, num_envs, vectorization_mode="vector_entry_point", **settings)
        elif settings or num_envs != 1:
            raise TypeError("num_envs and settings belong to a name; a vector environment that is made has its own")
        self.cradles, mode = name, name.metadata["autoreset_mode"]
        if mode is not AutoresetMode.SAME_STEP:
            raise ValueError(f'autoreset_mode is "{mode.value}"; Stable-Baselines3 takes "SameStep"')
        super().__init__(self.cradles.num_envs, self.cradles.single_observation_space, self.cradles.single_action_space)
        self.metadata = self.cradles.metadata  # films of VecVideoRecorder play at its speed

    def reset(self) -> np.ndarray:
        """Begin all episodes, with the seeds of `seed` and the options of `set_options`; observations (K, D)."""
        options = self._options[0]
        if any(own != options for own in self._options):
            raise ValueError("set_options was given different options for the cradles; give one dictionary for all")
        observations, info = self.cradles.reset(seed=self._seeds, options=options)
        self.reset_infos = _rows(info)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions (K, A) of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Advance one control interval: observations (K, D), rewards (K,), whether over (K,), infos."""
        observations, rewards, terminated, truncated, info = self.cradles.step(self._actions)
        infos, over = _rows(info), terminated | truncated
        last = _rows(info["final_info"]) if over.any() else []
        for k in np.flatnonzero(over):
            self.reset_infos[k], infos[k] = infos[k], last[k]
            infos[k]["terminal_observation"] = info["final_obs"][k]
        for k, own in enumerate(infos):
            own["TimeLimit.truncated"] = bool(truncated[k] and not terminated[k])
        return observations, rewards.astype(np.float32), over, infos

    def close(self) -> None:
        """End the threads, close the windows."""
        self.cradles.close()

    def get_images(self) -> list[Any]:
        """Give a picture (H, W, 3) uint8 of every cradle; with render_mode="rgb_array"."""
        return list(self.cradles.render() or ())

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """Give an attribute of the cradles asked for."""
        found = self.cradles.get_attr(attr_name)
        return [found[k] for k in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
        """Refuse: AttributeError."""
        self.cradles.set_attr(attr_name, value)

    def env_method(
        self, method_name: str, *arguments: Any, indices: int | Iterable[int] | None = None, **keywords: Any
    ) -> list[Any]:
        """Give what a method of the cradles asked for returns; it is called for all of them."""
        returned = self.cradles.call(method_name, *arguments, **keywords)
        return [returned[k] for k in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: int | Iterable[int] | None = None) -> list[bool]:
        """Say False for each: single cradles have no wrappers."""
        return [False for _ in self._get_indices(indices)]


def _rows(info: dict[str, Any]) -> list[dict[str, Any]]:
    """A dictionary for each environment, from Gymnasium's arrays and masks."""
    names = [name for name in info if not name.startswith("_") and not name.startswith("final_")]
    return [dict(zip(names, row, strict=True)) for row in zip(*(info[name].tolist() for name in names), strict=True)]
