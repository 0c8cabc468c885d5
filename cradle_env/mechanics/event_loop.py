"""The simulation loop: every group of bobs flies on its own segment; the earliest event is next.

An event is the end of a segment or the meeting of two neighbours. It ends the segments of the bobs it concerns,
changes their velocities, strings or contacts, and lays their next segments; nobody else is touched.
"""

import math

import numpy as np

from cradle_env.mechanics.contact import pair
from cradle_env.mechanics.contact_detection import last_moment, linger, predict, step_to, touching
from cradle_env.mechanics.energy_ledger import book, string_work
from cradle_env.mechanics.flight import lay
from cradle_env.mechanics.forces import radius_and_speed
from cradle_env.mechanics.impact import chain, follow, settle, settle_resolved, two_body
from cradle_env.mechanics.integrator import (
    between,
    derivative_between_segments,
    free_derivative_between_segments,
    pivot_between,
)
from cradle_env.mechanics.jit import entry, jit, leaf
from cradle_env.mechanics.layout import (
    BRANCH,
    DIM,
    DISSIPATION,
    DUE,
    END,
    EVENTS,
    FIRST,
    FLOWN,
    GRID,
    IMPACTS,
    LAST,
    LEFT,
    LEFT_LINK,
    LEFT_WIDTH,
    LINK,
    LOSS,
    LOST,
    MEETING,
    MULTI_BODY,
    ON_SERIES,
    OPEN,
    OUT,
    PART,
    PROGRESS,
    RATE0,
    RATE1,
    RELEASE,
    RESOLVED,
    SAMPLED,
    SEEN,
    SETTLED,
    SLACK,
    START,
    STRUCK_FIRST,
    STRUCK_LAST,
    T0,
    T1,
    TAUT,
    TENSION,
    TURN,
    TURNS,
    WHOSE,
    WORK,
    WORKED,
)
from cradle_env.mechanics.string_events import direction_after, turned
from cradle_env.mechanics.strings import unstretched

# What a run can end with.
DONE, FULL, STALLED, NOT_FINITE, NO_REST, PAUSED = 0, 1, 2, 3, 4, 5
# Steps of single bobs after which a run returns to Python, which is deaf to Ctrl-C until then: about 0.2 s.
MOST_FLOWN = 200_000
# So many events of each bob without this much progress [s] are a stall: N bobs that all but touch meet N²/2 times.
_STALL_EVENTS, _STALL_TIME = 2000, 1e-2
_FIRST = np.int64(0)


@entry
def run(cradle, bobs, table, S, W, until, times, motion, energy, impacts, count):
    """Advances the state S past `until` [s] and samples it; W is scratch.

    times (T,) s, ascending; motion (T, N, 4): theta, r, their rates; energy (T, N, 7) J: see `ledger.book`
    (or of length 0);
    impacts (M, 4): time, pair from 0, approach speed, energy taken; or (M, LOGGED), see `layout`; the first `count`
    rows are in use.
    Returns (DONE | FULL | PAUSED | STALLED | NOT_FINITE, rows in use). After FULL the same call goes on; after PAUSED,
    once FLOWN is 0 again.
    """
    status, count = advance(cradle, bobs, table, S, W, until, times, motion, energy, impacts, count)
    if status == DONE:
        for i in range(len(bobs)):
            sample(cradle, bobs, S, i, until, np.True_, times, motion, energy)
    return status, count


@jit
def advance(cradle, bobs, table, S, W, until, times, motion, energy, impacts, count):
    """The loop of `run`: every event up to `until` [s]."""
    lo, hi = _FIRST, _FIRST  # bobs to fly on
    if S[0, T1] == S[0, T0]:
        hi = begin(cradle, bobs, S, W)
    while True:
        if not fly_on(cradle, bobs, S, W, lo, hi):
            return NOT_FINITE, count
        bob, end, p, meeting = next_event(S)
        now = min(end, meeting)
        if now > until:
            return DONE, count
        if len(impacts) - count < len(bobs):
            return FULL, count
        S[0, EVENTS] += meeting <= end or S[bob, DUE] != GRID  # a step of any length is headway
        if now - S[0, PROGRESS] > _STALL_TIME:
            S[0, EVENTS], S[0, PROGRESS] = 0.0, now
        if S[0, EVENTS] > _STALL_EVENTS * len(bobs):
            return STALLED, count
        if S[0, FLOWN] > MOST_FLOWN:
            return PAUSED, count
        if meeting <= end:
            lo, hi, count = meet(cradle, bobs, table, S, W, p, times, motion, energy, impacts, count)
        else:
            lo, hi = finish(cradle, bobs, S, W, bob, times, motion, energy)


