"""The cradle as one would write it with SciPy: `solve_ivp(method="DOP853", events=...)`, hard impacts.

The peer of the benchmark and, at tight tolerances, a reference. It shares only the physics with the project:
N nonlinear spring pendulums (Lee & Hong, arXiv:2401.16693, eqs. 4-6) in polar coordinates about their pivots,

    m (r'' - r th'^2) = m g cos th - 4 T r0/sqrt(r0^2 + a^2) - b r'
    m (r th'' + 2 r' th') = -m g sin th - b r th'

string reversals and slack as events; two-body impacts along the line of centres with the restitution e(v) of
the KK contact (eq. 1); the first impact on resting bobs in touch by integrating the whole KK chain.

Only for delta >= 0: there is no resting contact here. One bob, the last, is released. SI units, radians.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, hypot, sin, sqrt
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from identification.bench.scipy_contact import Event, Peer, kk_chain, restitution_curve

NOISE = 1e-12  # m or m/s: a bob at rest neither reverses its string nor hits its neighbour by rounding
TOUCH = 1e-13  # m, gap below which closing bobs hit
IMPACTS_AT_ONCE = 1000  # more at one instant are a resting contact, which this integrator has not


@dataclass
class String:
    """The four strings of one bob: the law in force and, but for slack, its last reversal (s*, T*)."""

    law: str = "loading"  # T* + kappa (s - s*); or "unloading", T* (s/s*)^2; or "slack", 0
    s: float = 0.0
    tension: float = 0.0


def derivative(y: np.ndarray, peer: Peer, laws: tuple[np.ndarray, ...]) -> np.ndarray:
    """d(r, th, r', th')/dt of all bobs, y (4N,); T = c0 + c1 s + c2 s^2 by `laws` (c0, c1, c2), each (N,)."""
    r, theta, r_dot, theta_dot = y.reshape(4, -1)
    c0, c1, c2 = laws
    s = np.sqrt(r * r + peer.pivot_half_spacing**2) - peer.string_length
    pull = 4 * peer.length / peer.string_length / peer.mass * (c0 + s * (c1 + s * c2))
    drag = peer.b / peer.mass
    r_ddot = r * theta_dot**2 + peer.gravity * np.cos(theta) - pull - drag * r_dot
    theta_ddot = -(peer.gravity * np.sin(theta) + 2 * r_dot * theta_dot) / r - drag * theta_dot
    return np.concatenate([r_dot, theta_dot, r_ddot, theta_ddot])


def stretch(y: np.ndarray, i: int, peer: Peer) -> float:
    """Stretch s (m) of the strings of bob i."""
    return hypot(y[i], peer.pivot_half_spacing) - peer.string_length


def closing(y: np.ndarray, p: int, peer: Peer) -> tuple[float, float, float, float]:
    """Of bobs p and p + 1: the gap (m), the speed (m/s) at which it closes, unit vector p to p + 1."""
    n = peer.bobs
    r0, r1, swing0, swing1 = y[p], y[p + 1], y[p] * y[3 * n + p], y[p + 1] * y[3 * n + p + 1]
    s0, c0, s1, c1 = sin(y[n + p]), cos(y[n + p]), sin(y[n + p + 1]), cos(y[n + p + 1])
    dx, dy = peer.spacing + r1 * s1 - r0 * s0, r0 * c0 - r1 * c1
    distance = sqrt(dx * dx + dy * dy)
    nx, ny = dx / distance, dy / distance
    vx = y[2 * n + p + 1] * s1 + swing1 * c1 - y[2 * n + p] * s0 - swing0 * c0
    vy = -y[2 * n + p + 1] * c1 + swing1 * s1 + y[2 * n + p] * c0 - swing0 * s0
    return distance - 2 * peer.radius, -(nx * vx + ny * vy), nx, ny


def gap_event(y: np.ndarray, p: int, peer: Peer) -> float:
    """The gap while it closes, positive while it opens: an impact just made is no new one."""
    gap, speed, _, _ = closing(y, p, peer)
    return gap if speed > NOISE else max(gap, NOISE)


def string_event(y: np.ndarray, i: int, peer: Peer, string: String) -> float:
    """Falls through zero where the strings of bob i leave their law."""
    s = stretch(y, i, peer)
    if string.law == "slack":
        return NOISE - s
    if peer.strings == "elastic":
        return NOISE + s
    r_dot = y[2 * peer.bobs + i]
    return NOISE + (r_dot if string.law == "loading" else min(s, -r_dot))


def change_law(string: String, s: float, peer: Peer) -> None:
    """Put the next law in force; the present one has ended at stretch s."""
    if string.law == "slack":
        string.law = "loading"
    elif s < NOISE:
        string.law, string.s, string.tension = "slack", 0.0, 0.0
    elif string.law == "loading":
        string.law, string.s, string.tension = "unloading", s, string.tension + peer.kappa * (s - string.s)
    else:
        string.law, string.s, string.tension = "loading", s, string.tension * (s / string.s) ** 2


def polynomials(strings: list[String], peer: Peer) -> tuple[np.ndarray, ...]:
    """(c0, c1, c2), each (N,), of T = c0 + c1 s + c2 s^2."""
    rows = {
        "slack": lambda _: (0, 0, 0),
        "loading": lambda x: (x.tension - peer.kappa * x.s, peer.kappa, 0),
        "unloading": lambda x: (0, 0, x.tension / x.s**2),
    }
    return tuple(np.array([rows[x.law](x) for x in strings], float).T)


def kick(y: np.ndarray, p: int, speed: float, peer: Peer) -> None:
    """Add -`speed` to bob p and +`speed` (m/s) to bob p + 1 along their line of centres."""
    n = peer.bobs
    _, _, nx, ny = closing(y, p, peer)
    for i, dv in ((p, -speed), (p + 1, speed)):
        s, c = sin(y[n + i]), cos(y[n + i])
        y[2 * n + i] += dv * (nx * s - ny * c)
        y[3 * n + i] += dv * (nx * c + ny * s) / y[i]


def collide(
    y: np.ndarray, row: bool, restitution: Callable[[float], float], peer: Peer, **tolerances: float
) -> list[tuple[int, float]]:
    """Resolve in place every impact due at this instant; (pair from 1, speed) of each.

    `row`: all but the last bob still hang in touch, so the impact is that of the KK chain, to `tolerances`.
    Else two-body impacts, of the pairs in touch the fastest first.
    """
    impacts = []
    for _ in range(IMPACTS_AT_ONCE):
        states = [closing(y, p, peer) for p in range(peer.bobs - 1)]
        due = [(speed, p) for p, (gap, speed, _, _) in enumerate(states) if gap < TOUCH and speed > NOISE]
        if not due:
            return impacts
        speed, p = max(due)
        impacts.append((p + 1, speed))
        if not row:
            kick(y, p, (1 + restitution(speed)) / 2 * speed, peer)
            continue
        # From the last pair on, as the wave runs. The one that hits hangs higher, so the row is bent there.
        nx, ny = np.array([state[2:] for state in states[::-1]]).T
        for j, impulse in enumerate(kk_chain(peer, speed, nx[1:] * nx[:-1] + ny[1:] * ny[:-1], **tolerances)):
            kick(y, p - j, impulse * speed, peer)
        return impacts + [(p + 1 - j, 0.0) for j in range(1, peer.bobs - 1)]
    raise RuntimeError(f"{IMPACTS_AT_ONCE} impacts at one instant: this peer has no resting contact")


def flight(t: float, y: np.ndarray, strings: list[String], peer: Peer, times: np.ndarray, options: dict[str, Any]):
    """`solve_ivp` from (t, y) to the first impact or change of a string's law, or to the last of `times`."""
    pairs, bobs = range(peer.bobs - 1), range(peer.bobs)
    impacts = [Event(gap_event, (p, peer)) for p in pairs]
    reversals = [Event(string_event, (i, peer, strings[i])) for i in bobs]
    approaches = [Event(lambda y, p: closing(y, p, peer)[1] - NOISE, (p,), terminal=False) for p in pairs]
    laws = polynomials(strings, peer)
    options = options | {"events": impacts + reversals + approaches, "t_eval": times[times > t]}
    while True:
        run = solve_ivp(lambda _, y: derivative(y, peer, laws), (t, times[-1]), y, "DOP853", **options)
        if run.status < 0:
            raise RuntimeError(run.message)
        nearest = run.y_events[2 * peer.bobs - 1 :]
        if all(closing(state, p, peer)[0] >= -TOUCH for p in pairs for state in nearest[p]):
            return run
        # A pair met and parted within one step, so no sign changed: look again in shorter steps.
        options = options | {"max_step": options["max_step"] / 4}


