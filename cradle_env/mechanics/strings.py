"""Tension of one string: the hysteresis operator of eq. 4.

The stretch s = sqrt(r^2 + a^2) - sqrt(r0^2 + a^2). A string's memory is a branch through the point (s_ref, T_ref)
where it turned last: loading follows kappa (s - s_ref) + T_ref, unloading T_ref (s / s_ref)^2, and a slack string
has no memory. So the tension is a quadratic in s on every branch, whose coefficients are all that is kept. Elastic
strings only ever load, from (0, 0).
"""

import math

from cradle_env.mechanics.jit import entry, jit, leaf
from cradle_env.mechanics.layout import BRANCH, LOADING, SLACK, TENSION, UNLOADING

# The work of strings is taken over this part of their length at a time: an error of 1e-13 of it.
_EVEN = 0.05


@leaf
def unstretched(bob, t):
    """(L [m], dL/dt [m/s]) of a string of `bob` just straight at time t [s]: strings may creep."""
    if bob.creep == 0.0:
        return bob.string, 0.0
    return bob.string + bob.creep * math.log1p(t), bob.creep / (1.0 + t)


@leaf
def stretch(bob, t, r2):
    """s [m] of a string of `bob` at time t [s] and squared radius r2 [m^2]."""
    return math.sqrt(r2 + bob.half_spacing * bob.half_spacing) - unstretched(bob, t)[0]


@leaf
def tension(t0, t1, t2, s):
    """T [N] at stretch s [m] on a branch with the coefficients t0, t1, t2. Below zero stretch, where a step may end
    before the event is found, an unloaded string is slack already."""
    return t0 + s * (t1 + max(s, 0.0) * t2)


@leaf
def through(bob, branch, s, t):
    """Coefficients (t0, t1, t2) of the tension on a branch through tension t [N] at stretch s [m]."""
    if branch == LOADING:
        return t - bob.kappa * s, bob.kappa, 0.0
    if branch == UNLOADING:
        return 0.0, 0.0, t / (s * s)
    return 0.0, 0.0, 0.0


@jit
def take_branch(bob, S, i, branch, s, t):
    """Puts the strings of bob i on the branch through tension t [N] at stretch s [m]."""
    S[i, BRANCH] = branch
    S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2] = through(bob, branch, s, t)


@jit
def following(cradle, bob, branch, t0, t1, t2, s, speed):
    """(branch, coefficients of the tension) that follow at stretch s [m], the radius changing at `speed` [m/s].

    The tension is continuous.
    """
    after, t = branch, 0.0
    if s <= 0.0 and speed <= 0.0:
        after = SLACK
    elif branch == SLACK:
        if s >= 0.0:
            s, after = 0.0, LOADING
    elif cradle.hysteretic:
        t = tension(t0, t1, t2, s)
        if branch == LOADING and speed < 0.0:
            after = UNLOADING
        elif branch == UNLOADING and speed > 0.0:
            after = LOADING
    if after != branch:
        t0, t1, t2 = through(bob, after, s, t)
    return after, t0, t1, t2


@jit
def turn(cradle, bob, S, i, s, speed):
    """Sets the branch of the strings of bob i at stretch s [m], the radius changing at `speed` [m/s]. Returns whether
    it changed."""
    before = S[i, BRANCH]
    S[i, BRANCH], S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2] = following(
        cradle, bob, before, S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2], s, speed
    )
    return S[i, BRANCH] != before


@entry
def follow(cradle, bob, S, path, out):
    """Tension [N] of one string of `bob`, new and unstretched, along a path of stretches s >= 0 [m], (K,), into out."""
    take_branch(bob, S, 0, LOADING, 0.0, 0.0)
    before = 0.0
    for k, s in enumerate(path):
        if s != before:
            turn(cradle, bob, S, 0, before, s - before)
        out[k] = tension(S[0, TENSION], S[0, TENSION + 1], S[0, TENSION + 2], s)
        before = s


@jit
def work_between(bob, t, t0, t1, t2, r0, r1):
    """Energy [J] that the four strings take while the radius goes from r0 to r1 [m] on one branch, all at time t [s].

    The integral of 4 T r0 / sqrt(r0^2 + a^2) dr by three-point Gauss quadrature over some millimetres at a time, where
    the tension is all but a quadratic in r.
    """
    parts = 1 + int(abs(r1 - r0) / (_EVEN * bob.length))
    half, total = 0.5 * (r1 - r0) / parts, 0.0
    node = 0.7745966692414834 * half
    for k in range(parts):
        middle = r0 + (2 * k + 1) * half
        low, high = middle - node, middle + node
        ends = tension(t0, t1, t2, stretch(bob, t, low * low)) + tension(t0, t1, t2, stretch(bob, t, high * high))
        total += 5.0 * ends + 8.0 * tension(t0, t1, t2, stretch(bob, t, middle * middle))
    return bob.grip * half * total / 9.0
