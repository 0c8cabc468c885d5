"""Contacts that last."""

from cradle_env.effects.declaration import Effect, Parameter, Values

#: Scales below which contacts are instantaneous: to follow them in time would lose more by rounding than it shows.
_SHORTEST = 1e-5


def _apply(cradle, bobs, values: Values) -> None:
    cradle["contact_scale"] = values["scale"] if values["scale"] >= _SHORTEST else 0.0


contact_duration = Effect(
    name="contact_duration",
    symbol="s_c",
    acts_on="contact",
    summary="bobs move on while in touch: every contact is followed in time",
    equation="eq. 1 with k_el s_c^{−5/2}, k_f s_c^{−3/2}: the same e(v), contacts s_c times as long",
    reference="Lee & Hong eq. 1, Fig. 2b",
    energy="takes the work of the viscous part of eq. 1, as an instantaneous impact does",
    looks_like="impacts come some 0.1 ms later each: 1 mrad after 5 to 10 s; cascades of three and more",
    requires=("velocity_dependent_restitution",),
    parameters=(
        Parameter(
            "scale", "s_c", "1", "contact time over that of the spheres; 0: instantaneous",
            absent=0.0, low=0.0, high=3.0, scale=1.0,
        ),
    ),
    apply=_apply,
)  # fmt: skip
