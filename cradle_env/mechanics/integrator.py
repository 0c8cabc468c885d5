"""One eighth-order step of a group of bobs that move together, and the flight between two instants as a curve.

Bobs that touch nothing are groups of one; bobs in persistent contact, and all bobs of a cradle whose effects
couple them at a distance, share a group and a step.
"""

import numpy as np
from numba import int64, types

from cradle_env.mechanics.apart import GROUP, ROWS_TYPE, apart
from cradle_env.mechanics.contact import contact_forces, pair_forces
from cradle_env.mechanics.forces import pivot_at, rates, rates_on_elastic_strings
from cradle_env.mechanics.jit import jit
from cradle_env.mechanics.lanes import motion_on
from cradle_env.mechanics.layout import (
    BROUGHT,
    COLUMNS,
    CONTACT_LOSS,
    DIM,
    DRAG,
    END,
    FRAME,
    ON_SERIES,
    OUT,
    RATE0,
    RATE1,
    SERIES,
    STAGES,
    START,
    T0,
    T1,
    TENSION,
    TRIAL,
)
from cradle_env.mechanics.one_bob_step import step_one_bob
from cradle_env.mechanics.tableau import A as _A
from cradle_env.mechanics.tableau import B as _B
from cradle_env.mechanics.tableau import C as _C

# The method row by row without its zeros: weights, and the column of W where the stage that they weigh stands. The last
# row gives the result.
_STAGES = len(_C)
_ROW = np.cumsum([0, *(np.count_nonzero(row) for row in (*_A, _B))])
_WEIGHT = np.concatenate([row[row != 0.0] for row in (*_A, _B)])
_STAGE = STAGES + DIM * np.concatenate([np.flatnonzero(row) for row in (*_A, _B)])


@jit
def derivative(cradle, bobs, S, W, lo, hi, t, A, c, R, rate):
    """d/dt of the bobs lo..hi-1, with the contact forces within the group.

    Their motion stands in A from column c on; the derivative goes to R from column `rate` on.
    """
    free_derivative(cradle, bobs, S, W, lo, hi, t, A, c, R, rate)
    if hi - lo > 1:
        contact_forces(cradle, bobs, lo, hi, S, W, t, A, c, R, rate)


@jit
def free_derivative(cradle, bobs, S, W, lo, hi, t, A, c, R, rate):
    """`derivative` without the contact forces."""
    frame_x, frame_v, pull = A[0, c + FRAME], A[0, c + FRAME + 1], 0.0
    for i in range(lo, hi):
        drive = bobs[i].drive + frame_v
        ax, az, power, hold = rates(
            cradle, bobs[i], S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2], t,
            pivot_at(bobs[i], t) + frame_x, drive, A[i, c], A[i, c + 1], A[i, c + 2], A[i, c + 3],
        )  # fmt: skip
        pull += hold
        _write_rates(A, c, R, rate, i, drive, ax, az, power, hold)
    if cradle.coupled:
        pair_forces(cradle, bobs, t, A, c, R, rate)
        if cradle.frame_mass > 0.0:
            force = pull - cradle.frame_stiffness * frame_x - cradle.frame_damping * frame_v
            R[0, rate + FRAME], R[0, rate + FRAME + 1] = frame_v, force / cradle.frame_mass


@jit
def _write_rates(A, c, R, rate, i, drive, ax, az, power, hold):
    R[i, rate], R[i, rate + 1] = A[i, c + 2], A[i, c + 3]
    R[i, rate + 2], R[i, rate + 3] = ax, az
    R[i, rate + DRAG], R[i, rate + CONTACT_LOSS], R[i, rate + BROUGHT] = power, 0.0, -drive * hold


_DERIVATIVE = (types.none, *GROUP, types.float64, ROWS_TYPE, types.int64, ROWS_TYPE, types.int64)
_derivative_apart = apart(*_DERIVATIVE)(derivative.py_func)
_free_derivative_apart = apart(*_DERIVATIVE)(free_derivative.py_func)


@jit
def derivative_between_segments(cradle, bobs, S, W, lo, hi, t, A, c, R, rate):
    """`derivative`, in line for a bob that moves alone on series."""
    if hi - lo == 1:
        free_derivative_between_segments(cradle, bobs, S, W, lo, hi, t, A, c, R, rate)
    else:
        _derivative_apart(cradle, bobs, S, W, lo, hi, t, A, c, R, rate)


@jit
def free_derivative_between_segments(cradle, bobs, S, W, lo, hi, t, A, c, R, rate):
    """`free_derivative`, in line for bobs that move on series where they are alone."""
    if cradle.series == 0:
        _free_derivative_apart(cradle, bobs, S, W, lo, hi, t, A, c, R, rate)
        return
    frame_x, frame_v = A[0, c + FRAME], A[0, c + FRAME + 1]  # 0, but -0 + 0 is not -0
    for i in range(lo, hi):
        ax, az, power, hold = rates_on_elastic_strings(
            bobs[i], S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2], t,
            pivot_at(bobs[i], t) + frame_x, A[i, c], A[i, c + 1], A[i, c + 2], A[i, c + 3],
        )  # fmt: skip
        _write_rates(A, c, R, rate, i, bobs[i].drive + frame_v, ax, az, power, hold)


@jit
def step(cradle, bobs, S, W, lo, hi, h):
    """Advances the group of bobs lo..hi-1 by h [s] from the start of its segment, into W[:, OUT]."""
    if hi - lo == 1 and not cradle.coupled:
        step_one_bob(cradle, bobs, S, W, lo, h)
    else:
        _step_group(cradle, bobs, S, W, lo, hi, h)


