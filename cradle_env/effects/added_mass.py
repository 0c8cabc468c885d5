"""Inertia without weight."""

from cradle_env.effects.declaration import Effect, Parameter, Values


def _apply(cradle, bobs, values: Values) -> None:
    bobs["added_mass"] = values["mass"]


added_mass = Effect(
    name="added_mass",
    symbol="m_a",
    acts_on="bob",
    summary="air that a bob drags along, and its own buoyancy: inertia that has no weight",
    equation="(m + m_a) a = F,  weight m g; also in impacts",
    reference="Nelson & Olsson, Am. J. Phys. 54, 112 (1986): half the displaced air, and buoyancy",
    energy="holds ½ m_a v²",
    looks_like="everything slower by m_a/2m, damping weaker; like a slow clock or longer strings on a single cradle",
    parameters=(
        Parameter("mass", "m_a", "kg", "inertia added to each bob", absent=0.0, low=0.0, high=1.0, scale=1e-3),
    ),
    apply=_apply,
)
