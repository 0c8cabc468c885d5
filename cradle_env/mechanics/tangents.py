"""Exact derivatives of a run by parameters: a second flight over the impacts of a run that is over.

Between two impacts a bob flies alone, so each flight begins anew from the state in which the run left the impact
before: it searches for no meetings and drifts from the run nowhere. The series of a segment on dual numbers gives its
derivatives by state and forces; the chain rule, those by every parameter.

At an event at t_e, found where g = 0, the state x changes by a map, x+ = m(x-). With D the derivatives of the state at
fixed time and f its rates,

    dt_e = -dg / g',    D+ = dm(D- + f- dt_e) - f+ dt_e.

Where a string turns, goes slack or comes taut, the motion and its rates have no jump, so that only the memory of the
string changes; and dt_e plays no part, for there either the stretch stands still or the tension is zero.

References: Hiskens and Pai, IEEE Trans. Circuits Syst. I 47, 204 (2000); Müller, Chaos Solitons Fractals 5, 1671
(1995).
"""

import math

import numpy as np

from cradle_env.mechanics.jit import entry, jit
from cradle_env.mechanics.layout import (
    BRANCH,
    GRID,
    LANES,
    LEFT,
    LEFT_LINK,
    LEFT_WIDTH,
    LOADING,
    OPEN,
    SAMPLED,
    SLACK,
    START,
    STRUCK_FIRST,
    STRUCK_LAST,
    T0,
    TENSION,
)
from cradle_env.mechanics.series_flight import PRESENT, length_and_cause, load
from cradle_env.mechanics.string_events import direction_after, turned
from cradle_env.mechanics.strings import tension
from cradle_env.mechanics.tangent_impacts import collide, collide_chain, line_of_centres
from cradle_env.mechanics.tangent_lanes import (
    AT,
    AT_U,
    AT_W,
    AT_X,
    AT_Z,
    by_parameter,
    evaluate,
    evaluate_places,
    expand_tangents,
)
from cradle_env.mechanics.tangent_layout import DAMPING, FALL, KAPPA, MEMORY, PIVOT, PULL, RADIUS, SPACING2, STRING

# An impact gentler than this [m/s] is a graze: its instant has no derivative.
_GRAZE = 1e-6
# Bobs struck as one are struck at one instant for other values of a parameter too if their gaps change by less than
# this part of what the places of the bobs change by.
_TOGETHER = 1e-6
_LANE = np.int64(0)


@entry
def differentiate(cradle, bobs, table, S, W, sheet, inputs, impacts, times, until, law, fields, D, theta, r, instants):
    """Derivatives by P parameters of a run that began with the state S and had these impacts (M, LOGGED).

    law (P, LAW_FIELDS), fields (N, P, BOB_FIELDS) and D (N, P, STATES): derivatives of the cradle's record, the bobs'
    and the start, nan where they do not exist. S and D are lost; W, sheet (SHEET,), inputs (P, INPUTS): scratch. Fills
    theta and r (P, T, N) and instants (P, M).
    """
    row = 0
    while row < len(impacts):
        lo, hi, t = int(impacts[row, STRUCK_FIRST]), int(impacts[row, STRUCK_LAST]), impacts[row, 0]
        for i in range(lo, hi):
            fly(cradle, bobs[i], S, W, sheet, inputs, i, t, np.False_, times, fields[i], D[i], theta, r)
        strike(cradle, bobs, table, S, W, impacts, row, lo, hi, law, fields, D, instants)
        row += hi - lo - 1
    for i in range(len(bobs)):
        fly(cradle, bobs[i], S, W, sheet, inputs, i, until, np.True_, times, fields[i], D[i], theta, r)


