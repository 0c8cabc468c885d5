"""The next segment of flight of a group, cut at the first thing that changes its equations."""

import math

from cradle_env.mechanics.contact import blow_speed, close_gaps, opening, pair
from cradle_env.mechanics.forces import pivot_at
from cradle_env.mechanics.integrator import derivative, step
from cradle_env.mechanics.jit import jit, leaf, part
from cradle_env.mechanics.layout import (
    BRANCH,
    DIM,
    DUE,
    END,
    FLOWN,
    FORCE,
    FRAME,
    GRID,
    LINK,
    LOADING,
    OPEN,
    OUT,
    PART,
    PRESSED,
    RATE0,
    RATE1,
    RELEASE,
    RESOLVED,
    SLACK,
    STAGES,
    START,
    STEPS,
    T0,
    T1,
    TAUT,
    TURN,
    WHOSE,
)
from cradle_env.mechanics.strings import unstretched

# A string is not asked to turn for less than this radial speed [m/s]: rounding at rest.
_LEAST_SPEED = 1e-10
# The last correction of a quintic's zero, as a part of the segment; Newton's method leaves some square of it.
_CROSSING = 1e-6
# How well the end of a contact is located [s].
_PART_TOLERANCE = 1e-10
# After an event, the next point of the grid is passed over if it is nearer than this part of a step.
_SHORTEST = 0.25


@part
def plan(cradle, bobs, S, W, lo, hi):
    """Lays the segment of the bobs lo..hi-1 from its start: to a point of the grid, or to the first event of a
    string, a persistent contact or a resolved contact before it. Returns whether it is finite."""
    t = S[lo, T0]
    grid = (math.floor(t / cradle.step + _SHORTEST) + 1.0) * cradle.step
    full = contact_step(cradle, bobs, S, lo, hi, grid - t)
    h, cause, whose = full, GRID, lo
    _fly(cradle, bobs, S, W, lo, hi, h)

    if cradle.elastic:
        for i in range(lo, hi):
            when, kind = string_event(cradle, bobs[i], S, i, full)
            if when < h:
                h, cause, whose = when, kind, i
        if cause != GRID:
            _fly(cradle, bobs, S, W, lo, hi, h)

    for p in range(lo, hi - 1):
        if _held(cradle, bobs, S, W, p, h, END) < 0.0:
            h = _fly_to_parting(cradle, bobs, S, W, lo, hi, h, p)
            cause, whose = (RELEASE if S[p, LINK] == PRESSED else PART), p

    if hi - lo > 1:
        close_gaps(cradle, bobs, lo, hi, S, W, t + h, END)
    finite = True
    for i in range(lo, hi):
        S[i, T1] = grid if h == grid - t else t + h
        S[i, DUE], S[i, WHOSE] = cause, whose
        finite = finite and math.isfinite(S[i, END] + S[i, END + 2])
    return finite


@jit
def _fly(cradle, bobs, S, W, lo, hi, h):
    """Ends the group's segment h [s] after its start."""
    step(cradle, bobs, S, W, lo, hi, h)
    for i in range(lo, hi):
        for c in range(DIM):
            S[i, END + c] = W[i, OUT + c]
        S[i, STEPS] += 1.0
    # A step of bobs that move together costs twice as much for each.
    S[0, FLOWN] += hi - lo if hi - lo == 1 else 2 * (hi - lo)
    derivative(cradle, bobs, S, W, lo, hi, S[lo, T0] + h, S, END, S, RATE1)


@part
def contact_step(cradle, bobs, S, lo, hi, h):
    """The step [s] that follows the resolved contacts of a group and what acts between near bobs, at most h."""
    for p in range(lo, hi - 1):
        if S[p, LINK] == RESOLVED:
            gap, nx, nz, v_n, spread = pair(cradle, bobs, p, S[p, T0], S, START)
            # A contact that begins nearly at rest gets its speed from what presses the bobs together.
            pressing = max(-opening(cradle, bobs, p, S, START, S, RATE0, nx, nz, spread), 0.0)
            v = blow_speed(cradle, bobs, p, gap, v_n) + pressing * h
            if v > 0.0:
                m = 1.0 / (bobs[p].mobility + bobs[p + 1].mobility)
                h = min(h, cradle.contact_step * (m / cradle.contact_k_el) ** 0.4 * v**-0.2)
        elif S[p, LINK] == OPEN and cradle.reach > 0.0:
            gap, _, _, v_n, _ = pair(cradle, bobs, p, S[p, T0], S, START)
            if v_n != 0.0:
                # Exponentials of the gap: over half the gap, or one of their ranges, the step resolves them.
                h = min(h, (cradle.reach + 0.5 * max(gap, 0.0)) / abs(v_n))
    return h


@part
def string_event(cradle, bob, S, i, h):
    """(instant, kind) of the first string event of bob i on a segment of h [s]; (h, GRID) where there is none.

    Half of r^2 - r0^2, r0 where the strings are just straight, is the quintic with the values and two derivatives of
    both ends: TAUT at its zero, TURN at its slope's. Its error sets a string's branch late by dt, which misses a blow
    of the order dt^2 only.
    """
    q0, p0, a0 = half_square(bob, S[i, T0], S, i, START, RATE0)
    q1, p1, a1 = half_square(bob, S[i, T0] + h, S, i, END, RATE1)
    sign = -1.0 if S[i, BRANCH] == SLACK else 1.0  # what turns negative: the stretch, or less of it
    at_zero = may_cross(sign * q0, sign * p0, sign * q1, sign * p1, h)
    turns = False
    if cradle.hysteretic and S[i, BRANCH] != SLACK:
        way, least = (1.0 if S[i, BRANCH] == LOADING else -1.0), _LEAST_SPEED * bob.length
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
        if abs(following - u) < _CROSSING:
            return following
        u = following


@part
def _held(cradle, bobs, S, W, p, h, c):
    """What holds a contact of pair p h [s] after the start of its segment, where the motion stands in S from column c
    on: the force [N] of a persistent one, the overlap [m] of a resolved one. Negative where it has ended; 0 for bobs
    apart."""
    if S[p, LINK] == PRESSED:
        return W[p, FORCE]
    return -pair(cradle, bobs, p, S[p, T0] + h, S, c)[0] if S[p, LINK] == RESOLVED else 0.0


@part
def _fly_to_parting(cradle, bobs, S, W, lo, hi, h, p):
    """Ends the segment where what holds contact p reaches zero, found by false position (Illinois)."""
    if h <= _PART_TOLERANCE:
        return h
    low, high, mid, moved, inset = 0.0, h, h, 0.0, 0.5 * _PART_TOLERANCE
    held_high = _held(cradle, bobs, S, W, p, h, END)
    if S[p, LINK] == PRESSED:  # the force that held it at the start
        derivative(cradle, bobs, S, W, lo, hi, S[lo, T0], S, START, W, STAGES)
    held_low = max(_held(cradle, bobs, S, W, p, 0.0, START), 0.0)
    while high - low > _PART_TOLERANCE:
        mid = min(max(low + (high - low) * held_low / (held_low - held_high), low + inset), high - inset)
        _fly(cradle, bobs, S, W, lo, hi, mid)
        held = _held(cradle, bobs, S, W, p, mid, END)
        # An end that stays twice running counts for half, lest the other creep.
        if held < 0.0:
            held_low *= 0.5 if moved < 0.0 else 1.0
            high, held_high, moved = mid, held, -1.0
        else:
            held_high *= 0.5 if moved > 0.0 else 1.0
            low, held_low, moved = mid, held, 1.0
    if mid != high:
        _fly(cradle, bobs, S, W, lo, hi, high)
    return high
