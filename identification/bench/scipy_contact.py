"""The KK contact as one would write it with SciPy: two bobs, and a row of bobs in touch.

It shares only the physics with `cradle_env`: the force eps^1.5 k_el + k_f eps^0.5 eps' of Kuwabara and Kono, in Lee &
Hong, arXiv:2401.16693, eq. 1. SI units.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from math import cos, hypot, sqrt

import numpy as np
from numpy.polynomial import Chebyshev
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class Event:
    """An event of `solve_ivp`: found where function(y, *args) falls through zero."""

    function: Callable[..., float]
    args: tuple = ()
    terminal: bool = True
    direction: float = -1.0

    def __call__(self, _: float, y: np.ndarray) -> float:
        """Value at state y."""
        return self.function(y, *self.args)


@dataclass(frozen=True)
class Peer:
    """A cradle of identical bobs; the names are those of the physics, SI units."""

    bobs: int
    delta: float = 0.0
    strings: str = "hysteretic"  # or "elastic": T = kappa s, slack below 0
    length: float = 0.30
    pivot_half_spacing: float = 0.10
    mass: float = 0.2813
    radius: float = 0.020
    youngs_modulus: float = 200e9
    poisson_ratio: float = 0.29
    k_f: float = 18000.0
    kappa: float = 196.61
    b: float = 0.002
    gravity: float = 9.81

    @property
    def k_el(self) -> float:
        """Hertz stiffness of a pair in N/m^1.5."""
        return 2 / 3 * self.youngs_modulus / (1 - self.poisson_ratio**2) * sqrt(self.radius / 2)

    @property
    def string_length(self) -> float:
        """Unstretched length of one string in m."""
        return hypot(self.length, self.pivot_half_spacing)

    @property
    def spacing(self) -> float:
        """Distance of neighbouring pivots in m."""
        return 2 * self.radius * (1 + self.delta)

    @property
    def hanging(self) -> float:
        """Length of a bob at rest in m, where 4 kappa s r0/sqrt(r0^2 + a^2) = m g."""
        s = self.mass * self.gravity * self.string_length / (4 * self.kappa * self.length)
        return sqrt((self.string_length + s) ** 2 - self.pivot_half_spacing**2)

    def first_speed(self, angle: float) -> float:
        """Speed of the first blow in m/s: that of the fall from `angle` (rad), strings as long as at rest."""
        return sqrt(2 * self.gravity * self.hanging * (1 - cos(angle)))


def kk_pair(a: float) -> tuple[float, float]:
    """Restitution, and duration over (m_eff^2/(k_el^2 v))^(1/5), of a KK impact of A = a.

    With eps = X xi, X = (m_eff v^2/k_el)^(2/5), and time in X/v: xi'' = -xi^1.5 - A xi^0.5 xi' until the
    force vanishes. In z = sqrt(xi) and dtau = dt/z this is polynomial, so the root at first touch is gone:

        dz/dtau = u/2      du/dtau = -z^4 - A z^2 u      dt/dtau = z      until z^2 + A u = 0
    """

    def motion(_: float, y: np.ndarray) -> list[float]:
        z, u, _ = y
        return [u / 2, -(z**4) - a * z**2 * u, z]

    release = Event(lambda y: y[0] - sqrt(a * max(-y[1], 0)))
    run = solve_ivp(motion, (0, 20), [0, 1, 0], "DOP853", events=release, rtol=1e-13, atol=1e-15, max_step=0.05)
    _, u, t = run.y_events[0][0]
    return -u, t


@functools.cache  # as ours is: no run that is timed pays for it
def restitution_curve(peer: Peer, fastest: float = 10.0) -> Callable[[float], float]:
    """e(v), v in m/s up to `fastest`, of a KK pair: a function of A = k_f k_el^-0.6 m_eff^-0.4 v^0.2 alone.

    A Chebyshev series in sqrt(A), good to 1e-14: the force vanishes at z = sqrt(A e), so e has a term A^2.5.
    """
    scale = peer.k_f * peer.k_el**-0.6 * (peer.mass / 2) ** -0.4
    exact = np.vectorize(lambda root_a: kk_pair(root_a**2)[0])
    last = sqrt(max(scale, 1e-9) * fastest**0.2)
    first, *others = Chebyshev.interpolate(exact, 16, domain=[0.0, last]).coef.tolist()

    def restitution(speed: float) -> float:  # Clenshaw's sum in floats: an array of one number takes ten times as long
        u = 2.0 * sqrt(scale * speed**0.2) / last - 1.0
        b1 = b2 = 0.0
        for coefficient in reversed(others):
            b1, b2 = 2.0 * u * b1 - b2 + coefficient, b1
        return u * b1 - b2 + first

    return restitution


def kk_chain(peer: Peer, speed: float, bends: np.ndarray, rtol: float = 1e-12, atol: float = 1e-13) -> np.ndarray:
    """Impulses (N-1,) over m `speed` when one bob hits the others, at rest in touch; first the pair that closes.

    `bends` (N-2,) are the cosines between the lines of centres of successive pairs, which stay as they are:
    1 for a straight row. Lengths are in X = (m v^2/k_el)^(2/5), time in X/v; overlaps eps and impulses J obey

        eps_p' = u_p - 2 J_p + bend J_(p-1) + bend J_(p+1)      J_p' = max(0, eps_p^1.5 + a eps_p^0.5 eps_p')
    """
    pairs = len(bends) + 1
    a = peer.k_f / peer.k_el * speed / (peer.mass * speed**2 / peer.k_el) ** 0.4
    u = np.eye(pairs)[0]
    coupling = np.diag(bends, 1) + np.diag(bends, -1) - 2 * np.eye(pairs)

    def motion(_: float, y: np.ndarray) -> np.ndarray:
        eps_dot = u + coupling @ y[pairs:]
        overlap = np.maximum(y[:pairs], 0)
        return np.concatenate([eps_dot, np.maximum(0, overlap**1.5 + a * np.sqrt(overlap) * eps_dot)])

    # A wave takes about 2 units a bob; after 10 a bob all have parted.
    run = solve_ivp(motion, (0, 10 * (pairs + 1)), np.zeros(2 * pairs), "DOP853", rtol=rtol, atol=atol)
    return run.y[pairs:, -1]
