"""Bobs that attract each other."""

import math

from cradle_env.effects.declaration import Effect, Parameter, Values
from cradle_env.effects.neighbours import couple


def _apply(cradle, bobs, values: Values) -> None:
    cradle["attraction"], cradle["attraction_range"] = values["force"], values["range"]
    if values["force"] != 0.0:
        couple(cradle, values["range"])


bob_attraction = Effect(
    name="bob_attraction",
    symbol="F_a",
    acts_on="bob",
    summary="neighbours attract each other at short range: magnetism of the steel, a film of oil",
    equation="F = force · exp(−gap/range), along the line of centres",
    reference="magnetized bearings; capillary bridges",
    energy="holds −force · range · exp(−gap/range) for each pair",
    looks_like="bobs stick after gentle impacts and swing on together; early synchronization",
    between=True,
    parameters=(
        Parameter("force", "F_a", "N", "attraction at touch", absent=0.0, low=0.0, high=10.0, scale=0.01),
        Parameter("range", "ρ_a", "m", "over which it falls", absent=math.nan, low=1e-4, high=0.05, scale=0.003),
    ),
    apply=_apply,
    caveat="magnets fall off as a power of the distance, and differ from pair to pair",
)
