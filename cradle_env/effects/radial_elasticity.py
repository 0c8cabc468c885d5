"""Strings that stretch."""

from cradle_env.effects.declaration import Effect, Values


def _apply(cradle, bobs, values: Values) -> None:
    cradle["elastic"] = 1


radial_elasticity = Effect(
    name="radial_elasticity",
    symbol="r(t)",
    acts_on="string",
    summary="each bob hangs on four strings of stiffness κ that pull only when stretched",
    equation="m (r̈ − r θ̇²) = −4 T r0/√(r0² + a²) + m g cos θ − b ṙ;  T = κ s,  s = √(r² + a²) − √(r0² + a²)",
    reference="Lee & Hong eqs. 5, 6",
    energy="stores ∫ 4 T r0/√(r0² + a²) dr",
    looks_like="a fast ripple at 1/β times the swing's frequency; impacts off the horizontal",
    requires=("large_angle",),
    apply=_apply,
)
