"""Compiled part of `soft_contact`: equations of motion, Dormand-Prince steps, the location of every change of law.

Nothing is validated. N bobs, pair p joins bobs p and p + 1 (from 0). A state is (7, N + 1), rows below; its last
column is the frame's, with X in row R and X' in row R_DOT.
"""

from typing import NamedTuple

import numpy as np

from .compiled import entry, inner
from .soft_terms import BOB_FORCES, PAIR_FORCES, TORQUES, chosen

Array = np.ndarray

RIGID, ELASTIC, HYSTERETIC = 0, 1, 2
SLACK, LOADING, UNLOADING = 0, 1, 2
R, THETA, R_DOT, THETA_DOT = 0, 1, 2, 3  # rows of a state
CONTACT_WORK, STRING_WORK, OTHER_WORK = 4, 5, 6  # and what contacts [p], strings [i], all else [i] have taken, J
SIN, COS, X, Y, VX, VY, FX, FY, NEAR = range(9)  # rows of a scratch array (9, N)
STRING_NOISE = 1e-13  # m or m/s past which strings change law: rounding must not reverse a bob at rest
EVENT_TIME = 1e-12  # s, to which a change of law is located

# Dormand & Prince (1980), RK5(4)7M: stage times and weights, and the difference of the two solutions.
NODES = np.array([0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1])
STAGES = np.array([
    [0, 0, 0, 0, 0, 0],
    [1 / 5, 0, 0, 0, 0, 0],
    [3 / 40, 9 / 40, 0, 0, 0, 0],
    [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
    [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
    [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
])  # fmt: skip
ERROR = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])

pivot_torque, bob_force, pair_force = chosen(TORQUES), chosen(BOB_FORCES), chosen(PAIR_FORCES)


class Constants(NamedTuple):
    """What the compiled functions need; arrays per bob (N,) or per pair (N-1,)."""

    mass: Array  # what weighs
    inertia: Array  # what resists acceleration
    length: Array
    string_length: Array  # sqrt(r0^2 + a^2) per bob
    pivot: Array  # x of the pivots in the frame
    spacing: Array  # distance of neighbouring pivots per pair
    meeting: Array  # whether the bobs of a pair feel each other but by contact, per pair
    pivot_half_spacing: float
    strings: int
    kappa: float
    gravity: float
    b: float
    diameter: float
    k_el: float
    k_f: float
    drag_slope: float  # group_drag
    drag_range: float
    creep: float  # string_creep
    kink: float  # string_kink: tension grows by this share at an angle, over a width
    kink_angle: float
    kink_width: float
    sticky_energy: Array  # sticky_pair, per pair
    sticky_range: float
    any_sticky: bool
    frame_mass: float  # inf: no frame moves
    frame_frequency: float  # rad/s
    frame_damping: float  # kg/s
    frame_drag: float  # kg/m
    torques: Array  # rows of the tables of soft_terms
    bob_forces: Array
    pair_forces: Array


class Laws(NamedTuple):
    """Which laws are in force."""

    string: Array  # SLACK, LOADING or UNLOADING, (N,)
    turn: Array  # (s*, T*) of the last reversal, (2, N)
    pressing: Array  # (N-1,)
    sticking: Array  # in touch or not yet torn apart, (N-1,)


class Scratch(NamedTuple):
    """Room for one step."""

    stages: Array  # (7, 7, N + 1)
    new: Array  # (7, N + 1)
    at: Array  # (9, N), at the beginning of the step
    at_new: Array
    watched: Array  # pairs that may come into touch and part again within the step, (N-1,)
    began: Array  # time, speed and work at the beginning of each contact, (3, N-1)


@inner
def kinematics(y: Array, c: Constants, at: Array) -> None:
    """Places (x from the pivot, y) and velocities in the room, to `at`."""
    n = c.mass.size
    for i in range(n):
        sin, cos, r = np.sin(y[THETA, i]), np.cos(y[THETA, i]), y[R, i]
        swing = r * y[THETA_DOT, i]
        at[SIN, i], at[COS, i], at[X, i], at[Y, i] = sin, cos, r * sin, -r * cos
        at[VX, i] = y[R_DOT, n] + y[R_DOT, i] * sin + swing * cos
        at[VY, i] = swing * sin - y[R_DOT, i] * cos


@inner
def approach(at: Array, p: int, c: Constants) -> tuple[float, float, float, float]:
    """Unit vector (nx, ny) from bob p to p + 1, their overlap eps (m; < 0 apart) and eps' (m/s)."""
    dx, dy = c.spacing[p] + at[X, p + 1] - at[X, p], at[Y, p + 1] - at[Y, p]
    distance = np.sqrt(dx**2 + dy**2)
    nx, ny = dx / distance, dy / distance
    closing = nx * (at[VX, p] - at[VX, p + 1]) + ny * (at[VY, p] - at[VY, p + 1])
    return nx, ny, c.diameter - distance, closing


@inner
def paid_out(t: float, c: Constants) -> tuple[float, float, float]:
    """By how much creep has lengthened a string (m), with its rate and the rate of that."""
    if c.creep == 0.0:
        return 0.0, 0.0, 0.0
    return c.creep * np.log1p(t), c.creep / (1 + t), -c.creep / (1 + t) ** 2


@inner
def rigid_radius(t: float, i: int, c: Constants) -> tuple[float, float, float]:
    """r, r', r'' of bob i on strings that only creep: r^2 = L(t)^2 - a^2."""
    if c.creep == 0.0:
        return c.length[i], 0.0, 0.0
    more, rate, rate_dot = paid_out(t, c)
    total = c.string_length[i] + more
    r = np.sqrt(total**2 - c.pivot_half_spacing**2)
    r_dot = total * rate / r
    return r, r_dot, (rate**2 + total * rate_dot - r_dot**2) / r


@inner
def stretch(t: float, y: Array, i: int, c: Constants) -> tuple[float, float]:
    """Stretch s (m) of the strings of bob i, and s' (m/s)."""
    more, rate, _ = paid_out(t, c)
    now = np.sqrt(y[R, i] ** 2 + c.pivot_half_spacing**2)
    return now - c.string_length[i] - more, y[R, i] * y[R_DOT, i] / now - rate


@inner
def tension(s: float, law: int, s_turn: float, t_turn: float, kappa: float) -> float:
    """Tension (N) of one string stretched by s, on the line through its last reversal: eq. (4)."""
    if law == SLACK:
        return 0.0
    if law == LOADING:
        return t_turn + kappa * (s - s_turn)
    return t_turn * (s / s_turn) ** 2


@inner
def kinked(theta: float, c: Constants) -> float:
    """By what a kink multiplies the tension at an angle."""
    if c.kink == 0.0:
        return 1.0
    return 1 + c.kink * np.exp(-(((theta - c.kink_angle) / c.kink_width) ** 2))


@inner
def other_forces(t: float, y: Array, laws: Laws, c: Constants, at: Array) -> None:
    """Forces in the room of all but weight, strings, contacts, to rows FX and FY of `at`."""
    n = c.mass.size
    at[FX:] = 0.0
    between = c.drag_slope != 0.0 or len(c.pair_forces) > 0 or c.any_sticky
    for p in range(n - 1):
        if not (between and c.meeting[p]):
            continue
        nx, ny, eps, eps_dot = approach(at, p, c)
        push = 0.0
        for q in range(len(c.pair_forces)):
            push += pair_force(c.pair_forces[q], -eps, -eps_dot)
        if laws.sticking[p] and -eps < c.sticky_range:
            push -= 2 * c.sticky_energy[p] / c.sticky_range * (1 - max(-eps, 0.0) / c.sticky_range)
        nearness = np.exp(min(eps, 0.0) / c.drag_range)
        for i, force in ((p, -push), (p + 1, push)):
            at[FX, i] += force * nx
            at[FY, i] += force * ny
            at[NEAR, i] += nearness
    for i in range(n):
        drag = c.b * (1.0 + c.drag_slope * at[NEAR, i])
        at[FX, i] -= drag * at[VX, i]
        at[FY, i] -= drag * at[VY, i]
        place = y[R, n] + c.pivot[i] + at[X, i]
        for q in range(len(c.bob_forces)):
            force_x, force_y = bob_force(
                c.bob_forces[q], t, i + 1, c.mass[i], y[R, i], y[THETA, i], place, at[VX, i], at[VY, i]
            )
            at[FX, i] += force_x
            at[FY, i] += force_y


@inner
def derivative(t: float, y: Array, laws: Laws, c: Constants, at: Array, dy: Array) -> None:
    """Write d(state)/dt to dy (7, N + 1), under the laws in force; `at` (9, N) then holds the places."""
    n = c.mass.size
    dy[:] = 0.0
    kinematics(y, c, at)
    other_forces(t, y, laws, c, at)
    for i in range(n):
        dy[OTHER_WORK, i] = -at[FX, i] * at[VX, i] - at[FY, i] * at[VY, i]
    for p in range(n - 1):
        if laws.pressing[p]:
            nx, ny, eps, eps_dot = approach(at, p, c)
            push = np.sqrt(max(eps, 0.0)) * (c.k_el * eps + c.k_f * eps_dot)
            dy[CONTACT_WORK, p] = push * eps_dot
            for i, force in ((p, -push), (p + 1, push)):
                at[FX, i] += force * nx
                at[FY, i] += force * ny

    # Along (r^, th^): the strings' pull, and the grip of a pivot that turns stiffly. Both act on the frame, too.
    on_frame = loaded = 0.0
    for i in range(n):
        sin, cos = at[SIN, i], at[COS, i]
        force_y = at[FY, i] - c.mass[i] * c.gravity
        along, across = at[FX, i] * sin - force_y * cos, at[FX, i] * cos + force_y * sin
        grip = 0.0
        for q in range(len(c.torques)):
            grip += pivot_torque(c.torques[q], y[THETA_DOT, i]) / y[R, i]
        dy[OTHER_WORK, i] -= grip * y[R, i] * y[THETA_DOT, i]
        centrifugal = y[R, i] * y[THETA_DOT, i] ** 2
        if c.strings == RIGID:
            # The pull that keeps r as it must be, were the frame at rest; less by inertia sin X'' as it moves.
            dy[R_DOT, i] = rigid_radius(t, i, c)[2]
            pull = along + c.inertia[i] * (centrifugal - dy[R_DOT, i])
            loaded += c.inertia[i] * sin**2
        else:
            one_string = tension(stretch(t, y, i, c)[0], laws.string[i], laws.turn[0, i], laws.turn[1, i], c.kappa)
            pull = 4 * one_string * c.length[i] / c.string_length[i] * kinked(y[THETA, i], c)
            dy[R_DOT, i] = (along - pull) / c.inertia[i] + centrifugal
        dy[THETA_DOT, i] = (across + grip) / c.inertia[i] - 2 * y[R_DOT, i] * y[THETA_DOT, i]
        dy[STRING_WORK, i] = pull * y[R_DOT, i]
        on_frame += pull * sin - grip * cos
    drive = 0.0
    if c.frame_mass < np.inf:
        speed = y[R_DOT, n]
        damping = (c.frame_damping + c.frame_drag * abs(speed)) * speed
        dy[OTHER_WORK, n] = damping * speed
        spring = c.frame_mass * c.frame_frequency**2 * y[R, n]
        drive = (on_frame - damping - spring) / (c.frame_mass + loaded)
    dy[R, n], dy[R_DOT, n] = y[R_DOT, n], drive
    for i in range(n):
        dy[R, i], dy[THETA, i] = y[R_DOT, i], y[THETA_DOT, i]
        dy[THETA_DOT, i] = (dy[THETA_DOT, i] - drive * at[COS, i]) / y[R, i]
        if c.strings == RIGID:
            dy[STRING_WORK, i] -= c.inertia[i] * drive * at[SIN, i] * y[R_DOT, i]
        else:
            dy[R_DOT, i] -= drive * at[SIN, i]


@inner
def step(t: float, y: Array, h: float, k: Array, laws: Laws, c: Constants, at: Array, new: Array) -> float:
    """One Dormand-Prince step from y to new; k (7, 7, N + 1): stages, k[0] ready. Returns the largest error.

    k[6] is then the derivative at new, and `at` holds the places there.
    """
    rows, columns = y.shape
    for stage in range(1, 7):
        for row in range(rows):
            for i in range(columns):
                slope = 0.0
                for earlier in range(stage):
                    slope += STAGES[stage, earlier] * k[earlier, row, i]
                new[row, i] = y[row, i] + h * slope
        derivative(t + NODES[stage] * h, new, laws, c, at, k[stage])
    worst = 0.0
    for row in range(rows):
        for i in range(columns):
            slope = 0.0
            for stage in range(7):
                slope += ERROR[stage] * k[stage, row, i]
            worst = max(worst, abs(h * slope))
    return worst


@inner
def string_margin(t: float, y: Array, i: int, laws: Laws, c: Constants) -> float:
    """How far the strings of bob i are inside their present law; < 0: it has ended."""
    if c.strings == RIGID:
        return 1.0
    s, s_dot = stretch(t, y, i, c)
    if laws.string[i] == SLACK:
        return STRING_NOISE - s
    if c.strings == ELASTIC:
        return STRING_NOISE + s
    if laws.string[i] == LOADING:
        return STRING_NOISE + s_dot
    return STRING_NOISE + min(s, -s_dot)


@inner
def pair_margin(at: Array, p: int, pressing: bool, watched: bool, c: Constants) -> float:
    """How far pair p is inside its present law (m); < 0: it has ended.

    The force is positive where eps > 0 and eps + (k_f/k_el) eps' > 0. A watched pair, one that may come into
    touch and part again within the step, also ends it where it stops closing: no graze is stepped over.
    """
    _, _, eps, eps_dot = approach(at, p, c)
    push = eps + c.k_f / c.k_el * eps_dot
    if pressing:
        return push
    margin = -min(eps, push)
    return min(margin, eps_dot) if watched else margin


@inner
def least_margin(t: float, y: Array, at: Array, laws: Laws, watched: Array, c: Constants) -> float:
    """The least of all margins: positive as long as every law holds."""
    least = np.inf
    for i in range(c.mass.size):
        least = min(least, string_margin(t, y, i, laws, c))
    for p in range(watched.size):
        least = min(least, pair_margin(at, p, laws.pressing[p], watched[p], c))
    return least


@inner
def change_strings(t: float, y: Array, laws: Laws, c: Constants) -> bool:
    """Change the law of every string whose own has ended; the reversal is remembered, slack forgets. Has any?"""
    changed = False
    for i in range(c.mass.size):
        if string_margin(t, y, i, laws, c) >= 0.0:
            continue
        changed = True
        s, _ = stretch(t, y, i, c)
        if laws.string[i] == SLACK:
            laws.string[i] = LOADING
        elif s < 0.0:
            laws.string[i] = SLACK
            laws.turn[:, i] = 0.0
        else:
            laws.turn[1, i] = tension(s, laws.string[i], laws.turn[0, i], laws.turn[1, i], c.kappa)
            laws.turn[0, i] = s
            laws.string[i] = UNLOADING if laws.string[i] == LOADING else LOADING
    return changed


@inner
def locate(
    t: float,
    y: Array,
    h: float,
    k: Array,
    margin_low: float,
    laws: Laws,
    watched: Array,
    c: Constants,
    at: Array,
    new: Array,
) -> float:
    """Shorten a step from y, at whose end some law has ended, to the first such instant: `new` just past it.

    The root of the least margin, margin_low at y, as a function of the step, by bracketed secants (Illinois), every
    third trial a bisection. Each trial is a whole Dormand-Prince step, so no interpolation enters.
    """
    low, high = 0.0, h
    margin_high = least_margin(t + h, new, at, laws, watched, c)
    side = trials = 0
    while high - low > EVENT_TIME:
        trials += 1
        share = 0.5 if trials % 3 == 0 else margin_low / (margin_low - margin_high)
        trial = min(max(low + share * (high - low), low + 0.5 * EVENT_TIME), high - 0.5 * EVENT_TIME)
        step(t, y, trial, k, laws, c, at, new)
        margin = least_margin(t + trial, new, at, laws, watched, c)
        if margin < 0.0:
            high, margin_high = trial, margin
            margin_low *= 0.5 if side < 0 else 1.0
            side = -1
        else:
            low, margin_low = trial, margin
            margin_high *= 0.5 if side > 0 else 1.0
            side = 1
    step(t, y, high, k, laws, c, at, new)
    return high


@inner
def copy(source: Array, target: Array) -> None:
    """target[:] = source, of two dimensions, which numba would allocate for."""
    for row in range(source.shape[0]):
        for column in range(source.shape[1]):
            target[row, column] = source[row, column]


@inner
def note_contact(contacts: Array, count: int, t: float, p: int, began: Array, work: float) -> int:
    """Write the contact of pair p that has ended, if there is room for it; how many there are now."""
    if count < len(contacts):
        contacts[count, 0], contacts[count, 1], contacts[count, 2] = began[0, p], p + 1, began[1, p]
        contacts[count, 3], contacts[count, 4] = t - began[0, p], work - began[2, p]
    return count + 1


@entry
def advance(
    y: Array,
    times: Array,
    c: Constants,
    tolerance: float,
    max_step: float,
    laws: Laws,
    scratch: Scratch,
    states: Array,
    contacts: Array,
) -> int:
    """Fills `states` at `times` from y at t = 0, and `contacts` as far as they go; the number of all contacts."""
    n = c.mass.size
    k, new, at, at_new, watched, began = scratch
    if c.strings == RIGID:
        for i in range(n):
            y[R_DOT, i] = rigid_radius(0.0, i, c)[1]
    kinematics(y, c, at)
    for p in range(n - 1):
        laws.pressing[p] = laws.sticking[p] = pair_margin(at, p, False, False, c) < 0.0
    derivative(0.0, y, laws, c, at, k[0])
    # At first touch the force rises like a square root: begin with 1e-4 of a contact at 1 m/s, let h grow.
    first_step = 1e-4 * (c.inertia[0] / c.k_el) ** 0.4
    t, h, wanted, count = 0.0, first_step, 0, 0
    while wanted < times.size:
        if t >= times[wanted]:
            copy(y, states[wanted])
            wanted += 1
            continue
        tried = min(h, max_step)
        arrives = tried >= times[wanted] - t
        if arrives:
            tried = times[wanted] - t
        error = step(t, y, tried, k, laws, c, at_new, new) / tolerance
        growth = min(5.0, max(0.2, 0.9 * max(error, 1e-10) ** -0.2))
        if error > 1.0:
            h = tried * growth
            continue
        if not arrives or growth < 1.0:
            h = tried * growth
        for p in range(n - 1):
            _, _, eps, eps_dot = approach(at, p, c)
            watched[p] = not laws.pressing[p] and eps < 0.0 and eps + eps_dot * tried > 0.0
        if least_margin(t + tried, new, at_new, laws, watched, c) < 0.0:
            arrives = False
            margin = max(least_margin(t, y, at, laws, watched, c), 0.0)
            tried = locate(t, y, tried, k, margin, laws, watched, c, at_new, new)
        copy(new, y)
        copy(at_new, at)
        t = times[wanted] if arrives else t + tried
        changed = change_strings(t, y, laws, c)
        for p in range(n - 1):
            _, _, eps, eps_dot = approach(at, p, c)
            if pair_margin(at, p, laws.pressing[p], False, c) < 0.0:
                changed = True
                laws.pressing[p] = not laws.pressing[p]
                if laws.pressing[p]:
                    laws.sticking[p] = True
                    began[0, p], began[1, p], began[2, p] = t, eps_dot, y[CONTACT_WORK, p]
                    h = first_step
                else:
                    count = note_contact(contacts, count, t, p, began, y[CONTACT_WORK, p])
            elif laws.sticking[p] and -eps > c.sticky_range:
                laws.sticking[p] = False  # the force has fallen to nothing by then
        copy(k[6], k[0])
        if changed:
            derivative(t, y, laws, c, at, k[0])
    for p in range(n - 1):
        if laws.pressing[p]:
            count = note_contact(contacts, count, t, p, began, y[CONTACT_WORK, p])
    return count


@entry
def other_forces_at_rest(y: Array, laws: Laws, c: Constants, at: Array) -> None:
    """`other_forces` of a state at rest at t = 0."""
    kinematics(y, c, at)
    other_forces(0.0, y, laws, c, at)


def integrate(y: Array, times: Array, c: Constants, tolerance: float, max_step: float) -> tuple[Array, Array]:
    """States (T, 7, N + 1) at `times` from y at t = 0; contacts (K, 5): time, pair from 1, speed, duration, loss."""
    n, room = len(c.mass), 10_000
    states = np.empty((len(times), *y.shape))
    stages, new, at, at_new = np.empty((7, *y.shape)), np.empty_like(y), np.empty((9, n)), np.empty((9, n))
    scratch = Scratch(stages, new, at, at_new, np.zeros(n - 1, np.bool_), np.zeros((3, n - 1)))
    while True:
        contacts = np.empty((room, 5))
        count = advance(y.copy(), times, c, tolerance, max_step, laws_at_first(n), scratch, states, contacts)
        if count <= room:
            return states, contacts[:count]
        room = count


def forces_at_rest(y: Array, c: Constants) -> tuple[Array, Array]:
    """Forces (F_x, F_y), (N,) each, of all but weight, strings and contacts on bobs at rest at t = 0."""
    at = np.empty((9, len(c.mass)))
    other_forces_at_rest(y, laws_at_first(len(c.mass)), c, at)
    return at[FX], at[FY]


def laws_at_first(n: int) -> Laws:
    """Virgin strings, no contacts."""
    return Laws(np.full(n, LOADING), np.zeros((2, n)), np.zeros(n - 1, np.bool_), np.zeros(n - 1, np.bool_))
