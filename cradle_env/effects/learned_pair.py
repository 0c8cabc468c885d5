"""A force between neighbours of which only its shape in the data is known."""

import math

import numpy as np

from cradle_env.effects.declaration import Effect, Parameter, Values
from cradle_env.effects.neighbours import couple
from cradle_env.mechanics.layout import PAIR_DECAYS

#: Each term's shape, g = gap/R, u the speed at which the gap opens over the scale, and its meaning.
TERMS = {
    "pull_near": ("−exp(−20 g)", "an attraction at short range"),
    "pull": ("−exp(−4 g)", "an attraction at middle range"),
    "pull_far": ("−exp(−g)", "an attraction at long range"),
    "film_near": ("−u exp(−20 g)", "a resistance to opening and closing at short range"),
    "film": ("−u exp(−4 g)", "a resistance to opening and closing at middle range"),
    "film_far": ("−u exp(−g)", "a resistance to opening and closing at long range"),
}


def _apply(cradle, bobs, values: Values) -> None:
    for field, keys in (("pull", tuple(TERMS)[:3]), ("film", tuple(TERMS)[3:])):
        bobs[field][:-1] = np.transpose([values[key] for key in keys])
    if bobs["pull"].any() or bobs["film"].any():
        cradle["learned_pairs"], cradle["pair_speed"] = 1, values["speed"]
        couple(cradle, cradle["radius"][0] / max(PAIR_DECAYS))


learned_pair = Effect(
    name="learned_pair",
    symbol="F(gap)",
    acts_on="bob",
    summary="a smooth force between neighbours, by their gap and its rate; learned from data, it explains nothing",
    equation="F = Σ c_k φ_k(gap/R, v/speed) along the line of centres, > 0: apart",
    reference="a sparse library: Brunton, Proctor & Kutz, Proc. Natl. Acad. Sci. 113, 3932 (2016)",
    energy="takes −F v, booked with the drag",
    looks_like="neighbours that brake or draw each other as no effect of the catalogue does",
    parameters=(
        Parameter("speed", "v_s", "m/s", "scale of speeds", absent=math.nan, low=1e-6, high=100.0, scale=0.3),
        *(
            Parameter(key, f"c_{key}", "N", f"{meaning}: {shape}", 0.0, -100.0, 100.0, 1e-3, each="gap")
            for key, (shape, meaning) in TERMS.items()
        ),
    ),
    apply=_apply,
)
