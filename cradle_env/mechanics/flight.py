"""The next segment of flight of a group, cut at the first thing that changes its equations."""

import math

from cradle_env.mechanics.contact import blow_speed, close_gaps, pair, stiffness
from cradle_env.mechanics.forces import radial_acceleration, radius_and_speed
from cradle_env.mechanics.jit import jit, part
from cradle_env.mechanics.motion import derivative, step
from cradle_env.mechanics.parameters import (
    BRANCH,
    DIM,
    DUE,
    END,
    FORCE,
    GRID,
    LINK,
    LOADING,
    OUT,
    PART,
    PRESSED,
    RATE0,
    RATE1,
    RELEASE,
    RESOLVED,
    SLACK,
    START,
    STEPS,
    T0,
    T1,
    TAUT,
    TURN,
    WHOSE,
)
from cradle_env.mechanics.strings import stretch

# A string is not asked to turn for less than this radial speed [m/s]: rounding at rest.
_LEAST_SPEED = 1e-10
# How well events are located [s]. Switching a string's branch late by dt at a turn changes the tension by
# dt^2 only, at zero stretch by dt.
_TURN_TOLERANCE, _TAUT_TOLERANCE, _PART_TOLERANCE = 1e-6, 1e-10, 1e-10
# Steps per time scale of a resolved contact, which lasts 3.2 of them.
_CONTACT_STEP = 1.0 / 16.0


@jit
def plan(cradle, bobs, S, W, lo, hi):
    """Lays the segment of the bobs lo..hi-1 from its start: to the next point of the grid, or to the first event
    of a string, a persistent contact or a resolved contact before it. Returns whether it is finite."""
    t = S[lo, T0]
    grid = (math.floor(t / cradle.step + 1e-9) + 1.0) * cradle.step
    full = contact_step(cradle, bobs, S, lo, hi, grid - t)
    h, cause, whose = full, GRID, lo
    _fly(cradle, bobs, S, W, lo, hi, h)

    if cradle.elastic:
        for i in range(lo, hi):
            when, kind = string_event(cradle, bobs[i], S, i, full)
            if kind != GRID and when < h:
                h, cause, whose = when, kind, i
        if cause != GRID:
            h = _fly_to_string_event(cradle, bobs, S, W, lo, hi, h, full, cause, whose)

    for p in range(lo, hi - 1):
        if _parted(cradle, bobs, S, W, p, h):
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
    derivative(cradle, bobs, S, W, lo, hi, S[lo, T0] + h, S, END, S, RATE1)


@part
def contact_step(cradle, bobs, S, lo, hi, h):
    """The step [s] that follows the resolved contacts of a group, at most h."""
    for p in range(lo, hi - 1):
        if S[p, LINK] == RESOLVED:
            gap, _, _, v_n, _ = pair(cradle, bobs, p, S[p, T0], S, START)
            v = blow_speed(cradle, bobs, p, gap, v_n)
            if v > 0.0:
                m = bobs[p].mass * bobs[p + 1].mass / (bobs[p].mass + bobs[p + 1].mass)
                h = min(h, _CONTACT_STEP * (m / stiffness(cradle)) ** 0.4 * v**-0.2)
    return h


@part
def string_event(cradle, bob, S, i, h):
    """(instant, kind) of the first string event of bob i on a segment of h [s]; (h, GRID) where there is none."""
    when, kind, branch = h, GRID, S[i, BRANCH]
    s0, u0 = string_quantity(cradle, bob, S[i, T0], S, i, START, RATE0, TAUT)
    s1, u1 = string_quantity(cradle, bob, S[i, T0] + h, S, i, END, RATE1, TAUT)
    dips = branch != SLACK and u0 < 0.0 and u1 > 0.0 and s0 < -u0 * h  # slack and taut again in one step?
    if s1 < 0.0 or dips:
        at = first_crossing(s0, u0, s1, u1, h)
        if s1 < 0.0 or at < h:
            when, kind = at, TAUT
    if cradle.hysteretic and branch != SLACK:
        v1, a1 = string_quantity(cradle, bob, S[i, T0] + h, S, i, END, RATE1, TURN)
        if v1 < -_LEAST_SPEED or kind == TAUT:
            v0, a0 = string_quantity(cradle, bob, S[i, T0], S, i, START, RATE0, TURN)
            at = first_crossing(v0, a0, v1, a1, h)
            if at < when:
                when, kind = at, TURN
    return when, kind


@jit
def string_quantity(cradle, bob, t, S, i, c, rate, kind):
    """(value, slope) at time t [s] of what turns negative when the string of bob i has the event `kind`."""
    r, v = radius_and_speed(cradle, bob, t, S, i, c)
    if kind == TURN:
        sign = 1.0 if S[i, BRANCH] == LOADING else -1.0
        return sign * v, sign * radial_acceleration(bob, t, S, i, c, rate)
    sign = -1.0 if S[i, BRANCH] == SLACK else 1.0
    return sign * stretch(bob, r * r), sign * v * r / math.sqrt(r * r + bob.half_spacing * bob.half_spacing)


@jit
def first_crossing(f0, d0, f1, d1, h):
    """First instant in (0, h] from which on the cubic through (f0, slope d0) and (f1, slope d1) is negative.

    The value at 0 does not count: it may be an event's own rounding.
    """
    before = 0.0
    for k in range(1, 9):
        u = k / 8.0
        if _cubic(f0, d0, f1, d1, h, u) < 0.0:
            low, high = before, u
            for _ in range(40):
                mid = 0.5 * (low + high)
                if _cubic(f0, d0, f1, d1, h, mid) < 0.0:
                    high = mid
                else:
                    low = mid
            return high * h
        before = u
    return h


@jit
def _cubic(f0, d0, f1, d1, h, u):
    v = 1.0 - u
    return v * v * ((1.0 + 2.0 * u) * f0 + h * u * d0) + u * u * ((1.0 + 2.0 * v) * f1 - h * v * d1)


@part
def _fly_to_string_event(cradle, bobs, S, W, lo, hi, h, full, cause, whose):
    """Ends the segment at the string event found near h; Newton's method from the interpolated root."""
    tolerance = _TURN_TOLERANCE if cause == TURN else _TAUT_TOLERANCE
    for _ in range(6):
        _fly(cradle, bobs, S, W, lo, hi, h)
        value, rise = string_quantity(cradle, bobs[whose], S[lo, T0] + h, S, whose, END, RATE1, cause)
        if rise == 0.0 or abs(value) <= tolerance * abs(rise):
            break
        following = min(max(h - value / rise, 0.0), full)
        if following == h:
            break
        h = following
    return h


@part
def _parted(cradle, bobs, S, W, p, h):
    """Whether a contact of pair p has ended at the end of its segment of h [s]."""
    if S[p, LINK] == PRESSED:
        return W[p, FORCE] < 0.0
    return S[p, LINK] == RESOLVED and pair(cradle, bobs, p, S[p, T0] + h, S, END)[0] > 0.0


@part
def _fly_to_parting(cradle, bobs, S, W, lo, hi, h, p):
    """Ends the segment where the force of persistent contact p, or the overlap of a resolved one, reaches zero."""
    low, high, mid = 0.0, h, h
    while high - low > _PART_TOLERANCE:
        mid = 0.5 * (low + high)
        _fly(cradle, bobs, S, W, lo, hi, mid)
        if _parted(cradle, bobs, S, W, p, mid):
            high = mid
        else:
            low = mid
    if mid != high:
        _fly(cradle, bobs, S, W, lo, hi, high)
    return high
