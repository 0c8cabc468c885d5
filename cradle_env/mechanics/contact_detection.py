"""When two neighbours touch: foreseen on the interpolated motion, corrected on the integrated one."""

import math

from cradle_env.mechanics.contact import CONTACT, TOUCHING, pair, pair_at
from cradle_env.mechanics.integrator import between, derivative_between_segments, step_apart
from cradle_env.mechanics.jit import jit, leaf
from cradle_env.mechanics.layout import (
    BROUGHT,
    CONTACT_LOSS,
    DIM,
    DRAG,
    FIRST,
    LAST,
    LATER,
    LINK,
    MEETING,
    ON_SERIES,
    OPEN,
    OUT,
    SEEN,
    SEEN_GAP,
    SEEN_OPENING,
    SEEN_SQUARE,
    STAGES,
    START,
    T0,
    T1,
)
from cradle_env.mechanics.series_flight import brought_on, drag_on, place_on

# Two bobs in touch approach from this speed on [m/s]: rounding of the speeds after an impact.
_LEAST_APPROACH = 1e-12
# A touch gentler than this [m/s] stays where it was foreseen, to 1e-9 m: its time is no root of any use, for the
# curvature of the gap rules, and going back to it would find the same touch for ever.
_LEAST_LOCATED = 1e-6
# Nor is one that would be off by more than this [s].
_LATEST = 1e-6
# How well an instant is located [s], and in parts of it: after an hour or two, neighbouring numbers are further apart.
_LOCATED, _NEIGHBOURS = 1e-12, 5e-16
# Newton's method that moves by less than this [s] is as good as it gets: the next step would be some square of it.
_CLOSE = 1e-9
# What a cubic may miss of a gap, as a part of h^2 times its second derivative: 2^2 / 384, twice.
_UNSEEN = 0.02


@jit
def gap_between(cradle, bobs, S, p, t):
    """(gap beyond CONTACT, opening speed) of pair p at time t [s], interpolated."""
    gap, opening, _ = encounter(cradle, bobs, S, p, t)
    return gap, opening


@leaf
def encounter(cradle, bobs, S, p, t):
    """`gap_between`, and the square of the speed [m/s] of one bob relative to the other."""
    x0, z0, vx0, vz0 = between(S, p, t)
    x1, z1, vx1, vz1 = between(S, p + 1, t)
    gap, _, _, v_n, spread = pair_at(cradle, bobs, p, t, x0, z0, vx0, vz0, x1, z1, vx1, vz1)
    return gap + CONTACT, v_n, v_n * v_n + spread * (gap + 2.0 * cradle.radius)


@leaf
def predict(cradle, bobs, S, p):
    """The first instant [s] at which an open pair touches while both its segments last; inf if it does not.

    A gap is a distance, which grows again once the bobs have passed through each other. A segment in which they could
    do so is therefore searched in strides that are too short for it; and one in which the gap may dip unseen in strides
    that are short against the radial motion.
    """
    if S[p, LINK] != OPEN:
        return math.inf
    low, high = max(S[p, T0], S[p + 1, T0]), min(S[p, T1], S[p + 1, T1])
    if high <= low:
        return math.inf
    across, h = 4.0 * cradle.radius, high - low
    on_series = S[p, ON_SERIES] * S[p + 1, ON_SERIES] != 0.0
    if on_series and S[p, SEEN] == low:
        g0, v0, square0 = S[p, SEEN_GAP], S[p, SEEN_OPENING], S[p, SEEN_SQUARE]
    else:
        g0, v0, square0 = encounter(cradle, bobs, S, p, low)
    g1, v1, square1 = encounter(cradle, bobs, S, p, high)
    S[p, SEEN] = high if on_series else -1.0
    S[p, SEEN_GAP], S[p, SEEN_OPENING], S[p, SEEN_SQUARE] = g1, v1, square1
    if 2.0 * (square0 + square1) * h * h < across * across and stays_open(g0, v0, g1, v1, h):
        return math.inf
    fastest = math.sqrt(square0) + math.sqrt(square1)
    while low < high:
        end, gap, opening = high, g1, v1
        if fastest * (end - low) > across:
            end = low + max(g0, across) / fastest
        if on_series and end - low > 1.5 * cradle.step and not stays_open(g0, v0, g1, v1, high - low):
            end = low + cradle.step
        if low < end < high:
            gap, opening = gap_between(cradle, bobs, S, p, end)
        else:
            end = high
        found = first_touch(cradle, bobs, S, p, low, g0, v0, end, gap, opening)
        if found < math.inf:
            return found
        low, g0, v0 = end, gap, opening
    return math.inf


