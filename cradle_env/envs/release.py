"""`gym.make("NewtonCradleRelease-v0")`: one step is one whole experiment."""

from __future__ import annotations

import copy
import math
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import error, logger
from gymnasium.spaces import Box

from cradle_env.cradle import Cradle
from cradle_env.envs.fixed_settings import FixedSettings
from cradle_env.envs.settings import Settings
from cradle_env.envs.spaces import action_space, rounded
from cradle_env.envs.view import check_render_mode
from cradle_env.release import Release
from cradle_env.simulation import raised, sample_times, simulate
from cradle_env.synchronization import check_duration, half_window
from cradle_env.trajectory import Trajectory

#: Instants at which σ is shown, as parts of the duration.
FEATURES = np.arange(1, 13) / 12.0
#: Largest λ that can be told [1/s]: σ at its floor one second after the release.
_FASTEST = 7.0
#: Samples of an experiment [1/s].
_SAMPLE_RATE = 240.0
#: Settings of control, which there is none of.
_OF_CONTROL = ("control_interval", "spacer_speed", "synchronized_at", "camera_noise", "normalize_observations")


class NewtonCradleReleaseEnv(FixedSettings, gym.Env[np.ndarray, np.ndarray]):
    """The design problem: choose δ and the release angle, let go, and see how fast the bobs synchronize.

    ## Description

    An episode is one step, and a step one whole experiment of `duration` seconds, simulated exactly. It suits
    bandits and Bayesian optimisation; `NewtonCradle-v0` is the same cradle under control throughout.

    ## Action space

    `Box(-1, 1, (A,), float32)`, one number for each of `actions`, as in `NewtonCradle-v0`: 0 stands for the setting,
    −1 and 1 for the ends of `delta_range` and `release_angle_range`. A release angle at which the lifted bobs would
    overlap with those that hang is raised until they clear them.

    ## Observation space

    `Box((15,), float32)`; before the experiment σ = 1, λ = 0 and the settings.

    | entries | what | unit | least | largest |
    |---|---|---|---|---|
    | 0 to 11 | σ at 1/12, 2/12, ... 12/12 of the duration | 1 | 0 | 2 |
    | 12 | λ, over 1 s to 60 s | 1/s | −1 | 7 |
    | 13 | δ | 1 | −1 | 1 |
    | 14 | release angle | rad | 0 | π |

    `info` has the same keys, with arrays of one shape, after `reset` and `step`: `newton_exponent` [1/s], `delta`,
    `release_angle` [rad], and `times` [s] and `sigma` of the observation, both (12,). Before the experiment they are as
    in the observation. The cradle is `env.unwrapped.cradle`, the whole experiment `env.unwrapped.run`, a `Trajectory`,
    None before. Pictures (`render_mode="rgb_array"`) show σ(t).

    ## Rewards

    "synchronize": λ [1/s]; "sustain": −λ; or a function of the two infos, before and after. λ beats with δ and grows
    with the angle; at small angles and δ > 0.03 it is rugged. With the default settings it lies between 0.07 1/s (at
    δ = −0.02) and 0.31 1/s (near δ = 0.1, 0.06 rad).

    ## Episode end

    Terminated after the one step.

    ## Arguments

    Those of `NewtonCradle-v0` that describe a cradle (`released_bobs` less than `bobs`), `actions`, their ranges,
    `duration` (more than 1 s), `reward` and `dtype`, none of control; `reset(options=...)` likewise. Where settings are
    ranges, every episode draws a new cradle.

    ## Version history

    v0, unreleased (after 0.2.0): `times` and `sigma` in `info` are those of the observation.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012  as Gymnasium declares it

    def __init__(self, render_mode: str | None = None, **settings: Any) -> None:
        self.render_mode = check_render_mode(render_mode, self.metadata)
        for name in _OF_CONTROL:
            if name in settings:
                raise TypeError(f"{name} is a setting of NewtonCradle-v0; here nothing is controlled, so leave it out")
        self.settings = Settings.of(**settings)
        check_duration(self.settings.duration, _SAMPLE_RATE)
        self._times = sample_times(self.settings.duration, _SAMPLE_RATE)
        self._rows = np.rint(FEATURES * (len(self._times) - 1)).astype(int)
        fastest = Cradle(length=self.settings.narrowest().length, gravity=self.settings.widest().gravity)
        half_window(fastest.period, 1.0 / _SAMPLE_RATE)
        lifted = Release(angle=1.0, bobs=self.settings.released_bobs)  # to whatever angle
        lifted.check_synchronizes(Cradle(bobs=self.settings.bobs))
        self.action_space = action_space(self.settings)
        self._shape = self.action_space.shape
        low = np.concatenate([np.zeros(len(FEATURES)), [-1.0, -1.0, 0.0]])
        high = np.concatenate([np.full(len(FEATURES), 2.0), [_FASTEST, 1.0, math.pi]])
        dtype = self.settings.dtype
        self.observation_space = Box(low.astype(dtype), rounded(high, np.inf, dtype), dtype=dtype.type)
        #: The cradle of the experiment: as drawn by `reset`, with the δ of the action after `step`.
        self.cradle: Cradle | None = None
        #: The experiment, None before.
        self.run: Trajectory | None = None
        self._angle, self._ready, self._closed = 0.0, False, False
        self._episode = self.settings

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Prepares an experiment; `options` change settings for this one."""
        if self._closed:
            raise error.ClosedEnvironmentError("this environment is closed; make another")
        self._episode, posterior = self.settings.for_episode(options)
        super().reset(seed=seed)
        self._ready = False  # a refusal leaves no episode
        self.cradle, self._angle = self._episode.drawn(self.np_random, posterior)
        half_window(self.cradle.period, 1.0 / _SAMPLE_RATE)
        self.run, self._ready = None, True
        self._info = self._shown(0.0, self.cradle.delta, self._angle, np.ones(len(FEATURES)))
        return self._observation(self._info), copy.deepcopy(self._info)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """The experiment."""
        if not self._ready:
            if self._closed:
                raise error.ClosedEnvironmentError("this environment is closed; make another")
            raise error.ResetNeeded("call reset before step: each experiment is an episode")
        self.run = self.experiment(action)
        cradle = self.cradle = self.run.cradle
        self._ready = False
        exponent, before = self.run.newton_exponent(), self._info
        self._info = self._shown(
            exponent if math.isfinite(exponent) else _FASTEST,
            float(np.max(cradle.delta)),
            self.run.release.angle,  # type: ignore[union-attr]  a Release, as `experiment` makes it
            self.run.sigma()[self._rows],
        )
        reward, info = self._episode.reward, copy.deepcopy(self._info)
        gained = reward(before, info) if callable(reward) else info["newton_exponent"]
        return self._observation(info), -gained if reward == "sustain" else float(gained), True, False, info

    @property
    def ready(self) -> bool:
        """Whether `reset` has prepared an experiment, for `step` to make."""
        return self._ready

    def experiment(self, action: np.ndarray) -> Trajectory:
        """What `step(action)` simulates; nothing is changed."""
        cradle, settings = self.cradle, self._episode
        if cradle is None:
            raise error.ResetNeeded("there is no cradle yet; call reset first")
        values = settings.meaning(settings.checked_action(action), cradle, self._angle)
        cradle = cradle.replace(delta=values["delta"])
        asked = Release(angle=values["release_angle"], bobs=settings.released_bobs, start=settings.start)
        return simulate(cradle, raised(cradle, asked), settings.duration, _SAMPLE_RATE, ledger=False)

    def _shown(self, exponent: float, delta: Any, angle: Any, sigma: np.ndarray) -> dict[str, Any]:
        return {
            "newton_exponent": exponent, "delta": delta, "release_angle": angle,
            "times": self._times[self._rows], "sigma": sigma,
        }  # fmt: skip

    def _observation(self, info: dict[str, Any]) -> np.ndarray:
        rest = [info["newton_exponent"], info["delta"], info["release_angle"]]
        seen = np.concatenate([info["sigma"], rest]).astype(self.settings.dtype)
        return np.clip(seen, self.observation_space.low, self.observation_space.high)  # type: ignore[attr-defined]

    def render(self) -> np.ndarray | None:
        """The picture of σ(t), (600, 800, 3) uint8, empty before the experiment."""
        if self.render_mode is None:
            logger.warn('nothing to render: make the environment with render_mode="rgb_array"')
            return None
        if self.cradle is None or self._closed:
            raise error.ResetNeeded("there is no experiment; call reset first")
        from cradle_env.plotting import sigma_picture

        return sigma_picture(self.run, self.settings.duration)

    def close(self) -> None:
        """No step afterwards."""
        self._ready, self._closed = False, True
