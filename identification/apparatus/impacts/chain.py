"""What an impact on a line of bobs at rest gives to the last of them, by eq. 1 (Kuwabara and Kono).

The ratio of the last bob's speed to the first's depends on the number of bobs and on one number alone,
A = k_f k_el^(−3/5) m_eff^(−2/5) v^(1/5), m_eff = m/2: it is computed once by the simulator and interpolated.
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.interpolate import BarycentricInterpolator

from cradle_env.constitutive import contact_times, restitution_curve
from cradle_env.cradle import Cradle
from cradle_env.release import InitialState
from cradle_env.simulation import simulate

#: Largest A that is tabulated (e is 0.3 there), and the number of nodes in √A, in which the ratio is smooth.
MOST, _NODES = 1.0, 24
#: Speed at which the table is computed [m/s]: any does.
_SPEED = 0.4


def dissipation(k_f: float, k_el: float, mass: float, speeds: np.ndarray) -> np.ndarray:
    """A of impacts at these speeds [m/s]."""
    return k_f * k_el**-0.6 * (0.5 * mass) ** -0.4 * np.asarray(speeds) ** 0.2


def passed_on(bobs: int, A: np.ndarray) -> np.ndarray:
    """Speed of the last of `bobs` bobs over that of the first, which hits the others at rest and in touch."""
    nodes, ratios = _table(bobs)
    return BarycentricInterpolator(nodes, ratios)(np.sqrt(np.clip(A, 0.0, MOST)))


def passed_on_apart(bobs: int, A: np.ndarray) -> np.ndarray:
    """The same where the bobs at rest do not quite touch: one pair impact after the other."""
    A, share = np.asarray(A, dtype=float), np.ones(np.shape(A))
    for _ in range(bobs - 1):
        share = share * 0.5 * (1.0 + restitution(A * share**0.2))
    return share


def restitution(A: np.ndarray) -> np.ndarray:
    """e of a pair impact with dissipation A."""
    return _pair(np.asarray(A, dtype=float))[0]


def duration(A: np.ndarray) -> np.ndarray:
    """Contact time of a pair impact over (m_eff/k_el)^(2/5) v^(−1/5)."""
    return _pair(np.asarray(A, dtype=float))[1]


def _pair(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(e, scaled contact time), by the speeds at which one cradle has these A."""
    cradle = Cradle(bobs=2, model="ho")
    unit = dissipation(cradle.k_f, cradle.k_el, cradle.mass, np.array(1.0))
    speeds = np.maximum(np.clip(A, 1e-9, MOST) / unit, 1e-6) ** 5
    scale = (0.5 * cradle.mass / cradle.k_el) ** 0.4 * speeds**-0.2
    return restitution_curve(cradle, speeds), contact_times(cradle, speeds) / scale


@functools.cache
def _table(bobs: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes in √A (Chebyshev), and the ratios there."""
    angles = np.pi * (np.arange(_NODES) + 0.5) / _NODES
    nodes = 0.5 * np.sqrt(MOST) * (1.0 - np.cos(angles))
    cradle = Cradle(bobs=bobs, model="ho", b=0.0)
    unit = dissipation(1.0, cradle.k_el, cradle.mass, np.array(_SPEED))
    hit = np.zeros(bobs)
    hit[0] = _SPEED / cradle.length
    ratios = []
    for node in nodes:
        one = cradle.replace(k_f=float(node**2 / unit))
        run = simulate(one, InitialState(np.zeros(bobs), hit), times=np.array([0.0, 1e-9]), ledger=False)
        ratios.append(run.theta_dot[-1, -1] / hit[0])
    return nodes, np.array(ratios)
