"""`gym.make("NewtonCradleRelease-v0")`: one step is one whole experiment."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import error
from gymnasium.spaces import Box

from cradle_env.cradle import Cradle
from cradle_env.envs.settings import Settings
from cradle_env.envs.spaces import action_space, rounded
from cradle_env.errors import one_line
from cradle_env.release import Release
from cradle_env.simulation import raised, sample_times, simulate
from cradle_env.synchronization import check_duration, half_window

#: Instants at which σ is shown, as parts of the duration.
FEATURES = np.arange(1, 13) / 12.0
#: Largest λ that can be told [1/s]: σ at its floor one second after the release.
_FASTEST = 7.0
#: Samples of an experiment [1/s].
_SAMPLE_RATE = 240.0
#: Settings of control, which there is none of.
_OF_CONTROL = ("control_interval", "spacer_speed", "synchronized_at", "camera_noise")


class NewtonCradleReleaseEnv(gym.Env[np.ndarray, np.ndarray]):
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

    `info` has the same keys, with arrays of one shape, after `reset` and `step`: `times` [s] and `sigma`, the whole
    curve, both (T,); `newton_exponent` [1/s], `delta` and `release_angle` [rad]. Before the experiment they are as in
    the observation, σ = 1 at all times. The cradle itself is `env.unwrapped.cradle`.

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

    v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": 1}  # noqa: RUF012  as Gymnasium declares it

    def __init__(self, render_mode: str | None = None, **settings: Any) -> None:
        if render_mode is not None:
            raise ValueError(
                f"render_mode is {one_line(render_mode)}; one step is a whole experiment, which has no picture"
            )
        self.render_mode = None
        for name in _OF_CONTROL:
            if name in settings:
                raise TypeError(f"{name} is a setting of NewtonCradle-v0; here nothing is controlled, so leave it out")
        self.settings = Settings.of(**settings)
        check_duration(self.settings.duration, _SAMPLE_RATE)
        self._times = sample_times(self.settings.duration, _SAMPLE_RATE)
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
        self._ready = True
        self._info = {
            "newton_exponent": 0.0,
            "delta": self.cradle.delta,
            "release_angle": self._angle,
            "times": self._times.copy(),
            "sigma": np.ones(len(self._times)),
        }
        return self._observation(np.ones(len(FEATURES)), self._info), dict(self._info)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """The experiment."""
        if self.cradle is None or not self._ready:
            if self._closed:
                raise error.ClosedEnvironmentError("this environment is closed; make another")
            raise error.ResetNeeded("call reset before step: each experiment is an episode")
        action = self._episode.checked_action(action)
        values = self._episode.meaning(action, self.cradle, self._angle)
        cradle = self.cradle.replace(delta=values["delta"])
        asked = Release(angle=values["release_angle"], bobs=self._episode.released_bobs, start=self._episode.start)
        release = raised(cradle, asked)
        run = simulate(cradle, release, self._episode.duration, _SAMPLE_RATE, ledger=False)
        sigma, exponent = run.sigma(), run.newton_exponent()
        info = {
            "newton_exponent": exponent if math.isfinite(exponent) else _FASTEST,
            "delta": values["delta"], "release_angle": release.angle, "times": run.t, "sigma": sigma,
        }  # fmt: skip
        reward = self._episode.reward
        gained = reward(self._info, info) if callable(reward) else info["newton_exponent"]
        self.cradle, self._ready = cradle, False
        rows = np.rint(FEATURES * (len(run.t) - 1)).astype(int)
        return (
            self._observation(sigma[rows], info),
            -gained if reward == "sustain" else float(gained),
            True,
            False,
            info,
        )

    def _observation(self, sigma: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        rest = [info["newton_exponent"], info["delta"], info["release_angle"]]
        seen = np.concatenate([sigma, rest]).astype(self.settings.dtype)
        return np.clip(seen, self.observation_space.low, self.observation_space.high)  # type: ignore[attr-defined]

    def close(self) -> None:
        """No step afterwards."""
        self._ready, self._closed = False, True
