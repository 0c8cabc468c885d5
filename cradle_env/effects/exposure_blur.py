"""A camera or a filter that averages in time."""

import numpy as np

from cradle_env.effects.declaration import Effect, Parameter, Values

# Midpoints: the motion has kinks at impacts, where high-order quadrature gains nothing.
_PARTS = 10


def _instants(values: Values) -> tuple[np.ndarray, np.ndarray]:
    offsets = values["duration"] * ((np.arange(_PARTS) + 0.5) / _PARTS - 0.5)
    return offsets, np.full(_PARTS, 1.0 / _PARTS)


exposure_blur = Effect(
    name="exposure_blur",
    symbol="Δt_exp",
    acts_on="measurement",
    summary="each reading is the centred average over an exposure",
    equation="θ_file(t) = (1/Δt) ∫ θ(t + u) du,  |u| ≤ Δt/2",
    reference="any camera with an open shutter; moving-average filters",
    energy="none: it changes the reading, not the motion",
    looks_like="impacts rounded off, peaks slightly low",
    parameters=(Parameter("duration", "Δt", "s", "exposure", absent=0.0, low=0.0, high=1.0, scale=0.01),),
    instants=_instants,
)
