"""Pivots that are not where the spacer says."""

import numpy as np

from cradle_env.effects.declaration import Effect, Parameter, Values


def _gaps(values: Values) -> np.ndarray:
    return np.asarray(values["offset"])


spacer_offset = Effect(
    name="spacer_offset",
    symbol="Δδ",
    acts_on="support",
    summary="each gap is wider or narrower than stated",
    equation="δ_i = δ + offset_i",
    reference="Lee & Hong, section 4.2: σ beats with δ",
    energy="none: it moves the pivots once and for all",
    looks_like="impacts early or late from the first on; σ beats though δ = 0 is stated",
    parameters=(
        Parameter(
            "offset", "Δδ", "1", "what each gap has over the stated δ",
            absent=0.0, low=-0.05, high=0.2, scale=2e-3, each="gap",
        ),
    ),
    gaps=_gaps,
)  # fmt: skip
