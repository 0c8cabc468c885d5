"""A scale that reads too much or too little."""

import numpy as np

from cradle_env.effects.declaration import Effect, Parameter, Values


def _reading(values: Values, theta: np.ndarray) -> np.ndarray:
    return (1.0 + values["scale"]) * theta


angle_scale = Effect(
    name="angle_scale",
    symbol="s_θ",
    acts_on="measurement",
    summary="all angles in the file are too large or too small by a factor: calibration, perspective",
    equation="θ_file = (1 + scale) θ",
    reference="calibration of a camera",
    energy="none: it changes the reading, not the motion",
    looks_like="residuals in phase with the angle, from the release on",
    parameters=(Parameter("scale", "s_θ", "1", "excess of the reading", absent=0.0, low=-0.5, high=0.5, scale=5e-3),),
    reading=_reading,
)
