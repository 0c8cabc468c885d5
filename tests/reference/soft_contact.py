"""Newton's cradle with every contact resolved in time: the independent reference of the tests.

Nothing of the package is used. Each bob has polar coordinates about its own pivot, with unit vectors
r^ = (sin th, -cos th) and th^ = (cos th, sin th); the pivots stand on a frame that moves by X along x. Lagrange's
equations are

    m' (r'' - r th'^2 + X'' sin th)      = Q_r
    m' (r th'' + 2 r' th' + X'' cos th)  = Q_th
    M X'' + C X' + K X                   = sum of what the strings and pivots pass on to the frame, along x

where (Q_r, Q_th) is the force on the bob along (r^, th^): weight, strings, drag in the room, contacts, and what
`effects` adds. m' = m, but for added mass; without a frame X = 0.

Strings, eq. (4) of Lee & Hong (arXiv:2401.16693): four of them, stretched by s = sqrt(r^2 + a^2) - L with
L = sqrt(r0^2 + a^2), pull with 4 T r0/L. T runs through one anchor (s*, T*), the last reversal:

    loading  T = T* + kappa (s - s*)      unloading  T = T* (s/s*)^2      slack  T = 0, anchor back to (0, 0)

Contacts, eq. (1): F = max(0, k_el eps^1.5 + k_f eps^0.5 eps') along the line of centres, eps the overlap.

Every change of law (reversal, slack, contact begins or ends) is located and ends a step, so that the
Dormand-Prince 5(4) steps between them see smooth forces. SI units, radians; bobs numbered from 1.

Effects by name, with their keys; those with a value may be left out:

    group_drag         slope, range = 0.005     b (1 + slope sum over neighbours of exp(-gap/range)), 1 in touch
    added_mass         mass                     inertia m + mass, weight m g
    frame_compliance   frame_mass, frequency, damping_ratio    M, K = M w^2, C = 2 damping_ratio M w, w = 2 pi f
    spacer_offset      offset                   one per gap, added to delta
    mass_mismatch      relative                 one per bob: mass (1 + relative)
    length_mismatch    relative                 one per bob: length (1 + relative), pivots level
    string_creep       rate                     each string's L grows by rate ln(1 + t/1 s)
    contact_duration   scale                    contacts scale times as long as real ones: stiffness_factor scale^-2.5

and outside the catalogue

    frame_drag         c2                       -c2 |X'| X' on the frame of frame_compliance
    string_kink        stiffening, angle = 0, width = 0.05     T (1 + stiffening exp(-((th - angle)/width)^2)); no
                                                potential has this force, so it feeds or brakes the ripple of r
    sticky_pair        pair, energy, range = 1e-5    each separation of the pair takes `energy`: once in touch, it
                                                pulls by 2 energy/range (1 - gap/range), up to that gap

and all tables of `soft_terms`. How the instrument distorts is `laboratory`'s: angle_offset {offset}, angle_scale
{scale}, clock_scale {scale}, exposure_blur {duration}.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import root

from .soft_kernel import (
    CONTACT_WORK,
    ELASTIC,
    HYSTERETIC,
    OTHER_WORK,
    R_DOT,
    RIGID,
    STRING_WORK,
    THETA,
    THETA_DOT,
    Constants,
    R,
    forces_at_rest,
    integrate,
    kinked,
)
from .soft_terms import BOB_FORCES, PAIR_FORCES, TORQUES, rows

Values = dict[str, float | list[float]]

CONTACT = np.dtype(
    {"names": ["time", "pair", "speed", "duration", "energy_lost"], "formats": [float, int] + [float] * 3}
)

#: Keys of the effects that are no term, with the values they have where not given; None: must be given.
EFFECTS: dict[str, dict[str, float | None]] = {
    "group_drag": {"slope": None, "range": 5e-3},
    "added_mass": {"mass": None},
    "frame_compliance": {"frame_mass": None, "frequency": None, "damping_ratio": None},
    "spacer_offset": {"offset": None},
    "mass_mismatch": {"relative": None},
    "length_mismatch": {"relative": None},
    "string_creep": {"rate": None},
    "contact_duration": {"scale": None},
    "frame_drag": {"c2": None},
    "string_kink": {"stiffening": None, "angle": 0.0, "width": 0.05},
    "sticky_pair": {"energy": None, "pair": None, "range": 1e-5},
    "angle_offset": {"offset": None},
    "angle_scale": {"scale": None},
    "clock_scale": {"scale": None},
    "exposure_blur": {"duration": None},
}
KEYS = EFFECTS | {name: term.keys for table in (TORQUES, BOB_FORCES, PAIR_FORCES) for name, term in table.items()}


@dataclass(frozen=True)
class SoftCradle:
    """A cradle, in SI units. `mass` and `length` are one number or one per bob, `delta` one or one per gap.

    `stiffness_factor` f makes k_el f times and k_f f^0.6 times larger: e(v) stays, contacts last f^-0.4 as
    long. `kappa` None is the paper's beta = 0.114. `effects`: values by key, by name; see the head of this file.
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
    effects: dict[str, Values] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, values in self.effects.items():
            if name not in KEYS:
                raise ValueError(f"no effect {name!r}; there are {', '.join(KEYS)}")
            missing = {key for key, value in KEYS[name].items() if value is None} - set(values)
            if missing or set(values) - set(KEYS[name]):
                raise ValueError(f"{name}: given {', '.join(values) or 'nothing'}; keys are {', '.join(KEYS[name])}")
        if "frame_drag" in self.effects and "frame_compliance" not in self.effects:
            raise ValueError("frame_drag brakes a frame that moves; add frame_compliance")
        if "string_kink" in self.effects and self.strings == "rigid":
            raise ValueError("string_kink changes the tension of a stretch; strings must not be rigid")

    def effect(self, name: str, key: str, absent: float = 0.0) -> float | np.ndarray:
        """One value of an effect, `absent` without it."""
        if name not in self.effects:
            return absent
        value = {**KEYS[name], **self.effects[name]}[key]
        return float(value) if np.ndim(value) == 0 else np.asarray(value, float)

    @property
    def string_stiffness(self) -> float:
        """Stiffness of one string (N/m): `kappa`, or where it is not given that of the paper's beta = 0.114."""
        if self.kappa is not None:
            return float(self.kappa)
        # beta^2 = m g/(kappa_r r0) and kappa_r = 4 kappa r0^2/(r0^2 + a^2)
        r0 = np.mean(self.length)
        kappa_r = np.mean(self.mass) * self.gravity / (0.114**2 * r0)
        return float(kappa_r * (r0**2 + self.pivot_half_spacing**2) / (4 * r0**2))

    def constants(self) -> Constants:
        """The numbers behind the description, effects included."""
        n, effect = self.bobs, self.effect
        length = np.multiply(self.length, 1 + effect("length_mismatch", "relative")) * np.ones(n)
        mass = np.multiply(self.mass, 1 + effect("mass_mismatch", "relative")) * np.ones(n)
        spacing = 2 * self.radius * (1 + np.add(self.delta, effect("spacer_offset", "offset")) * np.ones(n - 1))
        k_el = 2 / 3 * self.youngs_modulus / (1 - self.poisson_ratio**2) * np.sqrt(self.radius / 2)
        factor = self.stiffness_factor
        if "contact_duration" in self.effects:
            factor = effect("contact_duration", "scale") ** -2.5
        pivot = np.concatenate([[0.0], np.cumsum(spacing)])
        frame_mass = effect("frame_compliance", "frame_mass", np.inf)
        omega = 2 * np.pi * effect("frame_compliance", "frequency")
        if not np.isfinite(omega):
            frame_mass, omega = np.inf, 0.0
        sticky = np.zeros(n - 1)
        sticky[np.arange(1, n) == effect("sticky_pair", "pair")] = effect("sticky_pair", "energy")
        return Constants(
            mass=mass,
            inertia=mass + effect("added_mass", "mass"),
            length=length,
            string_length=np.hypot(length, self.pivot_half_spacing),
            pivot=pivot - pivot.mean(),
            spacing=spacing,
            meeting=np.ones(n - 1, bool),
            pivot_half_spacing=self.pivot_half_spacing,
            strings={"rigid": RIGID, "elastic": ELASTIC, "hysteretic": HYSTERETIC}[self.strings],
            kappa=self.string_stiffness,
            gravity=self.gravity,
            b=self.b,
            diameter=2 * self.radius,
            k_el=float(k_el * factor),
            k_f=float(self.k_f * factor**0.6),
            drag_slope=effect("group_drag", "slope"),
            drag_range=effect("group_drag", "range", 1.0) or 1.0,
            creep=effect("string_creep", "rate"),
            kink=effect("string_kink", "stiffening"),
            kink_angle=effect("string_kink", "angle"),
            kink_width=effect("string_kink", "width", 1.0),
            sticky_energy=sticky,
            any_sticky=bool(sticky.any()),
            sticky_range=effect("sticky_pair", "range", 1.0),
            frame_mass=frame_mass,
            frame_frequency=omega,
            frame_damping=2 * effect("frame_compliance", "damping_ratio") * omega * frame_mass if omega else 0.0,
            frame_drag=effect("frame_drag", "c2"),
            torques=rows(TORQUES, self.effects),
            bob_forces=rows(BOB_FORCES, self.effects),
            pair_forces=rows(PAIR_FORCES, self.effects),
        )


