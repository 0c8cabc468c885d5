"""The Kuwabara-Kono impact of two spheres (eq. 1) as universal curves, and the restitution e(v).

With x the overlap in units of v t0 and t in units of t0 = (m_eff / k_el)^(2/5) v^(-1/5), eq. 1 becomes
x'' = -x^(3/2) - A x^(1/2) x', x(0) = 0, x'(0) = 1, with one parameter A = k_f k_el^(-3/5) m_eff^(-2/5) v^(1/5).
The impact ends when the force vanishes; then e = -x'. With x = p^2, w = x' + (2/3) A p^3 and dt = p dtau the
equations are polynomial, hence smooth at first touch where eq. 1 is not:

    dp/dtau = (w - (2/3) A p^3) / 2,   dw/dtau = -p^4,   dt/dtau = p,   end: p^2 + A x' = 0.

e and the contact time are analytic in sqrt(A) at 0 (Schwager & Poeschel, Phys. Rev. E 78, 051304 (2008)).
"""

import math

import numpy as np

from cradle_env.mechanics.jit import entry, jit, once
from cradle_env.mechanics.layout import CONSTANT, KUWABARA_KONO

# Nodes of the curves, uniform in u = sqrt(A) / (1 + sqrt(A)) so that 0 <= A < inf maps to 0 <= u < 1.
_INTERVALS = 1024
_STENCIL = 8  # nodes of the local interpolation


@jit
def _slope(A, p, w):
    x_dot = w - (2.0 / 3.0) * A * p**3
    return 0.5 * x_dot, -(p**4), p


@jit
def _rk4(A, p, w, t, h):
    """One fourth-order step of (p, w, t) over h in tau."""
    a1, b1, c1 = _slope(A, p, w)
    a2, b2, c2 = _slope(A, p + 0.5 * h * a1, w + 0.5 * h * b1)
    a3, b3, c3 = _slope(A, p + 0.5 * h * a2, w + 0.5 * h * b2)
    a4, b4, c4 = _slope(A, p + h * a3, w + h * b3)
    s = h / 6.0
    return p + s * (a1 + 2 * a2 + 2 * a3 + a4), w + s * (b1 + 2 * b2 + 2 * b3 + b4), t + s * (c1 + 2 * c2 + 2 * c3 + c4)


@jit
def pair_impact(A):
    """(e, contact time in units of t0) of one impact with dissipation A >= 0, to some 1e-12."""
    h = 0.004 / (1.0 + A) ** (1.0 / 3.0)  # w turns on the scale A^(-1/3) when dissipation rules
    p, w, t = 0.0, 1.0, 0.0
    while True:
        p1, w1, t1 = _rk4(A, p, w, t, h)
        if p1 * p1 + A * (w1 - (2.0 / 3.0) * A * p1**3) <= 0.0 or p1 <= 0.0:
            break
        p, w, t = p1, w1, t1
    low, high = 0.0, h  # the last part of the last step, by bisection
    for _ in range(60):
        mid = 0.5 * (low + high)
        p1, w1, t1 = _rk4(A, p, w, t, mid)
        if p1 > 0.0 and p1 * p1 + A * (w1 - (2.0 / 3.0) * A * p1**3) > 0.0:
            low = mid
        else:
            high = mid
    p, w, t = _rk4(A, p, w, t, 0.5 * (low + high))
    return (2.0 / 3.0) * A * p**3 - w, t


@entry
def _tabulate(table):
    for i in range(_INTERVALS):
        u = i / _INTERVALS
        z = u / (1.0 - u)
        e, t = pair_impact(z * z)
        # e falls as A^(-5/3): with that taken out, the tabulated function is of order 1 everywhere.
        table[i, 0] = e / (1.0 - u) ** (10.0 / 3.0)
        table[i, 1] = t


@once
def universal_curves() -> np.ndarray:
    """The tabulated curves, shape (nodes, 2): computed once per process, then read by every kernel."""
    table = np.empty((_INTERVALS, 2))
    _tabulate(table)
    return table


