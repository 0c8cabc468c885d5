"""Pendulums of different lengths."""

import numpy as np

from cradle_env.effects.declaration import Effect, Parameter, Values


def _apply(cradle, bobs, values: Values) -> None:
    bobs["length"] *= 1.0 + np.asarray(values["relative"])


length_mismatch = Effect(
    name="length_mismatch",
    symbol="Δr/r",
    acts_on="string",
    summary="each pendulum is longer or shorter than the nominal length",
    equation="r0_i = r0 (1 + relative_i)",
    reference="ω² = g/r0 of each",
    energy="none: it changes the geometry once and for all",
    looks_like="bobs swing at different frequencies: phases part steadily; impacts off the horizontal",
    parameters=(
        Parameter(
            "relative", "Δr/r", "1", "departure of each length from the nominal",
            absent=0.0, low=-0.2, high=0.2, scale=3e-3, each="bob",
        ),
    ),
    apply=_apply,
)  # fmt: skip
