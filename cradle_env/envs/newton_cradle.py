"""The environment of `gym.make("NewtonCradle-v0")`."""

from __future__ import annotations

from typing import Any, NoReturn

import gymnasium as gym
import numpy as np
from gymnasium import error, logger

from cradle_env.envs.episodes import Episodes, check_status, shown
from cradle_env.envs.fixed_settings import FixedSettings
from cradle_env.envs.settings import Settings
from cradle_env.envs.spaces import action_space, observation_space
from cradle_env.envs.state import State, check_state
from cradle_env.envs.view import View, check_render_mode
from cradle_env.mechanics.control_interval import BAD_ACTION, OVER, REWARD, SYNCHRONIZED
from cradle_env.simulation import impact_rows


class NewtonCradleEnv(FixedSettings, gym.Env[np.ndarray, np.ndarray]):
    """Newton's cradle of N bobs on elastic strings. The agent moves the spacer while the bobs swing.

    ## Description

    N steel bobs hang side by side on elastic strings, which lose energy whenever they stretch. One bob is lifted and
    released. Every impact transfers a little motion to the bobs between the ends, until all bobs swing in unison: they
    are *synchronized*. σ is the distance from synchronization (1 after the release, 0 when synchronized), and λ its
    rate, σ ≈ exp(−λt). The motion is that of Lee & Hong's nonlinear spring pendulums (arXiv:2401.16693), simulated to
    about 10⁻⁸ rad, impact by impact.

    The agent chooses the release angle, and the distance of the pivots by a spacer: δ is the distance of neighbouring
    pivots over the diameter of a bob, minus 1. At δ < 0 the bobs lean on each other, at δ > 0 they hang apart.

    ## Action space

    `Box(-1, 1, (A,), float32)` with one number for each of `actions`, by default both and in this order:

    | action | what it sets | −1 | 0 | 1 | unit |
    |---|---|---|---|---|---|
    | `delta` | target of the spacer, which changes a gap by at most `spacer_speed` | −0.02 | `delta` | 0.1 | 1 |
    | `release_angle` | release angle; only the first step uses it | 0.05 | `release_angle` | 0.5 | rad |

    −1 and 1 mean the ends of `delta_range` and `release_angle_range`, 0 means the setting, and the value is linear in
    between. Numbers beyond −1 and 1 are clipped; numbers that are not finite raise `InvalidAction`. The first step sets
    both and releases the bobs. In every later control interval the spacer moves each pivot at a constant velocity. This
    does work on the bobs, which `info["spacer"]` counts. If lifted bobs would overlap with hanging ones, the release
    angle is raised until they do not.

    ## Observation space

    `Box((4 N + 3,), float32)`, or float64 by `dtype`; the mechanics are always float64.

    | entries | what | unit | least | largest |
    |---|---|---|---|---|
    | 0 … N − 1 | r: distance of each bob from its pivot | m | 0 | 2 r0 |
    | N … 2N − 1 | θ: its angle from the vertical | rad | −π | π |
    | 2N … 3N − 1 | dr/dt | m/s | −4 √(g r0) | 4 √(g r0) |
    | 3N … 4N − 1 | dθ/dt | rad/s | −4 √(g/r0) | 4 √(g/r0) |
    | 4N | δ | 1 | −1 | 1 |
    | 4N + 1 | σ, see below | 1 | 0 | 2 |
    | 4N + 2 | time since the release | s | 0 | `duration` |

    Observations are the true motion. Effects that act on a measurement change readings of experiments, but no
    observations.

    With `camera_noise` the observation is `Box((N + 2,), float32)`: θ as a camera reads it once in every control
    interval, with independent normal errors of that standard deviation, then δ and the time. It has no lengths, speeds
    or σ. `info` and the rewards have no errors.

    `normalize_observations=True` scales observations to about 1. The units are then 0.02 r0 for r − r0, the largest
    release angle θ0 for θ, 0.1 √(g r0) for dr/dt, θ0 √(g/r0) for dθ/dt, and the duration for the time; `delta_range` is
    mapped to [−1, 1].

    σ(t) = |max θ + min θ| / θ0 of the lifted bob over the last 1.05 periods. This is the paper's σ at the middle of
    that window, since later angles are unknown at t. σ is 1 until the first window is complete. It stays 1 for one bob,
    or if all bobs are lifted.

    σ depends only on the lifted bob; the rewards and the end of an episode depend on all bobs. The swing of a bob is a
    complex number: its angle from equilibrium, and its angular velocity over √(g/r0). The *asynchrony* is the root of
    the share that swings relative to the mean of all bobs have in the sum of squared swings, over its value at the
    release. It is 1 while the lifted bobs swing and the others rest, and 0 in unison. It is set to 1 until every pair
    of neighbours has had an impact. The `relative_swing` is the amplitude of the swings relative to the mean, over its
    value at the release.

    `info` has the same keys after `reset` and `step`: `time` [s], `delta`, `release_angle` [rad], `sigma`,
    `asynchrony`, `relative_swing`, `newton_exponent` (λ so far [1/s], 0 while unknown), `impacts` (number in this
    step), `fastest_impact` [m/s], and the energies [J] `kinetic`, `gravity`, `strings` (held and lost by them),
    `drag`, `collisions` (lost so far), `spacer` (supplied so far). kinetic + gravity + strings + drag +
    collisions − spacer is constant. `env.unwrapped.impacts` lists the impacts.

    ## Rewards

    - `"synchronize"`: Φ(after) − Φ(before) − interval/duration with Φ = −ln(asynchrony), limited to 0 … −ln 0.05.
      The differences of Φ add up, so an episode returns at most −ln 0.05 = 3.0 less its length over `duration`: the
      optimum synchronizes as soon as possible. With δ = 0 throughout, five bobs return about 2.3.
    - `"sustain"`: `relative_swing` · interval/duration, with `relative_swing` limited to 1. It is 0 if there was no
      impact in the last 1.05 periods. An episode returns at most 1, if the bobs swing as at the release to its end.
    - A function of two infos, before and after the step, that returns a number.

    ## Starting state

    The bobs hang at rest at the setting's δ. If the release angle is not an action, the lifted bobs are held.

    ## Episode end

    An episode terminates when the asynchrony is ≤ `synchronized_at` at the end of every interval for 1.05 periods. It
    is truncated after `duration`. The registered time limit is 3600 steps, which is 60 s at the default interval. A
    longer episode or a shorter interval needs `max_episode_steps`, too.

    A step raises `SimulationError` if the motion cannot be computed: for unrealistic strings or bobs, which bounce
    without end, or for a hundred bobs at δ < 0 whose common equilibrium is not found.

    ## Arguments

    ```python
    gym.make("NewtonCradle-v0", bobs=5, delta=0.0, release_angle=0.228)
    ```

    | argument | default | |
    |---|---|---|
    | `bobs` | 5 | N, 1 to 200 |
    | `delta` | 0.0 | of all gaps, −0.05 to 0.2 |
    | `release_angle` | 0.228 | rad, above 0, on strings at most 1.5 |
    | `released_bobs` | 1 | how many bobs are lifted, from the last |
    | `start` | "unstretched" | or "hanging": length of the lifted strings |
    | `model`, `effects` | "nsp", {} | as in `Cradle`; or the path of a TOML file with a [model] table |
    | any number of `Cradle` | | `k_f`, `kappa`, `b`, `mass`, `length`, … |
    | `actions` | ("delta", "release_angle") | one or both |
    | `delta_range` | (−0.02, 0.1) | |
    | `release_angle_range` | (0.05, 0.5) | rad |
    | `spacer_speed` | 0.03 | fastest change of a gap, m/s |
    | `control_interval` | 1/60 | s, at least 0.0001 |
    | `duration` | 60.0 | s |
    | `reward` | "synchronize" | or "sustain", or a function |
    | `synchronized_at` | 0.05 | asynchrony |
    | `camera_noise` | None | or rad, 0 to 1: observations of a camera |
    | `normalize_observations` | False | or True: scaled to about 1 |
    | `dtype` | float32 | or float64 |
    | `render_mode` | None | "human", "rgb_array" or "ansi" |

    `delta`, `release_angle` and the numbers of `Cradle` may be ranges (low, high), from which `reset` draws with the
    environment's random numbers. `reset(options={...})` changes any of these for one episode, within the bounds of the
    observation space. `options={"posterior": "posterior.nc"}` draws the inferred parameters jointly from a calibration;
    others, such as `length` and `mass`, stay as they are set here.

    `get_state` and `set_state` save and restore the whole state bit for bit, including hysteresis and random numbers.
    They do not save the step count of a time limit around the environment; `max_episode_steps=-1` omits that limit.
    `make_vec("NewtonCradle-v0", num_envs=K)` steps K cradles in one call on all cores. Settings are fixed when the
    environment is made: `env.unwrapped.gravity = 1.0` raises an error.

    ## Version history

    v0, unreleased (after 0.2.0): rewards and the end of an episode follow the asynchrony of all bobs. Up to 0.2.0 they
    followed σ of the lifted bob, so returns cannot be compared with earlier ones.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array", "ansi"], "render_fps": 60}  # noqa: RUF012  as Gymnasium declares it

    def __init__(self, render_mode: str | None = None, **settings: Any) -> None:
        self.settings = Settings.of(**settings)
        self.render_mode = check_render_mode(render_mode, self.metadata)
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / self.settings.control_interval))}
        self.observation_space = observation_space(self.settings)
        self.action_space = action_space(self.settings)
        self._episodes = Episodes(1, self.settings)
        self._stepper = self._episodes.stepper()
        self._reward = None if isinstance(self.settings.reward, str) else self.settings.reward
        self._action_shape = self.action_space.shape
        self._begun = False
        self._view = None if render_mode is None else View(render_mode, self.metadata["render_fps"], self.settings)
        self._ready, self._closed = False, False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; `options` change settings for this episode, see the class."""
        if self._closed:
            raise error.ClosedEnvironmentError("this environment is closed; make another")
        settings, posterior = self.settings.for_episode(options)
        super().reset(seed=seed)
        cradle, angle = settings.drawn(self.np_random, posterior)
        self._ready = False  # an error below leaves no episode
        self._episodes.begin(0, settings, cradle, angle)
        self._episodes.read(0, self.settings.camera_noise, self.np_random)
        self._ready = self._begun = True
        if self._view is not None:
            self._view.begin()
            if self.render_mode == "human":
                self.render()
        return self._episodes.seen()[0].astype(self.settings.dtype), self._episodes.info(0)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Simulate one control interval."""
        if not self._ready:
            self._refuse()
        if not isinstance(action, np.ndarray) or action.shape != self._action_shape or action.dtype.kind != "f":
            action = self.settings.checked_action(action)
        episodes = self._episodes
        episodes.actions[0] = action
        before = None if self._reward is None else episodes.info(0)
        status = self._stepper.step(0, 1)
        if status:
            if status == BAD_ACTION:
                self.settings.checked_action(action)
            self._ready = False
            check_status(status, episodes.info(0)["time"])
        (row,) = episodes.report.tolist()
        info = shown(row)
        reward = row[REWARD] if before is None else float(self._reward(before, info.copy()))  # type: ignore[misc]
        if self._view is not None:
            self._view.follow(row[0], row[3], self._stepper.struck(int(row[5])))
            if self.render_mode == "human":
                self.render()
        episodes.read(0, self.settings.camera_noise, self.np_random)
        seen = episodes.seen()[0].astype(self.settings.dtype)
        return seen, reward, row[SYNCHRONIZED] > 0.0, row[OVER] > 0.0, info

    def render(self) -> Any:
        """Return a picture (H, W, 3) of uint8 or a text, or draw into the window, by `render_mode`."""
        if self._view is None:
            logger.warn('nothing to render: make the environment with render_mode="human", "rgb_array" or "ansi"')
            return None
        if self._closed or not self._begun:
            self._refuse()
        return self._view.render(self._episodes, 0, self._episodes.info(0))

    def close(self) -> None:
        """Close the window; the environment cannot be used afterwards."""
        self._ready, self._closed = False, True
        if self._view is not None:
            self._view.close()

    @property
    def impacts(self) -> np.ndarray:
        """Impacts of the last step: time [s], pair (i: bobs i and i + 1), speed [m/s], loss [J].

        Beyond 960 impacts of a bob per second only the first are kept.
        """
        if not self._begun:
            self._refuse()
        return impact_rows(self._stepper.struck(int(self._episodes.info(0)["impacts"])))

    def get_state(self) -> State:
        """Return the whole state for `set_state`: motion, hysteresis memory, settings and random numbers."""
        return State(
            settings=(self.settings.lasting,),
            cradles=tuple(self._episodes.of),
            arrays=tuple(array.copy() for array in (*self._episodes.arrays(), self._stepper.impacts)),
            random=[self.np_random.bit_generator.state],
            seeds=[self.np_random_seed],
            ready=self._ready,
        )

    def set_state(self, state: State) -> None:
        """Continue from a state, bit for bit; ValueError if it is of an environment with other settings."""
        if self._closed:
            self._refuse()
        check_state(state, [self.settings], self._episodes, 1)
        *arrays, impacts = state.arrays
        self._episodes.restore(tuple(arrays), state.cradles)
        self._stepper.impacts[:] = impacts
        self.np_random.bit_generator.state = state.random[0]  # type: ignore[assignment]
        self._np_random_seed = state.seeds[0]
        self._ready = self._begun = state.ready
        if self._view is not None:
            self._view.begin()

    def _refuse(self) -> NoReturn:
        if self._closed:
            raise error.ClosedEnvironmentError("this environment is closed; make another")
        raise error.ResetNeeded("there is no episode; call reset first")
