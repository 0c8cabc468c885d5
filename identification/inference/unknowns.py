"""What is to be inferred: each unknown with its unit, where to start, its prior, and how it is sampled."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cradle_env.cradle import FIELDS, Cradle
from cradle_env.errors import unknown_key
from cradle_env.parameter_name import ALL, ParameterName
from identification.experiment.experiment import Experiment
from identification.experiment.run import Prior, Run

#: Between what values of them there is a cradle, where that is not from 0 on.
_BOUNDS = {"delta": (-1.0, math.inf), "poisson_ratio": (-1.0, 0.5), "restitution": (0.0, 1.0)}
#: Without a prior, a positive unknown is uniform in its logarithm, this factor either way of its starting value.
_PRIOR_FACTORS = {"k_f": 1000.0, "kappa": 10.0, "b": 100.0}
#: Width of the global search in the logarithm: stated values are good to some tens of percent, b to a factor.
SEARCH_WIDTHS = {"k_f": 0.25, "kappa": 0.15, "b": 0.5}
#: Tension of strings over that of new ones from which a search begins: they wear in from 1 to 1/2 in seconds to a
#: minute of swinging, and stay there.
WORN_TENSION_RATIO = 0.6


@dataclass(frozen=True)
class Unknown:
    """One coordinate of the inference.

    name: a field of Cradle, "effect.parameter", or "quantity[bob]@run" for what belongs to one run; start and low,
    high in `unit`; mean, sd: a normal prior (nan: none, uniform between low and high); log: sampled as its
    logarithm, in which a uniform prior is then flat; search: half width of the global search in the sampled
    coordinate (0: not searched); nuisance: belongs to the measurement rather than to the cradle.
    """

    name: str
    unit: str
    symbol: str
    start: float
    low: float = -math.inf
    high: float = math.inf
    mean: float = math.nan
    sd: float = math.nan
    log: bool = False
    search: float = 0.0
    nuisance: bool = False

    def coordinate(self, value: float) -> float:
        """The sampled coordinate of a value."""
        return math.log(value) if self.log else value

    def value(self, coordinate):
        """The value(s) at sampled coordinate(s)."""
        return np.exp(coordinate) if self.log else coordinate

    def log_prior(self, coordinate: float) -> float:
        """Log density in the sampled coordinate, up to a constant; −inf outside the bounds."""
        value = float(self.value(coordinate))
        if not self.low <= value <= self.high:
            return -math.inf
        if math.isnan(self.sd):
            return 0.0
        jacobian = coordinate if self.log else 0.0
        return -0.5 * ((value - self.mean) / self.sd) ** 2 + jacobian


def model_unknowns(experiment: Experiment, parameters: Sequence[str] | None = None) -> list[Unknown]:
    """Unknowns of the cradle: k_f, kappa, b and those with a prior, as far as they matter, and effect parameters.

    parameters: which of the first three to infer; ValueError for one that is not theirs, or cannot matter.
    """
    cradle = experiment.cradle
    for name in parameters or ():
        if name not in SEARCH_WIDTHS:
            raise ValueError(unknown_key("parameter", name, SEARCH_WIDTHS) + "; others go into [infer] with a prior")
        if not matters(cradle, name):
            raise ValueError(f"{name} cannot matter in this model and is not inferred; leave it out")
    names = [name for name in (SEARCH_WIDTHS if parameters is None else parameters) if matters(cradle, name)]
    names += [name for name in experiment.infer if "." not in name and name not in names and matters(cradle, name)]
    unknowns = [_field_unknown(cradle, name, experiment.infer.get(name)) for name in names]
    chosen = [*experiment.unknown_effect_parameters]
    chosen += [name for name in experiment.infer if "." in name and name not in chosen]
    for name in chosen:
        prior = experiment.infer.get(name)
        unknowns += [_effect_unknown(cradle, element, prior) for element in _elements(cradle, name)]
    return unknowns


def matters(cradle: Cradle, name: str) -> bool:
    """Whether a parameter, α and n of e = 1 − α vⁿ among them, can have any effect on the motion of this cradle."""
    of_speed = cradle.has("velocity_dependent_restitution")
    if name in ("kappa", "pivot_half_spacing"):
        return cradle.has("radial_elasticity")
    if name in ("alpha", "n"):
        return cradle.bobs > 1 and of_speed
    if name in ("k_f", "youngs_modulus", "poisson_ratio"):  # of eq. 1
        return cradle.bobs > 1 and of_speed and cradle.power_law is None
    if name == "restitution":
        return cradle.bobs > 1 and not of_speed
    return cradle.bobs > 1 or name != "delta"


def _field_unknown(cradle: Cradle, name: str, prior: Prior | None) -> Unknown:
    unit, symbol = FIELDS[name]
    start = float(np.mean(cradle.delta)) if name == "delta" else float(getattr(cradle, name))
    if prior is not None:
        low, high = _BOUNDS.get(name, (0.0, math.inf))
        return _with_prior(Unknown(name, unit, symbol, start, low, high), prior)
    factor = _PRIOR_FACTORS[name]
    start = start or float(getattr(Cradle(), name))  # stated as 0: as good as not stated
    return Unknown(
        name, unit, symbol, start, low=start / factor, high=start * factor, log=True, search=SEARCH_WIDTHS[name]
    )  # fmt: skip


def _elements(cradle: Cradle, name: str) -> list[str]:
    """What is inferred under a name: itself, or every value of a parameter with one for each bob or gap."""
    stated = ParameterName.parse(name)
    parameters = (p for e in cradle.composition if e.name == stated.effect for p in e.parameters)
    if stated.element is None:
        for p in parameters:
            if p.key == stated.key:
                return [f"{stated.effect}.{key}" for key in p.element_keys(cradle.bobs)]
    return [name]


def _effect_unknown(cradle: Cradle, name: str, prior: Prior | None) -> Unknown:
    stated = ParameterName.parse(name)
    declared = next(e for e in cradle.composition if e.name == stated.effect)
    p = next(p for p in declared.parameters if p.key == stated.key)
    start: Any = cradle.effects.get(stated.effect, {}).get(stated.key, p.scale)
    symbol = p.symbol
    if stated.element == ALL:
        start = start[0]
    elif stated.element is not None:
        start, symbol = start[stated.element - 1], f"{p.symbol}_{stated.element}"
    if p.log:  # where the effect is absent, a search begins at its scale
        start, search = (start if math.isfinite(start) else p.scale), 1.0
    else:
        search = p.scale
    unknown = Unknown(name, p.unit, symbol, start, low=p.low, high=p.high, log=p.log, search=search)
    return unknown if prior is None else _with_prior(unknown, prior)


def _with_prior(unknown: Unknown, prior: Prior) -> Unknown:
    """The unknown with a stated prior: sampled as it is, searched over what the prior leaves open."""
    fields = {**unknown.__dict__, "log": False}
    if prior.sd is not None and prior.mean is not None:
        return Unknown(**{**fields, "start": prior.mean, "mean": prior.mean, "sd": prior.sd, "search": 2.0 * prior.sd})
    assert prior.low is not None and prior.high is not None
    inside = prior.low < unknown.start < prior.high
    start = unknown.start if inside else 0.5 * (prior.low + prior.high)
    width = 0.5 * (prior.high - prior.low)
    return Unknown(**{**fields, "start": start, "low": prior.low, "high": prior.high, "search": width})


def run_unknowns(experiment: Experiment, index: int, noise: float) -> list[Unknown]:
    """Unknowns of one run: release within its sd, or initial state; rest offsets; noise (`noise`: a first guess)."""
    cradle, run = experiment.cradle_of(experiment.runs[index]), experiment.runs[index]
    found: list[Unknown] = []

    def add(quantity: str, unit: str, symbol: str, start: float, bob: int | None = None, **fields) -> None:
        found.append(Unknown(name_in_run(quantity, index, bob), unit, symbol, start, nuisance=True, **fields))

    if run.state == "release":
        assert run.release is not None
        if run.release.angle_sd > 0.0:
            add("release_angle_error", "rad", "Δθ_0", 0.0, mean=0.0, sd=run.release.angle_sd)
        if run.release.time_sd > 0.0:
            add("release_time_error", "s", "Δt_0", 0.0, mean=0.0, sd=run.release.time_sd)
    else:
        theta, theta_dot = estimate_initial_motion(cradle, run)
        bobs = range(1, cradle.bobs + 1)
        for bob in bobs:
            add("theta", "rad", f"θ_{bob}", theta[bob - 1], bob, low=-math.pi, high=math.pi)
            add("theta_dot", "rad/s", f"θ̇_{bob}", theta_dot[bob - 1], bob)
        if cradle.has("radial_elasticity"):
            # Strings ripple by a part of what the bob's weight stretches them by.
            ripple = 0.3 * sag(cradle)
            speed = ripple * math.sqrt(cradle.radial_stiffness / cradle.mass)
            worn = {"low": 0.3, "high": 1.0, "mean": 0.65, "sd": 0.2, "search": 0.3}
            for bob in bobs:
                add("stretch", "m", f"Δr_{bob}", 0.0, bob, mean=0.0, sd=ripple)
                add("r_dot", "m/s", f"ṙ_{bob}", 0.0, bob, mean=0.0, sd=speed)
                if cradle.has("string_hysteresis"):
                    add("tension_ratio", "1", f"T_{bob}", WORN_TENSION_RATIO, bob, **worn)
    if run.rest == "free":
        unit, width = ("rad", 0.02) if run.quantity == "theta" else ("m", 0.02 * cradle.length)
        for bob in run.bobs_seen:
            add("rest", unit, f"x_{bob}", 0.0, bob, mean=0.0, sd=width)
    if run.noise is None:
        unit = "rad" if run.quantity == "theta" else "m"
        add("noise", unit, "σ_n", noise, low=1e-3 * noise, high=1e4 * noise, log=True)
    return found


def name_in_run(quantity: str, index: int, bob: int | None = None) -> str:
    """The name of an unknown of run `index` (from 0), of one bob (from 1) if each has its own."""
    return str(ParameterName(quantity, element=bob, run=index + 1))


def noise_name(index: int) -> str:
    """The name of the unknown noise of run `index` (from 0)."""
    return name_in_run("noise", index)


def sag(cradle: Cradle) -> float:
    """By how much a bob's weight stretches new strings, along r [m]."""
    return cradle.mass * cradle.gravity / cradle.radial_stiffness


def estimate_initial_motion(cradle: Cradle, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """(theta, theta_dot) at fit_from, each (N,): straight lines through the first readings of each bob."""
    along = run.angles(cradle)
    theta, theta_dot = np.zeros(cradle.bobs), np.zeros(cradle.bobs)
    step = 0.03 * cradle.period
    for i in range(cradle.bobs):
        seen = ~np.isnan(along[:, i]) & (run.times >= run.fit_from - step)
        close = seen & (run.times <= run.fit_from + step)
        close = close if close.sum() >= 3 else np.isin(np.arange(len(seen)), np.flatnonzero(seen)[:3])
        if close.sum() >= 2:
            theta_dot[i], theta[i] = np.polyfit(run.times[close] - run.fit_from, along[close, i], 1)
    return theta, theta_dot
