"""Tension of one string: the hysteresis operator of eq. 4.

The stretch s = sqrt(r^2 + a^2) - sqrt(r0^2 + a^2). A string's memory is a branch and one reference point (s, T)
on it: loading follows kappa (s - s_ref) + T_ref, unloading T_ref (s / s_ref)^2, and a slack string has no memory.
Elastic strings only ever load, from (0, 0).
"""

import math

from cradle_env.mechanics.jit import jit
from cradle_env.mechanics.parameters import BRANCH, LOADING, S_REF, SLACK, T_REF, UNLOADING


@jit
def stretch(bob, r2):
    """s [m] of a string of `bob` at squared radius r2 [m^2]."""
    return math.sqrt(r2 + bob.half_spacing * bob.half_spacing) - bob.string


@jit
def tension(bob, branch, s_ref, t_ref, s):
    """T [N] at stretch s [m] on a branch through (s_ref, t_ref)."""
    if branch == LOADING:
        return bob.kappa * (s - s_ref) + t_ref
    if branch == SLACK:
        return 0.0
    ratio = s / s_ref
    return t_ref * ratio * ratio


@jit
def turn(cradle, bob, S, i, s, speed):
    """Sets the branch of the strings of bob i at stretch s [m], its radius changing at `speed` [m/s].

    Returns whether the branch changed. The tension is continuous.
    """
    branch = S[i, BRANCH]
    if s <= 0.0 and speed <= 0.0:
        S[i, BRANCH], S[i, S_REF], S[i, T_REF] = SLACK, 0.0, 0.0
        return branch != SLACK
    if branch == SLACK:
        if s < 0.0:
            return False
        S[i, BRANCH], S[i, S_REF], S[i, T_REF] = LOADING, 0.0, 0.0
        return True
    if cradle.hysteretic and ((branch == LOADING and speed < 0.0) or (branch == UNLOADING and speed > 0.0)):
        now = tension(bob, branch, S[i, S_REF], S[i, T_REF], s)
        S[i, BRANCH] = UNLOADING if branch == LOADING else LOADING
        S[i, S_REF], S[i, T_REF] = s, now
        return True
    return False


@jit
def work_between(bob, branch, s_ref, t_ref, r0, r1):
    """Energy [J] that the four strings take while the radius goes from r0 to r1 [m] on one branch.

    The integral of 4 T r0 / sqrt(r0^2 + a^2) dr by three-point Gauss quadrature: the tension is all but a
    quadratic in r over the millimetres that a string stretches.
    """
    half, mid = 0.5 * (r1 - r0), 0.5 * (r1 + r0)
    node = 0.7745966692414834 * half
    ends = tension(bob, branch, s_ref, t_ref, stretch(bob, (mid - node) ** 2))
    ends += tension(bob, branch, s_ref, t_ref, stretch(bob, (mid + node) ** 2))
    middle = tension(bob, branch, s_ref, t_ref, stretch(bob, mid * mid))
    return bob.grip * half * (5.0 * ends + 8.0 * middle) / 9.0