@jit
def begin(cradle, bobs, S, W):
    """Finds which contacts persist at START, at T0. Returns how many bobs there are to fly on."""
    n = len(bobs)
    first = _FIRST
    for i in range(n):
        S[i, DISSIPATION], S[i, SEEN] = cradle.contact_k_f, -1.0
    free_derivative_between_segments(cradle, bobs, S, W, first, n, S[0, T0], S, START, S, RATE0)
    settle(cradle, bobs, S, W, first, n)
    regroup(cradle, bobs, S, W, first, n)
    return n


@jit
def next_event(S):
    """(bob, end) of the segment that ends first, (pair, instant) of the meeting that comes first."""
    bob, p, end, meeting = _FIRST, _FIRST, S[0, T1], S[0, MEETING]
    for i in range(1, len(S)):
        if S[i, T1] < end:
            bob, end = i, S[i, T1]
        if S[i, MEETING] < meeting:
            p, meeting = i, S[i, MEETING]
    return bob, end, p, meeting


@jit
def fly_on(cradle, bobs, S, W, lo, hi):
    """Lays the next segment of every group among the bobs lo..hi-1 and looks for meetings with neighbours."""
    finite = lay(cradle, bobs, S, W, lo, hi)
    if finite and hi > lo:
        for p in range(max(lo - 1, 0), min(hi, len(bobs) - 1)):
            S[p, MEETING] = predict(cradle, bobs, S, p)
    return finite


@jit
def finish(cradle, bobs, S, W, bob, times, motion, energy):
    """Ends the segment of a bob's group where it was planned to end. Returns the range of bobs to fly on."""
    lo, hi = int(S[bob, FIRST]), int(S[bob, LAST])
    cause, whose = S[lo, DUE], int(S[lo, WHOSE])
    for i in range(hi - 1, lo - 1, -1):  # row 0 last: the others look up the frame there
        arrive(cradle, bobs, S, i, S[i, T1], S, END, times, motion, energy)
        if S[i, ON_SERIES] == 0.0:
            for c in range(DIM):
                S[i, RATE0 + c] = S[i, RATE1 + c]
    if cause == TURN or cause == TAUT:
        turn_string(cradle, bobs[whose], S, whose, direction_after(S[whose, BRANCH], cause))
    elif cause == RELEASE or cause == PART:
        S[whose, LINK] = OPEN
        regroup(cradle, bobs, S, W, lo, hi)
    elif cradle.contact_scale > 0.0 and hi - lo > 1 and settle_resolved(cradle, bobs, S, W, lo, hi):
        regroup(cradle, bobs, S, W, lo, hi)
    return lo, hi


@leaf
def arrive(cradle, bobs, S, i, t, A, c, times, motion, energy):
    """Makes the motion in A, from column c on, bob i's new start at time t [s]; takes the samples due before."""
    sample(cradle, bobs, S, i, t, np.False_, times, motion, energy)
    if cradle.elastic and bobs[i].creep != 0.0:
        r, v = radius_and_speed(cradle, bobs[i], t, A, i, c)
        S[i, WORK] += string_work(cradle, bobs[i], S, i, t, r, v)
    for k in range(DIM):
        S[i, START + k] = A[i, c + k]
    S[i, T0] = t


@jit
def turn_string(cradle, bob, S, i, direction):
    """Switches the branch of bob i's strings for a stretch that goes in `direction`; books what they lost."""
    before = S[i, BRANCH]
    if bob.creep == 0.0:
        r, v = radius_and_speed(cradle, bob, S[i, T0], S, i, START)
        S[i, WORK] += string_work(cradle, bob, S, i, S[i, T0], r, v)
        S[i, WORKED] = r
    S[i, BRANCH], S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2] = turned(
        cradle, bob, before, S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2], S[i, T0], S, i, START, direction
    )
    if S[i, BRANCH] != before:
        S[i, TURNS] += 1.0
        if S[i, BRANCH] == SLACK:
            S[i, LOST] = S[i, WORK]


@jit
def turn_after_impact(cradle, bobs, S, lo, hi):
    """Puts the strings of the bobs lo..hi-1, whose velocities have jumped, on the branch of their new motion."""
    if cradle.hysteretic:
        for i in range(lo, hi):
            r, v = radius_and_speed(cradle, bobs[i], S[i, T0], S, i, START)
            string, growth = unstretched(bobs[i], S[i, T0])
            direction = r * v - string * growth
            if direction != 0.0 and S[i, BRANCH] != SLACK:
                turn_string(cradle, bobs[i], S, i, direction)


