"""Flights of bobs that move alone on elastic strings, as Taylor series: the next segments of four bobs at once.

A bob needs no other until something touches it. So lanes that the bobs to lay leave empty lay for others the segments
that follow their present ones.
"""

import math

import numpy as np

from cradle_env.mechanics.forces import pivot_at
from cradle_env.mechanics.jit import jit, leaf
from cradle_env.mechanics.lanes import (
    ALLOWED,
    BEND,
    DRAG_B,
    FORCES,
    LONGEST,
    PLACE,
    ROOM_U,
    ROOM_X,
    SLOPE,
    SQUARE,
    SQUARES,
    STEP,
    WIDTH,
    U,
    X,
    Z,
    expand,
    motion_on,
    work_on,
)
from cradle_env.mechanics.lanes import W as VZ
from cradle_env.mechanics.layout import (
    BRANCH,
    BROUGHT,
    COLUMNS,
    CONTACT_LOSS,
    DRAG,
    DUE,
    END,
    FIRST,
    FLOWN,
    GRID,
    LANE_BOB,
    LANE_BRANCH,
    LANE_LATER,
    LANES,
    LAST,
    LATER,
    LATER_DUE,
    LATER_END,
    LATER_SERIES,
    LATER_T1,
    MEETING,
    ON_SERIES,
    ORDER,
    SERIES,
    SERIES_WIDTH,
    START,
    STEPS,
    T0,
    T1,
    TENSION,
    TURN,
    WHOSE,
)
from cradle_env.mechanics.string_events import CROSSING, direction_after, loading, stretching, string_event, turned

# Which segment of a bob is in a lane; an empty lane is the first.
PRESENT, FOLLOWING, NO_LANE = np.int64(0), np.int64(1), np.int64(0)
_NOBODY = np.int64(-1)
# Halvings that find the bottom of a dip.
_BISECTIONS = 20


@leaf
def flies_on_series(cradle, S, i):
    """Whether bob i's next segment is a series."""
    return cradle.series != 0 and S[i, LAST] - S[i, FIRST] == 1.0


@leaf
def place_on(S, i, t):
    """Coordinates and velocities of bob i at time t [s] of its segment, a series."""
    return motion_on(S, i * COLUMNS + SERIES, t - S[i, T0])


@leaf
def drag_on(S, i, t):
    """What drag has taken from bob i [J] at time t [s] of its segment, a series."""
    return S[i, START + DRAG] + work_on(S, i * COLUMNS + SERIES, t - S[i, T0])


@leaf
def brought_on(bob, S, i, c, x, vx):
    """What the pivot of bob i has brought in [J] where the bob is at x with velocity vx along it [m, m/s], its segment,
    a series, having begun with the motion in column c on: the pivot's speed times the impulse of the strings on it."""
    impulse = (vx - S[i, c + 2]) / bob.mobility + bob.b * (x - S[i, c])
    return S[i, c + BROUGHT] + bob.drive * impulse


@jit
def lay_ahead(cradle, bobs, S, W, lanes):
    """Fills the lanes from number `lanes` on with segments that follow, those due first."""
    for lane in range(lanes, WIDTH):
        bob, first = _NOBODY, math.inf
        for i in range(len(bobs)):
            taken = S[i, LATER] != 0.0 or S[i, ON_SERIES] == 0.0 or S[i, T1] >= first or S[i, T1] > S[i, MEETING]
            if i > 0:
                taken = taken or S[i, T1] > S[i - 1, MEETING]
            for other in range(lane):
                taken = taken or W[0, LANE_BOB + other] == i
            if not taken:
                bob, first = i, S[i, T1]
        if bob < 0:
            return lane
        load(cradle, bobs[bob], S, W, lane, bob, FOLLOWING)
    return WIDTH


@leaf
def load(cradle, bob, S, W, lane, i, later):
    """Puts bob i's PRESENT segment into a lane, which begins at START, or the one FOLLOWING it, which begins at END."""
    t, c = (S[i, T1], END) if later else (S[i, T0], START)
    branch, t0, t1, t2 = S[i, BRANCH], S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2]
    if later:
        branch, t0, t1, t2 = branch_after(cradle, bob, S, i)
    W[0, LANE_BOB + lane], W[0, LANE_LATER + lane], W[0, LANE_BRANCH + lane] = i, later, branch
    W[0, LANES + WIDTH * PLACE + lane] = i * COLUMNS + (LATER_SERIES if later else SERIES)
    row, pull, drag = W[0, LANES + lane :], bob.grip * bob.mobility, bob.b * bob.mobility
    row[WIDTH * X], row[WIDTH * Z] = S[i, c] - pivot_at(bob, t), S[i, c + 1]
    row[WIDTH * U], row[WIDTH * VZ] = S[i, c + 2] - bob.drive, S[i, c + 3]
    row[WIDTH * FORCES], row[WIDTH * (FORCES + 1)] = bob.half_spacing * bob.half_spacing, bob.string
    row[WIDTH * (FORCES + 2)], row[WIDTH * (FORCES + 3)] = pull * t0, pull * t1
    row[WIDTH * (FORCES + 4)], row[WIDTH * (FORCES + 5)] = pull * t2, drag
    row[WIDTH * (FORCES + 6)], row[WIDTH * (FORCES + 7)] = drag * bob.drive, bob.fall
    row[WIDTH * ROOM_X], row[WIDTH * ROOM_U], row[WIDTH * DRAG_B] = S[i, c], S[i, c + 2], bob.b
    row[WIDTH * LONGEST], row[WIDTH * ALLOWED] = bob.longest, cradle.tolerance * bob.length


