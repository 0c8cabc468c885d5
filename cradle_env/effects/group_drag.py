"""Bobs that swing together are dragged more each."""

import math

from cradle_env.effects.declaration import Effect, Parameter, Values
from cradle_env.effects.neighbours import couple


def _apply(cradle, bobs, values: Values) -> None:
    cradle["drag_slope"], cradle["drag_range"] = values["slope"], values["range"]
    if values["slope"] != 0.0:
        couple(cradle, values["range"])


group_drag = Effect(
    name="group_drag",
    symbol="b_n",
    acts_on="bob",
    summary="the damping of a bob grows with the neighbours it has close by",
    equation="b_i = b (1 + slope Σ exp(−gap/range)), over its neighbours",
    reference="Lee & Hong, Fig. 2d",
    energy="takes b slope exp(−gap/range) v² for each neighbour",
    looks_like="faster decay once the bobs swing together than while one swings alone",
    between=True,
    parameters=(
        Parameter("slope", "s_b", "1", "growth by a neighbour at touch", absent=0.0, low=0.0, high=20.0, scale=0.3),
        Parameter("range", "ρ_b", "m", "over which it falls", absent=math.nan, low=1e-4, high=0.1, scale=0.005),
    ),
    apply=_apply,
    caveat="the paper fits b_n by groups; how it falls with distance is a guess",
)
