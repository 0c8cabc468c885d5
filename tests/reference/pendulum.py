"""One damped bob, by SciPy alone: the ring-downs that measurements of the damping are tested on.

Nothing of the package is used. On strings that do not stretch,

    m L² θ'' = −m g L sin θ − b L² θ' − c2 L³ |θ'| θ' − τ_c tanh(θ'/0.02 rad/s),

and on the strings of eq. 4 the soft-contact reference with one bob.
"""

import numpy as np
from scipy.integrate import solve_ivp

MASS, LENGTH, GRAVITY = 0.2813, 0.30, 9.81


def ring_down(angle, b, *, c2=0.0, tau_c=0.0, duration=60.0, rate=60.0, length=LENGTH, mass=MASS):
    """(times (T,) [s], θ (T,) [rad]) of a bob let go at rest at `angle` [rad]."""

    def slope(_, y):
        theta, omega = y
        torque = b * length**2 * omega + c2 * length**3 * abs(omega) * omega + tau_c * np.tanh(omega / 0.02)
        return omega, -GRAVITY / length * np.sin(theta) - torque / (mass * length**2)

    times = np.arange(int(duration * rate) + 1) / rate
    found = solve_ivp(slope, (0.0, times[-1]), (angle, 0.0), "DOP853", times, rtol=1e-9, atol=1e-11)
    return times, found.y[0]


def csv_of(path, times, readings):
    """A CSV of angles (T, N) in the strict form of an experiment's data."""
    readings = np.reshape(readings, (len(times), -1))
    header = ",".join(["t [s]", *(f"theta_{i + 1} [rad]" for i in range(readings.shape[1]))])
    rows = (",".join(map(repr, map(float, row))) for row in np.column_stack([times, readings]))
    path.write_text("\n".join([header, *rows, ""]), encoding="utf-8")
    return path
