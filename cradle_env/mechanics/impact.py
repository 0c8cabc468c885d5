"""Instantaneous impacts: of two bobs with e(v), of a touching group by the Kuwabara-Kono chain, and the plastic
end of a bounce too small to matter."""

import math

import numpy as np
from numba import types

from cradle_env.mechanics.apart import BOBS_TYPE, CRADLE_TYPE, GROUP, ROWS_TYPE, apart
from cradle_env.mechanics.contact import (
    LEAST_BOUNCE,
    TOUCHING,
    apply_chain,
    blow_speed,
    mobility,
    opening,
    pair,
    push_apart,
    set_normals,
    solve_chain,
    yielding,
)
from cradle_env.mechanics.integrator import free_derivative
from cradle_env.mechanics.jit import jit, leaf
from cradle_env.mechanics.layout import (
    ACTIVE,
    CANDIDATE,
    CHAIN,
    CHAIN_D,
    CHAIN_U,
    DISSIPATION,
    KUWABARA_KONO,
    LINK,
    LOSS,
    N_X,
    N_Z,
    OPEN,
    PRESSED,
    RATE0,
    RESOLVED,
    SOLUTION,
    START,
    T0,
    TRIAL,
    VELOCITIES,
    WANTED,
)
from cradle_env.mechanics.restitution import equivalent_dissipation, restitution

# Dormand and Prince's embedded pair of orders 5 and 4.
_A = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [1 / 5, 0, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
_E = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])

# Error per step of the chain's velocities [m/s], and the range of what that is relative to the largest.
_CHAIN_ERROR, _FINEST, _COARSEST = 1e-12, 1e-11, 1e-7
# A contact followed in time may come to rest when its bounce, at this acceleration [m/s^2], would be least.
_LEAST_PRESS = 1e-3
# A contact followed in time departs from eq. 1 as an impact at this speed [m/s] at least: pressed bobs begin at rest.
_LEAST_DEPARTURE = 1e-3
# A chain is left to itself after this many times the time scale of a pair impact, which lasts 3.2 of them.
CHAIN_LIMIT = 300.0


@jit
def two_body(cradle, bobs, table, S, W, p):
    """Impact of bobs p and p + 1 along their line of centres; changes their START, sets W[p, LOSS] [J]."""
    _, nx, nz, v_n, _ = pair(cradle, bobs, p, S[p, T0], S, START)
    if v_n >= 0.0:  # a graze, foreseen on the interpolated motion
        return
    d = yielding(cradle, bobs, p, S, START, nx, nz)
    e = restitution(cradle, table, 1.0 / d, -v_n)
    push_apart(cradle, bobs, p, S, START, S, START, VELOCITIES, nx, nz, -(1.0 + e) * v_n / d)
    W[p, LOSS] = 0.5 * v_n * v_n * (1.0 - e * e) / d


@apart(types.none, CRADLE_TYPE, BOBS_TYPE, ROWS_TYPE, ROWS_TYPE, types.int64, types.int64)
def follow(cradle, bobs, table, S, lo, hi):
    """Begins to follow in time the contacts of the bobs lo..hi-1, struck as one; those that it follows already go on.

    Eq. 1 at the k_f of the cradle; where its law departs from that, at the one k_f that gives the fastest impact its e.
    """
    k_f = cradle.contact_k_f
    if cradle.law != KUWABARA_KONO or cradle.departure_speed != 0.0:
        v, m = _LEAST_DEPARTURE, 0.0
        for p in range(lo, hi - 1):
            _, nx, nz, v_n, _ = pair(cradle, bobs, p, S[p, T0], S, START)
            if m == 0.0 or -v_n > v:
                v, m = max(-v_n, v), 1.0 / yielding(cradle, bobs, p, S, START, nx, nz)
        k_f = equivalent_dissipation(cradle, table, m, v) * cradle.contact_k_el**0.6 * m**0.4 * v**-0.2
    for p in range(lo, hi - 1):
        if S[p, LINK] != RESOLVED:
            S[p, LINK], S[p, DISSIPATION] = RESOLVED, k_f


@jit
def _chain_rates(A, lo, hi, W, x, out):
    """d/dtau of a chain's overlaps, their rates, impulses and works (eq. 1, dimensionless), from columns x to `out`."""
    for p in range(lo, hi - 1):
        overlap, rate = W[p, x], W[p, x + 1]
        force = 0.0
        if overlap > 0.0:
            force = max(0.0, math.sqrt(overlap) * (overlap + A * rate))
        W[p, out], W[p, out + 2], W[p, out + 3] = rate, force, force * rate
    for p in range(lo, hi - 1):
        total = -W[p, CHAIN_D] * W[p, out + 2]
        if p > lo:
            total -= W[p - 1, CHAIN_U] * W[p - 1, out + 2]
        if p < hi - 2:
            total -= W[p, CHAIN_U] * W[p + 1, out + 2]
        W[p, out + 1] = total