@leaf
def stays_open(g0, v0, g1, v1, h):
    """Whether a gap with these values [m] and slopes [m/s] at the ends of h [s] has no dip to zero between: if the
    cubic with these has none, by a margin. The margin is what a cubic misses, h^4 / 384 times the fourth derivative, of
    a motion of up to 2 rad on a segment, twice over."""
    if g1 <= 0.0:
        return False
    c1, c2, c3 = h * v0, 3.0 * (g1 - g0) - h * (2.0 * v0 + v1), h * (v0 + v1) - 2.0 * (g1 - g0)
    inside = c2 * c2 - 3.0 * c1 * c3
    if inside <= 0.0:
        return True
    slope = c2 + math.sqrt(inside)
    if slope == 0.0:
        return True
    u = -c1 / slope
    if not 0.0 < u < 1.0:
        return True
    return g0 + u * (c1 + u * (c2 + u * c3)) > _UNSEEN * max(abs(2.0 * c2), abs(2.0 * c2 + 6.0 * c3))


@jit
def first_touch(cradle, bobs, S, p, low, g0, v0, high, g1, v1):
    """The first instant [s] from low to high at which an open pair touches; inf if it does not. Its gap, beyond
    CONTACT, is g0 and g1 [m] there, and opens at v0 and v1 [m/s]; between, the bobs must not be able to pass through
    each other."""
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


@jit
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
        if high - low < least:
            return high if g > 0.0 else t
        newton = t - g / v if v < 0.0 else low
        if not low < newton < high or high - low >= width:
            newton = 0.5 * (low + high)
        elif abs(newton - t) < _CLOSE:
            return newton
        t = newton


@jit
def step_to(cradle, bobs, S, W, i, t):
    """Steps bob i's group exactly to time t [s] of its segment, into W[:, OUT]."""
    # The present segment is left: nothing that was laid or seen beyond it holds.
    S[i, LATER], S[i, SEEN] = 0.0, -1.0
    if i > 0:
        S[i - 1, SEEN] = -1.0
    if S[i, ON_SERIES] != 0.0:
        W[i, OUT], W[i, OUT + 1], W[i, OUT + 2], W[i, OUT + 3] = place_on(S, i, t)
        W[i, OUT + DRAG], W[i, OUT + CONTACT_LOSS] = drag_on(S, i, t), S[i, START + CONTACT_LOSS]
        W[i, OUT + BROUGHT] = brought_on(bobs[i], S, i, START, W[i, OUT], W[i, OUT + 2])
        return
    step_apart(cradle, bobs, S, W, int(S[i, FIRST]), int(S[i, LAST]), t - S[i, T0])


@jit
def last_moment(cradle, bobs, S, W, p):
    """How much later [s] than foreseen pair p touches; both bobs are at the foreseen instant, in W[:, OUT]."""
    t = S[p, MEETING]
    gap, _, _, v_n, _ = pair(cradle, bobs, p, t, W, OUT)
    late = -(gap + CONTACT) / v_n if v_n < -_LEAST_LOCATED else 0.0
    if abs(late) > _LATEST:
        return 0.0
    return max(late, S[p, T0] - t, S[p + 1, T0] - t)


@jit
def linger(cradle, bobs, S, W, lo, hi, t, dt):
    """Moves bob i's group, at time t [s] in W[:, OUT], by dt [s] along its tangent."""
    derivative_between_segments(cradle, bobs, S, W, lo, hi, t, W, OUT, W, STAGES)
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
