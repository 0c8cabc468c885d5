"""A frame that yields."""

import math

from cradle_env.effects.declaration import Effect, Parameter, Values


def _apply(cradle, bobs, values: Values) -> None:
    omega = 2.0 * math.pi * values["frequency"]
    if math.isfinite(values["frame_mass"]):
        cradle["frame_mass"], cradle["coupled"] = values["frame_mass"], 1
        cradle["frame_stiffness"] = values["frame_mass"] * omega**2
        cradle["frame_damping"] = 2.0 * values["damping_ratio"] * omega * values["frame_mass"]


frame_compliance = Effect(
    name="frame_compliance",
    symbol="M_f",
    acts_on="support",
    summary="all bobs hang on one frame that moves sideways on a spring and a damper",
    equation="M (X'' + 2 ζ ω X' + ω² X) = Σ horizontal pull of the strings,  ω = 2π frequency",
    reference="Hutzler et al., Am. J. Phys. 72, 1508 (2004); Huygens' clocks",
    energy="the strings give it Σ pull · X', of which it holds ½ M (X'² + ω² X²) and damps the rest",
    looks_like="bobs at rest begin to swing without an impact; frequencies of in-phase motion fall",
    requires=("radial_elasticity",),
    parameters=(
        Parameter(
            "frame_mass", "M_f", "kg", "moving mass of the frame, inf: it does not move",
            absent=math.inf, low=1e-2, high=1e4, scale=5.0,
        ),
        Parameter("frequency", "f_f", "Hz", "of the bare frame", absent=math.nan, low=0.2, high=200.0, scale=10.0),
        Parameter(
            "damping_ratio", "ζ_f", "1", "over critical, bare", absent=math.nan, low=0.0, high=2.0, scale=0.05
        ),
    ),
    apply=_apply,
    caveat="a real frame has more than one mode, and rocks as well as sways",
)  # fmt: skip
