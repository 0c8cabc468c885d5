"""Strings that give back less than they took."""

from cradle_env.effects.declaration import Effect, Values


def _apply(cradle, bobs, values: Values) -> None:
    cradle["hysteretic"] = 1


string_hysteresis = Effect(
    name="string_hysteresis",
    symbol="T[s, ṡ]",
    acts_on="string",
    summary="nylon loads along a line and unloads along a parabola, with memory of each reversal",
    equation="loading: T = κ (s − s_min) + T_min;  unloading: T = T_max (s/s_max)²;  slack: T = 0, memory cleared",
    reference="Lee & Hong eq. 4",
    energy="takes the area of the loop; at least zero from slack to slack",
    looks_like="the radial ripple dies within a second or two after each impact",
    requires=("radial_elasticity",),
    apply=_apply,
)