@leaf
def chain_presses(A, lo, hi, W, x):
    """Whether a pair presses or approaches; overlaps and their rates stand in W from column x on."""
    for p in range(lo, hi - 1):
        overlap, rate = W[p, x], W[p, x + 1]
        if rate > 1e-9 or (overlap > 0.0 and overlap + A * rate > 0.0):
            return True
    return False


@leaf
def chain_tolerance(scale):
    """Error per step of a chain whose speeds are in units of `scale` [m/s]."""
    return min(max(_CHAIN_ERROR / scale, _FINEST), _COARSEST)


@leaf
def stage_value(W, p, now, stages, width, s, h):
    """What stands in column `now` of pair p, at stage s of a step of length h; its rates at the stages stand from
    column `stages` on, `width` apart."""
    total = 0.0
    for j in range(s):
        total += _A[s, j] * W[p, stages + width * j]
    return W[p, now] + h * total


@leaf
def step_error(W, p, stages, width, h):
    """Error of a step of length h in what has its rates at the stages from column `stages` on, `width` apart."""
    total = 0.0
    for s in range(7):
        total += _E[s] * W[p, stages + width * s]
    return abs(h * total)


@leaf
def following_step(h, tolerance, error):
    """Length of the step after one of length h with this error."""
    return h * min(4.0, max(0.2, 0.9 * (tolerance / max(error, 1e-30)) ** 0.2))


@jit
def chain(cradle, bobs, table, S, W, lo, hi):
    """Multi-body Kuwabara-Kono impact of the touching bobs lo..hi-1, geometry frozen; changes their START.

    All contacts start at zero overlap. Sets W[p, LOSS] [J] to what each contact took (minus the work of its force).
    What parts counts for the scale of speeds too: a touch of rounding's size beside it is no blow. Returns the number
    of steps.
    """
    set_normals(cradle, bobs, lo, hi, S[lo, T0], S, START, W)
    struck, scale, m = False, 0.0, 0.0
    for p in range(lo, hi - 1):
        nx, nz = W[p, N_X], W[p, N_Z]
        W[p, CHAIN_D] = yielding(cradle, bobs, p, S, START, nx, nz)
        W[p, CHAIN_U] = 0.0
        if p > lo:
            off = -mobility(cradle, bobs, p, S, START, W[p - 1, N_X], W[p - 1, N_Z], nx, nz)
            W[p - 1, CHAIN_U] = off
        approach = 0.0 - pair(cradle, bobs, p, S[p, T0], S, START)[3]
        W[p, CHAIN], W[p, CHAIN + 1], W[p, CHAIN + 2], W[p, CHAIN + 3] = 0.0, approach, 0.0, 0.0
        struck = struck or approach > 0.0
        if abs(approach) > scale:
            scale, m = abs(approach), 1.0 / W[p, CHAIN_D]
    if not struck:
        return 0
    for p in range(lo, hi - 1):
        W[p, CHAIN_D] *= m
        W[p, CHAIN_U] *= m
        W[p, CHAIN + 1] /= scale
    steps = _resolve(equivalent_dissipation(cradle, table, m, scale), chain_tolerance(scale), lo, hi, W)
    for p in range(lo, hi - 1):
        W[p, SOLUTION] = W[p, CHAIN + 2] * m * scale
        W[p, LOSS] = W[p, CHAIN + 3] * m * scale * scale
    apply_chain(cradle, bobs, lo, hi, S, START, W, S, START, VELOCITIES)
    return steps


@jit
def _resolve(A, tolerance, lo, hi, W):
    """Integrates a chain until no pair presses or approaches, with control of the error; returns how many steps."""
    t, h, steps = 0.0, 0.01, 0
    while t < CHAIN_LIMIT and (t == 0.0 or chain_presses(A, lo, hi, W, CHAIN)):
        for s in range(7):
            for p in range(lo, hi - 1):
                for c in range(4):
                    W[p, CHAIN + 4 + c] = stage_value(W, p, CHAIN + c, CHAIN + 8 + c, 4, s, h)
            _chain_rates(A, lo, hi, W, CHAIN + 4, CHAIN + 8 + 4 * s)
        error = 0.0
        steps += 1
        for p in range(lo, hi - 1):
            for c in range(2):
                error = max(error, step_error(W, p, CHAIN + 8 + c, 4, h))
        if error <= tolerance:
            t += h
            for p in range(lo, hi - 1):
                for c in range(4):
                    W[p, CHAIN + c] = W[p, CHAIN + 4 + c]
        h = following_step(h, tolerance, error)
    return steps