@leaf
def sample(cradle, bobs, S, i, until, inclusive, times, motion, energy):
    """Takes the samples of bob i due before `until` [s] from its current segment."""
    k = int(S[i, SAMPLED])
    while k < len(times) and (times[k] < until or (inclusive and times[k] == until)):
        x, z, vx, vz = between(S, i, times[k])
        if cradle.elastic:
            pivot, drive = pivot_between(cradle, bobs[i], S, times[k])
            x -= pivot
            vx -= drive
            r = math.sqrt(x * x + z * z)
            motion[k, i, 0], motion[k, i, 1] = math.atan2(x, -z), r
            motion[k, i, 2], motion[k, i, 3] = (x * vz - z * vx) / (r * r), (x * vx + z * vz) / r
        else:
            motion[k, i, 0], motion[k, i, 1], motion[k, i, 2], motion[k, i, 3] = x, bobs[i].length, vx, 0.0
        if len(energy) > 0:
            held = book(cradle, bobs, S, i, times[k])
            for e in range(7):
                energy[k, i, e] = held[e]
        k += 1
    S[i, SAMPLED] = k


@jit
def regroup(cradle, bobs, S, W, lo, hi):
    """Sets the groups of the bobs lo..hi-1, which are at one instant, by their contacts; and their derivatives."""
    if cradle.coupled:
        lo, hi = _FIRST, len(bobs)
    first = lo
    for i in range(lo, hi):
        if i == hi - 1 or (S[i, LINK] == OPEN and not cradle.coupled):
            for j in range(first, i + 1):
                S[j, FIRST], S[j, LAST] = first, i + 1
            derivative_between_segments(cradle, bobs, S, W, first, i + 1, S[first, T0], S, START, S, RATE0)
            first = i + 1


@jit
def meet(cradle, bobs, table, S, W, p, times, motion, energy, impacts, count):
    """The meeting of pair p: ends the segments of all bobs concerned, resolves the impact, decides which contacts
    persist. Returns the range of bobs to fly on, and the rows of `impacts` in use."""
    t = S[p, MEETING]
    a, b = p, p + 2  # the bobs struck as one
    while a > 0 and touching(cradle, bobs, S, a - 1, t):
        a -= 1
    while b < len(bobs) and touching(cradle, bobs, S, b - 1, t):
        b += 1
    lo, hi = int(S[a, FIRST]), int(S[b - 1, LAST])
    i = lo
    while i < hi:
        step_to(cradle, bobs, S, W, i, t)
        i = int(S[i, LAST])
    dt = last_moment(cradle, bobs, S, W, p)
    i = lo
    while i < hi:
        linger(cradle, bobs, S, W, i, int(S[i, LAST]), t, dt)
        i = int(S[i, LAST])
    t += dt
    for i in range(hi - 1, lo - 1, -1):
        arrive(cradle, bobs, S, i, t, W, OUT, times, motion, energy)

    rows = count
    for q in range(a, b - 1):
        W[q, LOSS] = 0.0
        if S[q, LINK] != RESOLVED:  # a contact that goes on is no new impact
            impacts[rows, 0], impacts[rows, 1] = t, q
            impacts[rows, 2] = 0.0 - pair(cradle, bobs, q, t, S, START)[3]
            S[q, IMPACTS] += 1.0
            rows += 1
    S[p, MULTI_BODY] += b - a > 2
    if cradle.contact_scale > 0.0:
        follow(cradle, bobs, table, S, a, b)
        regroup(cradle, bobs, S, W, lo, hi)
    else:
        if b - a == 2:
            two_body(cradle, bobs, table, S, W, p)
        else:
            S[0, FLOWN] += chain(cradle, bobs, table, S, W, a, b) * (b - a)
        for q in range(a, b - 1):
            S[q, LINK] = OPEN
        turn_after_impact(cradle, bobs, S, a, b)
        regroup(cradle, bobs, S, W, lo, hi)
        made = settle(cradle, bobs, S, W, a, b)
        if made > 0:
            S[p, SETTLED] += made
            turn_after_impact(cradle, bobs, S, a, b)
            regroup(cradle, bobs, S, W, lo, hi)
    for row in range(count, rows):
        impacts[row, 3] = W[int(impacts[row, 1]), LOSS]
        if impacts.shape[1] > 4:
            log(S, impacts, row, a, b)
    return lo, hi, rows


@jit
def log(S, impacts, row, a, b):
    """Adds to a row of impacts that the bobs a..b-1 were struck as one, and how its two go on; see `layout.LOGGED`."""
    p = int(impacts[row, 1])
    impacts[row, STRUCK_FIRST], impacts[row, STRUCK_LAST], impacts[row, LEFT_LINK] = a, b, S[p, LINK]
    for i in range(2):
        c = LEFT + i * LEFT_WIDTH
        for k in range(4):
            impacts[row, c + k], impacts[row, c + 4 + k] = S[p + i, START + k], S[p + i, BRANCH + k]