@jit
def _step_group(cradle, bobs, S, W, lo, hi, h):
    """Stage by stage, for the contact forces couple the bobs."""
    for i in range(lo, hi):
        for c in range(DIM):
            W[i, STAGES + c] = S[i, RATE0 + c]
    for s in range(1, _STAGES):
        for i in range(lo, hi):
            x, z, vx, vz = 0.0, 0.0, 0.0, 0.0
            for k in range(_ROW[s], _ROW[s + 1]):
                weight, stage = _WEIGHT[k], _STAGE[k]
                x += weight * W[i, stage]
                z += weight * W[i, stage + 1]
                vx += weight * W[i, stage + 2]
                vz += weight * W[i, stage + 3]
            W[i, TRIAL], W[i, TRIAL + 1] = S[i, START] + h * x, S[i, START + 1] + h * z
            W[i, TRIAL + 2], W[i, TRIAL + 3] = S[i, START + 2] + h * vx, S[i, START + 3] + h * vz
        if cradle.frame_mass > 0.0:
            for column in (FRAME, FRAME + 1):
                total = 0.0
                for k in range(_ROW[s], _ROW[s + 1]):
                    total += _WEIGHT[k] * W[0, _STAGE[k] + column]
                W[0, TRIAL + column] = S[0, START + column] + h * total
        derivative(cradle, bobs, S, W, lo, hi, S[lo, T0] + _C[s] * h, W, TRIAL, W, STAGES + DIM * s)
    for i in range(lo, hi):
        for c in range(DIM):
            total = 0.0
            for k in range(_ROW[_STAGES], _ROW[_STAGES + 1]):
                total += _WEIGHT[k] * W[i, _STAGE[k] + c]
            W[i, OUT + c] = S[i, START + c] + h * total


step_apart = apart(types.none, *GROUP, types.float64)(step.py_func)


@jit
def between(S, i, t):
    """Coordinates and velocities of bob i at time t [s] of its segment: its series, or quintic Hermite.

    The latter errs by h^6 / 46080 times the sixth derivative on a segment of length h: 1e-10 rad at the default step.
    """
    if t == S[i, T0] or t == S[i, T1]:
        end = START if t == S[i, T0] else END
        return S[i, end], S[i, end + 1], S[i, end + 2], S[i, end + 3]
    if S[i, ON_SERIES] != 0.0:
        return motion_on(S, i * COLUMNS + SERIES, t - S[i, T0])
    return _hermite(S, i, t)


@apart(types.UniTuple(types.float64, 4), ROWS_TYPE, types.int64, types.float64)
def _hermite(S, i, t):
    h = S[i, T1] - S[i, T0]
    u = (t - S[i, T0]) / h
    v = 1.0 - u
    # Hermite basis of value, first and second derivative at the start; the end's by reflection.
    p0, p1 = v * v * v * (1.0 + u * (3.0 + 6.0 * u)), u * u * u * (1.0 + v * (3.0 + 6.0 * v))
    q0, q1 = h * v * v * v * u * (1.0 + 3.0 * u), -h * u * u * u * v * (1.0 + 3.0 * v)
    s0, s1 = 0.5 * h * h * v * v * v * u * u, 0.5 * h * h * u * u * u * v * v
    x, z = _blend(S, i, int64(0), p0, p1, q0, q1, s0, s1), _blend(S, i, int64(1), p0, p1, q0, q1, s0, s1)
    p1 = 30.0 * u * u * v * v / h
    q0, q1 = v * v * (1.0 + u * (2.0 - 15.0 * u)), u * u * (1.0 + v * (2.0 - 15.0 * v))
    s0, s1 = 0.5 * h * u * v * v * (2.0 - 5.0 * u), -0.5 * h * v * u * u * (2.0 - 5.0 * v)
    vx, vz = _blend(S, i, int64(0), -p1, p1, q0, q1, s0, s1), _blend(S, i, int64(1), -p1, p1, q0, q1, s0, s1)
    return x, z, vx, vz


@jit
def pivot_between(cradle, bob, S, t):
    """(x [m], dx/dt [m/s]) of a bob's pivot at time t [s], on the frame if that moves."""
    if cradle.frame_mass == 0.0 or S[0, T1] == S[0, T0]:
        return pivot_at(bob, t), bob.drive
    return pivot_at(bob, t) + cubic_between(S, int64(0), FRAME, t), bob.drive + cubic_between(S, int64(0), FRAME + 1, t)


@jit
def cubic_between(S, i, e, t):
    """What stands in column e (DRAG, CONTACT_LOSS, BROUGHT, FRAME) of bob i's block at time t [s] of its segment:
    cubic Hermite."""
    h = S[i, T1] - S[i, T0]
    u = (t - S[i, T0]) / h
    v = 1.0 - u
    values = v * v * (1.0 + 2.0 * u) * S[i, START + e] + u * u * (1.0 + 2.0 * v) * S[i, END + e]
    return values + h * u * v * (v * S[i, RATE0 + e] - u * S[i, RATE1 + e])


@jit
def _blend(S, i, c, p0, p1, q0, q1, s0, s1):
    """Coordinate c of bob i from its values, velocities and accelerations at both ends."""
    values = p0 * S[i, START + c] + p1 * S[i, END + c]
    velocities = q0 * S[i, START + 2 + c] + q1 * S[i, END + 2 + c]
    return values + velocities + s0 * S[i, RATE0 + 2 + c] + s1 * S[i, RATE1 + 2 + c]
