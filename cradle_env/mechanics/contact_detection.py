"""When two neighbours touch: foreseen on the interpolated motion, corrected on the integrated one."""

import math

from cradle_env.mechanics.contact import CONTACT, TOUCHING, pair, pair_at
from cradle_env.mechanics.integrator import between, derivative, step
from cradle_env.mechanics.jit import jit, part
from cradle_env.mechanics.layout import DIM, FIRST, LAST, LINK, MEETING, OPEN, OUT, STAGES, T0, T1

# Two bobs in touch approach from this speed on [m/s]: rounding of the speeds after an impact.
_LEAST_APPROACH = 1e-12
# A touch gentler than this [m/s] stays where it was foreseen, to 1e-9 m: its time is no root of any use, for the
# curvature of the gap rules, and going back to it would find the same touch for ever.
_LEAST_LOCATED = 1e-6
# Nor is one that would be off by more than this [s].
_LATEST = 1e-6
# How well an instant is located [s], and in parts of it: after an hour or two, neighbouring numbers are further apart.
_LOCATED, _NEIGHBOURS = 1e-12, 5e-16


@jit
def gap_between(cradle, bobs, S, p, t):
    """(gap beyond CONTACT, opening speed) of pair p at time t [s], interpolated."""
    x0, z0, vx0, vz0 = between(S, p, t)
    x1, z1, vx1, vz1 = between(S, p + 1, t)
    gap, _, _, v_n, _ = pair_at(cradle, bobs, p, t, x0, z0, vx0, vz0, x1, z1, vx1, vz1)
    return gap + CONTACT, v_n


@jit
def speed_between(cradle, bobs, S, p, t):
    """Speed [m/s] of one bob of pair p relative to the other at time t [s], interpolated."""
    x0, z0, vx0, vz0 = between(S, p, t)
    x1, z1, vx1, vz1 = between(S, p + 1, t)
    gap, _, _, v_n, spread = pair_at(cradle, bobs, p, t, x0, z0, vx0, vz0, x1, z1, vx1, vz1)
    return math.sqrt(v_n * v_n + spread * (gap + 2.0 * cradle.radius))


@jit
def predict(cradle, bobs, S, p):
    """The first instant [s] at which an open pair touches while both its segments last; inf if it does not.

    A gap is a distance, which grows again once the bobs have passed through each other. A segment in which they could
    do so is therefore searched in strides that are too short for it.
    """
    if S[p, LINK] != OPEN:
        return math.inf
    low, high = max(S[p, T0], S[p + 1, T0]), min(S[p, T1], S[p + 1, T1])
    if high <= low:
        return math.inf
    across = 4.0 * cradle.radius
    fastest = speed_between(cradle, bobs, S, p, low) + speed_between(cradle, bobs, S, p, high)
    while fastest * (high - low) > across:
        gap, _ = gap_between(cradle, bobs, S, p, low)
        end = low + max(gap, across) / fastest
        if not low < end < high:
            break
        found = first_touch(cradle, bobs, S, p, low, end)
        if found < math.inf:
            return found
        low = end
    return first_touch(cradle, bobs, S, p, low, high)


@jit
def first_touch(cradle, bobs, S, p, low, high):
    """The first instant [s] from low to high at which an open pair touches; inf if it does not. Between them the bobs
    must not be able to pass through each other."""
    g0, v0 = gap_between(cradle, bobs, S, p, low)
    g1, v1 = gap_between(cradle, bobs, S, p, high)
    if g0 <= 0.0 and v0 < -_LEAST_APPROACH:
        return low
    if g1 >= 0.0:
        # Only a dip can touch: closing at the start, opening at the end, and both straight lines reach zero.
        h = high - low
        if v0 >= 0.0 or v1 <= 0.0 or g0 > -v0 * h or g1 > v1 * h:
            return math.inf
        high = turning_point(cradle, bobs, S, p, low, high, 1.0)
        if gap_between(cradle, bobs, S, p, high)[0] >= 0.0:
            return math.inf
    elif g0 <= 0.0:
        opened = turning_point(cradle, bobs, S, p, low, high, -1.0)
        if gap_between(cradle, bobs, S, p, opened)[0] <= 0.0:
            # In touch without parting or approaching: until the overlap, of rounding's size at first, has doubled.
            depth = max(CONTACT, -2.0 * g0)
            return closing(cradle, bobs, S, p, low, high, depth) if g1 < -depth else math.inf
        low = opened
    return closing(cradle, bobs, S, p, low, high, 0.0)


@part
def turning_point(cradle, bobs, S, p, low, high, sign):
    """The instant [s], to 1e-9 or its last digit, at which the opening speed of pair p takes on the given sign."""
    least = max(1e-9, _NEIGHBOURS * high)
    while high - low > least:
        mid = 0.5 * (low + high)
        if sign * gap_between(cradle, bobs, S, p, mid)[1] > 0.0:
            high = mid
        else:
            low = mid
    return high


@jit
def closing(cradle, bobs, S, p, low, high, depth):
    """The instant [s] at which the gap falls below -depth [m], above it at `low` and below it at `high`: Newton's
    method, and bisection whenever it leaves the bracket or fails to halve it."""
    t, least = 0.5 * (low + high), max(_LOCATED, _NEIGHBOURS * high)
    while True:
        g, v = gap_between(cradle, bobs, S, p, t)
        g += depth
        width = high - low
        if g > 0.0:
            low = t
        else:
            high = t
        if abs(g) < 1e-14 or high - low < least:
            return high if g > 0.0 and high - low < least else t
        newton = t - g / v if v < 0.0 else low
        t = newton if low < newton < high and high - low < width else 0.5 * (low + high)


@part
def step_to(cradle, bobs, S, W, i, t):
    """Steps bob i's group exactly to time t [s] of its segment, into W[:, OUT]."""
    step(cradle, bobs, S, W, int(S[i, FIRST]), int(S[i, LAST]), t - S[i, T0])


@part
def last_moment(cradle, bobs, S, W, p):
    """How much later [s] than foreseen pair p touches; both bobs are at the foreseen instant, in W[:, OUT]."""
    t = S[p, MEETING]
    gap, _, _, v_n, _ = pair(cradle, bobs, p, t, W, OUT)
    late = -(gap + CONTACT) / v_n if v_n < -_LEAST_LOCATED else 0.0
    if abs(late) > _LATEST:
        return 0.0
    return max(late, S[p, T0] - t, S[p + 1, T0] - t)


@part
def linger(cradle, bobs, S, W, lo, hi, t, dt):
    """Moves bob i's group, at time t [s] in W[:, OUT], by dt [s] along its tangent."""
    derivative(cradle, bobs, S, W, lo, hi, t, W, OUT, W, STAGES)
    for i in range(lo, hi):
        for c in range(DIM):
            W[i, OUT + c] += dt * W[i, STAGES + c]


@jit
def touching(cradle, bobs, S, p, t):
    """Whether the bobs of pair p are struck as one at time t [s]."""
    if S[p, LINK] != OPEN:
        return True
    if t < S[p, T0] or t < S[p + 1, T0]:
        return False
    return gap_between(cradle, bobs, S, p, t)[0] <= TOUCHING
