"""What a run costs, in integration steps of single bobs."""

from __future__ import annotations

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.kernel_records import records

#: Steps of single bobs in one run at most: about a quarter of an hour.
MOST_STEPS = 1e9
#: Time that one takes, about [s].
_STEP_SECONDS = 1e-6


def steps_needed(cradle: Cradle, duration: float) -> float:
    """Steps of single bobs that a run of this duration [s] takes at least, without its impacts."""
    return steps_of(records(cradle)[0], cradle, duration)


def steps_of(c: np.ndarray, cradle: Cradle, duration: float) -> float:
    """Those of a run of a cradle whose record, (1,) of CRADLE, is c."""
    return float(duration) / float(c["step"][0]) * cradle.bobs


def check_cost(cradle: Cradle, duration: float, steps: float, most: float, remedy: str) -> None:
    """ValueError where a run of this duration [s] takes more than `most` steps of single bobs."""
    if steps > most:
        raise ValueError(
            f"{duration:.4g} s of this cradle takes {steps:.2g} steps of {duration * cradle.bobs / steps:.2g} s,"
            f" about {format_duration(steps * _STEP_SECONDS)}; it must be at most {most:.2g} steps; {remedy}"
        )


def format_duration(seconds: float) -> str:
    """A duration in days, hours, minutes or seconds, of two digits."""
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.2g} s"
