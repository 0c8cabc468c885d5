"""Where the energy is: what a bob holds, what it has lost and been given, at any time of its segment."""

import math

from cradle_env.mechanics.contact import attraction_energy
from cradle_env.mechanics.forces import radius_and_speed
from cradle_env.mechanics.integrator import between, cubic_between, pivot_between
from cradle_env.mechanics.jit import jit
from cradle_env.mechanics.layout import (
    BROUGHT,
    CONTACT_LOSS,
    DRAG,
    LOST,
    ON_SERIES,
    START,
    T0,
    T1,
    TENSION,
    WORK,
    WORKED,
)
from cradle_env.mechanics.series_flight import brought_on, drag_on
from cradle_env.mechanics.strings import stretch, unstretched, work_between


@jit
def motion_at(S, i, t):
    """Coordinates and velocities of bob i at time t [s]: on its segment, or held before the release."""
    if S[i, T1] > S[i, T0]:
        return between(S, i, t)
    return S[i, START], S[i, START + 1], S[i, START + 2], S[i, START + 3]


@jit
def string_work(cradle, bob, S, i, t, r, v):
    """Energy [J] that bob i's strings have taken beyond WORK at time t [s] of its segment, when its radius is r [m] and
    changes by v [m/s]: since they turned last, or, where they creep, since the start of the segment."""
    t0, t1, t2 = S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2]
    if bob.creep == 0.0:
        return work_between(bob, t, t0, t1, t2, S[i, WORKED], r)
    r0, v0 = radius_and_speed(cradle, bob, S[i, T0], S, i, START)
    middle, h = 0.5 * (S[i, T0] + t), t - S[i, T0]
    work = work_between(bob, middle, t0, t1, t2, r0, r)
    # They creep evenly about the middle: power changes by its distance in time from there.
    stiffer0 = (t1 + 2.0 * t2 * stretch(bob, S[i, T0], r0 * r0)) * v0
    stiffer = (t1 + 2.0 * t2 * stretch(bob, t, r * r)) * v
    return work - bob.grip * unstretched(bob, middle)[1] * h * h * (stiffer - stiffer0) / 12.0


@jit
def book(cradle, bobs, S, i, t):
    """Energies of bob i at time t [s], in J: kinetic; potential of gravity and of the attraction by the bob before;
    taken by drag; taken by the contact with the next bob while followed in time; given to its strings; of that lost at
    the last slack; brought in by its pivot."""
    bob = bobs[i]
    x, z, vx, vz = motion_at(S, i, t)
    potential, strings, drag, contact, brought = 0.0, 0.0, 0.0, 0.0, 0.0
    if cradle.attraction != 0.0 and i > 0:
        x0, z0, _, _ = motion_at(S, i - 1, t)
        potential = attraction_energy(cradle, bobs, i - 1, t, x0, z0, x, z)
    if cradle.elastic:
        height = z
        pivot, drive = pivot_between(cradle, bob, S, t)
        from_pivot = x - pivot
        r = math.sqrt(from_pivot * from_pivot + z * z)
        strings = S[i, WORK] + string_work(cradle, bob, S, i, t, r, (from_pivot * (vx - drive) + z * vz) / r)
    elif cradle.large_angle:
        sin, cos, along = math.sin(x), math.cos(x), bob.length * vx
        height, vx, vz = -bob.length * cos, along * cos + bob.drive, along * sin
    else:
        height, vx, vz = (0.5 * x * x - 1.0) * bob.length, bob.length * vx + bob.drive, 0.0
    if S[i, ON_SERIES] != 0.0:
        drag, contact = drag_on(S, i, t), S[i, START + CONTACT_LOSS]
        brought = brought_on(bob, S, i, START, x, vx)
    elif S[i, T1] > S[i, T0]:
        drag = cubic_between(S, i, DRAG, t)
        contact = cubic_between(S, i, CONTACT_LOSS, t)
        brought = cubic_between(S, i, BROUGHT, t)
    kinetic = 0.5 * (vx * vx + vz * vz) / bob.mobility
    potential += bob.mass * cradle.gravity * height
    return kinetic, potential, drag, contact, strings, S[i, LOST], brought
