"""Compiled part of `soft_contact`: forces, Dormand-Prince steps, the location of every change of law.

Nothing is validated. N bobs, pair p joins bobs p and p + 1 (from 0). A state is (5, N), rows below.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

Array = np.ndarray

RIGID, ELASTIC, HYSTERETIC = 0, 1, 2
SLACK, LOADING, UNLOADING = 0, 1, 2
R, THETA, R_DOT, THETA_DOT, WORK = 0, 1, 2, 3, 4  # rows of a state; WORK[p] is what contact p has absorbed, J
STRING_NOISE = 1e-13  # m or m/s past which strings change law: rounding must not reverse a bob at rest
EVENT_TIME = 1e-12  # s, to which a change of law is located
FRICTION_SPEED = 0.02  # rad/s over which pivot friction changes its sign

# Dormand & Prince (1980), RK5(4)7M: stage weights, and the difference of the two solutions.
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


class Constants(NamedTuple):
    """What the compiled functions need; arrays per bob (N,) or per pair (N-1,)."""

    mass: Array
    length: Array
    string_length: Array  # sqrt(r0^2 + a^2) per bob
    spacing: Array  # distance of neighbouring pivots per pair
    pivot_half_spacing: float
    strings: int
    kappa: float
    gravity: float
    b: float
    c2: float
    tau_c: float
    diameter: float
    k_el: float
    k_f: float


@njit
def tension(s: float, law: int, s_turn: float, t_turn: float, kappa: float) -> float:
    """Tension (N) of one string stretched by s, on the line through its last reversal: eq. (4)."""
    if law == SLACK:
        return 0.0
    if law == LOADING:
        return t_turn + kappa * (s - s_turn)
    return t_turn * (s / s_turn) ** 2


@njit
def stretch(y: Array, i: int, c: Constants) -> float:
    """Stretch s (m) of the strings of bob i."""
    return np.sqrt(y[R, i] ** 2 + c.pivot_half_spacing**2) - c.string_length[i]


@njit
def approach(y: Array, p: int, c: Constants) -> tuple[float, float, float, float]:
    """Unit vector (nx, ny) from bob p to p + 1, their overlap eps (m; < 0 apart) and eps' (m/s)."""
    sin0, cos0 = np.sin(y[THETA, p]), np.cos(y[THETA, p])
    sin1, cos1 = np.sin(y[THETA, p + 1]), np.cos(y[THETA, p + 1])
    r0, r1, dr0, dr1 = y[R, p], y[R, p + 1], y[R_DOT, p], y[R_DOT, p + 1]
    swing0, swing1 = r0 * y[THETA_DOT, p], r1 * y[THETA_DOT, p + 1]
    dx, dy = c.spacing[p] + r1 * sin1 - r0 * sin0, r0 * cos0 - r1 * cos1
    distance = np.sqrt(dx**2 + dy**2)
    nx, ny = dx / distance, dy / distance
    vx = dr1 * sin1 + swing1 * cos1 - dr0 * sin0 - swing0 * cos0
    vy = -dr1 * cos1 + swing1 * sin1 + dr0 * cos0 - swing0 * sin0
    return nx, ny, c.diameter - distance, -(nx * vx + ny * vy)


