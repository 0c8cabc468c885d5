"""What an impact does to derivatives: of two bobs, and of a row of bobs in touch."""

import math

import numpy as np

from cradle_env.mechanics.impact import (
    CHAIN_LIMIT,
    chain_presses,
    chain_tolerance,
    following_step,
    stage_value,
    step_error,
)
from cradle_env.mechanics.jit import jit
from cradle_env.mechanics.layout import CHAIN_D, CHAIN_U, KUWABARA_KONO, N_X, N_Z, POWER_LAW, STAGES, START
from cradle_env.mechanics.restitution import dissipation, equivalent_dissipation, restitution, restitution_slope
from cradle_env.mechanics.tangent_layout import ALPHA, EXPONENT, MOBILITY, RESTITUTION, STIFFNESS

# What an error of a chain's derivatives counts for against one of the chain itself.
_VARIED_WEIGHT = 1e-2
# Columns of scratch for a chain: overlap, its rate, impulse and their derivatives, now, at a stage, and d/dtau of 7
# stages; derivatives of the normals and of the chain's equations.
LINK_STATES = 6
LINK_NOW = STAGES
LINK_TRIAL, LINK_STAGES = LINK_NOW + LINK_STATES, LINK_NOW + 2 * LINK_STATES
VARIED_N_X, VARIED_N_Z, VARIED_D, VARIED_U = LINK_STAGES + 7 * LINK_STATES + np.int64([0, 1, 2, 3])


@jit
def line_of_centres(S, p):
    """(distance, n_x, n_z, opening speed, dv_x, dv_z) of bobs p and p + 1."""
    dx, dz = S[p + 1, START] - S[p, START], S[p + 1, START + 1] - S[p, START + 1]
    vx, vz = S[p + 1, START + 2] - S[p, START + 2], S[p + 1, START + 3] - S[p, START + 3]
    distance = math.sqrt(dx * dx + dz * dz)
    nx, nz = dx / distance, dz / distance
    return distance, nx, nz, nx * vx + nz * vz, vx, vz


@jit
def vary_line_of_centres(S, p, D0, D1):
    """Derivatives of n_x, n_z and the opening speed of `line_of_centres`."""
    distance, nx, nz, _, vx, vz = line_of_centres(S, p)
    dx, dz = D1[0] - D0[0], D1[1] - D0[1]
    along = nx * dx + nz * dz
    d_nx, d_nz = (dx - along * nx) / distance, (dz - along * nz) / distance
    return d_nx, d_nz, d_nx * vx + d_nz * vz + nx * (D1[2] - D0[2]) + nz * (D1[3] - D0[3])


@jit
def push(bob, jx, jz, d_jx, d_jz, fields, D):
    """Derivatives of a bob's velocities after an impulse (jx, jz) [N s]."""
    D[2] += d_jx * bob.mobility + jx * fields[MOBILITY]
    D[3] += d_jz * bob.mobility + jz * fields[MOBILITY]


@jit
def collide(cradle, bobs, table, S, p, q, law, fields, D):
    """Derivatives by parameter q of the velocities after an impact of bobs p and p + 1 at their meeting, from those
    before."""
    _, nx, nz, v_n, _, _ = line_of_centres(S, p)
    D0, D1 = D[p, q], D[p + 1, q]
    d_nx, d_nz, d_v = vary_line_of_centres(S, p, D0, D1)
    mobility = bobs[p].mobility + bobs[p + 1].mobility
    d_mobility = (fields[p, q, MOBILITY] + fields[p + 1, q, MOBILITY]) / mobility
    e = restitution(cradle, table, 1.0 / mobility, -v_n)
    impulse = -(1.0 + e) * v_n / mobility
    d_e = restitution_by_parameter(cradle, table, 1.0 / mobility, -v_n, d_v / v_n, -d_mobility, law)
    d_impulse = -(d_e * v_n + (1.0 + e) * d_v) / mobility - impulse * d_mobility
    jx, jz = d_impulse * nx + impulse * d_nx, d_impulse * nz + impulse * d_nz
    push(bobs[p], -impulse * nx, -impulse * nz, -jx, -jz, fields[p, q], D0)
    push(bobs[p + 1], impulse * nx, impulse * nz, jx, jz, fields[p + 1, q], D1)


