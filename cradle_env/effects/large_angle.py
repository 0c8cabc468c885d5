"""Swings beyond the small-angle limit."""

from cradle_env.effects.declaration import Effect, Values


def _apply(cradle, bobs, values: Values) -> None:
    cradle["large_angle"] = 1


large_angle = Effect(
    name="large_angle",
    symbol="sin θ",
    acts_on="bob",
    summary="gravity as sin θ, bobs on circles, impacts along the line of centres in the plane",
    equation="m r0 θ̈ = −m g sin θ − b r0 θ̇",
    reference="Lee & Hong eq. 6 at r = r0",
    energy="stores m g r0 (1 − cos θ)",
    looks_like="the period grows with amplitude, by θ0²/16",
    apply=_apply,
)
