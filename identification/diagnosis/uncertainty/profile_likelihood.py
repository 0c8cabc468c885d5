"""How far one quantity may be from its most probable value, all others refitted on the way."""

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
    """How far a quantity can go, in units in which the misfit, were all normal, would rise to u² at u, until it has
    risen to end², at most `furthest`; and the refitted point there, (D,).

    refit: of u and of where to start, (the point, the root of the rise of the misfit). point, ahead (D,): at u = 0, and
    its slope. Refits march along the ridge on which the point follows, in longer and longer strides, each from where
    the last two point to.
    """
    at, risen, stride, growth = 0.0, 0.0, end, 2.0
    for _ in range(_MAX_REFITS):
        last = stride >= furthest - at
        there = furthest if last else at + stride
        stride = there - at
        found, reached = refit(there, point + stride * ahead)
        near = abs(reached - end) < _TOLERANCE * end or (reached > end and stride < _TOLERANCE * there)
        if near and reached > risen:
            share = (end - risen) / (reached - risen)
            share = min(share, (furthest - at) / stride)
            return at + share * stride, point + share * (found - point)
        if reached > end:  # too far
            stride *= float(np.clip((end - risen) / (reached - risen), *_SHORTEN))
            growth = 1.0
        elif last:
            return furthest, found
        else:
            ahead = (found - point) / stride
            at, point, risen, stride = there, found, reached, growth * stride
    return at, point
