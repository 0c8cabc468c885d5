"""A scale whose zero is off."""

import numpy as np

from cradle_env.effects.declaration import Effect, Parameter, Values


def _reading(values: Values, theta: np.ndarray) -> np.ndarray:
    return theta + values["offset"]


angle_offset = Effect(
    name="angle_offset",
    symbol="θ_z",
    acts_on="measurement",
    summary="all angles in the file are shifted: a tilted camera or level",
    equation="θ_file = θ + offset",
    reference="instrument zero",
    energy="none: it changes the reading, not the motion",
    looks_like="a constant residual, the same for all bobs",
    parameters=(Parameter("offset", "θ_z", "rad", "zero of the scale", absent=0.0, low=-0.5, high=0.5, scale=2e-3),),
    reading=_reading,
)
