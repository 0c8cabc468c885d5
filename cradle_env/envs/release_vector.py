"""`gym.make_vec("NewtonCradleRelease-v0", num_envs=K)`: K experiments at once, on all cores by threads."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import iterate

from cradle_env.envs.fixed_settings import FixedSettings
from cradle_env.envs.release import NewtonCradleReleaseEnv
from cradle_env.threads import in_threads
from cradle_env.trajectory import Trajectory


class _Prepared(NewtonCradleReleaseEnv):
    """Takes the experiment of its next step from `prepared`, where there is one."""

    prepared: Trajectory | None = None

    def experiment(self, action: np.ndarray) -> Trajectory:
        run, self.prepared = self.prepared, None
        return super().experiment(action) if run is None else run


class NewtonCradleReleaseVectorEnv(FixedSettings, SyncVectorEnv):
    """`num_envs` of `NewtonCradleReleaseEnv`, as `SyncVectorEnv` makes of them, bit for bit; only faster.

    settings: as for `NewtonCradleReleaseEnv`. autoreset_mode: "NextStep", "SameStep" or "Disabled". workers: threads,
    all cores where omitted.
    """

    def __init__(
        self,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        workers: int | None = None,
        **settings: Any,
    ) -> None:
        super().__init__([functools.partial(_Prepared, **settings)] * num_envs, autoreset_mode=autoreset_mode)
        self._workers = workers

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """The experiments of all that are not to be reset first."""
        if not self.closed:
            singles: list[Any] = self.envs
            pairs = zip(singles, iterate(self.action_space, actions), strict=False)
            pending = [(env, action) for env, action in pairs if env.ready]
            runs = in_threads(lambda pair: pair[0].experiment(pair[1]), pending, self._workers)
            for (env, _), run in zip(pending, runs, strict=True):
                env.prepared = run
        return super().step(actions)
