"""What one effect declares about itself. Simulator, files, calibration, docs table and tests read nothing else."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from cradle_env.errors import check_range, unknown_key

#: Values of an effect's parameters by key; a sequence where there is one value per bob or per gap.
Values = Mapping[str, float]

#: Where an effect can act.
PLACES = ("string", "bob", "contact", "support", "measurement")


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    absent: the value at which the effect is not there (nan for a parameter that then means nothing);
    low, high: physical bounds; scale: a typical size, which starts searches and sets priors.
    """

    key: str
    symbol: str
    unit: str
    meaning: str
    absent: float
    low: float
    high: float
    scale: float


@dataclass(frozen=True)
class Effect:
    """One physical effect over the simplest cradle: linear pendulums, rigid strings, constant restitution, drag b.

    apply(cradle, bobs, values) writes the effect into the records that the kernels read; force(t, r, theta, v_r,
    v_theta, parameters) -> (F_r, F_theta) [N] is that of an effect from outside the package, compiled on first
    use. Measurement effects: `instants(values)` gives the offsets [s] and weights over which a reading averages,
    `reading(values, theta)` what the file shows for a true theta [rad].
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
    apply: Callable[[np.ndarray, np.ndarray, Values], None] | None = None
    force: Callable[..., tuple[float, float]] | None = None
    instants: Callable[[Values], tuple[np.ndarray, np.ndarray]] | None = None
    reading: Callable[[Values, np.ndarray], np.ndarray] | None = None
    caveat: str = field(default="")

    def __post_init__(self) -> None:
        if self.acts_on not in PLACES:
            raise ValueError(f"effect {self.name}: acts_on is {self.acts_on!r}; choose one of {', '.join(PLACES)}")
        if self.force is not None and len(self.parameters) > 8:
            raise ValueError(f"effect {self.name}: a force from outside takes at most 8 parameters")

    def absent_values(self) -> dict[str, float]:
        """The parameters at which the effect is not there."""
        return {p.key: p.absent for p in self.parameters}

    def checked(self, values: Values) -> dict[str, float]:
        """The values, complete and within bounds; ValueError otherwise."""
        known = {p.key: p for p in self.parameters}
        for key in values:
            if key not in known:
                raise ValueError(unknown_key(f"parameter of {self.name}", key, known))
        complete = {}
        for key, p in known.items():
            if key not in values:
                raise ValueError(f"{self.name}: {key} [{p.unit}] is missing; {p.meaning}")
            complete[key] = check_range(f"{self.name}: {key}", values[key], p.unit, p.low, p.high)
        return complete
