"""Where bobs touch: geometry, impacts, and contacts that persist.

Along a chain of bobs the contacts couple only neighbours, so every simultaneous problem is tridiagonal: with M_i
the mobility of bob i (velocity per impulse) and n_p the unit vector from bob p to p + 1,

    D_pp = n_p . (M_p + M_{p+1}) n_p,     D_{p,p+1} = -n_p . M_{p+1} n_{p+1}.

M is 1/m on elastic strings; a rigid string lets a bob move along its tangent only.
"""

import math

from cradle_env.mechanics.forces import pivot_at
from cradle_env.mechanics.jit import jit, leaf
from cradle_env.mechanics.layout import (
    ACTIVE,
    BROUGHT,
    CONTACT_LOSS,
    COORDINATES,
    DIAGONAL,
    DISSIPATION,
    DRAG,
    FORCE,
    LINK,
    N_X,
    N_Z,
    PAIR_DECAYS,
    PRESSED,
    RESOLVED,
    SOLUTION,
    UPPER,
    VALUE,
    VELOCITIES,
    WANTED,
)

#: Bobs are in touch from this overlap on [m]: far below any gap that matters, far above rounding, so that a
#: pair that has just parted is never found touching again by its last digit.
CONTACT = 1e-13
#: Bobs nearer than this [m] are struck as one group.
TOUCHING = 1e-9
#: A pressed pair whose bounce would not rise beyond this [m] is in persistent contact.
LEAST_BOUNCE = 1e-6


@jit
def place(cradle, bob, t, x, z, vx, vz):
    """Position and velocity (x, z, v_x, v_z) of a bob in the room at time t [s], SI, z upwards from the pivots."""
    if cradle.elastic:
        return x, z, vx, vz
    v, pivot = bob.length * vx, pivot_at(bob, t)
    if cradle.large_angle:
        sin, cos = math.sin(x), math.cos(x)
        return pivot + bob.length * sin, -bob.length * cos, v * cos + bob.drive, v * sin
    return pivot + bob.length * x, 0.0, v + bob.drive, 0.0


@jit
def pair_at(cradle, bobs, p, t, x0, z0, vx0, vz0, x1, z1, vx1, vz1):
    """`pair` for the states of the two bobs."""
    x0, z0, vx0, vz0 = place(cradle, bobs[p], t, x0, z0, vx0, vz0)
    x1, z1, vx1, vz1 = place(cradle, bobs[p + 1], t, x1, z1, vx1, vz1)
    dx, dz, vx, vz = x1 - x0, z1 - z0, vx1 - vx0, vz1 - vz0
    distance = math.sqrt(dx * dx + dz * dz)
    nx, nz = dx / distance, dz / distance
    v_t = nx * vz - nz * vx
    return distance - 2.0 * cradle.radius, nx, nz, nx * vx + nz * vz, v_t * v_t / distance


@jit
def pair(cradle, bobs, p, t, A, c):
    """(gap, n_x, n_z, v_n, v_t^2 / distance) of bobs p and p + 1, their motion at t [s] in A from column c on.

    gap [m] between the surfaces, unit vector from p to p + 1, speed [m/s] at which the gap opens, and the
    centripetal term [m/s^2] with which it opens at constant velocities.
    """
    q = p + 1
    return pair_at(
        cradle, bobs, p, t,
        A[p, c], A[p, c + 1], A[p, c + 2], A[p, c + 3], A[q, c], A[q, c + 1], A[q, c + 2], A[q, c + 3],
    )  # fmt: skip


@leaf
def tangent(cradle, theta):
    """(t_x, t_z): the direction in which a rigid string lets its bob move."""
    if cradle.large_angle:
        return math.cos(theta), math.sin(theta)
    return 1.0, 0.0


@leaf
def mobility(cradle, bobs, i, A, c, ax, az, bx, bz):
    """a . M b of bob i for two vectors, 1/kg times their units."""
    if cradle.elastic:
        return (ax * bx + az * bz) * bobs[i].mobility
    tx, tz = tangent(cradle, A[i, c])
    return (ax * tx + az * tz) * (bx * tx + bz * tz) * bobs[i].mobility


@leaf
def yielding(cradle, bobs, p, A, c, nx, nz):
    """D_pp: how fast pair p opens per impulse along n [1/kg]."""
    return mobility(cradle, bobs, p, A, c, nx, nz, nx, nz) + mobility(cradle, bobs, p + 1, A, c, nx, nz, nx, nz)


@leaf
def push(cradle, bobs, i, A, c, T, block, offset, jx, jz):
    """Adds M j to two components of bob i, from T[i, block + offset] on; its motion stands in A from column c on.

    j [kg m/s or N] changes velocities or accelerations (offset VELOCITIES), j [kg m] coordinates (offset
    COORDINATES). A rigid string takes up what of j lies along it; on a pivot that moves, this brings in energy.
    """
    k = block + offset
    if cradle.elastic:
        T[i, k] += jx * bobs[i].mobility
        T[i, k + 1] += jz * bobs[i].mobility
    else:
        tx, tz = tangent(cradle, A[i, c])
        along = jx * tx + jz * tz
        T[i, k] += along * bobs[i].mobility / bobs[i].length
        if offset == VELOCITIES:
            T[i, block + BROUGHT] += bobs[i].drive * (along * tx - jx)


