"""Dry friction where the strings are held."""

from cradle_env.effects.declaration import Effect, Parameter, Values


def _apply(cradle, bobs, values: Values) -> None:
    bobs["tau_c"] = values["tau_c"]


pivot_friction = Effect(
    name="pivot_friction",
    symbol="τ_c",
    acts_on="support",
    summary="a constant torque against the swing, smoothed over 0.02 rad/s about rest",
    equation="τ = −τ_c tanh(θ̇ / 0.02 rad/s)",
    reference="Squire, Am. J. Phys. 54, 984 (1986)",
    energy="takes τ_c |θ̇|",
    looks_like="amplitudes fall along a straight line and the last swings stop abruptly",
    caveat="Real pivots creep, roll and stick: their friction may be neither constant nor linear in speed.",
    parameters=(
        Parameter("tau_c", "τ_c", "N m", "torque against rotation", absent=0.0, low=0.0, high=1.0, scale=1e-4),
    ),
    apply=_apply,
)
