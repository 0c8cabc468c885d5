"""Strings that lengthen with time."""

from cradle_env.effects.declaration import Effect, Parameter, Values


def _apply(cradle, bobs, values: Values) -> None:
    bobs["creep"] = values["rate"]


string_creep = Effect(
    name="string_creep",
    symbol="s_c",
    acts_on="string",
    summary="the strings' unstretched length grows with the logarithm of time",
    equation="√(r0² + a²) grows by rate · ln(1 + t/1 s), t from the release",
    reference="logarithmic creep of nylon under load",
    energy="lost in the strings as they yield under load",
    looks_like="a frequency that falls, fast at first; bobs sink",
    requires=("radial_elasticity",),
    parameters=(
        Parameter("rate", "s_c", "m", "growth per e-fold of time", absent=0.0, low=0.0, high=0.02, scale=1e-4),
    ),
    apply=_apply,
)