@leaf
def push_apart(cradle, bobs, p, A, c, T, block, offset, nx, nz, j):
    """Pushes the bobs of pair p apart by j along n; see `push`."""
    push(cradle, bobs, p, A, c, T, block, offset, -j * nx, -j * nz)
    push(cradle, bobs, p + 1, A, c, T, block, offset, j * nx, j * nz)


@leaf
def acceleration(cradle, bobs, i, A, c, R, rate):
    """Acceleration (x, z) of bob i in the plane [m/s^2]; its derivative stands in R from column `rate` on."""
    if cradle.elastic:
        return R[i, rate + 2], R[i, rate + 3]
    tx, tz = tangent(cradle, A[i, c])
    along = bobs[i].length * R[i, rate + 2]
    inwards = bobs[i].length * A[i, c + 2] * A[i, c + 2] if cradle.large_angle else 0.0
    return along * tx - inwards * tz, along * tz + inwards * tx


@leaf
def opening(cradle, bobs, p, A, c, R, rate, nx, nz, spread):
    """Second derivative [m/s^2] of the gap of pair p, whose `pair` gives nx, nz and spread."""
    ax, az = acceleration(cradle, bobs, p, A, c, R, rate)
    bx, bz = acceleration(cradle, bobs, p + 1, A, c, R, rate)
    return nx * (bx - ax) + nz * (bz - az) + spread


@jit
def set_normals(cradle, bobs, lo, hi, t, A, c, W):
    """Sets the unit vectors n_p of the pairs of bobs lo..hi-1 at time t [s], for solve_chain and apply_chain."""
    for p in range(lo, hi - 1):
        _, W[p, N_X], W[p, N_Z], _, _ = pair(cradle, bobs, p, t, A, c)


@jit
def solve_chain(cradle, bobs, lo, hi, A, c, W):
    """Solves D x = W[:, WANTED] over the pairs of bobs lo..hi-1 with W[p, ACTIVE]; x = 0 for the others.

    The motion stands in A from column c on, its normals in W; the solution goes to W[:, SOLUTION]. Thomas algorithm.
    """
    coupled = False
    for p in range(lo, hi - 1):
        W[p, SOLUTION] = 0.0
        if W[p, ACTIVE] == 0.0:
            coupled = False
            continue
        nx, nz = W[p, N_X], W[p, N_Z]
        d = yielding(cradle, bobs, p, A, c, nx, nz)
        v = W[p, WANTED]
        W[p, UPPER] = 0.0
        if coupled:
            off = -mobility(cradle, bobs, p, A, c, W[p - 1, N_X], W[p - 1, N_Z], nx, nz)
            W[p - 1, UPPER] = off
            factor = off / W[p - 1, DIAGONAL]
            d -= factor * off
            v -= factor * W[p - 1, VALUE]
        W[p, DIAGONAL], W[p, VALUE] = d, v
        coupled = True
    following = 0.0
    for p in range(hi - 2, lo - 1, -1):
        if W[p, ACTIVE] == 0.0:
            following = 0.0
        else:
            following = (W[p, VALUE] - W[p, UPPER] * following) / W[p, DIAGONAL]
            W[p, SOLUTION] = following


@jit
def apply_chain(cradle, bobs, lo, hi, A, c, W, T, block, offset):
    """Pushes the bobs of every pair apart by W[p, SOLUTION] along n_p; see `push`."""
    for p in range(lo, hi - 1):
        if W[p, SOLUTION] != 0.0:
            push_apart(cradle, bobs, p, A, c, T, block, offset, W[p, N_X], W[p, N_Z], W[p, SOLUTION])


@jit
def kuwabara_kono(cradle, k_f, overlap, speed):
    """Contact force [N] of eq. 1 with this k_f, of contacts that are followed in time."""
    if overlap <= 0.0:
        return 0.0
    return max(0.0, math.sqrt(overlap) * (cradle.contact_k_el * overlap + k_f * speed))


@jit
def blow_speed(cradle, bobs, p, gap, v_n):
    """The speed [m/s] at which pair p would meet to hold the energy that its contact, followed in time, holds."""
    m = 1.0 / (bobs[p].mobility + bobs[p + 1].mobility)
    return math.sqrt(v_n * v_n + 0.8 * cradle.contact_k_el / m * max(-gap, 0.0) ** 2.5)


