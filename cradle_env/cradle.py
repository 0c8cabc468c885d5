"""A cradle: frozen, validated, in SI units or in the paper's dimensionless groups."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cradle_env import cradle_limits as limits
from cradle_env import display
from cradle_env.effects import Effect, compose, effect
from cradle_env.effects.elements import with_value
from cradle_env.errors import check_range, one_line
from cradle_env.impact_law import fit_power_law
from cradle_env.mechanics import layout
from cradle_env.parameter_name import ParameterName
from cradle_env.pickling import reduce_to_fields

#: β of the standard set: what κ is taken from where it is not given.
STANDARD_BETA = 0.114
#: Range of speeds [m/s] over which e(v) of k_f is fitted by 1 − α vⁿ (the paper's Fig. 2c).
POWER_LAW_SPEEDS = (0.02, 1.0)


#: Unit and symbol of the fields of Cradle that are physical quantities.
FIELDS = {
    "k_f": ("N s m^-3/2", "k_f"),
    "kappa": ("N/m", "κ"),
    "b": ("kg/s", "b"),
    "length": ("m", "r_0"),
    "pivot_half_spacing": ("m", "a"),
    "mass": ("kg", "m"),
    "radius": ("m", "R"),
    "youngs_modulus": ("Pa", "E"),
    "poisson_ratio": ("1", "ν"),
    "delta": ("1", "δ"),
    "gravity": ("m/s^2", "g"),
    "restitution": ("1", "e"),
}


@dataclass(frozen=True, eq=True)
class Cradle:
    """N equal bobs on strings, and the model of them: frozen, validated, in SI units.

    Parameters
    ----------
    bobs : int
        N, 1 to 200.
    length : float
        r0, height of the pivots over a bob's centre on unstretched strings [m].
    pivot_half_spacing : float
        a, half the distance between the two pivots of a bob [m]; a string is √(r0² + a²) long.
    mass, radius : float
        Of one bob [kg], [m].
    youngs_modulus, poisson_ratio : float
        Of the bobs' material [Pa], [1]; they set the stiffness `k_el` of a contact (eq. 1).
    k_f : float
        Viscoelastic dissipation of a contact [N s/m^(3/2)] (eq. 1).
    kappa : float, optional
        κ, loading stiffness of one string [N/m] (eq. 4). Default: that of β = 0.114.
    b : float
        Linear drag on a bob [kg/s] (eqs. 5, 6).
    delta : float or sequence of float
        δ = d/2R − 1 of pivots a distance d apart: one number, or one for each of the N − 1 gaps.
    gravity : float
        [m/s²]
    model : {"nsp", "pendulum", "ho"}
        The base model; `MODELS` lists the effects of each.
    effects : mapping of str to mapping
        More effects by name, each with its parameters; ``{"-name": {}}`` takes one of the model's out. `CATALOGUE`
        lists them.
    power_law : (float, float), optional
        (α, n) of e = 1 − α vⁿ, v in m/s, instead of eq. 1.
    restitution : float
        Constant e of a model without velocity_dependent_restitution.

    Raises
    ------
    ValueError
        Names the field, its value and unit, and what is allowed.

    References
    ----------
    Lee & Hong, arXiv:2401.16693, eqs. 1 to 6.

    Examples
    --------
    >>> cradle = Cradle(bobs=3, delta=0.01, effects={"quadratic_drag": {"c2": 2e-3}})
    >>> round(cradle.beta, 3), round(cradle.period, 2), cradle.gaps.tolist()
    (0.114, 1.1, [0.01, 0.01])
    """

    bobs: int = 5
    length: float = 0.30
    pivot_half_spacing: float = 0.10
    mass: float = 0.2813
    radius: float = 0.020
    youngs_modulus: float = 200e9
    poisson_ratio: float = 0.29
    k_f: float = 18000.0
    kappa: float = None  # type: ignore[assignment]  # filled in below
    b: float = 0.002
    delta: float | tuple[float, ...] = 0.0
    gravity: float = 9.81
    model: str = "nsp"
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    power_law: tuple[float, float] | None = None
    restitution: float = 0.97

    def __post_init__(self) -> None:
        put = functools.partial(object.__setattr__, self)
        bobs = check_range("bobs", self.bobs, "", 1, 200)
        if bobs != int(bobs) or isinstance(self.bobs, bool):
            raise ValueError(f"bobs is {one_line(self.bobs)}; it must be a whole number from 1 to 200")
        put("bobs", int(bobs))
        for name, unit in (("length", "m"), ("mass", "kg"), ("radius", "m"), ("gravity", "m/s^2")):
            positive = check_range(name, getattr(self, name), unit, 0.0, limits.LARGEST, above=True)
            put(name, check_range(name, positive, unit, limits.SMALLEST))
        put("youngs_modulus", check_range("youngs_modulus", self.youngs_modulus, "Pa", *limits.MODULI))
        put("poisson_ratio", check_range("poisson_ratio", self.poisson_ratio, "", -1.0, 0.5, above=True))
        for name, unit in (("pivot_half_spacing", "m"), ("k_f", "N s/m^(3/2)"), ("b", "kg/s")):
            put(name, check_range(name, getattr(self, name), unit, 0.0, limits.LARGEST))
        put("restitution", check_range("restitution", self.restitution, "", 0.0, 1.0))
        kappa = self._kappa_for(STANDARD_BETA) if self.kappa is None else self.kappa
        put("kappa", check_range("kappa", kappa, "N/m", 0.0, limits.LARGEST, above=True))
        if self.power_law is not None:
            if np.shape(self.power_law) != (2,):
                raise ValueError(f"power_law is {one_line(self.power_law)}; it must be the pair (alpha, n)")
            alpha, n = self.power_law
            put("power_law", (check_range("alpha", alpha, "", 0.0), check_range("n", n, "", 0.0)))
        put("delta", limits.check_delta(self.delta, self.bobs))
        put("effects", limits.check_effects(self.model, self.effects, self.bobs))
        limits.check_proportions(self)

    @classmethod
    def from_groups(
        cls, *, beta: float = STANDARD_BETA, alpha: float | None = None, n: float | None = None, **fields
    ) -> Cradle:
        """A cradle from dimensionless groups.

        Parameters
        ----------
        beta : float
            β = ω_θ/ω_r, which sets κ.
        alpha, n : float, optional
            Of e = 1 − α vⁿ, v in m/s, instead of k_f; both or neither.
        **fields
            Other fields of `Cradle`, but not kappa.

        Raises
        ------
        ValueError
            For kappa, for one of alpha and n alone, and as `Cradle`.

        Examples
        --------
        >>> cradle = Cradle.from_groups(bobs=2, beta=0.1, alpha=0.02, n=0.2)
        >>> round(cradle.beta, 6), cradle.alpha, cradle.n
        (0.1, 0.02, 0.2)
        """
        if "kappa" in fields:
            raise ValueError("both beta and kappa are given; beta sets kappa, so give one of them")
        if (alpha is None) != (n is None):
            raise ValueError("alpha and n belong together: give both (e = 1 − α vⁿ) or neither (k_f)")
        if alpha is not None and n is not None:
            fields["power_law"] = (alpha, n)
        return cls(**fields).replace(beta=beta)

    def __reduce__(self):
        return reduce_to_fields(self)

    def replace(self, *, beta: float | None = None, **fields) -> Cradle:
        """A copy with some fields changed.

        Parameters
        ----------
        beta : float, optional
            Sets κ, by the masses and lengths of the copy.
        **fields
            Fields of `Cradle`.

        Examples
        --------
        >>> Cradle(bobs=5).replace(bobs=2).bobs
        2
        """
        cradle = dataclasses.replace(self, **fields)
        if beta is None:
            return cradle
        return dataclasses.replace(cradle, kappa=cradle._kappa_for(check_range("beta", beta, "", *limits.BETAS)))

    def with_values(self, values: Mapping[str, float]) -> Cradle:
        """A copy with some parameters changed by name.

        Parameters
        ----------
        values : mapping of str to float
            By a field, "effect.key", "effect.key[i]" of bob or gap i, or "effect.key[*]" of all of them. The last
            of values that must sum to 0 is computed from the others.

        Raises
        ------
        ValueError
            For a name of another form, a number beyond the values there are, and values out of bounds.

        Examples
        --------
        >>> cradle = Cradle(bobs=3, effects={"spacer_offset": {"offset": [0.0, 0.0]}})
        >>> cradle.with_values({"b": 0.003, "spacer_offset.offset[2]": 0.001}).gaps.tolist()
        [0.0, 0.001]
        """
        fields: dict[str, Any] = {}
        effects: dict[str, dict[str, Any]] = {name: dict(known) for name, known in self.effects.items()}
        for text, value in values.items():
            name = ParameterName.parse(text)
            if name.effect:
                effects[name.effect] = with_value(effects.get(name.effect, {}), name, value)
            else:
                fields[text] = value
        closed = {name: effect(name.removeprefix("-")).balance(known) for name, known in effects.items()}
        return self.replace(**fields, effects=closed)

    def _kappa_for(self, beta: float) -> float:
        stiffness = self.mass * self.gravity / (self.length * beta**2)
        return stiffness * (1.0 + (self.pivot_half_spacing / self.length) ** 2) / 4.0

    @functools.cached_property
    def composition(self) -> tuple[Effect, ...]:
        """The effects that make up the model."""
        return compose(self.model, self.effects)

    def has(self, name: str) -> bool:
        """Whether the model holds the effect of that name."""
        return any(e.name == name for e in self.composition)

    @property
    def k_el(self) -> float:
        """Elastic stiffness of a contact, (2/3) E/(1 − ν²) √(R/2) [N/m^(3/2)] (eq. 1)."""
        return 2.0 / 3.0 * self.youngs_modulus / (1.0 - self.poisson_ratio**2) * math.sqrt(self.radius / 2.0)

    @property
    def radial_stiffness(self) -> float:
        """κ_r of the four strings against a radial displacement, 4 κ r0²/(r0² + a²) [N/m]."""
        return 4.0 * self.kappa / (1.0 + (self.pivot_half_spacing / self.length) ** 2)

    @property
    def beta(self) -> float:
        """β = ω_θ/ω_r = √(m g/(κ_r r0))."""
        return math.sqrt(self.mass * self.gravity / (self.radial_stiffness * self.length))

    @property
    def alpha(self) -> float:
        """α of e = 1 − α vⁿ; fitted to e(v) over 0.02–1 m/s where k_f is given (v in m/s)."""
        return self._power_law[0]

    @property
    def n(self) -> float:
        """n of e = 1 − α vⁿ; see `alpha`."""
        return self._power_law[1]

    @functools.cached_property
    def _power_law(self) -> tuple[float, float]:
        if not self.has("velocity_dependent_restitution"):
            return 1.0 - self.restitution, 0.0
        if self.power_law is not None:
            return self.power_law
        if self.k_f == 0.0:
            return 0.0, 0.0
        return fit_power_law(*self.contact_records(), *POWER_LAW_SPEEDS)

    def write_law(self, record: np.ndarray) -> None:
        """Writes the law of this cradle's impacts into the record that the kernels read, (1,) of CRADLE."""
        record["k_el"], record["k_f"], record["restitution"] = self.k_el, self.k_f, self.restitution
        record["alpha"], record["exponent"] = self.power_law or (0.0, 0.0)
        record["law"] = layout.KUWABARA_KONO if self.power_law is None else layout.POWER_LAW
        if not self.has("velocity_dependent_restitution"):
            record["law"] = layout.CONSTANT

    def contact_records(self) -> tuple[np.ndarray, float]:
        """What decides a pair impact: the record (1,) of CRADLE, its contact part filled, and a bob's inertia [kg]."""
        record, bobs = np.zeros(1, layout.CRADLE), np.zeros(self.bobs, layout.BOB)
        self.write_law(record)
        for e in self.composition:
            if e.acts_on in ("bob", "contact") and e.apply is not None:
                e.apply(record, bobs, self.effects.get(e.name, {}))
        return record, self.mass + float(bobs["added_mass"][0])

    @property
    def period(self) -> float:
        """Small-angle period 2π √(r0/g) [s]."""
        return 2.0 * math.pi * math.sqrt(self.length / self.gravity)

    @functools.cached_property
    def gaps(self) -> np.ndarray:
        """δ of each gap, as stated, and what effects add; shape (N − 1,), read-only."""
        gaps = np.broadcast_to(np.asarray(self.delta, dtype=float), (self.bobs - 1,))
        for e in self.composition:
            if e.gaps is not None:
                gaps = gaps + e.gaps(self.effects.get(e.name, {}))
        gaps.flags.writeable = False
        return gaps

    @functools.cached_property
    def pivots(self) -> np.ndarray:
        """x of each bob's pivot [m], centred; shape (N,), read-only."""
        x = np.concatenate([[0.0], np.cumsum(2.0 * self.radius * (1.0 + self.gaps))])
        x -= 0.5 * x[-1]
        x.flags.writeable = False
        return x

    def __repr__(self) -> str:
        standard = {"kappa": self._kappa_for(STANDARD_BETA)}
        return display.summary_line("Cradle", display.changed_fields(self, standard))

    def _repr_html_(self) -> str:
        effects = ", ".join(e.name for e in self.composition)
        rows = [("bobs", str(self.bobs), ""), ("model", self.model, ""), ("effects", effects, "")]
        for name, (unit, _) in FIELDS.items():
            rows.append((name, display.value_text(getattr(self, name)), "" if unit == "1" else unit))
        if self.power_law is not None:
            rows.append(("power_law", display.value_text(self.power_law), ""))
        for name, values in self.effects.items():
            units = {p.key: p.unit for p in effect(name.removeprefix("-")).parameters}
            rows += [(f"{name}.{key}", display.value_text(value), units[key]) for key, value in values.items()]
        return display.table("Cradle", rows)

    def __hash__(self) -> int:
        return hash((self.bobs, self.length, self.kappa, self.k_f, self.b, self.delta, self.model))


#: Fields of Cradle that are one number each.
CRADLE_NUMBERS = tuple(
    f.name for f in dataclasses.fields(Cradle) if f.name not in ("bobs", "delta", "model", "effects", "power_law")
)
