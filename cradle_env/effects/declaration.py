"""What one effect declares about itself. Simulator, files, calibration, docs table and tests read nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cradle_env.errors import check_range, one_line, unknown_key
from cradle_env.mechanics.layout import USER

#: Values of an effect's parameters by key; where there is one for each bob or gap, an array of them.
Values = Mapping[str, Any]

#: Where an effect can act.
PLACES = ("string", "bob", "contact", "support", "measurement")


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Parameters
    ----------
    key, symbol, unit, meaning : str
        Its name in files and in Python, and how texts and figures show it.
    absent : float
        Value at which the effect is absent: inf if the effect fades as the parameter grows, nan if the parameter
        means nothing without the effect.
    low, high : float
        Physical bounds, in its unit.
    scale : float
        A typical value, in its unit: it starts searches and sets priors.
    each : {"", "bob", "gap"}
        Whether the parameter is one number, or one for each bob or gap.
    balanced : bool
        Whether the numbers of all bobs or gaps sum to 0.

    Raises
    ------
    ValueError
        If the effect is absent at the upper bound.

    Examples
    --------
    >>> drag = Parameter("c2", "c₂", "kg/m", "force per squared speed", absent=0.0, low=0.0, high=1.0, scale=1e-3)
    >>> drag.is_strength, drag.one_sided, drag.at_strength(2.0)
    (True, True, 0.002)
    """

    key: str
    symbol: str
    unit: str
    meaning: str
    absent: float
    low: float
    high: float
    scale: float
    each: str = ""
    balanced: bool = False

    def __post_init__(self) -> None:
        if math.isfinite(self.absent) and self.absent == self.high > self.low:
            raise ValueError(f"{self.key}: absent at its upper bound, {self.high:g}; state it with the other sign")

    @property
    def log(self) -> bool:
        """Whether only its order of magnitude is known beforehand: positive, and not absent at a finite value."""
        return self.low > 0.0 and not math.isfinite(self.absent)

    def count(self, bobs: int) -> int:
        """How many numbers a cradle of N bobs needs."""
        return {"": 1, "bob": bobs, "gap": bobs - 1}[self.each]

    @property
    def is_strength(self) -> bool:
        """Whether the effect is absent at a value of this parameter; the others mean nothing there."""
        return not math.isnan(self.absent)

    @property
    def one_sided(self) -> bool:
        """Whether the parameter is at a bound when the effect is absent."""
        return math.isinf(self.absent) or self.absent in (self.low, self.high)

    def at_strength(self, factor: float) -> float:
        """The value at `factor` scales from where the effect is absent; 1/factor scales if it is absent at inf."""
        if math.isinf(self.absent):
            return self.scale / factor if factor else self.absent
        return self.absent + factor * self.scale

    def repeat(self, value: float, bobs: int) -> Any:
        """The value, moved to the nearest bound if outside, for each bob or gap; the last one balances the sum."""
        value = min(max(value, self.low), self.high)
        if not self.each:
            return value
        others = [value] * (self.count(bobs) - self.balanced)
        return [*others, -value * len(others)] if self.balanced else others

    def element_keys(self, bobs: int) -> list[str]:
        """Keys of the values that are free: "c2", or "offset[1]", … one for each bob or gap, less a balanced last."""
        if not self.each:
            return [self.key]
        return [f"{self.key}[{i + 1}]" for i in range(self.count(bobs) - self.balanced)]

    def check(self, name: str, value: Any, bobs: int) -> float | tuple[float, ...]:
        """The value within its bounds; one for each bob or gap as a tuple, from a list or a single number."""
        several = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
        number: Any = value
        if not self.each:
            if several:
                raise ValueError(f"{name} takes one number [{self.unit}], not a list")
            return float(number) if number == self.absent else check_range(name, number, self.unit, self.low, self.high)
        values = list(number) if several else [number] * self.count(bobs)
        if len(values) != self.count(bobs):
            raise ValueError(f"{name} has {len(values)} values; {bobs} bobs have {self.count(bobs)} {self.each}s")
        numbers = tuple(check_range(name, v, self.unit, self.low, self.high) for v in values)
        if self.balanced and abs(sum(numbers)) > 1e-9:
            raise ValueError(f"{name} sums to {sum(numbers):g}; the values of all {self.each}s must sum to 0")
        return numbers