@jit
def _interpolate(table, column, u):
    """Local polynomial interpolation (Lagrange, 8 nodes) of one tabulated curve at 0 <= u < 1."""
    x = u * _INTERVALS
    first = min(max(int(x) - _STENCIL // 2 + 1, 0), _INTERVALS - _STENCIL)
    total = 0.0
    for i in range(_STENCIL):
        weight = table[first + i, column]
        for j in range(_STENCIL):
            if j != i:
                weight *= (x - (first + j)) / (i - j)
        total += weight
    return total


@jit
def restitution_of(table, A):
    """e of an impact with dissipation A >= 0."""
    z = math.sqrt(A)
    u = z / (1.0 + z)
    return _interpolate(table, 0, u) * (1.0 - u) ** (10.0 / 3.0)


@jit
def restitution_slope(table, A):
    """de/dA of `restitution_of`, A > 0: the slope of the interpolation itself."""
    z = math.sqrt(A)
    u = z / (1.0 + z)
    x = u * _INTERVALS
    first = min(max(int(x) - _STENCIL // 2 + 1, 0), _INTERVALS - _STENCIL)
    slope = 0.0
    for i in range(_STENCIL):
        for k in range(_STENCIL):
            if k != i:
                weight = table[first + i, 0] / (i - k)
                for j in range(_STENCIL):
                    if j != i and j != k:
                        weight *= (x - (first + j)) / (i - j)
                slope += weight
    by_u = _INTERVALS * slope * (1.0 - u) ** (10.0 / 3.0) - (10.0 / 3.0) * restitution_of(table, A) / (1.0 - u)
    return by_u * (1.0 - u) ** 2 / (2.0 * z)


@jit
def dissipation(cradle, m_eff, v):
    """A of an impact at speed v [m/s] of a pair with reduced mass m_eff [kg]."""
    return cradle.k_f * cradle.k_el**-0.6 * m_eff**-0.4 * v**0.2


@jit
def departure(c, u):
    """What a learned law adds to e, u: speed over its scale; c0 + c1 u + c2 u^2 + c3 exp(-u / 0.1) + c4 / u."""
    return c[0] + u * (c[1] + c[2] * u) + c[3] * math.exp(-u / 0.1) + c[4] / u


@jit
def restitution(cradle, table, m_eff, v):
    """e at normal speed v > 0 [m/s] under the cradle's law; 0 <= e <= 1."""
    if cradle.law == CONSTANT:
        e = cradle.restitution
    elif cradle.law == KUWABARA_KONO:
        e = restitution_of(table, dissipation(cradle, m_eff, v))
    else:
        e = max(0.0, 1.0 - cradle.alpha * v**cradle.exponent)
    if cradle.departure_speed != 0.0:
        e = min(1.0, max(0.0, e + departure(cradle.departure, v / cradle.departure_speed)))
    return e


@entry
def curve(cradle, table, m_eff, speeds, out):
    """(e, contact time [s]) at each speed [m/s] into `out`, shape (len(speeds), 2)."""
    for k, v in enumerate(speeds):
        A = equivalent_dissipation(cradle, table, m_eff, v)
        z = math.sqrt(A)
        t0 = (m_eff / cradle.k_el) ** 0.4 * v**-0.2
        out[k, 0] = restitution(cradle, table, m_eff, v)
        out[k, 1] = _interpolate(table, 1, z / (1.0 + z)) * t0


@jit
def equivalent_dissipation(cradle, table, m_eff, v):
    """The A at which a Kuwabara-Kono impact has the e of the cradle's law at speed v: a multi-body impact under
    any law is that of the Kuwabara-Kono chain with the same pair impact."""
    if cradle.law == KUWABARA_KONO and cradle.departure_speed == 0.0:
        return dissipation(cradle, m_eff, v)
    e = restitution(cradle, table, m_eff, v)
    low, high = 0.0, 100.0  # e(100) = 6e-4
    for _ in range(60):
        mid = 0.5 * (low + high)
        if restitution_of(table, mid) > e:
            low = mid
        else:
            high = mid
    return 0.5 * (low + high)
