"""The state at rest from which a run begins."""

import math

import numpy as np

from cradle_env.mechanics.contact import CONTACT, pair, set_normals, solve_chain
from cradle_env.mechanics.forces import user_force
from cradle_env.mechanics.jit import entry, jit
from cradle_env.mechanics.layout import (
    ACTIVE,
    DIM,
    FORCE,
    LINK,
    LOADING,
    MEETING,
    OPEN,
    PRESSED,
    SLACK,
    SOLUTION,
    START,
    T0,
    UNLOADING,
    WANTED,
    WORK,
    WORKED,
)
from cradle_env.mechanics.strings import stretch, take_branch, work_between

_FIRST = np.int64(0)
# Contact forces at rest are found so often anew, and count as found where no gap is left beyond this [m].
_ROUNDS, _AT_REST = 200, 1e-9
# A bob hangs where a force from outside, which depends on where it is, moves it by no more than this [m or rad]; and
# the time at which it is asked for there [s]: before the run, where what shakes is still.
_STILL, _BEFORE = 1e-14, -1.0
# So often a release angle is raised; what is left falls at least by 1 - cos(angle) each time.
_RAISES = 100
# Radii by which neighbours may be said to overlap, as angles that are measured do, and are spread.
SPREAD = 0.25


@jit
def hanging_radius(cradle, bob, load):
    """Radius [m] at which the strings, on the virgin loading line, carry a load [N]."""
    if not cradle.elastic:
        return bob.length
    a2 = bob.half_spacing * bob.half_spacing
    string = bob.string + load / (bob.grip * bob.kappa)
    return math.sqrt(string * string - a2)


@jit
def put(cradle, bob, S, i, theta, r):
    """Writes the start at rest of bob i at angle theta [rad] and radius r [m], its strings on the virgin line."""
    take_branch(bob, S, i, LOADING, 0.0, 0.0)
    for c in range(DIM):
        S[i, START + c] = 0.0
    if cradle.elastic:
        S[i, START], S[i, START + 1] = bob.pivot + r * math.sin(theta), -r * math.cos(theta)
        S[i, WORK] = work_between(bob, S[i, T0], 0.0, bob.kappa, 0.0, bob.length, max(r, bob.length))
        S[i, WORKED] = r
    else:
        S[i, START] = theta


@jit
def place_of(cradle, bob, S, i):
    """(theta [rad], r [m]) of bob i where it is put."""
    if not cradle.elastic:
        return S[i, START], bob.length
    x, z = S[i, START] - bob.pivot, S[i, START + 1]
    return math.atan2(x, -z), math.sqrt(x * x + z * z)


@jit
def from_outside(cradle, bob, theta, r):
    """(x, z) [N] of the force from outside on a bob at rest."""
    f_r, f_t = user_force(cradle, bob, _BEFORE, r, theta, 0.0, 0.0)
    if not cradle.large_angle:
        return f_t, -f_r
    sin, cos = math.sin(theta), math.cos(theta)
    return f_r * sin + f_t * cos, f_t * sin - f_r * cos


@jit
def hang(cradle, bob, S, i, fx, fz):
    """Puts bob i into its equilibrium under a contact force (fx, fz) [N], its strings along the load; where a force
    from outside depends on its place, half the way there, which ends in any stable one. Returns how far that moves
    it [rad and m, the larger], 0 without such a force."""
    weight, forced = bob.mass * cradle.gravity, cradle.user_force != 0
    theta0, r0 = place_of(cradle, bob, S, i)
    if forced:
        more_x, more_z = from_outside(cradle, bob, theta0, r0)
        fx += more_x
        fz += more_z
    theta, r = fx / weight, bob.length
    if cradle.large_angle:
        theta = math.atan2(fx, weight - fz)
        r = hanging_radius(cradle, bob, math.sqrt(fx * fx + (fz - weight) ** 2))
    if not forced:
        put(cradle, bob, S, i, theta, r)
        return 0.0
    put(cradle, bob, S, i, 0.5 * (theta0 + theta), 0.5 * (r0 + r))
    return max(abs(theta - theta0), abs(r - r0))


@entry
def at_rest(cradle, bobs, angles, hanging, S, W):
    """`put_at_rest`, for Python."""
    return put_at_rest(cradle, bobs, angles, hanging, S, W)