@leaf
def branch_after(cradle, bob, S, i):
    """Branch and tension of bob i's strings after its present segment."""
    branch, t0, t1, t2 = S[i, BRANCH], S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2]
    if S[i, DUE] == GRID:
        return branch, t0, t1, t2
    return turned(cradle, bob, branch, t0, t1, t2, S[i, T1], S, i, END, direction_after(branch, S[i, DUE]))


@leaf
def fly_lanes(cradle, bobs, S, W, lanes):
    """Lays the segments of the bobs in the first `lanes` lanes. Returns whether they are finite."""
    for lane in range(lanes, WIDTH):
        W[0, LANES + WIDTH * PLACE + lane] = W[0, LANES + WIDTH * PLACE]
    expand(W, LANES, S)
    finite = True
    for lane in range(lanes):
        i = int(W[0, LANE_BOB + lane])
        finite = close(cradle, bobs[i], S, W, lane, i, W[0, LANE_LATER + lane] != 0.0) and finite
    return finite


@leaf
def close(cradle, bob, S, W, lane, i, later):
    """Ends the segment in a lane at its step or at the first event of the string before it. Returns whether it is
    finite."""
    t, c = (S[i, T1], END) if later else (S[i, T0], START)
    end, cause = length_and_cause(cradle, bob, W[0, LANE_BRANCH + lane], W[0, LANES + lane :])
    t1 = t + end
    series, last = (LATER_SERIES, LATER_END) if later else (SERIES, END)
    x, z, vx, vz = motion_on(S, i * COLUMNS + series, t1 - t)
    S[i, last], S[i, last + 1], S[i, last + 2], S[i, last + 3] = x, z, vx, vz
    S[i, last + DRAG] = S[i, c + DRAG] + work_on(S, i * COLUMNS + series, t1 - t)
    S[i, last + CONTACT_LOSS] = S[i, c + CONTACT_LOSS]
    S[i, last + BROUGHT] = brought_on(bob, S, i, c, x, vx)
    if later:
        S[i, LATER], S[i, LATER_T1], S[i, LATER_DUE] = 1.0, t1, cause
    else:
        S[i, T1], S[i, DUE], S[i, WHOSE], S[i, ON_SERIES] = t1, cause, i, 1.0
    S[i, STEPS] += 1.0
    S[0, FLOWN] += 1.0
    return math.isfinite(x + vx)


@leaf
def length_and_cause(cradle, bob, branch, row):
    """(length [s], cause of its end) of the segment in a lane, on this branch of the string: the lane's step, or the
    first event of the string."""
    h, straight = row[WIDTH * STEP], bob.length * bob.length
    end, cause = string_event(
        cradle, bob, branch, h,
        0.5 * (row[WIDTH * SQUARES] - straight), 0.5 * row[WIDTH * (SQUARES + 1)], row[WIDTH * (SQUARES + 2)],
        0.5 * (row[WIDTH * SQUARE] - straight), 0.5 * row[WIDTH * SLOPE], 0.5 * row[WIDTH * BEND],
    )  # fmt: skip
    if cause != GRID:
        end = crossing(row, cause, stretching(branch) if cause != TURN else loading(branch), straight, end, h)
        if end == h:
            cause = GRID
    return end, cause


@jit
def crossing(row, kind, sign, straight, guess, h):
    """Where before h the series of r^2 in a lane first falls below `straight` (TAUT), or its slope below 0 (TURN), with
    this sign; h where it does not. From a guess, by Newton's method, and bisection where it leaves the bracket."""
    low, high, t = 0.0, h, guess
    if sign * event_value(row, kind, straight, h)[0] >= 0.0:  # it dips at most: to where its slope turns
        for _ in range(_BISECTIONS):
            mid = 0.5 * (low + high)
            if sign * event_value(row, kind, straight, mid)[1] < 0.0:
                low = mid
            else:
                high = mid
        if sign * event_value(row, kind, straight, high)[0] >= 0.0:
            return h
        low, t = 0.0, min(t, high)
    while True:
        value, slope = event_value(row, kind, straight, t)
        if sign * value < 0.0:
            high = t
        else:
            low = t
        following = t - value / slope
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - t) < CROSSING * h:
            return following
        t = following


@leaf
def event_value(row, kind, straight, t):
    """What has a zero at an event of this kind, and its slope, at t [s] of the series in a lane."""
    value, slope, bend = 0.0, 0.0, 0.0
    for k in range(ORDER - 2, -1, -1):
        bend = bend * t + slope
        slope = slope * t + value
        value = value * t + row[WIDTH * (SQUARES + k)]
    return (slope, 2.0 * bend) if kind == TURN else (value - straight, slope)


@leaf
def take_later(S, i):
    """Makes the segment of bob i that is laid already its present one."""
    S[i, LATER] = 0.0
    S[i, T1], S[i, DUE], S[i, WHOSE] = S[i, LATER_T1], S[i, LATER_DUE], i
    for c in range(7):
        S[i, END + c] = S[i, LATER_END + c]
    for k in range(SERIES_WIDTH):
        S[i, SERIES + k] = S[i, LATER_SERIES + k]
