"""Where the energy is: what a bob holds, what it has lost and been given, at any time of its segment."""

import math

from cradle_env.mechanics.contact import attraction_energy
from cradle_env.mechanics.forces import radius_and_speed
from cradle_env.mechanics.jit import jit
from cradle_env.mechanics.motion import between, cubic_between, pivot_between
from cradle_env.mechanics.parameters import BROUGHT, CONTACT_LOSS, DRAG, LOST, START, T0, T1, TENSION, WORK
from cradle_env.mechanics.strings import work_between


@jit
def motion_at(S, i, t):
    """Coordinates and velocities of bob i at time t [s]: on its segment, or held before the release."""
    if S[i, T1] > S[i, T0]:
        return between(S, i, t)
    return S[i, START], S[i, START + 1], S[i, START + 2], S[i, START + 3]


@jit
def string_work(cradle, bob, S, i, r):
    """Energy [J] that bob i's strings take from the start of its segment to radius r [m]."""
    r0 = radius_and_speed(cradle, bob, S[i, T0], S, i, START)[0]
    return work_between(bob, S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2], r0, r)


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
        from_pivot = x - pivot_between(cradle, bob, S, t)[0]
        strings = S[i, WORK] + string_work(cradle, bob, S, i, math.sqrt(from_pivot * from_pivot + z * z))
    elif cradle.large_angle:
        sin, cos, along = math.sin(x), math.cos(x), bob.length * vx
        height, vx, vz = -bob.length * cos, along * cos + bob.drive, along * sin
    else:
        height, vx, vz = (0.5 * x * x - 1.0) * bob.length, bob.length * vx + bob.drive, 0.0
    if S[i, T1] > S[i, T0]:
        drag = cubic_between(S, i, DRAG, t)
        contact = cubic_between(S, i, CONTACT_LOSS, t)
        brought = cubic_between(S, i, BROUGHT, t)
    kinetic = 0.5 * (vx * vx + vz * vz) / bob.mobility
    potential += bob.mass * cradle.gravity * height
    return kinetic, potential, drag, contact, strings, S[i, LOST], brought
