"""Instantaneous impacts: of two bobs with e(v), of a touching group by the Kuwabara-Kono chain, and the plastic
end of a bounce too small to matter."""

import math

import numpy as np

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
from cradle_env.mechanics.jit import jit
from cradle_env.mechanics.motion import derivative
from cradle_env.mechanics.parameters import (
    ACTIVE,
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

#: Error per step of the chain's velocities, relative to the speed of the blow.
_CHAIN_TOLERANCE = 1e-8
# A contact followed in time may come to rest when its bounce, at this acceleration [m/s^2], would be least.
_LEAST_PRESS = 1e-3
# A chain is left to itself after this many times the time scale of a pair impact, which lasts 3.2 of them.
_CHAIN_LIMIT = 300.0


@jit
def two_body(cradle, bobs, table, S, W, p):
    """Impact of bobs p and p + 1 along their line of centres; changes their START, sets W[p, LOSS] [J]."""
    _, nx, nz, v_n, _ = pair(cradle, bobs, p, S, START)
    if v_n >= 0.0:  # a graze, foreseen on the interpolated motion
        return
    d = yielding(cradle, bobs, p, S, START, nx, nz)
    e = restitution(cradle, table, 1.0 / d, -v_n)
    push_apart(cradle, bobs, p, S, START, S, START + 2, nx, nz, -(1.0 + e) * v_n / d)
    W[p, LOSS] = 0.5 * v_n * v_n * (1.0 - e * e) / d


@jit
def _chain_rates(A, diagonal, upper, x, n, out):
    """d/dt of overlaps x[:n], their rates x[n:2n], impulses x[2n:3n] and works x[3n:4n], dimensionless (eq. 1)."""
    for p in range(n):
        force = 0.0
        if x[p] > 0.0:
            root = math.sqrt(x[p])
            force = max(0.0, root * (x[p] + A * x[n + p]))
        out[p] = x[n + p]
        out[2 * n + p] = force
        out[3 * n + p] = force * x[n + p]
    for p in range(n):
        total = -diagonal[p] * out[2 * n + p]
        if p > 0:
            total -= upper[p - 1] * out[2 * n + p - 1]
        if p < n - 1:
            total -= upper[p] * out[2 * n + p + 1]
        out[n + p] = total


@jit
def _chain_is_over(A, x, n):
    """No pair presses, and none approaches."""
    for p in range(n):
        if x[n + p] > 1e-9 or (x[p] > 0.0 and x[p] + A * x[n + p] > 0.0):
            return False
    return True


@jit
def chain(cradle, bobs, table, S, W, lo, hi):
    """Multi-body Kuwabara-Kono impact of the touching bobs lo..hi-1, geometry frozen; changes their START.

    All contacts start at zero overlap. Sets W[p, LOSS] [J] to what each contact took (minus the work of its force).
    """
    n = hi - lo - 1
    diagonal, upper, x = np.empty(n), np.zeros(n), np.zeros(4 * n)
    nx0, nz0, blow, struck = 0.0, 0.0, 0.0, 0
    for p in range(n):
        _, nx, nz, v_n, _ = pair(cradle, bobs, lo + p, S, START)
        diagonal[p] = yielding(cradle, bobs, lo + p, S, START, nx, nz)
        if p > 0:
            upper[p - 1] = -mobility(cradle, bobs, lo + p, S, START, nx0, nz0, nx, nz)
        nx0, nz0 = nx, nz
        x[n + p] = -v_n
        if -v_n > blow:
            blow, struck = -v_n, p
    if blow == 0.0:
        return
    m = 1.0 / diagonal[struck]
    A = equivalent_dissipation(cradle, table, m, blow)
    for p in range(n):
        diagonal[p] *= m
        upper[p] *= m
        x[n + p] /= blow
    _resolve(A, diagonal, upper, x, n)
    set_normals(cradle, bobs, lo, hi, S, START, W)
    for p in range(n):
        W[lo + p, SOLUTION] = x[2 * n + p] * m * blow
        W[lo + p, LOSS] = x[3 * n + p] * m * blow * blow
    apply_chain(cradle, bobs, lo, hi, S, START, W, S, START + 2)


@jit
def _resolve(A, diagonal, upper, x, n):
    """Integrates a chain's overlaps, their rates, impulses and works x (4n,) until no pair presses or approaches."""
    K, trial = np.empty((7, 4 * n)), np.empty(4 * n)
    t, h = 0.0, 0.01
    while t < _CHAIN_LIMIT and not (t > 0.0 and _chain_is_over(A, x, n)):
        for s in range(7):
            trial[:] = x
            for j in range(s):
                weight = h * _A[s, j]
                if weight != 0.0:
                    for c in range(4 * n):
                        trial[c] += weight * K[j, c]
            _chain_rates(A, diagonal, upper, trial, n, K[s])
        error = 0.0
        for c in range(2 * n):
            e = 0.0
            for s in range(7):
                e += _E[s] * K[s, c]
            error = max(error, abs(h * e))
        if error <= _CHAIN_TOLERANCE:
            t += h
            x[:] = trial
        h *= min(4.0, max(0.2, 0.9 * (_CHAIN_TOLERANCE / max(error, 1e-30)) ** 0.2))


@jit
def settle(cradle, bobs, S, W, lo, hi):
    """Makes persistent those contacts of the bobs lo..hi-1 which press and no longer bounce; changes START, LINK.

    RATE0 holds the accelerations without contact forces. A contact persists if, with all that persist, its force
    is positive and its bounce would stay below LEAST_BOUNCE; its opening speed goes to zero, and what that takes
    [J] is added to W[p, LOSS]. Returns the number of new persistent contacts.
    """
    candidates = 0
    for p in range(lo, hi - 1):
        gap, nx, nz, v_n, spread = pair(cradle, bobs, p, S, START)
        W[p, N_X], W[p, N_Z] = nx, nz
        W[p, WANTED] = -opening(cradle, bobs, p, S, START, S, RATE0, nx, nz, spread)
        small = v_n * v_n <= 2.0 * LEAST_BOUNCE * abs(W[p, WANTED])
        W[p, ACTIVE] = (gap <= TOUCHING and small) or S[p, LINK] == PRESSED
        candidates += W[p, ACTIVE] != 0.0
    while candidates > 0:
        solve_chain(cradle, bobs, lo, hi, S, START, W)
        dropped = 0
        for p in range(lo, hi - 1):
            if W[p, ACTIVE] != 0.0:
                _, nx, nz, v_n, _ = pair(cradle, bobs, p, S, START)
                press = W[p, SOLUTION] * yielding(cradle, bobs, p, S, START, nx, nz)
                if press <= 0.0 or v_n * v_n > 2.0 * LEAST_BOUNCE * press:
                    W[p, ACTIVE] = 0.0
                    dropped += 1
        candidates -= dropped
        if dropped == 0:
            break
    made = 0
    for p in range(lo, hi - 1):
        made += W[p, ACTIVE] != 0.0 and S[p, LINK] != PRESSED
        S[p, LINK] = PRESSED if W[p, ACTIVE] != 0.0 else OPEN
        W[p, WANTED] = -pair(cradle, bobs, p, S, START)[3]
    if candidates > 0:
        solve_chain(cradle, bobs, lo, hi, S, START, W)
        for p in range(lo, hi - 1):
            if W[p, ACTIVE] != 0.0:
                W[p, LOSS] += 0.5 * W[p, SOLUTION] * W[p, WANTED]
        apply_chain(cradle, bobs, lo, hi, S, START, W, S, START + 2)
    return made


@jit
def settle_resolved(cradle, bobs, S, W, lo, hi):
    """Makes persistent the contacts, followed in time, of a group that has all but come to rest.

    START must stand at the end of a step. Returns whether anything changed; RATE0 is then without contact forces.
    """
    for p in range(lo, hi - 1):
        if S[p, LINK] == RESOLVED:
            gap, _, _, v_n, _ = pair(cradle, bobs, p, S, START)
            if blow_speed(cradle, bobs, p, gap, v_n) ** 2 > 2.0 * LEAST_BOUNCE * _LEAST_PRESS:
                return False
    for i in range(lo, hi):
        derivative(cradle, bobs, S, W, i, i + 1, S[i, T0], S, START, S, RATE0)
    settle(cradle, bobs, S, W, lo, hi)
    for p in range(lo, hi - 1):
        if S[p, LINK] == OPEN:
            S[p, LINK] = RESOLVED
    return True
