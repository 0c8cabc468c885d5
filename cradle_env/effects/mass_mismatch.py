"""Bobs of different masses."""

import numpy as np

from cradle_env.effects.declaration import Effect, Parameter, Values


def _apply(cradle, bobs, values: Values) -> None:
    bobs["mass"] *= 1.0 + np.asarray(values["relative"])


mass_mismatch = Effect(
    name="mass_mismatch",
    symbol="Δm/m",
    acts_on="bob",
    summary="each bob is heavier or lighter than the nominal mass; the sum is as stated",
    equation="m_i = m (1 + relative_i),  Σ relative_i = 0",
    reference="impacts of unequal masses: Hinch & Saint-Jean, Proc. R. Soc. A 455, 3201 (1999)",
    energy="none: it changes inertia and weight alike",
    looks_like="shares of velocity that an impact leaves; heavier bobs also decay slower and hang lower",
    parameters=(
        Parameter(
            "relative", "Δm/m", "1", "departure of each bob from the nominal mass",
            absent=0.0, low=-0.5, high=1.0, scale=0.01, each="bob", balanced=True,
        ),
    ),
    apply=_apply,
)  # fmt: skip