@jit
def collide_chain(cradle, bobs, table, S, W, lo, hi, lead, q, law, fields, D):
    """`collide` for the touching bobs lo..hi-1: the variational equations of `impact.chain`, in its units, which are
    those of the pair `lead` and stay what they are."""
    m, scale = 1.0 / (bobs[lead].mobility + bobs[lead + 1].mobility), -line_of_centres(S, lead)[3]
    for p in range(lo, hi - 1):
        _, W[p, N_X], W[p, N_Z], v_n, _, _ = line_of_centres(S, p)
        W[p, VARIED_N_X], W[p, VARIED_N_Z], d_v = vary_line_of_centres(S, p, D[p, q], D[p + 1, q])
        W[p, CHAIN_D] = (bobs[p].mobility + bobs[p + 1].mobility) * m
        W[p, VARIED_D] = (fields[p, q, MOBILITY] + fields[p + 1, q, MOBILITY]) * m
        for c in range(LINK_STATES):
            W[p, LINK_NOW + c] = 0.0
        W[p, LINK_NOW + 1], W[p, LINK_NOW + 4] = -v_n / scale, -d_v / scale
    for p in range(lo, hi - 2):
        across = W[p, N_X] * W[p + 1, N_X] + W[p, N_Z] * W[p + 1, N_Z]
        d_across = W[p, VARIED_N_X] * W[p + 1, N_X] + W[p, VARIED_N_Z] * W[p + 1, N_Z]
        d_across += W[p, N_X] * W[p + 1, VARIED_N_X] + W[p, N_Z] * W[p + 1, VARIED_N_Z]
        W[p, CHAIN_U] = -across * bobs[p + 1].mobility * m
        W[p, VARIED_U] = -(d_across * bobs[p + 1].mobility + across * fields[p + 1, q, MOBILITY]) * m

    A = equivalent_dissipation(cradle, table, m, scale)
    d_m, d_scale = -W[lead, VARIED_D], W[lead, LINK_NOW + 4]
    d_e = restitution_by_parameter(cradle, table, m, scale, d_scale, d_m, law)
    d_A = d_e / restitution_slope(table, A) + A * (0.4 * d_m - 0.2 * d_scale)
    resolve_varied(A, d_A, chain_tolerance(scale), lo, hi, W)
    for p in range(lo, hi - 1):
        nx, nz, impulse, d_impulse = (
            W[p, N_X],
            W[p, N_Z],
            W[p, LINK_NOW + 2] * m * scale,
            W[p, LINK_NOW + 5] * m * scale,
        )
        jx, jz = d_impulse * nx + impulse * W[p, VARIED_N_X], d_impulse * nz + impulse * W[p, VARIED_N_Z]
        push(bobs[p], -impulse * nx, -impulse * nz, -jx, -jz, fields[p, q], D[p, q])
        push(bobs[p + 1], impulse * nx, impulse * nz, jx, jz, fields[p + 1, q], D[p + 1, q])


@jit
def varied_rates(A, d_A, lo, hi, W, x, out):
    """d/dtau of a chain's overlaps, their rates and impulses, and of their derivatives, from columns x to `out`."""
    for p in range(lo, hi - 1):
        overlap, rate, force, d_force = W[p, x], W[p, x + 1], 0.0, 0.0
        if overlap > 0.0 and overlap + A * rate > 0.0:
            root = math.sqrt(overlap)
            force = root * (overlap + A * rate)
            d_force = (1.5 * root + 0.5 * A * rate / root) * W[p, x + 3] + root * (A * W[p, x + 4] + d_A * rate)
        W[p, out], W[p, out + 2], W[p, out + 3], W[p, out + 5] = rate, force, W[p, x + 4], d_force
    for p in range(lo, hi - 1):
        total = -W[p, CHAIN_D] * W[p, out + 2]
        d_total = -W[p, CHAIN_D] * W[p, out + 5] - W[p, VARIED_D] * W[p, out + 2]
        if p > lo:
            total -= W[p - 1, CHAIN_U] * W[p - 1, out + 2]
            d_total -= W[p - 1, CHAIN_U] * W[p - 1, out + 5] + W[p - 1, VARIED_U] * W[p - 1, out + 2]
        if p < hi - 2:
            total -= W[p, CHAIN_U] * W[p + 1, out + 2]
            d_total -= W[p, CHAIN_U] * W[p + 1, out + 5] + W[p, VARIED_U] * W[p + 1, out + 2]
        W[p, out + 1], W[p, out + 4] = total, d_total


@jit
def resolve_varied(A, d_A, tolerance, lo, hi, W):
    """Integrates a chain and its derivatives until no pair presses or approaches; control of the chain's error."""
    t, h = 0.0, 0.01
    while t < CHAIN_LIMIT and (t == 0.0 or chain_presses(A, lo, hi, W, LINK_NOW)):
        for s in range(7):
            for p in range(lo, hi - 1):
                for c in range(LINK_STATES):
                    W[p, LINK_TRIAL + c] = stage_value(W, p, LINK_NOW + c, LINK_STAGES + c, LINK_STATES, s, h)
            varied_rates(A, d_A, lo, hi, W, LINK_TRIAL, LINK_STAGES + LINK_STATES * s)
        error = 0.0
        for p in range(lo, hi - 1):
            for c in range(LINK_STATES):
                weight = 1.0 if c < 3 else _VARIED_WEIGHT
                error = max(error, step_error(W, p, LINK_STAGES + c, LINK_STATES, h) * weight)
        if error <= tolerance:
            t += h
            for p in range(lo, hi - 1):
                for c in range(LINK_STATES):
                    W[p, LINK_NOW + c] = W[p, LINK_TRIAL + c]
        h = following_step(h, tolerance, error)


@jit
def restitution_by_parameter(cradle, table, m_eff, v, d_v, d_m, law):
    """Derivative of e by a parameter; d_v and d_m: those of the logarithms of v and m_eff."""
    if cradle.law == KUWABARA_KONO:
        A = dissipation(cradle, m_eff, v)
        d_A = law[STIFFNESS] * m_eff**-0.4 * v**0.2 + A * (0.2 * d_v - 0.4 * d_m)
        return restitution_slope(table, A) * d_A
    if cradle.law == POWER_LAW:
        lost = cradle.alpha * v**cradle.exponent
        return -law[ALPHA] * v**cradle.exponent - lost * (law[EXPONENT] * math.log(v) + cradle.exponent * d_v)
    return law[RESTITUTION]