@njit
def derivative(y: Array, law: Array, turn: Array, pressing: Array, c: Constants, dy: Array) -> None:
    """Write d(state)/dt to dy (5, N); the laws in force: law (N,), turn (s*, T*) (2, N), pressing (N-1,)."""
    n = y.shape[1]
    for i in range(n):
        r, theta, r_dot, theta_dot = y[R, i], y[THETA, i], y[R_DOT, i], y[THETA_DOT, i]
        swing = r * theta_dot
        drag = c.b + c.c2 * np.sqrt(r_dot**2 + swing**2)
        one_string = tension(stretch(y, i, c), law[i], turn[0, i], turn[1, i], c.kappa)
        pull = 4 * one_string * c.length[i] / c.string_length[i]
        force_r = c.mass[i] * c.gravity * np.cos(theta) - pull - drag * r_dot
        force_theta = -c.mass[i] * c.gravity * np.sin(theta) - drag * swing
        if c.tau_c != 0.0:
            force_theta -= c.tau_c * np.tanh(theta_dot / FRICTION_SPEED) / r
        dy[R, i], dy[THETA, i] = r_dot, theta_dot
        dy[R_DOT, i] = force_r / c.mass[i] + swing * theta_dot
        dy[THETA_DOT, i] = (force_theta / c.mass[i] - 2 * r_dot * theta_dot) / r
        dy[WORK, i] = 0.0
    for p in range(n - 1):
        if pressing[p]:
            nx, ny, eps, eps_dot = approach(y, p, c)
            root_eps = np.sqrt(max(eps, 0.0))
            force = root_eps * (c.k_el * eps + c.k_f * eps_dot)
            dy[WORK, p] = force * eps_dot
            for i, push in ((p, -force), (p + 1, force)):
                sin, cos = np.sin(y[THETA, i]), np.cos(y[THETA, i])
                dy[R_DOT, i] += push * (nx * sin - ny * cos) / c.mass[i]
                dy[THETA_DOT, i] += push * (nx * cos + ny * sin) / (c.mass[i] * y[R, i])
    if c.strings == RIGID:
        dy[R_DOT] = 0.0


@njit
def step(y: Array, h: float, k: Array, law: Array, turn: Array, pressing: Array, c: Constants, new: Array) -> float:
    """One Dormand-Prince step from y to new; k (7, 5, N): stages, k[0] ready. Returns the largest error."""
    flat, flat_new, flat_k = y.ravel(), new.ravel(), k.reshape(7, -1)
    for stage in range(1, 7):
        for j in range(flat.size):
            slope = 0.0
            for earlier in range(stage):
                slope += STAGES[stage, earlier] * flat_k[earlier, j]
            flat_new[j] = flat[j] + h * slope
        derivative(new, law, turn, pressing, c, k[stage])
    worst = 0.0
    for j in range(flat.size):
        slope = 0.0
        for stage in range(7):
            slope += ERROR[stage] * flat_k[stage, j]
        worst = max(worst, abs(h * slope))
    return worst


@njit
def string_margin(y: Array, i: int, law: Array, c: Constants) -> float:
    """How far the strings of bob i are inside their present law; < 0: it has ended."""
    if c.strings == RIGID:
        return 1.0
    s = stretch(y, i, c)
    if law[i] == SLACK:
        return STRING_NOISE - s
    if c.strings == ELASTIC:
        return STRING_NOISE + s
    if law[i] == LOADING:
        return STRING_NOISE + y[R_DOT, i]
    return STRING_NOISE + min(s, -y[R_DOT, i])


@njit
def pair_margin(y: Array, p: int, pressing: Array, watched: Array, c: Constants) -> float:
    """How far pair p is inside its present law (m); < 0: it has ended.

    The force is positive where eps > 0 and eps + (k_f/k_el) eps' > 0. A watched pair, one that may come into
    touch and part again within the step, also ends it where it stops closing: no graze is stepped over.
    """
    _, _, eps, eps_dot = approach(y, p, c)
    push = eps + c.k_f / c.k_el * eps_dot
    if pressing[p]:
        return push
    margin = -min(eps, push)
    return min(margin, eps_dot) if watched[p] else margin


@njit
def least_margin(y: Array, law: Array, pressing: Array, watched: Array, c: Constants) -> float:
    """The least of all margins: positive as long as every law holds."""
    least = np.inf
    for i in range(law.size):
        least = min(least, string_margin(y, i, law, c))
    for p in range(pressing.size):
        least = min(least, pair_margin(y, p, pressing, watched, c))
    return least


@njit
def change_strings(y: Array, law: Array, turn: Array, c: Constants) -> None:
    """Change the law of every string whose own has ended; the reversal is remembered, slack forgets."""
    for i in range(law.size):
        if string_margin(y, i, law, c) >= 0.0:
            continue
        s = stretch(y, i, c)
        if law[i] == SLACK:
            law[i] = LOADING
        elif s < 0.0:
            law[i] = SLACK
            turn[:, i] = 0.0
        else:
            turn[1, i] = tension(s, law[i], turn[0, i], turn[1, i], c.kappa)
            turn[0, i] = s
            law[i] = UNLOADING if law[i] == LOADING else LOADING


