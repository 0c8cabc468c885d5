"""The unknowns of the inference: unit, start, prior and sampled coordinate of each."""

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
from identification.inference import click_likelihood

#: Physical bounds of fields of Cradle; other fields go from 0 to infinity.
_BOUNDS = {"delta": (-1.0, math.inf), "poisson_ratio": (-1.0, 0.5), "restitution": (0.0, 1.0)}
#: Without a prior, the logarithm of an unknown is uniform, from start/factor to start·factor.
_PRIOR_FACTORS = {"k_f": 1000.0, "kappa": 10.0, "b": 100.0}
#: Half width of the global search in the logarithm: stated values are correct within 25 to 35 %, b within a factor 1.6.
SEARCH_WIDTHS = {"k_f": 0.25, "kappa": 0.3, "b": 0.5}
#: Start value of the tension of strings over that of new strings. It falls from 1 to 1/2 within seconds to a minute of
#: swinging, and stays there.
WORN_TENSION_RATIO = 0.6

#: Unknowns of a run of impacts, beside its noise: instant of the release in the recording [s], part of the contact's
#: duration by which a click follows the touch, probability that a click is missed, false clicks a second.
RELEASE_TIME, CLICK_LAG, MISSED, FALSE_RATE = "release_time", "click_lag", "missed", "false_rate"
#: A click is made between the touch and the end of the contact; searched from the middle, over all of it.
_LAG, _LAG_BOUNDS, _LAG_SEARCH = 0.5, (0.0, 1.0), 0.5
#: How far the release may be off where the pattern of clicks has it, in half swings, and how far it is searched.
_RELEASE_OFF, _RELEASE_SEARCH = 0.2, 0.02
#: Where these two are searched from, their bounds, and the width of what clicks of a minute tell, in the logarithm.
_MISSED, _MISSED_BOUNDS = 0.05, (1e-3, 0.98)
_FALSE_RATE, _FALSE_RATE_BOUNDS, _RARE_WIDTH = 0.05, (1e-3, 20.0), 0.7


@dataclass(frozen=True)
class Unknown:
    """One unknown of the inference.

    Parameters
    ----------
    name : str
        A field of Cradle, "effect.key", or "quantity[bob]@run" for a quantity of one run.
    unit, symbol : str
        Unit and symbol.
    start : float
        Value from which a search starts, in `unit`.
    low, high : float
        Bounds, in `unit`.
    mean, sd : float
        Normal prior, in `unit`; nan for a uniform prior between the bounds.
    log : bool
        Whether the logarithm is sampled. A uniform prior is then uniform in the logarithm.
    search : float
        Half width of the global search, in the sampled coordinate; 0 if the unknown is not searched.
    nuisance : bool
        Whether it belongs to the measurement and not to the cradle.
    width : float
        Standard deviation of the sampled coordinate from which sampling starts; nan if least squares gives it.

    Examples
    --------
    >>> b = Unknown("b", "kg/s", "b", 0.002, low=2e-5, high=0.2, log=True)
    >>> round(float(b.value(b.coordinate(0.01))), 6), b.log_prior(b.coordinate(1.0))
    (0.01, -inf)
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
    width: float = math.nan

    def coordinate(self, value: float) -> float:
        """Convert a value to the sampled coordinate."""
        return math.log(value) if self.log else value

    def value(self, coordinate):
        """Convert sampled coordinates, a number or an array, to values."""
        return np.exp(coordinate) if self.log else coordinate

    def log_prior(self, coordinate: float) -> float:
        """Log density of the prior in the sampled coordinate, up to a constant; −inf outside the bounds."""
        value = float(self.value(coordinate))
        if not self.low <= value <= self.high:
            return -math.inf
        if math.isnan(self.sd):
            return 0.0
        jacobian = coordinate if self.log else 0.0
        return -0.5 * ((value - self.mean) / self.sd) ** 2 + jacobian


def model_unknowns(experiment: Experiment, parameters: Sequence[str] | None = None) -> list[Unknown]:
    """List the unknowns of the cradle: k_f, kappa, b, fields with a prior, and effect parameters.

    A field that has no effect on the motion of this cradle is left out. parameters: which of k_f, kappa and b to infer.
    Raises ValueError if it has another name, or one without effect.
    """
    cradle = experiment.cradle
    for name in parameters or ():
        if name not in SEARCH_WIDTHS:
            raise ValueError(unknown_key("parameter", name, SEARCH_WIDTHS) + "; others go into [infer] with a prior")
        if not matters(cradle, name):
            raise ValueError(f"{name} has no effect in this model and is not inferred; leave it out")
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
    """Whether a parameter, including α and n of e = 1 − α vⁿ, can have an effect on the motion of this cradle."""
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
    start = start or float(getattr(Cradle(), name))  # a stated 0 has no logarithm
    return Unknown(
        name, unit, symbol, start, low=start / factor, high=start * factor, log=True, search=SEARCH_WIDTHS[name]
    )  # fmt: skip


def _elements(cradle: Cradle, name: str) -> list[str]:
    """Names of the unknowns under a name: itself, or each element of a parameter with one value per bob or gap."""
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
    if p.log:  # an absent effect starts from its scale
        start, search = (start if math.isfinite(start) else p.scale), 1.0
    else:
        search = p.scale
    unknown = Unknown(name, p.unit, symbol, start, low=p.low, high=p.high, log=p.log, search=search)
    return unknown if prior is None else _with_prior(unknown, prior)


def _with_prior(unknown: Unknown, prior: Prior) -> Unknown:
    """Give an unknown a stated prior: its value is sampled, not its logarithm, and searched over the prior's width."""
    fields = {**unknown.__dict__, "log": False}
    if prior.sd is not None and prior.mean is not None:
        return Unknown(**{**fields, "start": prior.mean, "mean": prior.mean, "sd": prior.sd, "search": 2.0 * prior.sd})
    assert prior.low is not None and prior.high is not None
    inside = prior.low < unknown.start < prior.high
    start = unknown.start if inside else 0.5 * (prior.low + prior.high)
    width = 0.5 * (prior.high - prior.low)
    return Unknown(**{**fields, "start": start, "low": prior.low, "high": prior.high, "search": width})