@entry
def lift(cradle, bobs, lifted, angle, hanging, S, W, angles):
    """`put_lifted`, for Python."""
    return put_lifted(cradle, bobs, lifted, angle, hanging, S, W, angles)


@jit
def put_at_rest(cradle, bobs, angles, hanging, S, W):
    """Fills S, at T0, with bobs at rest: lifted to angles (N,) [rad], the others (nan) in their common equilibrium.

    A lifted bob starts at r0, its strings unstretched, or, with `hanging`, at the length at which its weight alone
    hangs. Forces from outside on single bobs belong to the equilibrium, as they are before the run; those between
    bobs and the yielding of a frame do not. Lifted neighbours that would overlap a little are spread until they touch.
    Returns the largest remaining overlap [m]; inf where no equilibrium was found that keeps the bobs in their order, as
    in long rows under high pressure.
    """
    n, moved = len(bobs), 0.0
    for i in range(n):
        S[i, LINK], S[i, MEETING], W[i, FORCE] = OPEN, math.inf, 0.0
    for i in range(n):
        r = hanging_radius(cradle, bobs[i], bobs[i].mass * cradle.gravity)
        if math.isnan(angles[i]):
            put(cradle, bobs[i], S, i, 0.0, r)
            shift = 0.0
            for _ in range(_ROUNDS):
                shift = hang(cradle, bobs[i], S, i, 0.0, 0.0)
                if shift < _STILL:
                    break
            moved = max(moved, shift)
        else:
            put(cradle, bobs[i], S, i, angles[i], r if hanging else bobs[i].length)

    # Contact forces between bobs that hang: a bob yields to a horizontal force as 1 / (m g / r), which is r / g
    # times its mobility; the true compliance differs by the square of the lean, so this converges linearly.
    worst = 0.0
    for _ in range(_ROUNDS):
        worst = 0.0
        for p in range(n - 1):
            gap = pair(cradle, bobs, p, S[p, T0], S, START)[0]
            hangs = math.isnan(angles[p]) and math.isnan(angles[p + 1])
            W[p, ACTIVE] = hangs and (gap < 0.0 or W[p, FORCE] > 0.0)
            W[p, WANTED] = -gap * cradle.gravity / bobs[p].length
            if W[p, ACTIVE] != 0.0:
                worst = max(worst, abs(gap))
        if worst < 1e-16 and moved < _STILL:
            break
        set_normals(cradle, bobs, _FIRST, n, S[0, T0], S, START, W)
        solve_chain(cradle, bobs, _FIRST, n, S, START, W)
        for p in range(n - 1):
            W[p, FORCE] = max(0.0, W[p, FORCE] + W[p, SOLUTION])
        nx0, nz0 = 0.0, 0.0
        before, moved = 0.0, 0.0
        for i in range(n):
            nx, nz, after = 0.0, 0.0, 0.0
            if i < n - 1 and W[i, FORCE] > 0.0:
                _, nx, nz, _, _ = pair(cradle, bobs, i, S[i, T0], S, START)
                after = W[i, FORCE]
            if math.isnan(angles[i]):
                shift = hang(cradle, bobs[i], S, i, before * nx0 - after * nx, before * nz0 - after * nz)
                moved = max(moved, shift)
            nx0, nz0, before = nx, nz, after
    for p in range(n - 1):
        if W[p, FORCE] > 0.0:
            S[p, LINK] = PRESSED
            if pair(cradle, bobs, p, S[p, T0], S, START)[1] < 0.0:
                worst = math.inf
    if not max(worst, moved) < _AT_REST:
        return math.inf

    for i in range(n):
        W[i, ACTIVE] = not math.isnan(angles[i])
    return spread(cradle, bobs, S, W)


@jit
def put_lifted(cradle, bobs, lifted, angle, hanging, S, W, angles):
    """`put_at_rest` with the last `lifted` bobs at an angle [rad], raised until they clear those that hang.

    angles (N,) is scratch. Returns the angle, 0 where none is lifted, nan where there is no such rest.
    """
    n = len(bobs)
    first = n - lifted
    for _ in range(_RAISES):
        for i in range(n):
            angles[i] = angle if i >= first else math.nan
        if put_at_rest(cradle, bobs, angles, hanging, S, W) == math.inf:
            return math.nan
        if lifted == 0:
            return 0.0
        if lifted == n:
            return angle
        short = overlap_of(cradle, bobs, S, first - 1)
        if short <= CONTACT:
            return angle
        angle += short / bobs[first].length
    return math.nan