@njit
def locate(
    y: Array,
    h: float,
    k: Array,
    law: Array,
    turn: Array,
    pressing: Array,
    watched: Array,
    c: Constants,
    new: Array,
) -> float:
    """Shorten a step from y, at whose end some law has ended, to the first such instant: `new` just past it.

    The root of the least margin as a function of the step, by bracketed secants (Illinois), every third trial
    a bisection. Each trial is a whole Dormand-Prince step, so no interpolation enters.
    """
    low, high = 0.0, h
    margin_low = max(least_margin(y, law, pressing, watched, c), 0.0)
    margin_high = least_margin(new, law, pressing, watched, c)
    side = trials = 0
    while high - low > EVENT_TIME:
        trials += 1
        share = 0.5 if trials % 3 == 0 else margin_low / (margin_low - margin_high)
        trial = min(max(low + share * (high - low), low + 0.5 * EVENT_TIME), high - 0.5 * EVENT_TIME)
        step(y, trial, k, law, turn, pressing, c, new)
        margin = least_margin(new, law, pressing, watched, c)
        if margin < 0.0:
            high, margin_high = trial, margin
            margin_low *= 0.5 if side < 0 else 1.0
            side = -1
        else:
            low, margin_low = trial, margin
            margin_high *= 0.5 if side > 0 else 1.0
            side = 1
    step(y, high, k, law, turn, pressing, c, new)
    return high


@njit
def integrate(
    y: Array, times: Array, c: Constants, tolerance: float, max_step: float
) -> tuple[Array, list[tuple[float, int, float, float, float]]]:
    """States (T, 5, N) at `times` from y at t = 0; rows (time, pair from 1, speed, duration, energy lost)."""
    n = y.shape[1]
    law, turn = np.full(n, LOADING), np.zeros((2, n))
    pressing, unwatched = np.zeros(n - 1, np.bool_), np.zeros(n - 1, np.bool_)
    watched = unwatched.copy()
    began = np.zeros((3, n - 1))  # time, speed and WORK at the beginning of the present contact
    contacts = [(0.0, 0, 0.0, 0.0, 0.0) for _ in range(0)]
    states = np.empty((times.size, 5, n))
    k, new = np.empty((7, 5, n)), np.empty((5, n))
    # At first touch the force rises like a square root: begin with 1e-4 of a contact at 1 m/s, let h grow.
    first_step = 1e-4 * (c.mass.min() / c.k_el) ** 0.4
    for p in range(n - 1):
        pressing[p] = pair_margin(y, p, pressing, unwatched, c) < 0.0
    t, h, wanted = 0.0, first_step, 0
    while wanted < times.size:
        if t >= times[wanted]:
            states[wanted] = y
            wanted += 1
            continue
        derivative(y, law, turn, pressing, c, k[0])
        tried = min(h, max_step)
        arrives = tried >= times[wanted] - t
        if arrives:
            tried = times[wanted] - t
        error = step(y, tried, k, law, turn, pressing, c, new) / tolerance
        growth = min(5.0, max(0.2, 0.9 * max(error, 1e-10) ** -0.2))
        if error > 1.0:
            h = tried * growth
            continue
        if not arrives or growth < 1.0:
            h = tried * growth
        for p in range(n - 1):
            _, _, eps, eps_dot = approach(y, p, c)
            watched[p] = not pressing[p] and eps < 0.0 and eps + eps_dot * tried > 0.0
        if least_margin(new, law, pressing, watched, c) < 0.0:
            arrives = False
            tried = locate(y, tried, k, law, turn, pressing, watched, c, new)
        y[:] = new
        t = times[wanted] if arrives else t + tried
        change_strings(y, law, turn, c)
        for p in range(n - 1):
            if pair_margin(y, p, pressing, unwatched, c) < 0.0:
                pressing[p] = not pressing[p]
                if pressing[p]:
                    began[0, p], began[1, p], began[2, p] = t, approach(y, p, c)[3], y[WORK, p]
                    h = first_step
                else:
                    contacts.append((began[0, p], p + 1, began[1, p], t - began[0, p], y[WORK, p] - began[2, p]))
    for p in range(n - 1):
        if pressing[p]:
            contacts.append((began[0, p], p + 1, began[1, p], t - began[0, p], y[WORK, p] - began[2, p]))
    return states, contacts
