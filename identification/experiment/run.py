"""What is known of one measured run, and priors of what is not."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from cradle_env.cost import check_cost, steps_needed
from cradle_env.cradle import Cradle
from cradle_env.effects import CATALOGUE
from cradle_env.errors import check_range, one_line, unknown_key
from cradle_env.parameter_name import ParameterName
from cradle_env.release import Release
from cradle_env.simulation import prepare
from identification.experiment.recording import UNITS

#: Noise [rad or m] below which the errors of a simulation, some 1e-7 over 10 s, would count as misfit.
_LEAST_NOISE = 1e-7
#: Steps of single bobs in one simulation of a measured run at most, some 10 s: a fit makes thousands of them.
_MOST_STEPS = 1e7
_LATE = "count t from the release, not from 1970 as a clock in Unix time does, or keep less of the recording"


@dataclass(frozen=True)
class Prior:
    """What is known of an unknown: a normal (mean, sd), or a uniform one (low, high), in its SI unit."""

    mean: float | None = None
    sd: float | None = None
    low: float | None = None
    high: float | None = None

    def __post_init__(self) -> None:
        given = tuple(name for name in ("mean", "sd", "low", "high") if getattr(self, name) is not None)
        if given not in (("mean", "sd"), ("low", "high")):
            raise ValueError(f"a prior has mean and sd, or low and high; given: {', '.join(given) or 'nothing'}")
        for name in given:
            value = check_range(name, getattr(self, name), "", 0.0 if name == "sd" else -math.inf, above=name == "sd")
            object.__setattr__(self, name, value)
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low is {self.low:g} and high is {self.high:g}; low must be less than high")

    @property
    def support(self) -> tuple[float, ...]:
        """Values that must be possible: the mean, or the two ends, just inside."""
        if self.low is None or self.high is None:
            return (float(self.mean or 0.0),)
        inset = 1e-9 * (self.high - self.low)
        return self.low + inset, self.high - inset


def check_noise(noise: float, unit: str, scale: float = 1.0) -> float:
    """1 sigma of a reading [unit], of which one is `scale` rad or m; ValueError for less than simulations resolve."""
    remedy = "state the scatter of a single reading, or leave noise out to have it inferred"
    return check_range("noise", noise, unit, _LEAST_NOISE / scale, remedy=remedy)


@dataclass(frozen=True)
class ReleaseInfo:
    """How a run was released, and how well that is known: angle_sd [rad] and time_sd [s], 1 sigma, 0 for exactly."""

    release: Release
    angle_sd: float = 0.0
    time_sd: float = 0.0

    def __post_init__(self) -> None:
        for name, unit in (("angle_sd", "rad"), ("time_sd", "s")):
            object.__setattr__(self, name, check_range(name, getattr(self, name), unit, 0.0))


@dataclass(frozen=True, eq=False)
class Run:
    """One measured run, in SI units.

    times: (T,) [s], ascending, 0 at the release if there is one; readings: (T, N), quantity "theta" [rad] or "x" [m,
    from each bob's rest position], nan where missing; release: how it began, if known; delta: δ, one number or one
    per gap, that of the cradle where omitted; noise: 1 sigma [rad or m], to be inferred where omitted; fit_from,
    fit_to [s]: data before are not used, later ones held out; the whole where omitted. state: "release" (starts
    from rest as stated) or "free" (initial state inferred at fit_from); rest: "known", or "free" (an offset of each
    bob is inferred). unit, scale: that of the readings in the file and its SI value; lines: (T, N), where each
    reading stands in the file, if there is one, 0 for none.
    """

    times: np.ndarray
    readings: np.ndarray
    quantity: str = "theta"
    release: ReleaseInfo | None = None
    delta: float | tuple[float, ...] = None  # type: ignore[assignment]  # filled in by Experiment
    noise: float | None = None
    fit_from: float = None  # type: ignore[assignment]  # filled in below
    fit_to: float | None = None
    state: str = "release"
    rest: str = "known"
    file: str = "run1.csv"
    unit: str = "rad"
    scale: float = 1.0
    lines: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name, choices in (
            ("quantity", ("theta", "x")),
            ("state", ("release", "free")),
            ("rest", ("known", "free")),
            ("unit", UNITS.get(self.quantity, ())),
        ):
            if getattr(self, name) not in choices:
                raise ValueError(
                    f"{name} is {one_line(getattr(self, name))}; it must be {' or '.join(map(repr, choices))}"
                )
        self._check_arrays()
        if self.state == "release" and self.release is None:
            raise ValueError(
                'state is "release", but no release is stated;'
                ' add release = { bobs = 1, angle = ... }, or write state = "free"'
            )
        if self.noise is not None:
            object.__setattr__(self, "noise", check_noise(self.noise, "rad" if self.quantity == "theta" else "m"))
        self._check_window()

    def _check_arrays(self) -> None:
        times, readings = (np.ascontiguousarray(a, dtype=float) for a in (self.times, self.readings))
        if times.ndim != 1 or readings.ndim != 2 or len(times) != len(readings):
            raise ValueError(
                f"times {times.shape} and readings {readings.shape} do not match; give times (T,) and readings (T, N)"
            )
        if not np.isfinite(times).all() or (times[1:] <= times[:-1]).any():
            raise ValueError("times must be finite seconds, each later than the one before")
        if np.isinf(readings).any():
            raise ValueError("readings hold an infinite value; write nan where one is missing")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "readings", readings)

    def _check_window(self) -> None:
        seen = self.times[~np.isnan(self.readings).all(axis=1)]
        if len(seen) == 0:
            raise ValueError(f"no usable rows: {self.file} holds no reading at all; each row needs a value or more")
        earliest = 0.0 if self.state == "release" else -math.inf
        start = max(float(self.times[0]), earliest) if self.fit_from is None else self.fit_from
        start = check_range(
            "fit_from", start, "s", earliest, remedy='the release is at t = 0; for earlier data write state = "free"'
        )
        object.__setattr__(self, "fit_from", start)
        end = math.inf
        if self.fit_to is not None:
            end = check_range("fit_to", self.fit_to, "s")
            object.__setattr__(self, "fit_to", end)
        if end <= start:
            raise ValueError(f"fit_to is {end:g} s, not after fit_from, {start:g} s; give a later one")
        if not ((seen >= start) & (seen <= end)).any():
            window = f"fit_from {start:g} s" + (f" and fit_to {end:g} s" if end < math.inf else "")
            raise ValueError(
                f"{window} leaves no usable rows:"
                f" the readings of {self.file} lie between {seen[0]:g} and {seen[-1]:g} s; widen the window"
            )
        object.__setattr__(self, "fit_from", max(start, float(seen[0])))  # from there on there is something to fit

    @property
    def duration(self) -> float:
        """From where its simulations begin to its last reading [s]."""
        return max(float(self.times[-1]) - (self.fit_from if self.state == "free" else 0.0), 0.0)

    @property
    def fitted(self) -> np.ndarray:
        """Which rows may be fitted, (T,) of bool: from fit_from to fit_to, with a reading."""
        end = math.inf if self.fit_to is None else self.fit_to
        return (self.times >= self.fit_from) & (self.times <= end) & ~np.isnan(self.readings).all(axis=1)

    @property
    def held_out(self) -> np.ndarray:
        """Which rows lie beyond fit_to, (T,) of bool; none where it is not stated."""
        end = math.inf if self.fit_to is None else self.fit_to
        return (self.times > end) & ~np.isnan(self.readings).all(axis=1)

    def place(self, row: int, bob: int) -> str:
        """Where a bob's reading in a row stands in the file, or another bob's where it has none."""
        if self.lines is None:
            return f"row {row + 1}"
        return f"line {self.lines[row, bob] or self.lines[row].max()}"

    def angles(self, cradle: Cradle) -> np.ndarray:
        """The readings as angles [rad], (T, N): as far as the strings reach."""
        return self.readings if self.quantity == "theta" else np.arcsin(np.clip(self.readings / cradle.length, -1, 1))

    @property
    def bobs_seen(self) -> tuple[int, ...]:
        """Numbers of the bobs with at least one reading that is fitted or held out."""
        used = self.readings[self.fitted | self.held_out]
        return tuple(int(i) + 1 for i in np.flatnonzero(~np.isnan(used).all(axis=0)))


#: Fields of Cradle that can be inferred.
INFERABLE = (
    "length pivot_half_spacing mass radius youngs_modulus poisson_ratio k_f kappa b delta gravity restitution".split()
)


def check_run(cradle: Cradle, run: Run) -> Run:
    """The run with its δ, if it fits the cradle and can begin as stated; ValueError otherwise."""
    if run.readings.shape[1] != cradle.bobs:
        raise ValueError(f"readings of {run.readings.shape[1]} bobs; the cradle has {cradle.bobs} bobs")
    of_run = cradle if run.delta is None else cradle.replace(delta=run.delta)
    if run.release is not None:
        prepare(of_run, run.release.release)
    check_cost(of_run, run.duration, steps_needed(of_run, run.duration), _MOST_STEPS, _LATE)
    return dataclasses.replace(run, delta=of_run.delta)


def check_prior(cradle: Cradle, name: str, prior: Prior) -> None:
    """Refuses the prior of something that cannot be inferred, or one that reaches impossible values."""
    parameters = {f"{e.name}.{p.key}": p for e in cradle.composition for p in e.parameters}
    if name not in INFERABLE and name not in parameters:
        stated = ParameterName.parse(name)
        absent = stated.effect or stated.key
        if absent in (e.name for e in CATALOGUE) and not cradle.has(absent):
            raise ValueError(
                f"{name} is of an effect that is not in the model; add {absent!r} to effects under [model]"
            )
        raise ValueError(unknown_key("name to infer", name, [*INFERABLE, *parameters]))
    for value in prior.support:
        if name in INFERABLE:
            cradle.replace(**{name: value})
        else:
            p = parameters[name]
            check_range(name, value, p.unit, p.low, p.high)
