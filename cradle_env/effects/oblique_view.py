"""A camera that does not look straight at the row of bobs."""

import math

import numpy as np

from cradle_env.effects.declaration import Effect, Parameter, Values


def _reading(values: Values, theta: np.ndarray) -> np.ndarray:
    N = theta.shape[-1]
    pivots = values["spacing"] * (np.arange(N) - 0.5 * (N - 1))
    along = values["slant"] * (theta + 2.0 * pivots) - 0.5 * values["roll"] * theta
    return theta * (1.0 - along - 0.5 * values["pitch"] * theta * (theta + pivots))


oblique_view = Effect(
    name="oblique_view",
    symbol="ψ",
    acts_on="measurement",
    summary="a film shows what is nearer to the camera larger, for it is turned about the vertical, pitched or rolled",
    equation="θ_file = θ − slant θ (θ + 2 x) + roll θ²/2 − pitch θ² (θ + x)/2, x = spacing (i − (N + 1)/2)",
    reference="perspective, to first order in the turn: Hartley & Zisserman, Multiple View Geometry, ch. 6 (2004)",
    energy="none: it changes the reading, not the motion",
    looks_like="a factor of the angles that changes along the row; residuals of the same sign at both turning points",
    parameters=(
        Parameter(
            "slant", "ψ ℓ/d", "1", "loss of scale along a pendulum's length ℓ: turn over distance, times ℓ",
            absent=0.0, low=-0.3, high=0.3, scale=1e-2,
        ),
        Parameter(
            "pitch", "φ ℓ/d", "1", "gain of scale by a pendulum's length ℓ downwards: pitch over distance, times ℓ",
            absent=0.0, low=-0.3, high=0.3, scale=1e-2,
        ),
        Parameter("roll", "ρ", "rad", "error of the vertical", absent=0.0, low=-0.3, high=0.3, scale=5e-3),
        Parameter(
            "spacing", "a/ℓ", "1", "distance of neighbours over a pendulum's length",
            absent=math.nan, low=1e-3, high=10.0, scale=0.13,
        ),
    ),
    reading=_reading,
)  # fmt: skip
