"""What durations of contacts alone tell of a cradle."""

from __future__ import annotations

import numpy as np

from cradle_env.cradle import Cradle
from identification.experiment.constraint import Constraint, quantity_of

#: Relative step of a numerical derivative.
_STEP = 1e-3


def duration_constraint(kind: str, cradle: Cradle, k_f_sd: float, speeds: np.ndarray) -> Constraint:
    """The duration of a contact at the middle of the speeds (K,) [m/s].

    Durations follow from k_f and k_el together. The fit held k_el, so k_f carries the whole error of the duration.

    cradle: with the fitted k_f; k_f_sd: its standard deviation [N s/m^(3/2)].
    """
    name = f"contact_duration[{float(np.exp(np.mean(np.log(speeds)))):.4g}]"
    ends = [quantity_of(cradle.replace(k_f=cradle.k_f * factor), name) for factor in (1.0 - _STEP, 1.0 + _STEP)]
    slope = (ends[1] - ends[0]) / (2.0 * _STEP * cradle.k_f)
    return Constraint(kind, (name,), np.array([quantity_of(cradle, name)]), np.array([[(slope * k_f_sd) ** 2]]))