@dataclass(frozen=True)
class SoftRun:
    """One run: states at `times` (T,), each (T, N); `contacts` has a row for each time two bobs pressed.

    frame: X and X', (T, 2). taken: the energy that contacts, strings and everything else have taken out of motion
    and weight so far, (T, 3) in J; what they give back counts as negative.
    """

    cradle: SoftCradle
    times: np.ndarray
    theta: np.ndarray
    r: np.ndarray
    theta_dot: np.ndarray
    r_dot: np.ndarray
    contacts: np.ndarray
    frame: np.ndarray
    taken: np.ndarray

    def velocity(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities of the bobs in the room, (T, N) along x and y."""
        sin, cos, swing = np.sin(self.theta), np.cos(self.theta), self.r * self.theta_dot
        return self.frame[:, 1:] + self.r_dot * sin + swing * cos, swing * sin - self.r_dot * cos

    def position(self) -> np.ndarray:
        """Horizontal positions of the bobs in the room, (T, N), from the middle of the pivots at rest."""
        return self.cradle.constants().pivot + self.frame[:, :1] + self.r * np.sin(self.theta)

    def mechanical_energy(self) -> np.ndarray:
        """Kinetic and gravitational energy of bobs, and energy of the frame and its spring, (T,) in J.

        With the sum of `taken` it is constant.
        """
        c = self.cradle.constants()
        vx, vy = self.velocity()
        bobs = c.inertia * (vx**2 + vy**2) / 2 - c.mass * c.gravity * self.r * np.cos(self.theta)
        if np.isinf(c.frame_mass):
            return bobs.sum(axis=1)
        x, speed = self.frame.T
        return bobs.sum(axis=1) + c.frame_mass * (speed**2 + (c.frame_frequency * x) ** 2) / 2

    def energy(self) -> np.ndarray:
        """Mechanical, string and contact energy (T,) in J; not where strings have no potential, nor of other forces."""
        if self.cradle.strings == "hysteretic" or {"string_creep", "string_kink"} & set(self.cradle.effects):
            raise ValueError("the energy stored in strings depends on their history")
        c, a = self.cradle.constants(), self.cradle.pivot_half_spacing
        x, y = self.r * np.sin(self.theta), -self.r * np.cos(self.theta)
        # The radial force 4 kappa s r0/L0, s = sqrt(r^2 + a^2) - L0, integrated from r0; none when slack.
        stretched = np.maximum(self.r, c.length)
        hyp, hyp0 = np.hypot(stretched, a), c.string_length
        area = (stretched * hyp - c.length * hyp0) / 2
        area += a**2 / 2 * (np.arcsinh(stretched / a) - np.arcsinh(c.length / a))
        strings = 4 * c.kappa * c.length / hyp0 * (area - hyp0 * (stretched - c.length))
        overlap = np.maximum(0, c.diameter - np.hypot(c.spacing + np.diff(x), np.diff(y)))
        return self.mechanical_energy() + strings.sum(axis=1) + (0.4 * c.k_el * overlap**2.5).sum(axis=1)


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
    the others in their common equilibrium, and the frame where these hold it. States are given at the ascending
    `times` (s). `tolerance` bounds the error of each step in each coordinate (m, rad, m/s, rad/s, J): 32 times less
    halves the steps; `max_step` (s) bounds the steps themselves.
    """
    c = cradle.constants()
    state = initial_state(c, angles, start)
    states, contacts = integrate(state, np.asarray(times, float), c, tolerance, max_step)
    in_order = contacts[np.argsort(contacts[:, 0], kind="stable")]
    table = np.array([tuple(row) for row in in_order], dtype=CONTACT)
    r, theta, r_dot, theta_dot = (states[:, row, :-1] for row in (R, THETA, R_DOT, THETA_DOT))
    taken = states[:, [CONTACT_WORK, STRING_WORK, OTHER_WORK]].sum(axis=2)
    return SoftRun(cradle, times, theta, r, theta_dot, r_dot, table, states[:, [R, R_DOT], -1], taken)


def initial_state(c: Constants, angles: dict[int, float], start: str = "unstretched") -> np.ndarray:
    """State (7, N + 1) in which the bobs named in `angles` are let go; see `simulate_soft`."""
    bobs = len(c.mass)
    state = np.zeros((7, bobs + 1))
    lifted = np.array([i + 1 in angles for i in range(bobs)])
    state[R, :-1] = np.where(lifted & (start == "unstretched"), c.length, hanging_length(c))
    state[THETA, :-1][lifted] = [angles[i + 1] for i in np.flatnonzero(lifted)]
    # What shakes has no equilibrium; the bobs start where they would hang were it still.
    shaking = c.bob_forces[:, -1] == list(BOB_FORCES).index("vibration")
    settle(state, lifted, c._replace(bob_forces=c.bob_forces[~shaking], meeting=~lifted[:-1] & ~lifted[1:]))
    return state


def hanging_length(c: Constants) -> np.ndarray:
    """Radius r (N,) at which the virgin strings carry the weight: 4 kappa s r0/L0 = m g."""
    if c.strings == RIGID:
        return c.length
    stretch = c.mass * c.gravity * c.string_length / (4 * c.kappa * c.length)
    return np.sqrt((c.string_length + stretch) ** 2 - c.pivot_half_spacing**2)


def settle(state: np.ndarray, lifted: np.ndarray, c: Constants) -> None:
    """Put the bobs that are not lifted into their common equilibrium, and the frame where they hold it.

    Unknown are r/r0 and th of each bob and one number u per pair: u > 0 is the contact force over m g, which
    compresses by (F/k_el)^(2/3); u < 0 an open gap of -u diameters; and X. Lifted bobs stay, and act on nobody.
    """
    n = len(lifted)
    if not (np.any(c.spacing < c.diameter) or c.kink or np.any(forces_at_rest(state, c))):
        return
    weight = c.mass * c.gravity
    start = np.concatenate([state[R, :n] / c.length, state[THETA, :n]])
    trial = state.copy()
    spring = c.frame_mass * c.frame_frequency**2 if c.frame_frequency > 0.0 else 0.0

    def residual(unknown: np.ndarray) -> np.ndarray:
        radius, angle, u, shift = unknown[:n] * c.length, unknown[n : 2 * n], unknown[2 * n : -1], unknown[-1]
        trial[R, :n], trial[THETA, :n], trial[R, n] = radius, angle, shift
        force_x, force_y = forces_at_rest(trial, c)
        dx = c.spacing + np.diff(radius * np.sin(angle))
        dy = np.diff(-radius * np.cos(angle))
        distance = np.hypot(dx, dy)
        force = np.where(c.meeting, weight.mean() * np.maximum(u, 0), 0)
        push_x = force_x - np.diff(force * dx / distance, prepend=0, append=0)
        push_y = force_y - np.diff(force * dy / distance, prepend=0, append=0)
        stretch = np.hypot(radius, c.pivot_half_spacing) - c.string_length
        pull = 4 * c.kappa * stretch * c.length / c.string_length * kinked.py_func(angle, c)
        along = (push_x * np.sin(angle) - push_y * np.cos(angle) - pull) / weight + np.cos(angle)
        across = (push_x * np.cos(angle) + push_y * np.sin(angle)) / weight - np.sin(angle)
        balance = np.concatenate([radius / c.length - 1 if c.strings == RIGID else along, across])
        meeting = distance / c.diameter - 1 + np.minimum(u, 0) + (force / c.k_el) ** (2 / 3) / c.diameter
        bobs = np.where(np.concatenate([lifted, lifted]), unknown[: 2 * n] - start, balance)
        # The strings pass on to the frame what pulls the bobs aside.
        frame = shift - force_x[~lifted].sum() / spring if spring > 0.0 else shift
        return np.concatenate([bobs, np.where(c.meeting, meeting, u), [frame]])

    solution = root(residual, np.concatenate([start, 1 - c.spacing / c.diameter, [0.0]]), options={"xtol": 1e-15})
    worst = np.abs(residual(solution.x)).max()
    if worst > 1e-12:
        raise RuntimeError(f"no equilibrium for pivot spacings {c.spacing} m: residual {worst:.1e} > 1e-12")
    state[R, :n], state[THETA, :n], state[R, n] = solution.x[:n] * c.length, solution.x[n : 2 * n], solution.x[-1]
