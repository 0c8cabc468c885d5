"""A clock that runs fast or slow."""

from cradle_env.effects.declaration import Effect, Parameter, Values


def _clock(values: Values) -> float:
    return 1.0 + values["scale"]


clock_scale = Effect(
    name="clock_scale",
    symbol="s_t",
    acts_on="measurement",
    summary="all times in the file are too large or too small by a factor: the nominal frame rate of a camera",
    equation="t_file = (1 + scale) t",
    reference="frame rates of consumer cameras",
    energy="none: it changes the reading, not the motion",
    looks_like="a phase that runs away in proportion to time; on one cradle the same as g/r0 and all damping",
    parameters=(
        Parameter("scale", "s_t", "1", "excess of the file's times", absent=0.0, low=-0.2, high=0.2, scale=1e-3),
    ),
    clock=_clock,
)