@entry
def moving(cradle, bobs, theta, theta_dot, r, r_dot, tension_ratio, S, W):
    """Fills S, at T0, with any motion: arrays (N,), rad, m and per second; r = nan is the hanging length.

    tension_ratio: tension over that of the virgin loading line at the same stretch. Bobs that would overlap a
    little are spread until they touch. Returns the largest remaining overlap [m].
    """
    for i in range(len(bobs)):
        S[i, MEETING], W[i, ACTIVE] = math.inf, 1.0
        radius = hanging_radius(cradle, bobs[i], bobs[i].mass * cradle.gravity) if math.isnan(r[i]) else r[i]
        put(cradle, bobs[i], S, i, theta[i], radius)
        if cradle.elastic:
            sin, cos, v = math.sin(theta[i]), math.cos(theta[i]), radius * theta_dot[i]
            S[i, START + 2] = r_dot[i] * sin + v * cos
            S[i, START + 3] = v * sin - r_dot[i] * cos
            s = stretch(bobs[i], S[i, T0], radius * radius)
            if s < 0.0 or (s == 0.0 and r_dot[i] < 0.0):
                take_branch(bobs[i], S, i, SLACK, s, 0.0)
            elif cradle.hysteretic:
                branch = LOADING if r_dot[i] >= 0.0 else UNLOADING
                take_branch(bobs[i], S, i, branch, s, tension_ratio[i] * bobs[i].kappa * s)
        else:
            S[i, START + 2] = theta_dot[i]
    return spread(cradle, bobs, S, W)


@jit
def spread(cradle, bobs, S, W):
    """Turns neighbours that overlap a little, both with W[i, ACTIVE], away from each other until they touch.

    Returns the largest overlap that remains [m]. A little: beyond what the spacer leaves too little room, SPREAD radii.
    """
    for p in range(len(bobs) - 1):
        lack = 2.0 * cradle.radius - (bobs[p + 1].pivot - bobs[p].pivot)
        if overlap_of(cradle, bobs, S, p) > max(lack, 0.0) + SPREAD * cradle.radius:
            return overlap_of(cradle, bobs, S, p)
    for _ in range(10000):
        worst = 0.0
        for p in range(len(bobs) - 1):
            gap = pair(cradle, bobs, p, S[p, T0], S, START)[0]
            if gap < -1e-15 and W[p, ACTIVE] != 0.0 and W[p + 1, ACTIVE] != 0.0:
                worst = max(worst, -gap)
                rotate(cradle, bobs, S, p, 0.5 * gap / bobs[p].length)
                rotate(cradle, bobs, S, p + 1, -0.5 * gap / bobs[p + 1].length)
        if worst == 0.0:
            break
    overlap = 0.0
    for p in range(len(bobs) - 1):
        overlap = max(overlap, overlap_of(cradle, bobs, S, p))
    return overlap


@jit
def overlap_of(cradle, bobs, S, p):
    """By how much bobs p and p + 1 overlap at the start [m], more than a diameter where they have changed places."""
    gap, nx, _, _, _ = pair(cradle, bobs, p, S[p, T0], S, START)
    return 2.0 * cradle.radius - math.copysign(gap + 2.0 * cradle.radius, nx)


@jit
def rotate(cradle, bobs, S, i, angle):
    """Turns the start of bob i about its pivot by an angle [rad]."""
    if not cradle.elastic:
        S[i, START] += angle
        return
    cos, sin, pivot = math.cos(angle), math.sin(angle), bobs[i].pivot
    x, z, vx, vz = S[i, START] - pivot, S[i, START + 1], S[i, START + 2], S[i, START + 3]
    S[i, START], S[i, START + 1] = pivot + cos * x - sin * z, sin * x + cos * z
    S[i, START + 2], S[i, START + 3] = cos * vx - sin * vz, sin * vx + cos * vz
