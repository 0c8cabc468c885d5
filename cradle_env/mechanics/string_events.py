"""When a string turns, goes slack or comes taut, and the branch of its tension that follows."""

from cradle_env.mechanics.forces import pivot_at, radius_and_speed
from cradle_env.mechanics.jit import jit, leaf
from cradle_env.mechanics.layout import (
    FRAME,
    GRID,
    LOADING,
    SLACK,
    TAUT,
    TURN,
    UNLOADING,
)
from cradle_env.mechanics.strings import following, stretch, unstretched

# A string is not asked to turn for less than this radial speed [m/s]: rounding at rest.
_LEAST_SPEED = 1e-10
# The last correction of a zero, as a part of the segment; Newton's method leaves some square of it.
CROSSING = 1e-6


@jit
def string_event(cradle, bob, branch, h, q0, p0, a0, q1, p1, a1):
    """(instant, kind) of the first event on a segment of h [s] of strings on `branch`; (h, GRID) where there is none.

    q, p, a: half of r^2 - r0^2, r0 where the strings are just straight, and its two derivatives, at the start and at
    the end. It is taken as the quintic with these values: TAUT at its zero, TURN at its slope's. Its error sets a
    string's branch late by dt, which misses a blow of the order dt^2 only.
    """
    sign = stretching(branch)
    at_zero = may_cross(sign * q0, sign * p0, sign * q1, sign * p1, h)
    turns, way = False, loading(branch)
    if cradle.hysteretic and branch != SLACK:
        least = _LEAST_SPEED * bob.length
        turns = at_zero or may_cross(way * p0 + least, way * a0, way * p1 + least, way * a1, h)
    if not (at_zero or turns):
        return h, GRID
    c1, c2 = h * p0, 0.5 * h * h * a0
    value, slope, bend = q1 - q0 - c1 - c2, h * p1 - c1 - 2.0 * c2, h * h * a1 - 2.0 * c2
    c3 = 10.0 * value - 4.0 * slope + 0.5 * bend
    c4 = -15.0 * value + 7.0 * slope - bend
    c5 = 6.0 * value - 3.0 * slope + 0.5 * bend
    u, kind = 1.0, GRID
    if at_zero:
        u, kind = first_crossing(sign, q0, c1, c2, c3, c4, c5), TAUT
    if turns:
        at = first_crossing(way, c1, 2.0 * c2, 3.0 * c3, 4.0 * c4, 5.0 * c5, 0.0)
        if at < u:
            u, kind = at, TURN
    return u * h, kind


@leaf
def stretching(branch):
    """The sign of what turns negative where strings on `branch` go slack or come taut: the stretch, or less of it."""
    return -1.0 if branch == SLACK else 1.0


@leaf
def loading(branch):
    """The sign of the radial speed of strings on `branch` until they turn."""
    return 1.0 if branch == LOADING else -1.0


@leaf
def direction_after(branch, kind):
    """The direction in which the stretch goes after an event of this kind on `branch`."""
    return -1.0 if branch == LOADING or (branch == UNLOADING and kind == TAUT) else 1.0


@jit
def turned(cradle, bob, branch, t0, t1, t2, t, A, i, c, direction):
    """`following` of bob i's strings at t [s], its motion in A from column c on, whose stretch goes in `direction`."""
    s = stretch(bob, t, radius_and_speed(cradle, bob, t, A, i, c)[0] ** 2)
    if branch == SLACK or cradle.hysteretic == 0 or (branch == UNLOADING and s < 1e-9):
        s = 0.0  # at the event of zero stretch, located to rounding
    return following(cradle, bob, branch, t0, t1, t2, s, direction)


@leaf
def half_square(bob, t, S, i, c, rate):
    """(r^2 - r0^2) / 2, r0 where the strings are just straight, of bob i at time t [s] and its two derivatives by
    time."""
    x, z = S[i, c] - pivot_at(bob, t) - S[0, c + FRAME], S[i, c + 1]
    vx, vz = S[i, c + 2] - bob.drive - S[0, c + FRAME + 1], S[i, c + 3]
    bend = vx * vx + vz * vz + x * (S[i, rate + 2] - S[0, rate + FRAME + 1]) + z * S[i, rate + 3]
    string, growth = unstretched(bob, t)
    value = 0.5 * (x * x + z * z + bob.half_spacing * bob.half_spacing - string * string)
    return value, x * vx + z * vz - string * growth, bend - growth * growth + string * growth / (1.0 + t)


@leaf
def may_cross(f0, d0, f1, d1, h):
    """Whether a function with values f0, f1 and slopes d0, d1 at the ends of h is negative at the end or may dip
    below zero between: where it falls at first and rises at last, and both tangents reach zero."""
    return f1 < 0.0 or (d0 < 0.0 and d1 > 0.0 and f0 < -d0 * h and f1 < d1 * h)


@jit
def first_crossing(sign, c0, c1, c2, c3, c4, c5):
    """First u in (0, 1] from which on sign * (c0 + c1 u + ... + c5 u^5) is negative; 1 where it is not.

    The value at 0 does not count: it may be an event's own rounding.
    """
    low = 0.0
    for k in range(1, 9):
        high = k / 8.0
        if sign * (c0 + high * (c1 + high * (c2 + high * (c3 + high * (c4 + high * c5))))) < 0.0:
            break
        low = high
    if low == 1.0:
        return 1.0
    u = 0.5 * (low + high)
    while True:  # Newton's method, and bisection where it leaves the bracket
        value = c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))))
        slope = c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))
        if sign * value < 0.0:
            high = u
        else:
            low = u
        following = u - value / slope
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - u) < CROSSING:
            return following
        u = following
