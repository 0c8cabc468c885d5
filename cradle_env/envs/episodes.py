"""Episodes under way: the arrays that the kernel of a control interval advances, one row per environment."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numba
import numpy as np

from cradle_env.cost import check_cost
from cradle_env.cradle import Cradle
from cradle_env.envs.settings import Settings
from cradle_env.envs.spaces import largest, of_camera, scaling
from cradle_env.errors import check_range
from cradle_env.kernel_records import records
from cradle_env.mechanics import control_interval, event_loop, restitution
from cradle_env.mechanics import layout as p
from cradle_env.simulation import EXHAUSTED, SimulationError, check_rest
from cradle_env.synchronization import ENVELOPE_PERIODS, FLOOR, WINDOW

#: How many arrays `Episodes.arrays` are.
EPISODE_ARRAYS = 8
# Integration step over that of `simulate`: 1e-8 rad instead of 1e-10 over 10 s, 1e-5 where contacts are followed in
# time.
_TOLERANCE = 2.5e-12
# Samples of σ are taken at least so often [1/s]: a peak is missed by 3e-4 of it at most.
_SAMPLE_RATE = 120.0
# Impacts of one bob that are kept, at most so often [1/s]; of any interval at least, and at most, so many. More are
# counted all the same.
_IMPACT_RATE, _LEAST_IMPACTS, _MOST_IMPACTS = 960.0, 16, 2000
# Steps of single bobs in one control interval at most, which Ctrl-C cannot interrupt: impacts may need as many again.
_MOST_STEPS = 1e5
# Samples of sigma's window at most.
_MOST_WINDOW = 1e6
_REWARDS = {"synchronize": p.SYNCHRONIZE, "sustain": p.SUSTAIN}


def shown(report: Sequence[Any] | np.ndarray) -> dict[str, Any]:
    """What an info shows of a row of `report`, or of its columns; energies in J."""
    return {
        "time": report[0], "delta": report[1], "release_angle": report[2], "sigma": report[3],
        "asynchrony": report[13], "relative_swing": report[14], "newton_exponent": report[4], "impacts": report[5],
        "fastest_impact": report[6], "kinetic": report[7], "gravity": report[8], "strings": report[9],
        "drag": report[10], "collisions": report[11], "spacer": report[12],
    }  # fmt: skip


class Episodes:
    """`count` episodes of cradles with equally many bobs; arrays have one row each."""

    def __init__(self, count: int, settings: Settings) -> None:
        n = settings.bobs
        self.cradles = np.zeros(count, p.CRADLE)
        self.bobs = np.zeros((count, n), p.BOB)
        self.state = np.zeros((count, n, p.COLUMNS))
        self.episodes = np.zeros(count, p.EPISODE)
        self.ring = np.zeros((count, 1))
        self.report = np.zeros((count, control_interval.REPORT))
        #: float64 whatever an environment shows: another type would compile the kernels anew.
        self.observations = np.zeros((count, 4 * n + 3))
        #: Errors of the last readings of θ [rad]; empty where the state is seen as it is.
        self.camera_errors = np.zeros((count, n if settings.camera_noise is not None else 0))
        #: What observations are shown as differences from, and in units of; None where they are shown as they are.
        self._scaling = scaling(settings) if settings.normalize_observations else None
        #: What the next step takes, clipped to [-1, 1]; no part of the state.
        self.actions = np.zeros((count, len(settings.actions)))
        self._steppers: list[Stepper] = []
        #: The cradle of each episode.
        self.of: list[Cradle | None] = [None] * count
        self._largest = largest(settings)
        self._kept = int(min(max(_IMPACT_RATE * settings.control_interval, _LEAST_IMPACTS), _MOST_IMPACTS))
        self._records: tuple[Cradle, Settings, np.ndarray, np.ndarray, np.ndarray] | None = None

    def begin(self, k: int, settings: Settings, cradle: Cradle, angle: float) -> None:
        """Puts episode k before its release: `cradle`, to be released at `angle` [rad]."""
        # Most episodes are of the same cradle under the same settings.
        if self._records is None or self._records[0] is not cradle or self._records[1] is not settings:
            self.check_shown(cradle)
            self._records = (cradle, settings, *_records(cradle, settings, self._largest))
        _, _, c, bobs, episode = self._records
        self.cradles[k], self.bobs[k], self.episodes[k] = c[0], bobs, episode[0]
        self.of[k] = cradle
        self.episodes["angle_range"][k, 1] = angle
        self._widen(2 * int(episode["half_window"][0]) + 1)
        if not control_interval.begin(
            self.cradles, self.bobs, self.state, *_scratch(settings.bobs), self.episodes, self.observations,
            self.report, k,
        ):  # fmt: skip
            check_rest(cradle, math.nan)

    def arrays(self) -> tuple[np.ndarray, ...]:
        """Everything that makes up the state: copies of these, put back, continue bit for bit."""
        return (
            self.cradles, self.bobs, self.state, self.episodes, self.report, self.observations, self.camera_errors,
            self.ring,
        )  # fmt: skip

    def restore(self, arrays: tuple[np.ndarray, ...], of: Sequence[Cradle | None]) -> None:
        """Takes up a state of the cradles `of`, copied from `arrays`."""
        width = arrays[-1].shape[1]
        self._widen(width)
        for own, saved in zip((*self.arrays()[:-1], self.ring[:, :width]), arrays, strict=True):
            own[:] = saved
        self.episodes["largest"] = self._largest  # what is shown here, whatever was shown there
        self.of = list(of)
        self._find_forces()

    def read(self, k: int, noise: float | None, random: np.random.Generator) -> None:
        """The camera, if there is one, reads the angles of episode k; noise: standard deviation [rad]."""
        if noise is not None:
            self.camera_errors[k] = noise * random.standard_normal(self.camera_errors.shape[1])

    def seen(self) -> np.ndarray:
        """What the environments show: the true state (count, 4 N + 3), or what their cameras read (count, N + 2)."""
        n, seen = self.camera_errors.shape[1], self.observations
        if n > 0:
            seen = of_camera(self.observations)
            seen[:, :n] = np.clip(seen[:, :n] + self.camera_errors, -math.pi, math.pi)
        if self._scaling is not None:
            middle, unit = self._scaling
            seen = (seen - middle) / unit
        return seen

    def info(self, k: int) -> dict[str, float]:
        """The info of episode k."""
        return shown(self.report[k].tolist())

    def check_shown(self, cradle: Cradle) -> None:
        """ValueError if the bobs of a cradle can move beyond what the observations hold."""
        speed, spin = math.sqrt(cradle.gravity * cradle.length), math.sqrt(cradle.gravity / cradle.length)
        if any(2.0 * x > most for x, most in zip((0.75 * cradle.length, speed, spin), self._largest, strict=True)):
            r, r_dot, theta_dot = self._largest
            raise ValueError(
                f"length is {cradle.length:g} m and gravity {cradle.gravity:g} m/s^2, but the observation space holds"
                f" r to {r:g} m, dr/dt to {r_dot:g} m/s and dθ/dt to {theta_dot:g} rad/s; make an environment with"
                " ranges (low, high) of them"
            )

    def stepper(self) -> Stepper:
        """Something that advances these episodes, in one thread."""
        self._steppers.append(Stepper(self.bobs.shape[1], self._kept))
        self._steppers[-1].bind(self)
        return self._steppers[-1]

    def _widen(self, width: int) -> None:
        """Makes room in `ring` for so many samples of each episode."""
        if width > self.ring.shape[1]:
            self.ring = np.pad(self.ring, ((0, 0), (0, width - self.ring.shape[1])))
            self._bind()

    def _find_forces(self) -> None:
        """A force from outside has another address in every process."""
        for k in np.flatnonzero(self.cradles["user_force"]):
            self.cradles["user_force"][k] = records(self.of[k])[0]["user_force"][0]  # type: ignore[arg-type]

    def _bind(self) -> None:
        for stepper in self._steppers:
            stepper.bind(self)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_records": None}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        self.__dict__.update(kept)
        self._find_forces()
        self._bind()


class Stepper:
    """Scratch of one thread, and the call that advances the episodes lo..hi-1 by one control interval.

    step(lo, hi) returns the first status that is not DONE.
    """

    def __init__(self, bobs: int, impacts: int) -> None:
        self.scratch, self.angles = _scratch(bobs)
        # The kernel needs room for one more of every bob.
        self.impacts = np.zeros(((impacts + 1) * bobs, 4))
        self.step: Callable[[int, int], int]

    def bind(self, of: Episodes) -> None:
        """Steps these episodes from now on. The machine code is called as it is: numba's dispatcher would look up the
        types of all arguments at every call, which takes a tenth of a step."""
        arguments = (
            of.cradles, of.bobs, restitution.universal_curves(), of.state, self.scratch, self.angles, of.episodes,
            of.ring, self.impacts, of.report, of.actions, of.observations,
        )  # fmt: skip
        machine_code = control_interval.step.compile((*map(numba.typeof, arguments), numba.int64, numba.int64))
        self.step = functools.partial(machine_code, *arguments)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "step"}

    def struck(self, count: int) -> np.ndarray:
        """The impacts of the last episode stepped, the first `count` of them, as the kernel writes them: (M, 4)."""
        return self.impacts[: min(count, len(self.impacts) - len(self.angles))]


def _scratch(bobs: int) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((bobs, p.SCRATCH)), np.zeros(bobs)


def _records(
    cradle: Cradle, settings: Settings, most: tuple[float, float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Records of a cradle and of its episode: (1,) of CRADLE, (N,) of BOB and (1,) of EPISODE; most: see `largest`."""
    c, bobs = records(cradle, _TOLERANCE)
    check_cost(
        cradle,
        settings.control_interval,
        settings.control_interval / c["step"][0] * cradle.bobs,
        _MOST_STEPS,
        "give a shorter control_interval",
    )
    steps = math.ceil(settings.control_interval / c["step"][0] - 1e-9)
    c["step"] = settings.control_interval / steps
    samples = math.ceil(settings.control_interval * _SAMPLE_RATE - 1e-9)
    window = 0.5 * ENVELOPE_PERIODS * cradle.period * samples / settings.control_interval
    check_range("half the window of sigma", window, "samples", high=_MOST_WINDOW, remedy="take a shorter cradle")
    episode = np.zeros(1, p.EPISODE)
    values: dict[str, Any] = {
        "interval": steps,
        "samples": samples,
        "half_window": round(window),
        "lead": cradle.bobs - 1,
        "lifted": settings.released_bobs,
        "hanging": settings.start == "hanging",
        "delta_column": settings.actions.index("delta") if "delta" in settings.actions else -1,
        "angle_column": settings.actions.index("release_angle") if "release_angle" in settings.actions else -1,
        "delta_range": (settings.delta_range[0], cradle.delta, settings.delta_range[1]),
        "angle_range": (settings.release_angle_range[0], 0.0, settings.release_angle_range[1]),
        "fastest": settings.spacer_speed / (2.0 * cradle.radius),
        "exponent_from": WINDOW[0],
        "exponent_to": WINDOW[1],
        "floor": FLOOR,
        "synchronized_at": settings.synchronized_at,
        "window": ENVELOPE_PERIODS * cradle.period,
        "asynchrony": 1.0,
        "low_since": math.inf,
        "duration": settings.duration,
        "reward_kind": _REWARDS.get(settings.reward, p.ELSEWHERE) if isinstance(settings.reward, str) else p.ELSEWHERE,
        "largest": most,
        "steps": -1,
        "delta": cradle.delta,
        "sigma": 1.0,
    }
    for name, value in values.items():
        episode[name] = value
    return c, bobs, episode


def check_status(status: int, time: float) -> None:
    """SimulationError unless the status is that of a run carried on."""
    if status != event_loop.DONE:
        raise SimulationError(f"the episode stopped after {time:g} s: {EXHAUSTED[status]}")
