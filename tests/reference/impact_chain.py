"""Balls on a line that collide by eq. 1, by SciPy alone: what measurements of impacts are tested on.

Nothing of the package is used.
"""

import functools

import numpy as np
from scipy.integrate import solve_ivp

MASS, RADIUS, YOUNG, POISSON = 0.2813, 0.020, 200e9, 0.29
K_EL = 2.0 / 3.0 * YOUNG / (1.0 - POISSON**2) * np.sqrt(RADIUS / 2.0)


@functools.cache
def collide(bobs, speed, k_f, k_el=K_EL, mass=MASS):
    """(velocities (N,) after [m/s], duration of the first contact [s]): the first ball hits the others, which touch."""

    def forces(y):
        x, v = y[:bobs], y[bobs:]
        overlap = np.maximum(x[:-1] - x[1:], 0.0)
        return np.maximum(k_el * overlap**1.5 + k_f * np.sqrt(overlap) * (v[:-1] - v[1:]), 0.0) * (overlap > 0.0)

    def slope(_, y):
        f = forces(y)
        return np.concatenate([y[bobs:], (np.append(0.0, f) - np.append(f, 0.0)) / mass])

    scale = (0.5 * mass / k_el) ** 0.4 * speed**-0.2
    start = np.zeros(2 * bobs)
    start[bobs] = speed
    start[0] = 1e-9 * speed * scale  # a contact that has just begun

    def push(_, y):
        """What the first contact would push with, over √overlap, if it could also pull."""
        return k_el * (y[0] - y[1]) + k_f * (y[bobs] - y[bobs + 1])

    def last(_, y):
        """Falls below zero when all are apart, and none goes after another."""
        return 1.0 if (np.diff(y[:bobs]) <= 0.0).any() or (np.diff(y[bobs:]) < 0.0).any() else -1.0

    push.direction, last.terminal = -1.0, True
    span, events = (0.0, 40.0 * scale), (push, last)
    found = solve_ivp(slope, span, start, "DOP853", rtol=1e-10, atol=1e-16, max_step=scale / 40, events=events)
    return found.y[bobs:, -1], float(found.t_events[0][0])
