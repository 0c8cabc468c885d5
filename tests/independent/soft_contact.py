"""Newton's cradle with every contact resolved in time: the independent reference of the tests.

Nothing of the package is used. Each bob has polar coordinates about its own pivot, with unit vectors
r^ = (sin th, -cos th) and th^ = (cos th, sin th); Lagrange's equations are

    m (r'' - r th'^2)       = Q_r         m (r th'' + 2 r' th') = Q_th

where (Q_r, Q_th) is the force on the bob along (r^, th^): weight, strings, drag, contacts.

Strings, eq. (4) of Lee & Hong (arXiv:2401.16693): four of them, stretched by s = sqrt(r^2 + a^2) -
sqrt(r0^2 + a^2), pull with 4 T r0/sqrt(r0^2 + a^2). T runs through one anchor (s*, T*), the last reversal:

    loading  T = T* + kappa (s - s*)      unloading  T = T* (s/s*)^2      slack  T = 0, anchor back to (0, 0)

Contacts, eq. (1): F = max(0, k_el eps^1.5 + k_f eps^0.5 eps') along the line of centres, eps the overlap.

Every change of law (reversal, slack, contact begins or ends) is located and ends a step, so that the
Dormand-Prince 5(4) steps between them see smooth forces. SI units, radians; bobs numbered from 1.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import root

from .soft_kernel import ELASTIC, HYSTERETIC, R_DOT, RIGID, THETA, THETA_DOT, Constants, R, integrate

CONTACT = np.dtype(
    {"names": ["time", "pair", "speed", "duration", "energy_lost"], "formats": [float, int] + [float] * 3}
)


@dataclass(frozen=True)
class SoftCradle:
    """A cradle, in SI units. `mass` and `length` are one number or one per bob, `delta` one or one per gap.

    `stiffness_factor` f makes k_el f times and k_f f^0.6 times larger: e(v) stays, contacts last f^-0.4 as
    long. `kappa` None is the paper's beta = 0.114. `effects`: {"quadratic_drag": {"c2": kg/m},
    "pivot_friction": {"tau_c": N m}}, the force -c2 |v| v and the torque -tau_c tanh(th'/0.02).
    """

    bobs: int
    length: float | np.ndarray = 0.30
    pivot_half_spacing: float = 0.10
    mass: float | np.ndarray = 0.2813
    radius: float = 0.020
    youngs_modulus: float = 200e9
    poisson_ratio: float = 0.29
    k_f: float = 18000.0
    kappa: float | None = None
    b: float = 0.002
    gravity: float = 9.81
    delta: float | np.ndarray = 0.0
    strings: str = "hysteretic"
    stiffness_factor: float = 1.0
    effects: dict[str, dict[str, float]] = field(default_factory=dict)

    def constants(self) -> Constants:
        """The numbers behind the description."""
        n = self.bobs
        length = np.broadcast_to(self.length, n).astype(float)
        mass = np.broadcast_to(self.mass, n).astype(float)
        kappa = self.kappa
        if kappa is None:  # beta^2 = m g/(kappa_r r0) and kappa_r = 4 kappa r0^2/(r0^2 + a^2)
            r0 = length.mean()
            kappa_r = mass.mean() * self.gravity / (0.114**2 * r0)
            kappa = kappa_r * (r0**2 + self.pivot_half_spacing**2) / (4 * r0**2)
        k_el = 2 / 3 * self.youngs_modulus / (1 - self.poisson_ratio**2) * np.sqrt(self.radius / 2)
        return Constants(
            mass=mass,
            length=length,
            string_length=np.hypot(length, self.pivot_half_spacing),
            spacing=2 * self.radius * (1 + np.broadcast_to(self.delta, n - 1).astype(float)),
            pivot_half_spacing=self.pivot_half_spacing,
            strings={"rigid": RIGID, "elastic": ELASTIC, "hysteretic": HYSTERETIC}[self.strings],
            kappa=float(kappa),
            gravity=self.gravity,
            b=self.b,
            c2=self.effects.get("quadratic_drag", {}).get("c2", 0.0),
            tau_c=self.effects.get("pivot_friction", {}).get("tau_c", 0.0),
            diameter=2 * self.radius,
            k_el=k_el * self.stiffness_factor,
            k_f=self.k_f * self.stiffness_factor**0.6,
        )


@dataclass(frozen=True)
class SoftRun:
    """One run: states at `times` (T,), each (T, N); `contacts` has a row for each time two bobs pressed."""

    cradle: SoftCradle
    times: np.ndarray
    theta: np.ndarray
    r: np.ndarray
    theta_dot: np.ndarray
    r_dot: np.ndarray
    contacts: np.ndarray

    def energy(self) -> np.ndarray:
        """Kinetic, gravitational, string and contact energy (T,) in J; not for hysteretic strings."""
        if self.cradle.strings == "hysteretic":
            raise ValueError("the energy stored in hysteretic strings depends on their history")
        c, a = self.cradle.constants(), self.cradle.pivot_half_spacing
        x, y = self.r * np.sin(self.theta), -self.r * np.cos(self.theta)
        bobs = c.mass * ((self.r_dot**2 + (self.r * self.theta_dot) ** 2) / 2 + c.gravity * y)
        # The radial force 4 kappa s r0/L0, s = sqrt(r^2 + a^2) - L0, integrated from r0; none when slack.
        stretched = np.maximum(self.r, c.length)
        hyp, hyp0 = np.hypot(stretched, a), c.string_length
        area = (stretched * hyp - c.length * hyp0) / 2
        area += a**2 / 2 * (np.arcsinh(stretched / a) - np.arcsinh(c.length / a))
        strings = 4 * c.kappa * c.length / hyp0 * (area - hyp0 * (stretched - c.length))
        overlap = np.maximum(0, c.diameter - np.hypot(c.spacing + np.diff(x), np.diff(y)))
        return (bobs + strings).sum(axis=1) + (0.4 * c.k_el * overlap**2.5).sum(axis=1)


def simulate_soft(
    cradle: SoftCradle,
    angles: dict[int, float],
    start: str = "unstretched",
    *,
    times: np.ndarray,
    tolerance: float = 1e-11,
    max_step: float = 1e-3,
) -> SoftRun:
    """Release the bobs named in `angles` (bob number to rad) from rest at t = 0.

    Lifted bobs start with unstretched strings or, `start="hanging"`, at their length hanging straight down;
    the others in their common equilibrium. States are given at the ascending `times` (s). `tolerance` bounds
    the error of each step in each coordinate (m, rad, m/s, rad/s): 32 times less halves the steps; `max_step`
    (s) bounds the steps themselves.
    """
    c = cradle.constants()
    state = np.zeros((5, cradle.bobs))
    lifted = np.array([i + 1 in angles for i in range(cradle.bobs)])
    state[R] = np.where(lifted & (start == "unstretched"), c.length, hanging_length(c))
    state[THETA, lifted] = [angles[i + 1] for i in np.flatnonzero(lifted)]
    if np.any(c.spacing < c.diameter):
        lean_on_each_other(state, lifted, c)
    states, contacts = integrate(state, np.asarray(times, float), c, tolerance, max_step)
    order = np.argsort([row[0] for row in contacts], kind="stable")
    table = np.array([contacts[i] for i in order], dtype=CONTACT)
    return SoftRun(cradle, times, states[:, THETA], states[:, R], states[:, THETA_DOT], states[:, R_DOT], table)


def hanging_length(c: Constants) -> np.ndarray:
    """Radius r (N,) at which the virgin strings carry the weight: 4 kappa s r0/L0 = m g."""
    if c.strings == RIGID:
        return c.length
    stretch = c.mass * c.gravity * c.string_length / (4 * c.kappa * c.length)
    return np.sqrt((c.string_length + stretch) ** 2 - c.pivot_half_spacing**2)


def lean_on_each_other(state: np.ndarray, lifted: np.ndarray, c: Constants) -> None:
    """Put the bobs that are not lifted into their common equilibrium.

    Unknown are r/r0 and th of each bob and one number u per pair: u > 0 is the contact force over m g, which
    compresses by (F/k_el)^(2/3); u < 0 an open gap of -u diameters. Lifted bobs stay, and press on nobody.
    """
    n = len(lifted)
    pairs = ~lifted[:-1] & ~lifted[1:]
    weight = c.mass * c.gravity
    start = np.concatenate([state[R] / c.length, state[THETA]])

    def residual(unknown: np.ndarray) -> np.ndarray:
        radius, angle, u = unknown[:n] * c.length, unknown[n : 2 * n], unknown[2 * n :]
        dx = c.spacing + np.diff(radius * np.sin(angle))
        dy = np.diff(-radius * np.cos(angle))
        distance = np.hypot(dx, dy)
        force = np.where(pairs, weight.mean() * np.maximum(u, 0), 0)
        push_x = -np.diff(force * dx / distance, prepend=0, append=0)
        push_y = -np.diff(force * dy / distance, prepend=0, append=0)
        stretch = np.hypot(radius, c.pivot_half_spacing) - c.string_length
        pull = 4 * c.kappa * stretch * c.length / c.string_length
        along = (push_x * np.sin(angle) - push_y * np.cos(angle) - pull) / weight + np.cos(angle)
        across = (push_x * np.cos(angle) + push_y * np.sin(angle)) / weight - np.sin(angle)
        balance = np.concatenate([radius / c.length - 1 if c.strings == RIGID else along, across])
        meeting = distance / c.diameter - 1 + np.minimum(u, 0) + (force / c.k_el) ** (2 / 3) / c.diameter
        held = np.concatenate([lifted, lifted])
        return np.concatenate([np.where(held, unknown[: 2 * n] - start, balance), np.where(pairs, meeting, u)])

    solution = root(residual, np.concatenate([start, 1 - c.spacing / c.diameter]), options={"xtol": 1e-15})
    worst = np.abs(residual(solution.x)).max()
    if worst > 1e-12:
        raise RuntimeError(f"no equilibrium for pivot spacings {c.spacing} m: residual {worst:.1e} > 1e-12")
    state[R], state[THETA] = solution.x[:n] * c.length, solution.x[n : 2 * n]
