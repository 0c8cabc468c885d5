"""The next segment of flight of a group, cut at the first thing that changes its equations."""

import math

from numba import types

from cradle_env.mechanics.apart import GROUP, apart
from cradle_env.mechanics.contact import blow_speed, close_gaps, opening, pair
from cradle_env.mechanics.integrator import derivative, step
from cradle_env.mechanics.jit import jit
from cradle_env.mechanics.lanes import WIDTH
from cradle_env.mechanics.layout import (
    BRANCH,
    DIM,
    DUE,
    END,
    FLOWN,
    FORCE,
    GRID,
    LAST,
    LATER,
    LINK,
    ON_SERIES,
    OPEN,
    OUT,
    PART,
    PRESSED,
    RATE0,
    RATE1,
    RELEASE,
    RESOLVED,
    STAGES,
    START,
    STEPS,
    T0,
    T1,
    WHOSE,
)
from cradle_env.mechanics.series_flight import (
    NO_LANE,
    PRESENT,
    flies_on_series,
    fly_lanes,
    lay_ahead,
    load,
    take_later,
)
from cradle_env.mechanics.string_events import half_square, string_event

# How well the end of a contact is located [s].
_PART_TOLERANCE = 1e-10
# Speeds [m/s, rad/s on rigid strings] from which on a motion has diverged: no cradle swings so fast. The search for
# meetings goes in strides that are short against the speed, and would hardly end.
_DIVERGED = 1e5
# After an event, the next point of the grid is passed over if it is nearer than this part of a step.
_SHORTEST = 0.25


@jit
def lay(cradle, bobs, S, W, lo, hi):
    """Lays the next segment of every group among the bobs lo..hi-1. Returns whether all are finite."""
    i, lanes, finite = lo, NO_LANE, True
    while i < hi:
        last = int(S[i, LAST])
        if not flies_on_series(cradle, S, i):
            finite = plan(cradle, bobs, S, W, i, last) and finite
        elif S[i, LATER] != 0.0:
            take_later(S, i)
        else:
            if lanes == WIDTH:
                finite = fly_lanes(cradle, bobs, S, W, lanes) and finite
                lanes = NO_LANE
            load(cradle, bobs[i], S, W, lanes, i, PRESENT)
            lanes += 1
        i = last
    if lanes > 0:
        finite = fly_lanes(cradle, bobs, S, W, lay_ahead(cradle, bobs, S, W, lanes)) and finite
    return finite


@apart(types.boolean, *GROUP)
def plan(cradle, bobs, S, W, lo, hi):
    """Lays the segment of the bobs lo..hi-1 from its start: to a point of the grid, or to the first event of a
    string, a persistent contact or a resolved contact before it. Returns whether it is finite, and has not diverged."""
    t = S[lo, T0]
    grid = (math.floor(t / cradle.step + _SHORTEST) + 1.0) * cradle.step
    full = contact_step(cradle, bobs, S, lo, hi, grid - t)
    h, cause, whose = full, GRID, lo
    _fly(cradle, bobs, S, W, lo, hi, h)

    if cradle.elastic:
        for i in range(lo, hi):
            q0, p0, a0 = half_square(bobs[i], t, S, i, START, RATE0)
            q1, p1, a1 = half_square(bobs[i], t + full, S, i, END, RATE1)
            when, kind = string_event(cradle, bobs[i], S[i, BRANCH], full, q0, p0, a0, q1, p1, a1)
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
        S[i, DUE], S[i, WHOSE], S[i, ON_SERIES] = cause, whose, 0.0
        finite = finite and math.isfinite(S[i, END]) and abs(S[i, END + 2]) + abs(S[i, END + 3]) < _DIVERGED
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


@jit
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


@jit
def _held(cradle, bobs, S, W, p, h, c):
    """What holds a contact of pair p h [s] after the start of its segment, where the motion stands in S from column c
    on: the force [N] of a persistent one, the overlap [m] of a resolved one. Negative where it has ended; 0 for bobs
    apart."""
    if S[p, LINK] == PRESSED:
        return W[p, FORCE]
    return -pair(cradle, bobs, p, S[p, T0] + h, S, c)[0] if S[p, LINK] == RESOLVED else 0.0


@jit
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