@jit
def fly(cradle, bob, S, W, sheet, inputs, i, until, inclusive, times, fields, D, theta, r):
    """Flies bob i alone to `until` [s] and takes the samples due before."""
    k = int(S[i, SAMPLED])
    while S[i, T0] < until:
        load(cradle, bob, S, W, _LANE, i, PRESENT)
        expand_tangents(W, LANES, sheet)
        vary_inputs(bob, S, i, fields, D, inputs)
        start = S[i, T0]
        h, cause = length_and_cause(cradle, bob, S[i, BRANCH], W[0, LANES:])
        end = start + h
        if end >= until:
            end, cause = until, GRID
        while k < len(times) and (times[k] < end or (inclusive and times[k] == until == end)):
            evaluate_places(sheet, times[k] - start)
            sample(sheet, inputs, i, k, theta, r)
            k += 1
        evaluate(sheet, end - start)
        arrive(bob, S, i, end, sheet, inputs, fields, D)
        if cause != GRID:
            turn_string(cradle, bob, S, i, direction_after(S[i, BRANCH], cause), fields, D)
    while inclusive and k < len(times):
        for q in range(len(D)):  # of an instant that is the last event's too
            theta[q, k, i], r[q, k, i] = math.nan, math.nan
        k += 1
    S[i, SAMPLED] = k


@jit
def vary_inputs(bob, S, i, fields, D, inputs):
    """Derivatives of the inputs of `tangent_lanes` by the parameters, for the segment that begins at START."""
    pull = bob.grip * bob.mobility
    for q in range(len(D)):
        inputs[q, 0], inputs[q, 1] = D[q, 0] - fields[q, PIVOT], D[q, 1]
        inputs[q, 2], inputs[q, 3] = D[q, 2], D[q, 3]
        for k in range(3):
            inputs[q, 4 + k] = fields[q, PULL] * S[i, TENSION + k] + pull * D[q, MEMORY + k]
        inputs[q, 7], inputs[q, 8], inputs[q, 9] = fields[q, DAMPING], fields[q, SPACING2], fields[q, STRING]
        inputs[q, 10], inputs[q, 11] = fields[q, FALL], 0.0


@jit
def sample(sheet, inputs, i, k, theta, r):
    """Takes sample k of bob i where the sheet stands."""
    x, z = sheet[AT], sheet[AT + 1]
    r2 = x * x + z * z
    for q in range(len(inputs)):
        dx, dz = by_parameter(sheet, AT_X, inputs, q), by_parameter(sheet, AT_Z, inputs, q)
        theta[q, k, i], r[q, k, i] = (x * dz - z * dx) / r2, (x * dx + z * dz) / math.sqrt(r2)


@jit
def arrive(bob, S, i, t, sheet, inputs, fields, D):
    """Makes the motion where the sheet stands bob i's new start at t [s], with its derivatives."""
    S[i, T0] = t
    S[i, START], S[i, START + 1] = sheet[AT] + bob.pivot, sheet[AT + 1]
    S[i, START + 2], S[i, START + 3] = sheet[AT + 2], sheet[AT + 3]
    for q in range(len(D)):
        D[q, 0] = by_parameter(sheet, AT_X, inputs, q) + fields[q, PIVOT]
        D[q, 1] = by_parameter(sheet, AT_Z, inputs, q)
        D[q, 2], D[q, 3] = by_parameter(sheet, AT_U, inputs, q), by_parameter(sheet, AT_W, inputs, q)


@jit
def turn_string(cradle, bob, S, i, direction, fields, D):
    """Switches the branch of bob i's strings for a stretch that goes in `direction`."""
    branch, t0, t1, t2 = turned(
        cradle, bob, S[i, BRANCH], S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2], S[i, T0], S, i, START, direction
    )
    for q in range(len(D)):
        vary_memory(bob, S, i, branch, fields[q], D[q])
    S[i, BRANCH], S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2] = branch, t0, t1, t2


@jit
def vary_memory(bob, S, i, branch, fields, D):
    """Derivatives of the tension's coefficients on the branch that follows, from those of the place D[0], D[1] where it
    begins."""
    before = S[i, BRANCH]
    if branch == before:
        return
    if branch == SLACK or before == SLACK:
        D[MEMORY], D[MEMORY + 1], D[MEMORY + 2] = 0.0, fields[KAPPA] if branch == LOADING else 0.0, 0.0
        return
    x, z = S[i, START] - bob.pivot, S[i, START + 1]
    t0, t1, t2 = S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2]
    along = math.sqrt(x * x + z * z + bob.half_spacing * bob.half_spacing)
    s = along - bob.string
    ds = (x * (D[0] - fields[PIVOT]) + z * D[1] + 0.5 * fields[SPACING2]) / along - fields[STRING]
    pull = tension(t0, t1, t2, s)
    d_pull = D[MEMORY] + s * (D[MEMORY + 1] + s * D[MEMORY + 2]) + (t1 + 2.0 * t2 * s) * ds
    if branch == LOADING:
        D[MEMORY], D[MEMORY + 1], D[MEMORY + 2] = d_pull - fields[KAPPA] * s - bob.kappa * ds, fields[KAPPA], 0.0
    else:
        D[MEMORY], D[MEMORY + 1], D[MEMORY + 2] = 0.0, 0.0, (d_pull - 2.0 * pull * ds / s) / (s * s)