@jit
def contact_forces(cradle, bobs, lo, hi, S, W, t, A, c, R, rate):
    """Adds the contact forces within a group at time t [s] to its derivative and leaves them in W[:, FORCE] [N].

    Persistent contacts: the force that keeps the gap closed, whatever its sign (the loop ends a contact whose
    force turns negative). Resolved contacts: eq. 1, never attractive; what it takes is booked with bob p.
    """
    pressed = False
    for p in range(lo, hi - 1):
        W[p, FORCE] = 0.0
        if S[p, LINK] == PRESSED:
            pressed = True
        elif S[p, LINK] == RESOLVED:
            gap, nx, nz, v_n, _ = pair(cradle, bobs, p, t, A, c)
            force = kuwabara_kono(cradle, S[p, DISSIPATION], -gap, -v_n)
            push_apart(cradle, bobs, p, A, c, R, rate, VELOCITIES, nx, nz, force)
            R[p, rate + CONTACT_LOSS] = -force * v_n
            W[p, FORCE] = force
    if pressed:
        for p in range(lo, hi - 1):
            W[p, ACTIVE] = S[p, LINK] == PRESSED
            if W[p, ACTIVE] != 0.0:
                _, nx, nz, _, spread = pair(cradle, bobs, p, t, A, c)
                W[p, N_X], W[p, N_Z] = nx, nz
                W[p, WANTED] = -opening(cradle, bobs, p, A, c, R, rate, nx, nz, spread)
        solve_chain(cradle, bobs, lo, hi, A, c, W)
        apply_chain(cradle, bobs, lo, hi, A, c, W, R, rate, VELOCITIES)
        for p in range(lo, hi - 1):
            if W[p, ACTIVE] != 0.0:
                W[p, FORCE] = W[p, SOLUTION]


@jit
def pair_forces(cradle, bobs, t, A, c, R, rate):
    """Adds to the derivative of all bobs what acts between neighbours at a distance: attraction
    F exp(-gap / range) along the line of centres, and the drag -b slope exp(-gap / range) v that each has from the
    other's nearness; and a learned force. A gap counts from 0 on."""
    for p in range(len(bobs) - 1):
        gap, nx, nz, v_n, _ = pair(cradle, bobs, p, t, A, c)
        gap = max(gap, 0.0)
        if cradle.attraction != 0.0:
            force = cradle.attraction * math.exp(-gap / cradle.attraction_range)
            push_apart(cradle, bobs, p, A, c, R, rate, 2, nx, nz, -force)
        if cradle.drag_slope != 0.0:
            weight = cradle.drag_slope * math.exp(-gap / cradle.drag_range)
            for i in range(p, p + 2):
                _, _, vx, vz = place(cradle, bobs[i], t, A[i, c], A[i, c + 1], A[i, c + 2], A[i, c + 3])
                b = weight * bobs[i].b
                push(cradle, bobs, i, A, c, R, rate, 2, -b * vx, -b * vz)
                R[i, rate + DRAG] += b * (vx * vx + vz * vz)
        if cradle.learned_pairs != 0:
            force = learned_pair(bobs[p], gap / cradle.radius, v_n / cradle.pair_speed)
            push_apart(cradle, bobs, p, A, c, R, rate, VELOCITIES, nx, nz, force)
            R[p, rate + DRAG] -= force * v_n


@jit
def learned_pair(bob, gap, u):
    """Repulsion [N] of a bob and the next: -sum (pull_k + film_k u) exp(-decay_k gap); gap in radii of a bob, u the
    speed at which it opens in units of its scale."""
    a, b, c = PAIR_DECAYS
    near, middle, far = math.exp(-a * gap), math.exp(-b * gap), math.exp(-c * gap)
    pull = bob.pull[0] * near + bob.pull[1] * middle + bob.pull[2] * far
    return -pull - u * (bob.film[0] * near + bob.film[1] * middle + bob.film[2] * far)


@jit
def attraction_energy(cradle, bobs, p, t, x0, z0, x1, z1):
    """What pair p holds by its attraction [J], at coordinates of the two bobs at time t [s]."""
    gap = pair_at(cradle, bobs, p, t, x0, z0, 0.0, 0.0, x1, z1, 0.0, 0.0)[0]
    return -cradle.attraction * cradle.attraction_range * math.exp(-max(gap, 0.0) / cradle.attraction_range)


@jit
def close_gaps(cradle, bobs, lo, hi, S, W, t, c):
    """Takes out what integration leaves of gap and opening speed (some 1e-13) in the persistent contacts of the
    bobs lo..hi-1, whose motion at t [s] stands in S from column c on."""
    set_normals(cradle, bobs, lo, hi, t, S, c, W)
    for offset in (COORDINATES, VELOCITIES):
        for p in range(lo, hi - 1):
            W[p, ACTIVE] = S[p, LINK] == PRESSED
            gap, _, _, v_n, _ = pair(cradle, bobs, p, t, S, c)
            W[p, WANTED] = -gap if offset == COORDINATES else -v_n
        solve_chain(cradle, bobs, lo, hi, S, c, W)
        apply_chain(cradle, bobs, lo, hi, S, c, W, S, c, offset)
