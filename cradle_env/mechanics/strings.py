"""Tension of one string: the hysteresis operator of eq. 4.

The stretch s = sqrt(r^2 + a^2) - sqrt(r0^2 + a^2). A string's memory is a branch through the point (s_ref, T_ref)
where it turned last: loading follows kappa (s - s_ref) + T_ref, unloading T_ref (s / s_ref)^2, and a slack string
has no memory. So the tension is a quadratic in s on every branch, whose coefficients are all that is kept. Elastic
strings only ever load, from (0, 0).
"""

import math

from cradle_env.mechanics.jit import entry, jit, leaf
from cradle_env.mechanics.layout import BRANCH, LOADING, SLACK, TENSION, UNLOADING


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


@jit
def take_branch(bob, S, i, branch, s, t):
    """Puts the strings of bob i on the branch through tension t [N] at stretch s [m]."""
    t0, t1, t2 = 0.0, 0.0, 0.0
    if branch == LOADING:
        t0, t1 = t - bob.kappa * s, bob.kappa
    elif branch == UNLOADING:
        t2 = t / (s * s)
    S[i, BRANCH], S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2] = branch, t0, t1, t2


@jit
def turn(cradle, bob, S, i, s, speed):
    """Sets the branch of the strings of bob i at stretch s [m], its radius changing at `speed` [m/s].

    Returns whether the branch changed. The tension is continuous.
    """
    branch, following, t = S[i, BRANCH], S[i, BRANCH], 0.0
    if s <= 0.0 and speed <= 0.0:
        following = SLACK
    elif branch == SLACK:
        if s >= 0.0:
            s, following = 0.0, LOADING
    elif cradle.hysteretic:
        t = tension(S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2], s)
        if branch == LOADING and speed < 0.0:
            following = UNLOADING
        elif branch == UNLOADING and speed > 0.0:
            following = LOADING
    if following != branch:
        take_branch(bob, S, i, following, s, t)
    return following != branch


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

    The integral of 4 T r0 / sqrt(r0^2 + a^2) dr by three-point Gauss quadrature: the tension is all but a
    quadratic in r over the millimetres that a string stretches.
    """
    half, mid = 0.5 * (r1 - r0), 0.5 * (r1 + r0)
    node = 0.7745966692414834 * half
    low, middle, high = mid - node, mid, mid + node
    ends = tension(t0, t1, t2, stretch(bob, t, low * low)) + tension(t0, t1, t2, stretch(bob, t, high * high))
    return bob.grip * half * (5.0 * ends + 8.0 * tension(t0, t1, t2, stretch(bob, t, middle * middle))) / 9.0