@jit
def strike(cradle, bobs, table, S, W, impacts, row, lo, hi, law, fields, D, instants):
    """The impact of the bobs lo..hi-1 in the rows of impacts from `row` on: derivatives of its instant and of what
    follows. S goes on as the run did."""
    lead, closing = lo, 0.0  # the pair that meets fastest sets the instant
    for p in range(lo, hi - 1):
        v_n = line_of_centres(S, p)[3]
        if v_n < closing:
            lead, closing = p, v_n
    for q in range(len(law)):
        dt = instant(S, lead, law[q], D[lead, q], D[lead + 1, q])
        if closing > -_GRAZE or not all_at(S, lo, hi, dt, q, law, D):
            dt = math.nan
        for p in range(lo, hi - 1):
            instants[q, row + p - lo] = dt
            if impacts[row + p - lo, LEFT_LINK] != OPEN:
                dt = math.nan
        for i in range(lo, hi):
            shift(bobs[i], S, i, dt, D[i, q])
        if hi - lo == 2:
            collide(cradle, bobs, table, S, lo, q, law[q], fields, D)
        elif not math.isnan(dt):
            collide_chain(cradle, bobs, table, S, W, lo, hi, lead, q, law[q], fields, D)
    for i in range(lo, hi):
        c = LEFT if i < hi - 1 else LEFT + LEFT_WIDTH
        here = row + min(i, hi - 2) - lo
        for q in range(len(law)):
            vary_memory(bobs[i], S, i, impacts[here, c + 4], fields[i, q], D[i, q])
        for k in range(4):
            S[i, START + k], S[i, BRANCH + k] = impacts[here, c + k], impacts[here, c + 4 + k]
        for q in range(len(law)):
            shift(bobs[i], S, i, -instants[q, row], D[i, q])


@jit
def gap_slope(S, p, law, D0, D1):
    """Derivative of the gap of pair p at fixed time."""
    _, nx, nz, _, _, _ = line_of_centres(S, p)
    return nx * (D1[0] - D0[0]) + nz * (D1[1] - D0[1]) - 2.0 * law[RADIUS]


@jit
def instant(S, p, law, D0, D1):
    """Derivative of the instant at which pair p meets."""
    return -gap_slope(S, p, law, D0, D1) / line_of_centres(S, p)[3]


@jit
def all_at(S, lo, hi, dt, q, law, D):
    """Whether all pairs of the bobs lo..hi-1 still meet at one instant, which moves by dt, as parameter q varies."""
    for p in range(lo, hi - 1):
        scale = abs(D[p, q, 0]) + abs(D[p + 1, q, 0]) + abs(D[p, q, 1]) + abs(D[p + 1, q, 1]) + abs(law[q, RADIUS])
        apart = gap_slope(S, p, law[q], D[p, q], D[p + 1, q]) + line_of_centres(S, p)[3] * dt
        if abs(apart) > _TOGETHER * scale:
            return False
    return True


@jit
def shift(bob, S, i, dt, D):
    """Derivatives of bob i's motion at an instant that moves by dt, from those at fixed time."""
    x, z, vx, vz = S[i, START] - bob.pivot, S[i, START + 1], S[i, START + 2], S[i, START + 3]
    r2 = x * x + z * z
    s = math.sqrt(r2 + bob.half_spacing * bob.half_spacing) - bob.string
    pull = bob.grip * bob.mobility * tension(S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2], s) / math.sqrt(r2)
    drag = bob.b * bob.mobility
    D[0] += vx * dt
    D[1] += vz * dt
    D[2] -= (pull * x + drag * vx) * dt
    D[3] -= (pull * z + drag * vz + bob.fall) * dt
