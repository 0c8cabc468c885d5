"""What an environment is told: the cradle, what may be done to it, and what is wanted of it."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from gymnasium.error import InvalidAction

from cradle_env.cradle import CRADLE_NUMBERS, Cradle
from cradle_env.effects import MODELS
from cradle_env.errors import check_range, one_line, unknown_key
from cradle_env.model_files import read_model, read_posterior
from cradle_env.pickling import rebuild
from cradle_env.release import Release

#: What an action can set.
ACTIONS = ("delta", "release_angle")
REWARDS = ("synchronize", "sustain")
#: δ over which the mechanics are tested.
DELTA_LIMITS = (-0.05, 0.2)
#: What `reset(options=...)` can change for one episode.
PER_EPISODE = ("delta", "release_angle", *CRADLE_NUMBERS)
# A camera that errs by more [rad] sees nothing of a swing.
_MOST_NOISE = 1.0

Range = float | tuple[float, float]


@dataclass(frozen=True)
class Settings:
    """Settings of an environment; those of `PER_EPISODE` may be ranges (low, high), drawn anew for every episode.

    bobs: N, 1 to 200; delta: δ of all gaps; release_angle [rad] of the `released_bobs` last bobs; start:
    "unstretched" or "hanging"; model: "ho", "pendulum", "nsp" or the path of a TOML file with a [model] table;
    effects: more of them by name with their parameters; cradle: other fields of Cradle; actions: what the agent
    sets, the rest being as set here; delta_range, release_angle_range [rad]: what the actions −1 and 1 mean, 0
    being the setting; spacer_speed: fastest change of a gap [m/s]; control_interval [s]; duration of an episode
    [s]; reward: "synchronize", "sustain" or a function of two infos, before and after a step; synchronized_at: σ;
    camera_noise: standard deviation of the angles that a camera reads [rad], None where the state is seen as it is;
    dtype of the observations. Raises ValueError or TypeError, naming the setting and what is allowed.
    """

    bobs: int = 5
    delta: Range = 0.0
    release_angle: Range = 0.228
    released_bobs: int = 1
    start: str = "unstretched"
    model: str = "nsp"
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    cradle: Mapping[str, Any] = field(default_factory=dict)
    actions: Sequence[str] = ACTIONS
    delta_range: tuple[float, float] = (-0.02, 0.1)
    release_angle_range: tuple[float, float] = (0.05, 0.5)
    spacer_speed: float = 0.03
    control_interval: float = 1.0 / 60.0
    duration: float = 60.0
    reward: str | Callable[[dict[str, float], dict[str, float]], float] = "synchronize"
    synchronized_at: float = 0.05
    camera_noise: float | None = None
    normalize_observations: bool = False
    dtype: Any = np.float32

    @classmethod
    def of(cls, **given: Any) -> Settings:
        """Settings from keyword arguments, among which fields of Cradle stand beside the settings' own."""
        own = {f.name for f in dataclasses.fields(cls)} - {"cradle"}
        for key in given:
            if key not in SETTINGS:
                # Python's own words: TorchRL's GymEnv leaves `frameskip` out where it reads them.
                raise TypeError(f"unexpected keyword argument {key!r}: {unknown_key('setting', key, SETTINGS)}")
        cradle = {key: value for key, value in given.items() if key not in own}
        return cls(cradle=cradle, **{key: value for key, value in given.items() if key in own})

    def __post_init__(self) -> None:
        put = functools.partial(object.__setattr__, self)
        # A set would say neither which number of an action is which, nor the same in every process.
        if isinstance(self.actions, str) or not isinstance(self.actions, Sequence) or not self.actions:
            raise ValueError(
                f"actions is {one_line(self.actions)}; give one or both of {', '.join(ACTIONS)}, as a sequence"
            )
        for name in self.actions:
            if name not in ACTIONS:
                raise ValueError(unknown_key("action", str(name), ACTIONS))
        if len(set(self.actions)) != len(self.actions):
            raise ValueError(f"actions is {one_line(self.actions)}; name each only once")
        put("actions", tuple(self.actions))
        if isinstance(self.reward, str) and self.reward not in REWARDS:
            raise ValueError(unknown_key("reward", self.reward, REWARDS) + ", or a function of two infos")
        if not isinstance(self.reward, str) and not callable(self.reward):
            raise TypeError(f"reward is {one_line(self.reward)}; it must be one of {', '.join(REWARDS)} or a function")
        for name, unit in (("spacer_speed", "m/s"), ("duration", "s")):
            put(name, check_range(name, getattr(self, name), unit, 0.0, above=True))
        # σ's window holds a sample of every interval.
        put("control_interval", check_range("control_interval", self.control_interval, "s", 1e-4))
        if self.control_interval > self.duration:
            raise ValueError(f"control_interval is {self.control_interval:g} s; an episode lasts {self.duration:g} s")
        put("synchronized_at", check_range("synchronized_at", self.synchronized_at, "", 0.0, 1.0, above=True))
        if self.camera_noise is not None:
            put("camera_noise", check_range("camera_noise", self.camera_noise, "rad", 0.0, _MOST_NOISE))
        if not isinstance(self.normalize_observations, bool | np.bool_):
            raise TypeError(f"normalize_observations is {one_line(self.normalize_observations)}; it is True or False")
        try:
            put("dtype", np.dtype(self.dtype))
        except TypeError:
            raise TypeError(f"dtype is {one_line(self.dtype)}; observations are float32 or float64") from None
        if self.dtype not in (np.float32, np.float64):
            raise ValueError(f"dtype is {self.dtype}; observations are float32 or float64")
        put("delta_range", self._checked_limits("delta_range", "", *DELTA_LIMITS))
        put("release_angle_range", self._checked_limits("release_angle_range", "rad", 0.0, math.pi))
        if not isinstance(self.effects, Mapping) or not all(isinstance(v, Mapping) for v in self.effects.values()):
            raise TypeError(
                f"effects is {one_line(self.effects)}; give {{name: {{parameter: value}}}}, {{}} for no parameters"
            )
        put("effects", MappingProxyType(dict(self.effects)))
        put("cradle", MappingProxyType(dict(self.cradle)))
        if not isinstance(self.model, str | Path):
            raise TypeError(
                f"model is {one_line(self.model)}; it must be one of {', '.join(MODELS)} or the path of a TOML file"
            )
        if Path(self.model).suffix.lower() == ".toml":
            model, effects = read_model(Path(self.model))
            put("model", model)
            put("effects", MappingProxyType({**effects, **self.effects}))
        put("model", str(self.model))
        for name in PER_EPISODE:
            ends = self._ends(name)
            if not ends and name in ACTIONS:
                raise ValueError(f"{name} is None; give a number, or a range (low, high)")
            for value in ends:
                self._check(name, value)
            if ends and ends[0] > ends[1]:
                raise ValueError(f"{name} is ({ends[0]:g}, {ends[1]:g}); a range is (low, high), low below high")
        for longest in (0, -1):  # both ends of every range make a cradle
            cradle = self._cradle({name: self._ends(name)[longest] for name in PER_EPISODE if self._ends(name)})
            angles = self._ends("release_angle")
            if "release_angle" in self.actions:
                angles = self.release_angle_range
            release = Release(angle=angles[longest], bobs=self.released_bobs, start=self.start)
            release.angles_of(cradle)
        # "5" and 5.0 are five, too; arrays are made of whole numbers.
        put("bobs", cradle.bobs)
        put("released_bobs", release.bobs)

    def __reduce__(self):
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return rebuild, (
            type(self),
            {**fields, "effects": dict(self.effects), "cradle": dict(self.cradle)},
        )

    def _checked_limits(self, name: str, unit: str, low: float, high: float) -> tuple[float, float]:
        limits = getattr(self, name)
        if not _is_range(limits):
            raise ValueError(f"{name} is {one_line(limits)}; it must be two numbers (low, high)")
        least, largest = (check_range(name, x, unit, low, high, above=low == 0.0) for x in limits)
        if not least < largest:
            raise ValueError(f"{name} is ({least:g}, {largest:g}); a range is (low, high), low below high")
        return least, largest

    def _check(self, name: str, value: Any) -> None:
        """ValueError unless the value is possible, and within what the actions reach."""
        if name in ACTIONS:
            unit, limits = ("", DELTA_LIMITS) if name == "delta" else ("rad", (0.0, math.pi))
            remedy = "at δ = −1 the pivots coincide" if name == "delta" else ""
            if name in self.actions:
                limits, remedy = getattr(self, f"{name}_range"), f"or widen {name}_range"
            check_range(name, value, unit, *limits, above=name == "release_angle" and limits[0] == 0.0, remedy=remedy)
        else:
            check_range(name, value, "")

    def _given(self, name: str) -> Any:
        return getattr(self, name) if name in ("delta", "release_angle") else self.cradle.get(name)

    def _ends(self, name: str) -> tuple:
        """The least and the largest that a setting can become; empty where it is not given."""
        value = self._given(name)
        return () if value is None else tuple(value) if _is_range(value) else (value, value)

    def _cradle(self, values: Mapping[str, Any]) -> Cradle:
        fields = {**self.cradle, **{k: v for k, v in values.items() if k != "release_angle"}}
        return Cradle(bobs=self.bobs, model=self.model, effects=self.effects, **fields)

    def for_episode(self, options: Mapping[str, Any] | None) -> tuple[Settings, Mapping[str, np.ndarray] | None]:
        """The settings of one episode, and the draws of a posterior if one is named."""
        if options is None:
            return self, None
        if not isinstance(options, Mapping):
            raise TypeError(f"options is {type(options).__name__}; it must be a dictionary")
        for key in options:
            if key not in PER_EPISODE and key != "posterior":
                if key in SETTINGS:
                    raise ValueError(f"option {key!r} is the same for all episodes; make an environment with it")
                raise ValueError(unknown_key("option", str(key), (*PER_EPISODE, "posterior")))
        if not options:
            return self, None
        own = {key: value for key, value in options.items() if key in ("delta", "release_angle")}
        cradle = {key: value for key, value in options.items() if key in CRADLE_NUMBERS}
        changed = dataclasses.replace(self, cradle={**self.cradle, **cradle}, **own)
        return changed, read_posterior(options["posterior"]) if "posterior" in options else None

    @functools.cached_property
    def fixed(self) -> Cradle | None:
        """The cradle of every episode; None where a range is drawn."""
        return (
            None if any(_is_range(self._given(name)) for name in PER_EPISODE) else self._cradle({"delta": self.delta})
        )

    def drawn(
        self, rng: np.random.Generator, posterior: Mapping[str, np.ndarray] | None = None
    ) -> tuple[Cradle, float]:
        """A cradle and a release angle [rad]: ranges uniformly, in the order of `PER_EPISODE`; then, jointly, one
        draw of the posterior."""
        if posterior is None and self.fixed is not None:
            return self.fixed, self.release_angle  # type: ignore[return-value]
        values = {}
        for name in PER_EPISODE:
            if self._given(name) is not None:
                given = self._given(name)
                values[name] = float(rng.uniform(*given)) if _is_range(given) else given
        cradle = self._cradle(values)
        if posterior is not None:
            row = int(rng.integers(len(next(iter(posterior.values())))))
            try:
                cradle = cradle.with_values({name: float(draws[row]) for name, draws in posterior.items()})
            except (KeyError, ValueError) as error:
                raise ValueError(
                    f"this cradle cannot take the posterior: {error}; give the environment the bobs and the effects of "
                    "the calibration, with what was known of them"
                ) from None
            if "delta" in posterior:
                self._check("delta", cradle.delta)
        return cradle, values["release_angle"]

    def checked_action(self, action: Any) -> np.ndarray:
        """The action as float64, clipped to [−1, 1]; InvalidAction unless it has a finite number for each of
        `actions`."""
        numbers = as_numbers(action)
        if numbers.shape != (len(self.actions),) or not np.isfinite(numbers).all():
            wanted = f"{len(self.actions)} finite numbers: {', '.join(self.actions)}"
            raise InvalidAction(f"action is {one_line(action)}; it must be {wanted}")
        return np.clip(numbers, -1.0, 1.0)

    def meaning(self, action: np.ndarray, cradle: Cradle, angle: float) -> dict[str, float]:
        """δ and release angle [rad] that an action stands for, on a cradle and at an angle that were drawn."""
        drawn: dict[str, Any] = {"delta": cradle.delta, "release_angle": angle}
        for name, number in zip(self.actions, action, strict=True):
            low, high = getattr(self, f"{name}_range")
            drawn[name] = float(np.interp(number, [-1.0, 0.0, 1.0], [low, drawn[name], high]))
        return drawn

    def widest(self) -> Cradle:
        """The cradle with the upper end of every range."""
        return self._cradle({name: self._ends(name)[-1] for name in PER_EPISODE if self._ends(name)})

    def narrowest(self) -> Cradle:
        """The cradle with the lower end of every range."""
        return self._cradle({name: self._ends(name)[0] for name in PER_EPISODE if self._ends(name)})

    @functools.cached_property
    def lasting(self) -> dict[str, Any]:
        """What is the same for all episodes, and so for a state and the environment that takes it up."""
        told = {name: getattr(self, name) for name in _LASTING}
        return {**told, "reward": self.reward if isinstance(self.reward, str) else "a function"}


#: What an environment can be told.
SETTINGS = (*(f.name for f in dataclasses.fields(Settings) if f.name != "cradle"), *CRADLE_NUMBERS, "power_law")


# What observations show of a state is no part of it.
_SHOWN = ("dtype", "normalize_observations")
_LASTING = tuple(
    f.name for f in dataclasses.fields(Settings) if f.name not in (*PER_EPISODE, "cradle", "model", "effects", *_SHOWN)
)


def as_numbers(action: Any) -> np.ndarray:
    """What was given as float64, empty where it is not made of real numbers; text is none, nor are dates."""
    try:
        given = np.asarray(action)
        return given.astype(float) if given.dtype.kind in "biuf" else np.empty(0)
    except (TypeError, ValueError):
        return np.empty(0)


def _is_range(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return value.shape == (2,)
    return isinstance(value, Sequence) and not isinstance(value, str) and len(value) == 2
