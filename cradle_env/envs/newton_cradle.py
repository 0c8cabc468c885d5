"""`gym.make("NewtonCradle-v0")`."""

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
    """Newton's cradle of N bobs on elastic strings, whose spacer the agent moves while the bobs click.

    ## Description

    N steel bobs hang side by side, each on strings that stretch and lose energy in every stretch. One is lifted and
    let go. What looks like a perfect exchange decays: every impact leaves a little motion with the bobs between,
    until all swing together, *synchronized*. σ measures how far they are from it (1 after the release, 0 when
    synchronized), λ how fast they get there, σ ≈ exp(−λt). The motion is that of Lee & Hong's nonlinear spring
    pendulums (arXiv:2401.16693), simulated to some 10⁻⁸ rad, impact by impact.

    The agent chooses how far the lifted bob is released, and how wide the spacer holds the pivots apart: δ is the
    distance of neighbouring pivots over the diameter of a bob, minus 1. At δ < 0 the bobs lean on each other, at
    δ > 0 they hang apart.

    ## Action space

    `Box(-1, 1, (A,), float32)` with one number for each of `actions`, by default both and in this order:

    | action | what it sets | −1 | 0 | 1 | unit |
    |---|---|---|---|---|---|
    | `delta` | where the spacer goes, at most `spacer_speed` fast | −0.02 | `delta` | 0.1 | 1 |
    | `release_angle` | angle of release; only the first step's counts | 0.05 | `release_angle` | 0.5 | rad |

    −1 and 1 stand for the ends of `delta_range` and `release_angle_range`, 0 for the setting, and numbers between for
    what lies between. Numbers beyond are clipped; only what is not finite is refused (`InvalidAction`). The first
    step sets both and lets go. From then on the spacer moves each pivot at a constant velocity through every
    control interval. This does work on the bobs, which `info["spacer"]` counts: no energy comes from nowhere. A
    release angle at which the lifted bobs would overlap with those that hang is raised until they clear them.

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

    This is the true motion: effects that act on a measurement change readings of it alone, not what is seen here.

    With `camera_noise` the agent sees less: `Box((N + 2,), float32)` holds θ as a camera reads it once in every control
    interval, with independent normal errors of that standard deviation, then δ and the time. Lengths, speeds and σ are
    not seen. `info` and the rewards stay true.

    With `normalize_observations` all of this is scaled to about 1: r − r0 in units of 0.02 r0, θ of the largest release
    angle θ0, dr/dt of 0.1 √(g r0), dθ/dt of θ0 √(g/r0), δ to [−1, 1] over `delta_range`, the time in durations.

    σ(t) = |max θ + min θ| / θ0 of the lifted bob over the last 1.05 periods: the paper's σ at the middle of that
    window, the latest that can be known at t. Until the first window is full σ is 1; with nothing
    to synchronize with, one bob alone or all lifted, it stays 1.

    σ watches the lifted bob alone. The rewards and the end of an episode count every bob. Its swing is how far it is
    from its resting angle, and how fast it moves. The swings about the mean of all bobs make up a part of all swing;
    the *asynchrony* is the root of that part over what it was at the release: 1 as the lifted bobs swing and the
    others rest, 0 in unison. It is 1 until every pair of neighbours has had an impact. The `relative_swing` is the
    amplitude of the swings about the mean over that at the release: how much of the clicking is left.

    `info` has the same keys after `reset` and `step`: `time` [s], `delta`, `release_angle` [rad], `sigma`,
    `asynchrony`, `relative_swing`, `newton_exponent` (λ so far [1/s], 0 while unknown), `impacts` (number in this
    step), `fastest_impact` [m/s], and the energies [J] `kinetic`, `gravity`, `strings` (held and lost by them),
    `drag`, `collisions` (taken so far), `spacer` (brought in so far). kinetic + gravity + strings + drag +
    collisions − spacer is constant. The impacts themselves are `env.unwrapped.impacts`.

    ## Rewards

    - `"synchronize"`: Φ(after) − Φ(before) − interval/duration with Φ = −ln(asynchrony), held between 0 and −ln 0.05.
      The shaping telescopes, so that an episode returns at most −ln 0.05 = 3.0 minus the part of the duration that it
      took: the optimum synchronizes as soon as possible. With nothing done (δ = 0, N = 5) it returns about 2.3.
    - `"sustain"`: `relative_swing` · interval/duration, counted up to 1, and only while the last impact is no longer
      ago than 1.05 periods. At most 1, for a cradle that goes on clicking as at the release.
    - any function of two infos, before and after the step, to a number.

    ## Starting state

    The bobs hang at rest at the setting's δ, or, where the release angle is not an action, are held lifted.

    ## Episode end

    Terminated when synchronized: asynchrony ≤ `synchronized_at` at the end of every interval for 1.05 periods.
    Truncated after `duration`; the registered time limit is 3600 steps, which is 60 s at the default interval, so a
    longer episode or a shorter interval needs `max_episode_steps` too.

    A step raises `SimulationError` if the motion cannot be carried on: strings or bobs far from any cradle's, which
    press and bounce without end; or a hundred bobs let go at δ < 0, of which no common rest is found.

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
    | `camera_noise` | None | or rad, 0 to 1: observations are a camera's |
    | `normalize_observations` | False | or True: scaled to about 1 |
    | `dtype` | float32 | or float64 |
    | `render_mode` | None | "human", "rgb_array" or "ansi" |

    `delta`, `release_angle` and the numbers of `Cradle` may be ranges (low, high), drawn anew by `reset` from the
    environment's random numbers. `reset(options={...})` changes any of these for one episode, within what the
    observation space holds; `options={"posterior": "posterior.nc"}` draws what a calibration inferred, jointly, and
    leaves all else, such as `length` and `mass`, as it is here.

    `get_state` and `set_state` save and restore everything, hysteresis and random numbers too, bit for bit; not the
    steps that a time limit around the environment has counted: `max_episode_steps=-1` does without one.
    `make_vec("NewtonCradle-v0", num_envs=K)` steps K cradles in one call on all cores. Settings are read once:
    `env.unwrapped.gravity = 1.0` is refused.

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
        """Begins an episode; `options` change settings for this one, see the class."""
        if self._closed:
            raise error.ClosedEnvironmentError("this environment is closed; make another")
        settings, posterior = self.settings.for_episode(options)
        super().reset(seed=seed)
        cradle, angle = settings.drawn(self.np_random, posterior)
        self._ready = False  # a refusal leaves no episode
        self._episodes.begin(0, settings, cradle, angle)
        self._episodes.read(0, self.settings.camera_noise, self.np_random)
        self._ready = self._begun = True
        if self._view is not None:
            self._view.begin()
            if self.render_mode == "human":
                self.render()
        return self._episodes.seen()[0].astype(self.settings.dtype), self._episodes.info(0)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One control interval."""
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
        """A picture as (H, W, 3) uint8, a text, or a window, by `render_mode`."""
        if self._view is None:
            logger.warn('nothing to render: make the environment with render_mode="human", "rgb_array" or "ansi"')
            return None
        if self._closed or not self._begun:
            self._refuse()
        return self._view.render(self._episodes, 0, self._episodes.info(0))

    def close(self) -> None:
        """Closes the window; no step afterwards."""
        self._ready, self._closed = False, True
        if self._view is not None:
            self._view.close()

    @property
    def impacts(self) -> np.ndarray:
        """Impacts of the last step: time [s], pair (i: bobs i and i + 1), speed [m/s], loss [J]; of more than 960 of a
        bob in a second the first."""
        if not self._begun:
            self._refuse()
        return impact_rows(self._stepper.struck(int(self._episodes.info(0)["impacts"])))

    def get_state(self) -> State:
        """The whole state, motion, hysteresis memory, random numbers and all; `set_state` puts it back."""
        return State(
            settings=(self.settings.lasting,),
            cradles=tuple(self._episodes.of),
            arrays=tuple(array.copy() for array in (*self._episodes.arrays(), self._stepper.impacts)),
            random=[self.np_random.bit_generator.state],
            seeds=[self.np_random_seed],
            ready=self._ready,
        )

    def set_state(self, state: State) -> None:
        """Goes on from a state, bit for bit as its environment would have; ValueError if it is of another."""
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
