"""What values a cradle can have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env.effects import compose
from cradle_env.errors import check_range, one_line

if TYPE_CHECKING:
    from cradle_env.cradle import Cradle

# Beyond this, in SI units, a number is a slip of the pen, and squares of it leave the range of numbers.
LARGEST = 1e12
#: Nothing of length, mass, radius or gravity is smaller, no gap wider, and no β beyond these.
SMALLEST, WIDEST, BETAS = 1e-9, 100.0, (1e-6, 1e3)
#: The row of bobs in lengths of the strings at most: places are known to 1e-16 of the row.
LONGEST_ROW = 1e5
#: Largest k_f (m/2)^{-2/5} k_el^{-3/5} v^{1/5}, the damping of a contact that is followed in time, at v = √(g r0).
#: From 100 on, its equations are too stiff for explicit steps and the motion diverges; up to 50 it does not.
MOST_DAMPED = 30.0
#: Moduli [Pa] from that of a foam to a million times that of diamond.
MODULI = (1.0, 1e18)


def check_proportions(cradle: Cradle) -> None:
    """ValueError for a row of bobs, or a contact followed in time, that numbers cannot resolve."""
    if cradle.pivot_half_spacing > LONGEST_ROW * cradle.length:
        raise ValueError(
            f"pivot_half_spacing is {cradle.pivot_half_spacing:.3g} m on strings of length {cradle.length:g} m; "
            f"it must be at most {LONGEST_ROW:g} times as long, or rounding hides the motion"
        )
    span = float(np.ptp(cradle.pivots))
    if span > LONGEST_ROW * cradle.length:
        raise ValueError(
            f"the bobs hang in a row of {span:.3g} m on strings of length {cradle.length:g} m; "
            f"it must be at most {LONGEST_ROW:g} times as long, or rounding hides the motion"
        )
    if cradle.has("contact_duration") and cradle.power_law is not None:
        raise ValueError("contact_duration follows eq. 1 in time and needs k_f; take the power law out")
    most = MOST_DAMPED * (0.5 * cradle.mass) ** 0.4 * cradle.k_el**0.6 / (cradle.gravity * cradle.length) ** 0.1
    if cradle.effects.get("contact_duration", {}).get("scale", 0.0) > 0.0 and cradle.k_f > most:
        raise ValueError(
            f"k_f is {cradle.k_f:.3g} N s/m^(3/2); with contact_duration it must be at most {most:.3g} N s/m^(3/2): "
            "beyond, e is below 0.005 and contacts creep; take contact_duration out, impacts are plastic"
        )


def check_delta(delta: Any, bobs: int) -> float | tuple[float, ...]:
    """δ within its bounds: one number, or one for each gap as a tuple."""
    if isinstance(delta, Sequence | np.ndarray) and np.ndim(delta) > 0:
        if len(delta) != bobs - 1:
            raise ValueError(f"delta has {len(delta)} values; {bobs} bobs have {bobs - 1} gaps")
        return tuple(check_range("delta", d, "", -1.0, WIDEST, above=True) for d in delta)
    number: Any = delta
    return check_range("delta", number, "", -1.0, WIDEST, above=True, remedy="at δ = −1 the pivots coincide")


def check_effects(model: str, effects: Any, bobs: int) -> Mapping[str, Mapping[str, float]]:
    """The effects beside those of a model, each with all its parameters within bounds, read-only."""
    if not isinstance(effects, Mapping) or not all(isinstance(values, Mapping) for values in effects.values()):
        raise ValueError(f"effects is {one_line(effects)}; give {{name: {{parameter: value}}}}, {{}} for no parameters")
    composed = {e.name: e for e in compose(model, effects)}
    checked = {}
    for name, values in effects.items():
        if name.startswith("-") and values:
            raise ValueError(f"{name!r} takes an effect out and has no parameters; given: {', '.join(values)}")
        checked[name] = MappingProxyType(composed[name].check(values, bobs) if name in composed else {})
    return MappingProxyType(checked)
