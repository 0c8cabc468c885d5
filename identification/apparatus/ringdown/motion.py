"""The motion of one damped bob on its strings, fitted to a ring-down.

The model is that of the simulator: a pendulum at any angle on strings with the hysteresis of eq. 4, so that what the
strings take is not counted as drag, with the drag

    F = −b v − c2 |v| v,   and the torque   −τ_c tanh(θ̇ / 0.02 rad/s),

of which b is always there, and c2 and τ_c where `terms` says so. Unknown besides are the angle and its rate at the
first reading, the length of the strings (the period tells it), the zero of the angle, and, with hysteresis, how far
the strings have worn in: until they have, they grow longer and the period with them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from scipy.optimize import least_squares

from cradle_env.cradle import Cradle
from cradle_env.release import InitialState
from cradle_env.simulation import simulate
from identification.apparatus.residuals import correlation_of
from identification.apparatus.ringdown.swings import Swing

#: Terms of the damping beside b, by the name of the effect that they are, and their parameter.
TERMS = {"quadratic_drag": "c2", "pivot_friction": "tau_c"}
#: Parameters that every fit has, in this order; those of its terms follow, then the memory of strings that have one.
COMMON = ("theta", "theta_dot", "length", "offset", "b")
#: Tension of a string over that of a new one: where fits begin (worn in, it is T = κ s/2), and its bounds.
MEMORY, _MEMORIES, _MEMORY_BOUNDS = "memory", (0.52, 0.98), (0.3, 1.0)
#: Horizons of the fit, in periods: each starts where the last ended, so that no swing is miscounted.
_HORIZONS = (4.0, 16.0, 64.0, np.inf)
#: Step of a numerical derivative, in units of a parameter's scale.
_STEP = 1e-4
#: Periods in a window whose amplitude is taken.
_WINDOW = 3.0


@dataclass(frozen=True, eq=False)
class Fit:
    """One ring-down fitted with some terms.

    terms: beside b; parameters, covariance: in the order of `names`, the covariance widened by `inflation`, how many
    successive residuals count for one; rss: residual sum of squares [rad²]; model (T,) [rad].
    """

    swing: Swing
    terms: tuple[str, ...]
    parameters: np.ndarray
    covariance: np.ndarray
    inflation: float
    rss: float
    model: np.ndarray

    @property
    def residual(self) -> np.ndarray:
        """Readings less model (T,) [rad]."""
        return self.swing.angle - self.model

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return _names(self.swing.cradle, self.terms)

    def of(self, name: str) -> tuple[float, float]:
        """(value, standard deviation) of a parameter by its name."""
        k = self.names.index(name)
        return float(self.parameters[k]), float(np.sqrt(self.covariance[k, k]))


def _names(cradle: Cradle, terms: tuple[str, ...]) -> tuple[str, ...]:
    return (*COMMON, *terms, *((MEMORY,) if cradle.has("string_hysteresis") else ()))


def damped(cradle: Cradle, terms: tuple[str, ...], parameters: np.ndarray, times: np.ndarray) -> np.ndarray:
    """θ (T,) [rad] of a bob with these parameters at these times [s]."""
    of = dict(zip(_names(cradle, terms), parameters, strict=True))
    bob = cradle.replace(length=of["length"], b=of["b"], effects={name: {TERMS[name]: of[name]} for name in terms})
    memory = np.array([of[MEMORY]]) if MEMORY in of else None
    start = InitialState(np.array([of["theta"]]), np.array([of["theta_dot"]]), tension_ratio=memory)
    return simulate(bob, start, times=times, ledger=False).theta[:, 0] + of["offset"]


def fit(swing: Swing, terms: tuple[str, ...], near: Fit | None = None) -> Fit:
    """Least squares; near: a fit of the same swing with fewer terms, from where to start."""
    size = float(np.sqrt(2.0 * np.mean(swing.angle[: len(swing.angle) // 4 + 2] ** 2)))
    omega = np.sqrt(swing.cradle.gravity / swing.cradle.length)
    speed, mass = size * omega * swing.cradle.length, swing.cradle.mass
    drag = mass * 0.01  # b that takes a tenth of the amplitude in 20 s
    scales = {
        "theta": size,
        "theta_dot": size * omega,
        "length": 0.01 * swing.cradle.length,
        "offset": 0.01 * size,
        "b": drag,
        "quadratic_drag": drag / speed,
        "pivot_friction": drag * speed * swing.cradle.length,
        MEMORY: 0.1,
    }
    if near is not None:
        known = {name: 0.1 * scales[name] for name in terms} | dict(zip(near.names, near.parameters, strict=True))
        return _descend(swing, terms, known, scales, _HORIZONS[-1:])
    known = dict(zip(COMMON, (*_first_guess(swing), drag), strict=True)) | {name: 0.1 * scales[name] for name in terms}
    memories = _MEMORIES if swing.cradle.has("string_hysteresis") else (1.0,)
    fits = [_descend(swing, terms, known | {MEMORY: memory}, scales, _HORIZONS) for memory in memories]
    return min(fits, key=lambda one: one.rss)


def _descend(
    swing: Swing,
    terms: tuple[str, ...],
    known: Mapping[str, float],
    scales_of: Mapping[str, float],
    horizons: Sequence[float],
) -> Fit:
    """Least squares from the values that are known, all unknowns in units of their scales."""
    names = _names(swing.cradle, terms)
    scales = np.array([scales_of[name] for name in names])
    bounds = {
        "theta": (-1.4, 1.4),
        "theta_dot": (-np.inf, np.inf),
        "length": (0.3 * known["length"], 3.0 * known["length"]),
        "offset": (-0.5, 0.5),
        MEMORY: _MEMORY_BOUNDS,
    }
    low, high = np.array([bounds.get(name, (0.0, np.inf)) for name in names]).T / scales
    unit = np.array([known[name] for name in names]) / scales
    found = None
    for horizon in horizons:
        rows = swing.times <= horizon * swing.cradle.period
        if rows.sum() <= len(unit):
            continue

        def residual(unit: np.ndarray, rows: np.ndarray = rows) -> np.ndarray:
            return damped(swing.cradle, terms, unit * scales, swing.times[rows]) - swing.angle[rows]

        def jacobian(unit: np.ndarray, residual: Callable = residual) -> np.ndarray:
            here = residual(unit)
            steps = np.diag(np.where(unit + _STEP > high, -_STEP, _STEP))
            return np.column_stack([(residual(unit + step) - here) / step.sum() for step in steps])

        unit = np.clip(unit, low + 1e-6, high - 1e-6)
        found = least_squares(
            residual, unit, cast(Any, jacobian), bounds=(low, high), xtol=1e-6, ftol=1e-7, max_nfev=60
        )
        unit = found.x
        if rows.all():
            break
    assert found is not None
    parameters = unit * scales
    model = damped(swing.cradle, terms, parameters, swing.times)
    left = swing.angle - model
    inflation, rss = correlation_of(left), float(left @ left)
    variance = rss / max(len(left) - len(unit), 1) * inflation
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * variance * np.outer(scales, scales)
    return Fit(swing, terms, parameters, covariance, inflation, rss, model)


def amplitudes(swing: Swing, angle: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """(time [s], amplitude [rad]) of successive windows of an angle (T,): of the sine that fits best in each."""
    edges = np.arange(0.0, swing.times[-1], _WINDOW * period)
    middles, sizes = [], []
    for start in edges:
        rows = (swing.times >= start) & (swing.times < start + _WINDOW * period)
        if rows.sum() < 8 or swing.times[-1] < start + 0.9 * _WINDOW * period:
            continue
        phase = 2.0 * np.pi * swing.times[rows] / period
        basis = np.column_stack([np.cos(phase), np.sin(phase), np.ones(rows.sum())])
        solution = np.linalg.lstsq(basis, angle[rows], rcond=None)[0]
        middles.append(start + 0.5 * _WINDOW * period)
        sizes.append(np.hypot(solution[0], solution[1]))
    return np.array(middles), np.array(sizes)


def period_of(swing: Swing) -> float:
    """The period [s] of a swing by its strongest frequency, to a small part of a swing over the whole."""
    span, nominal = swing.times[-1], swing.cradle.period
    frequencies = np.arange(0.5 / nominal, 1.6 / nominal, 0.1 / span)
    even = np.linspace(0.0, span, 2 * round(span / nominal) * 16)
    angle = np.interp(even, swing.times, swing.angle)
    strength = np.abs(np.exp(-2j * np.pi * np.outer(frequencies, even)) @ angle)
    return float(1.0 / frequencies[int(np.argmax(strength))])


def _first_guess(swing: Swing) -> tuple[float, float, float, float]:
    """Angle and rate at the first reading, length and offset."""
    period = period_of(swing)
    rows = swing.times <= 2.0 * period
    phase = 2.0 * np.pi * swing.times[rows] / period
    basis = np.column_stack([np.cos(phase), np.sin(phase), np.ones(rows.sum())])
    cosine, sine, offset = np.linalg.lstsq(basis, swing.angle[rows], rcond=None)[0]
    height = swing.cradle.gravity * (period / (2.0 * np.pi)) ** 2
    sag = swing.cradle.mass * swing.cradle.gravity / swing.cradle.radial_stiffness
    length = height - (sag if swing.cradle.has("radial_elasticity") else 0.0)
    return float(cosine), float(sine * 2.0 * np.pi / period), float(length), float(offset)