def run_unknowns(experiment: Experiment, index: int, noise: float) -> list[Unknown]:
    """List the unknowns of run `index`, from 0.

    They are the errors of the release or the initial state, the rest offsets, and the noise. noise: its first guess
    [rad or m].
    """
    cradle, run = experiment.cradle_of(experiment.runs[index]), experiment.runs[index]
    unknowns: list[Unknown] = []

    def add(quantity: str, unit: str, symbol: str, start: float, bob: int | None = None, **fields) -> None:
        unknowns.append(Unknown(name_in_run(quantity, index, bob), unit, symbol, start, nuisance=True, **fields))

    if run.of_impacts:
        half = 0.5 * cradle.period
        start, off = click_likelihood.release_instant(cradle, run), _RELEASE_OFF * half
        add(RELEASE_TIME, "s", "t_0", start, low=start - off, high=start + off, search=_RELEASE_SEARCH * half)
        add(CLICK_LAG, "1", "s_c", _LAG, low=_LAG_BOUNDS[0], high=_LAG_BOUNDS[1], search=_LAG_SEARCH)
        rare = {"log": True, "width": _RARE_WIDTH}
        add(MISSED, "1", "m", _MISSED, low=_MISSED_BOUNDS[0], high=_MISSED_BOUNDS[1], **rare)
        add(FALSE_RATE, "1/s", "ρ", _FALSE_RATE, low=_FALSE_RATE_BOUNDS[0], high=_FALSE_RATE_BOUNDS[1], **rare)
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
            # The radial ripple is a part of the static stretch of the strings.
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
        add("noise", run.si_unit, "σ_n", noise, low=1e-3 * noise, high=1e4 * noise, log=True)
    return unknowns


def name_in_run(quantity: str, index: int, bob: int | None = None) -> str:
    """Name an unknown of run `index`, from 0, and of `bob`, from 1, if each bob has its own."""
    return str(ParameterName(quantity, element=bob, run=index + 1))


def noise_name(index: int) -> str:
    """Name the unknown noise of run `index`, from 0."""
    return name_in_run("noise", index)


def sag(cradle: Cradle) -> float:
    """Static stretch of new strings by the weight of a bob, along r [m]."""
    return cradle.mass * cradle.gravity / cradle.radial_stiffness


def estimate_initial_motion(cradle: Cradle, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Estimate angles [rad] and their rates [rad/s] at `fit_from`, each (N,), by lines through the first readings."""
    angles = run.angles(cradle)
    theta, theta_dot = np.zeros(cradle.bobs), np.zeros(cradle.bobs)
    step = 0.03 * cradle.period
    for i in range(cradle.bobs):
        seen = ~np.isnan(angles[:, i]) & (run.times >= run.fit_from - step)
        close = seen & (run.times <= run.fit_from + step)
        close = close if close.sum() >= 3 else np.isin(np.arange(len(seen)), np.flatnonzero(seen)[:3])
        if close.sum() >= 2:
            theta_dot[i], theta[i] = np.polyfit(run.times[close] - run.fit_from, angles[close, i], 1)
    return theta, theta_dot