@dataclass(frozen=True)
class Effect:
    """One physical effect over the simplest cradle: linear pendulums, rigid strings, constant restitution, drag b.

    Parameters
    ----------
    name, symbol : str
        Its name in files and in Python, and its symbol in texts.
    acts_on : {"string", "bob", "contact", "support", "measurement"}
        Where it acts.
    summary, equation, reference, energy, looks_like, caveat : str
        What it is, its equation and source, the energy that it stores or takes, its signs in data, and its limits.
    parameters : tuple of Parameter
        None of a switch.
    requires : tuple of str
        Names of effects without which it is impossible.
    between : bool
        Whether it needs a neighbour.
    apply : callable, optional
        apply(cradle, bobs, values) writes the effect into the records that the kernels read.
    force : callable, optional
        force(t, r, theta, v_r, v_theta, parameters) -> (F_r, F_theta) [N], of an effect from outside the package;
        numba compiles it. At t < 0 it is the force on bobs at rest before the release.
    gaps : callable, optional
        gaps(values) is added to δ of each gap, (N − 1,).
    instants : callable, optional
        instants(values) -> offsets [s] and weights over which a reading averages.
    clock : callable, optional
        clock(values) is the rate of the file's clock over the true one.
    reading : callable, optional
        reading(values, theta) is the angle in the file of a true theta [rad].

    Raises
    ------
    ValueError
        For an unknown acts_on, or a force with too many parameters.

    Examples
    --------
    >>> from cradle_env import CATALOGUE
    >>> drag = next(effect for effect in CATALOGUE if effect.name == "quadratic_drag")
    >>> drag.acts_on, drag.equation, [p.key for p in drag.parameters]
    ('bob', 'F = −c2 |v| v', ['c2'])
    """

    name: str
    symbol: str
    acts_on: str
    summary: str
    equation: str
    reference: str
    energy: str
    looks_like: str
    parameters: tuple[Parameter, ...] = ()
    requires: tuple[str, ...] = ()
    between: bool = False
    apply: Callable[[np.ndarray, np.ndarray, Values], None] | None = None
    force: Callable[..., tuple[float, float]] | None = None
    gaps: Callable[[Values], np.ndarray] | None = None
    instants: Callable[[Values], tuple[np.ndarray, np.ndarray]] | None = None
    clock: Callable[[Values], float] | None = None
    reading: Callable[[Values, np.ndarray], np.ndarray] | None = None
    caveat: str = field(default="")

    def __post_init__(self) -> None:
        if self.acts_on not in PLACES:
            raise ValueError(
                f"effect {self.name}: acts_on is {one_line(self.acts_on)}; choose one of {', '.join(PLACES)}"
            )
        if self.force is not None and len(self.parameters) > USER:
            raise ValueError(f"effect {self.name}: a force from outside takes at most {USER} parameters")

    def absent_values(self) -> dict[str, float]:
        """The parameters at which the effect is not there; those that then mean nothing at their scale."""
        return {p.key: p.scale if math.isnan(p.absent) else p.absent for p in self.parameters}

    @property
    def strengths(self) -> tuple[Parameter, ...]:
        """The parameters at some value of which the effect is absent; none of an effect that is a switch."""
        return tuple(p for p in self.parameters if p.is_strength)

    def is_absent(self, values: Values) -> bool:
        """Whether all strengths are where the effect is absent; never so for a switch."""
        strengths = self.strengths
        return bool(strengths) and all(np.all(np.equal(values[p.key], p.absent)) for p in strengths)

    def element_names(self, bobs: int) -> list[str]:
        """Names of all free values for a cradle of N bobs: "effect.key", "effect.key[i]"."""
        return [f"{self.name}.{key}" for p in self.parameters for key in p.element_keys(bobs)]

    def balance(self, values: Values) -> dict[str, Any]:
        """The values, the last of each parameter that must sum to 0 computed from the others."""
        balanced = dict(values)
        for p in self.parameters:
            if p.balanced and p.key in balanced:
                *others, _ = balanced[p.key]
                balanced[p.key] = [*others, -sum(others)]
        return balanced

    def check(self, values: Values, bobs: int) -> dict[str, float | tuple[float, ...]]:
        """The values for a cradle of N bobs, complete and within bounds; ValueError otherwise."""
        known = {p.key: p for p in self.parameters}
        for key in values:
            if key not in known:
                raise ValueError(unknown_key(f"parameter of {self.name}", key, known))
        complete = {}
        for key, p in known.items():
            if key not in values:
                raise ValueError(f"{self.name}: {key} [{p.unit}] is missing; {p.meaning}")
            complete[key] = p.check(f"{self.name}: {key}", values[key], bobs)
        return complete
