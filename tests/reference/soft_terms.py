"""Forces that a cradle may have beside weight, strings, drag b and contact: small compiled functions, by name.

Some belong to the catalogue of effects and bear its names and keys; the others are apparatus that no catalogue
foresees, or that differs in detail from its formulas. Each function has its parameters p in the order of the keys
in its table below; the first key is the strength, at 0 the term is absent. SI units, radians.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .compiled import inner

SIGN_CHANGE = 0.02  # rad/s over which dry friction changes its sign
NUMBER = 5  # column of a row of parameters that says whose they are


# Torque (N m) at a pivot where the string turns at `rate` (rad/s).


@inner
def pivot_friction(p, rate):
    """-tau_c tanh(rate/0.02)."""
    return -p[0] * np.tanh(rate / SIGN_CHANGE)


@inner
def smooth_friction(p, rate):
    """-tau_c rate/(|rate| + rate_0): reaches its full value slowly, like 1 - rate_0/rate."""
    return -p[0] * rate / (abs(rate) + p[1])


@inner
def stribeck_friction(p, rate):
    """-(tau_c + (tau_s - tau_c) exp(-(rate/rate_0)^2)) tanh(rate/0.02): tau_s when all but at rest, tau_c when fast."""
    return -(p[0] + (p[1] - p[0]) * np.exp(-((rate / p[2]) ** 2))) * np.tanh(rate / SIGN_CHANGE)


# Force (F_x, F_y) on one bob (number from 1) at angle theta on radius r, x from the middle of the room, velocity there.


@inner
def quadratic_drag(p, t, bob, mass, r, theta, x, vx, vy):
    """-c2 |v| v."""
    drag = -p[0] * np.hypot(vx, vy)
    return drag * vx, drag * vy


@inner
def power_drag(p, t, bob, mass, r, theta, x, vx, vy):
    """-c |v|^(power - 1) v."""
    speed = np.hypot(vx, vy)
    drag = -p[0] * speed ** (p[1] - 1) if speed > 0.0 else 0.0
    return drag * vx, drag * vy


@inner
def side_wind(p, t, bob, mass, r, theta, x, vx, vy):
    """F_x = force exp(-((x - centre)/width)^2): a steady jet; the same everywhere for width = inf."""
    return p[0] * np.exp(-(((x - p[1]) / p[2]) ** 2)), 0.0


@inner
def vibration(p, t, bob, mass, r, theta, x, vx, vy):
    """F_x = mass acceleration sin(2 pi frequency t + phase): what bobs feel in a room that shakes."""
    return mass * p[0] * np.sin(2 * np.pi * p[1] * t + p[2]), 0.0


@inner
def magnet(p, t, bob, mass, r, theta, x, vx, vy):
    """Along th^, -U'(theta)/r of U = -energy exp(-((theta - angle)/width)^2), on bob number p[1] alone."""
    if bob != p[1]:
        return 0.0, 0.0
    away = (theta - p[2]) / p[3]
    force = -2 * p[0] * away / (p[3] * r) * np.exp(-(away**2))
    return force * np.cos(theta), force * np.sin(theta)


# Repulsion (N) of two neighbours along their line of centres, surfaces `gap` apart (m; < 0: pressed), gap' = `rate`.


@inner
def bob_attraction(p, gap, rate):
    """-force exp(-gap/range), -force in touch."""
    return -p[0] * np.exp(-max(gap, 0.0) / p[1])


@inner
def power_attraction(p, gap, rate):
    """-force (1 + gap/distance)^-power, -force in touch: like that of magnets, with a long tail."""
    return -p[0] * (1 + max(gap, 0.0) / p[1]) ** -p[2]


@inner
def squeeze_film(p, gap, rate):
    """-coefficient gap'/(gap + floor)^3: air pressed out of the gap and drawn back in; coefficient in N s m^2."""
    return -p[0] * rate / (max(gap, 0.0) + p[1]) ** 3


class Term(NamedTuple):
    """A compiled function and its keys, with the values they have where not given; None: must be given."""

    function: Callable
    keys: dict[str, float | None]


TORQUES = {
    "pivot_friction": Term(pivot_friction, {"tau_c": None}),
    "smooth_friction": Term(smooth_friction, {"tau_c": None, "rate": 0.2}),
    "stribeck_friction": Term(stribeck_friction, {"tau_c": None, "tau_s": None, "rate": 0.2}),
}
BOB_FORCES = {
    "quadratic_drag": Term(quadratic_drag, {"c2": None}),
    "power_drag": Term(power_drag, {"c": None, "power": 1.5}),
    "side_wind": Term(side_wind, {"force": None, "centre": 0.0, "width": np.inf}),
    "vibration": Term(vibration, {"acceleration": None, "frequency": None, "phase": 0.0}),
    "magnet": Term(magnet, {"energy": None, "bob": None, "angle": 0.0, "width": 0.05}),
}
PAIR_FORCES = {
    "bob_attraction": Term(bob_attraction, {"force": None, "range": 5e-3}),
    "power_attraction": Term(power_attraction, {"force": None, "distance": 5e-3, "power": 4.0}),
    "squeeze_film": Term(squeeze_film, {"coefficient": None, "floor": 1e-4}),
}


def chosen(table: dict[str, Term]) -> Callable:
    """Compiled f(row, ...): the function of the table that a row of `rows` belongs to, called with that row."""
    functions = [term.function for term in table.values()]

    def from_number(number: int) -> Callable:
        function = functions[number]

        @inner
        def last(row, *state):
            return function(row, *state)

        if number + 1 == len(functions):
            return last
        others = from_number(number + 1)

        @inner
        def first_or_others(row, *state):
            if row[NUMBER] == number:
                return function(row, *state)
            return others(row, *state)

        return first_or_others

    return from_number(0)


def rows(table: dict[str, Term], effects: dict[str, dict[str, float]]) -> np.ndarray:
    """The terms of the table that are present, (K, NUMBER + 1): parameters, and which function of the table it is."""
    present = []
    for number, (name, term) in enumerate(table.items()):
        values = [{**term.keys, **effects.get(name, {})}[key] for key in term.keys]
        if name in effects and values[0] != 0.0:
            present.append([*values, *[0.0] * (NUMBER - len(values)), number])
    return np.array(present, float).reshape(-1, NUMBER + 1)