@jit
def _press(cradle, bobs, S, W, lo, hi):
    """Finds which candidate contacts press when all that press are kept closed: sets ACTIVE and SOLUTION [N].

    A contact that closes joins, and can only raise the forces of the others (D has no positive off-diagonal), so
    that none ever has to leave: the one solution of the complementarity problem in at most as many rounds as pairs.
    """
    for p in range(lo, hi - 1):
        W[p, ACTIVE], W[p, SOLUTION] = 0.0, 0.0
        W[p, CANDIDATE] = min(W[p, CANDIDATE], 1.0)
    while True:
        joined = False
        for p in range(lo, hi - 1):
            if W[p, CANDIDATE] != 0.0 and W[p, ACTIVE] == 0.0:
                closing, nx, nz = W[p, WANTED], W[p, N_X], W[p, N_Z]
                if p > lo:
                    near = mobility(cradle, bobs, p, S, START, W[p - 1, N_X], W[p - 1, N_Z], nx, nz)
                    closing += near * W[p - 1, SOLUTION]
                if p < hi - 2:
                    near = mobility(cradle, bobs, p + 1, S, START, W[p + 1, N_X], W[p + 1, N_Z], nx, nz)
                    closing += near * W[p + 1, SOLUTION]
                if closing > 0.0:
                    W[p, CANDIDATE], joined = 2.0, True
        if not joined:
            return
        for p in range(lo, hi - 1):
            W[p, ACTIVE] = W[p, CANDIDATE] == 2.0
        solve_chain(cradle, bobs, lo, hi, S, START, W)


@jit
def settle(cradle, bobs, S, W, lo, hi):
    """Makes persistent those contacts of the bobs lo..hi-1 which press and no longer bounce; changes START, LINK.

    RATE0 holds the accelerations without the forces of persistent contacts, but with those of contacts that are
    followed in time, which stay so. A contact persists if, with all that persist, its force is positive and its
    bounce would stay below LEAST_BOUNCE; its opening speed goes to zero, and what that takes [J] is added to
    W[p, LOSS]. Returns the number of new persistent contacts.
    """
    for p in range(lo, hi - 1):
        gap, nx, nz, v_n, spread = pair(cradle, bobs, p, S[p, T0], S, START)
        W[p, N_X], W[p, N_Z] = nx, nz
        W[p, WANTED] = -opening(cradle, bobs, p, S, START, S, RATE0, nx, nz, spread)
        W[p, CANDIDATE] = S[p, LINK] != RESOLVED and (gap <= TOUCHING or S[p, LINK] == PRESSED)
    while True:
        _press(cradle, bobs, S, W, lo, hi)
        dropped = False
        for p in range(lo, hi - 1):
            if W[p, ACTIVE] != 0.0:
                v_n = pair(cradle, bobs, p, S[p, T0], S, START)[3]
                press = W[p, SOLUTION] * yielding(cradle, bobs, p, S, START, W[p, N_X], W[p, N_Z])
                if v_n * v_n > 2.0 * LEAST_BOUNCE * press:
                    W[p, CANDIDATE], dropped = 0.0, True
        if not dropped:
            break
    made, pressed = 0, False
    for p in range(lo, hi - 1):
        pressed = pressed or W[p, ACTIVE] != 0.0
        made += W[p, ACTIVE] != 0.0 and S[p, LINK] != PRESSED
        if S[p, LINK] != RESOLVED:
            S[p, LINK] = PRESSED if W[p, ACTIVE] != 0.0 else OPEN
        W[p, WANTED] = -pair(cradle, bobs, p, S[p, T0], S, START)[3]
    if pressed:
        solve_chain(cradle, bobs, lo, hi, S, START, W)
        for p in range(lo, hi - 1):
            if W[p, ACTIVE] != 0.0:
                W[p, LOSS] += 0.5 * W[p, SOLUTION] * W[p, WANTED]
        apply_chain(cradle, bobs, lo, hi, S, START, W, S, START, VELOCITIES)
    return made


@apart(types.boolean, *GROUP)
def settle_resolved(cradle, bobs, S, W, lo, hi):
    """Makes persistent the contacts, followed in time, of a group that has all but come to rest.

    START must stand at the end of a step. Returns whether anything changed; RATE0 is then without contact forces.
    """
    resolved = False
    for p in range(lo, hi - 1):
        W[p, TRIAL] = S[p, LINK]
        if S[p, LINK] == RESOLVED:
            resolved = True
            gap, _, _, v_n, _ = pair(cradle, bobs, p, S[p, T0], S, START)
            if blow_speed(cradle, bobs, p, gap, v_n) ** 2 > 2.0 * LEAST_BOUNCE * _LEAST_PRESS:
                return False
    if not resolved:
        return False
    for p in range(lo, hi - 1):
        if S[p, LINK] == RESOLVED:
            S[p, LINK] = OPEN
    free_derivative(cradle, bobs, S, W, lo, hi, S[lo, T0], S, START, S, RATE0)
    settle(cradle, bobs, S, W, lo, hi)
    for p in range(lo, hi - 1):
        if S[p, LINK] == OPEN and W[p, TRIAL] != OPEN:
            S[p, LINK] = RESOLVED
    return True
