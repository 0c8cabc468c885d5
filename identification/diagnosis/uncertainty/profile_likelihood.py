"""Profile likelihood: how far one quantity can be from its best value, with all others refitted.

Source: Venzon and Moolgavkar (1988), Applied Statistics 37, 87.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: Evaluations of each refit. Few are enough, for it starts where the last two refits extrapolate to.
REFIT_EVALUATIONS = 20
#: Relative distance within which a profile's end is interpolated: of the misfit to its end, or of the last two strides.
_TOLERANCE = 0.15
#: Bounds of the factor by which a stride that went too far is shortened.
_SHORTEN = (0.1, 0.7)
#: Refits at most on the way to an end.
_MAX_REFITS = 24


def find_profile_end(
    refit: Callable[[float, np.ndarray], tuple[np.ndarray, float]],
    point: np.ndarray,
    ahead: np.ndarray,
    furthest: float,
    end: float,
) -> tuple[float, np.ndarray]:
    """The distance u at which the profile of χ² has risen by end², and the refitted point (D,) there.

    u is measured in standard deviations of a normal distribution, where the profile would rise by u². furthest: largest
    u. refit(u, start): (refitted point (D,), root of the rise in χ²) with the quantity fixed at u. point, ahead (D,):
    the point at u = 0 and its slope. The search takes longer and longer strides along the ridge of χ², each from where
    the last two points extrapolate to.
    """
    at, last_rise, stride, growth = 0.0, 0.0, end, 2.0
    for _ in range(_MAX_REFITS):
        last = stride >= furthest - at
        there = furthest if last else at + stride
        stride = there - at
        refitted, rise = refit(there, point + stride * ahead)
        near = abs(rise - end) < _TOLERANCE * end or (rise > end and stride < _TOLERANCE * there)
        if near and rise > last_rise:
            share = (end - last_rise) / (rise - last_rise)
            share = min(share, (furthest - at) / stride)
            return at + share * stride, point + share * (refitted - point)
        if rise > end:  # too far
            stride *= float(np.clip((end - last_rise) / (rise - last_rise), *_SHORTEN))
            growth = 1.0
        elif last:
            return furthest, refitted
        else:
            ahead = (refitted - point) / stride
            at, point, last_rise, stride = there, refitted, rise, growth * stride
    return at, point