def simulate(
    bobs: int,
    *,
    angle: float,
    times: np.ndarray,
    start: str = "unstretched",
    rtol: float = 1e-8,
    atol: float = 1e-10,
    max_step: float = 0.01,
    **cradle: Any,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Release the last bob from rest at `angle` (rad) at t = 0, the others hanging; `cradle` as in `Peer`.

    `start`: "unstretched" or "hanging" length of the released bob. `times` (T,) ascending, in s. Returns
    theta (T, N), r (T, N) and the impacts (K, 3): time, pair (from 1), closing speed; an impact on the
    resting row has one row per pair, with speed 0 where nothing closed.
    """
    peer = Peer(bobs, **cradle)
    if peer.delta < 0:
        raise ValueError(f"delta = {peer.delta}: this peer has no resting contact, delta >= 0 only")
    restitution = restitution_curve(peer)
    times = np.asarray(times, float)
    y = np.concatenate([np.full(bobs, peer.hanging), np.zeros(3 * bobs)])
    y[bobs - 1] = peer.length if start == "unstretched" else peer.hanging
    y[2 * bobs - 1] = angle
    strings = [String() for _ in range(bobs)]
    options = {"rtol": rtol, "atol": atol, "max_step": max_step}
    states, impacts = [np.repeat(y[None], np.count_nonzero(times <= 0), axis=0)], []
    t, row = 0.0, peer.delta == 0 and bobs > 2
    while t < times[-1]:
        run = flight(t, y, strings, peer, times, options)
        states.append(np.reshape(run.y, (4 * bobs, -1)).T)
        if run.status == 0:
            break
        stops = run.t_events[: 2 * bobs - 1]
        stop = next(i for i, when in enumerate(stops) if when.size)
        t, y = stops[stop][0], run.y_events[stop][0].copy()
        # The kinks of a chain cost it two digits, to have them back a hundredth of a second.
        new = collide(y, row, restitution, peer, rtol=max(0.01 * rtol, 3e-14), atol=0.01 * atol)
        impacts += [(t, *impact) for impact in new]
        row = row and not new
        for i, string in enumerate(strings):
            if stops[bobs - 1 + i].size or string_event(y, i, peer, string) < 0:
                change_law(string, stretch(y, i, peer), peer)
    states = np.concatenate(states)
    return states[:, bobs : 2 * bobs], states[:, :bobs], np.array(impacts).reshape(-1, 3)
