"""The spacer that holds the pivots, in motion: each pivot moves at its own velocity, which changes at once.

In the room a bob on elastic strings feels nothing of the jump; a rigid string passes on what lies along it. The
energy that comes in is booked with the bob.
"""

import math

import numpy as np

from cradle_env.mechanics.contact_detection import step_to
from cradle_env.mechanics.event_loop import arrive, finish, fly_on, regroup, turn_after_impact
from cradle_env.mechanics.forces import pivot_at
from cradle_env.mechanics.impact import settle
from cradle_env.mechanics.jit import jit
from cradle_env.mechanics.layout import BROUGHT, LAST, LATER, LINK, LOSS, OPEN, OUT, PRESSED, START, T1

_FIRST = np.int64(0)


@jit
def pivot_per_delta(cradle, bobs, i):
    """dx/d(delta) of bob i's pivot [m], the cradle's middle at rest."""
    return (i - 0.5 * (len(bobs) - 1)) * 2.0 * cradle.radius


@jit
def hold(cradle, bobs, i, delta):
    """Puts the pivot of bob i where a spacer at rest at delta holds it."""
    bobs[i].drive = 0.0
    bobs[i].pivot = pivot_per_delta(cradle, bobs, i) * (1.0 + delta) + bobs[i].misplaced


@jit
def drive(cradle, bobs, S, W, t, rate, times, motion, energy):
    """From t [s] on, d(delta)/dt = rate [1/s] for every gap. No event before t may be pending.

    Returns whether all is finite, and the energy that contacts took as rigid strings jerked [J].
    """
    n = len(bobs)
    i = 0
    while i < n:
        lo, hi = i, int(S[i, LAST])
        if S[i, T1] <= t:
            finish(cradle, bobs, S, W, i, times, motion, energy)
        else:
            step_to(cradle, bobs, S, W, i, t)
            for j in range(hi - 1, lo - 1, -1):
                arrive(cradle, bobs, S, j, t, W, OUT, times, motion, energy)
        i = hi
    for i in range(n):
        S[i, LATER] = 0.0
        x, before = pivot_at(bobs[i], t), bobs[i].drive
        after = rate * pivot_per_delta(cradle, bobs, i)
        bobs[i].drive, bobs[i].pivot = after, x - after * t
        if not cradle.elastic:
            jerk(cradle, bobs[i], S, i, before, after)
    took = 0.0
    if cradle.elastic:
        turn_after_impact(cradle, bobs, S, _FIRST, n)
        regroup(cradle, bobs, S, W, _FIRST, n)
    else:
        took = settle_again(cradle, bobs, S, W)
    return fly_on(cradle, bobs, S, W, _FIRST, n), took


@jit
def jerk(cradle, bob, S, i, before, after):
    """What a rigid string does to bob i when its pivot's velocity jumps [m/s]: the bob's velocity in the room
    changes along the string only."""
    if cradle.large_angle:
        sin, cos = math.sin(S[i, START]), math.cos(S[i, START])
        S[i, START + 2] -= (after - before) * cos / bob.length
        S[i, START + BROUGHT] += 0.5 / bob.mobility * sin * sin * (after * after - before * before)
    else:
        S[i, START + 2] -= (after - before) / bob.length


@jit
def settle_again(cradle, bobs, S, W):
    """Decides anew which contacts persist; returns the energy that this takes [J]."""
    n, took = len(bobs), 0.0
    for p in range(n - 1):
        W[p, LOSS] = 0.0
        if S[p, LINK] == PRESSED:
            S[p, LINK] = OPEN
    regroup(cradle, bobs, S, W, _FIRST, n)
    if settle(cradle, bobs, S, W, _FIRST, n) > 0:
        regroup(cradle, bobs, S, W, _FIRST, n)
    for p in range(n - 1):
        took += W[p, LOSS]
    return took
