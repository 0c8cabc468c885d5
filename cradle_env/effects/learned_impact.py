"""A departure of the restitution from the model's e(v), of which only its shape in the data is known."""

import math

from cradle_env.effects.declaration import Effect, Parameter, Values

#: Each term's shape, u = v/speed, and its meaning.
TERMS = {
    "level": ("1", "alike at all speeds"),
    "slope": ("u", "in proportion to the speed"),
    "bend": ("u²", "as the square of the speed"),
    "gentle": ("exp(−u/0.1)", "at gentle impacts"),
    "wet": ("1/u", "by the same speed in every impact, as a film of liquid takes it"),
}


def _apply(cradle, bobs, values: Values) -> None:
    if any(values[key] != 0.0 for key in TERMS):
        cradle["departure"] = [values[key] for key in TERMS]
        cradle["departure_speed"] = values["speed"]


learned_impact = Effect(
    name="learned_impact",
    symbol="Δe(v)",
    acts_on="contact",
    summary="what a smooth function of the impact speed adds to e; learned from data, it explains nothing",
    equation="e = e_model(v) + Σ c_k φ_k(v/speed),  0 ≤ e ≤ 1",
    reference="a sparse library: Brunton, Proctor & Kutz, Proc. Natl. Acad. Sci. 113, 3932 (2016); wet impacts: Davis,"
    " Rager & Good, J. Fluid Mech. 468, 107 (2002)",
    energy="each impact takes m_eff v² (1 − e²) / 2",
    looks_like="impacts that take a share of energy which no e(v) of the catalogue has",
    parameters=(
        Parameter("speed", "v_s", "m/s", "scale of impact speeds", absent=math.nan, low=1e-6, high=100.0, scale=0.3),
        *(
            Parameter(key, f"c_{key}", "1", f"change of e {meaning}: {shape}", 0.0, -1.0, 1.0, 1e-2)
            for key, (shape, meaning) in TERMS.items()
        ),
    ),
    apply=_apply,
)
