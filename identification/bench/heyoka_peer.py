"""The cradle as one would write it with heyoka: Taylor series compiled for these equations, impacts as events.

Bobs on elastic strings without hysteresis, in Cartesian coordinates about their pivots (Lee & Hong, arXiv:2401.16693,
eqs. 4-6); two-body impacts along the line of centres with the restitution e(v) of the KK contact (eq. 1), as terminal
events of the integrator. Strings that go slack and contacts that last are left out. SI units, radians.
"""

import importlib
from collections.abc import Callable
from math import hypot
from typing import Any

import numpy as np

from identification.bench.scipy_contact import Peer, restitution_curve


def integrator(bobs: int, *, angle: float, tol: float, **cradle: Any) -> Callable[[np.ndarray], np.ndarray]:
    """Compile the cradle whose last bob is let go at `angle` [rad], its strings as long as at rest, the others hanging.

    `tol` is heyoka's; `cradle` as in `Peer`. Returns a function that simulates from the start: of times (T,) [s],
    ascending from 0, it makes theta (T, N) [rad].
    """
    heyoka: Any = importlib.import_module("heyoka")  # of the extra `bench`

    peer = Peer(bobs, strings="elastic", **cradle)
    places = [heyoka.make_vars(f"x{i}", f"z{i}", f"u{i}", f"w{i}") for i in range(bobs)]
    ratio = peer.length / peer.string_length
    system = []
    for x, z, u, w in places:
        square = x * x + z * z
        stretch = heyoka.sqrt(square + peer.pivot_half_spacing**2) - peer.string_length
        pull = 4.0 * ratio * peer.kappa / peer.mass * stretch / heyoka.sqrt(square)
        drag = peer.b / peer.mass
        system += [(x, u), (z, w), (u, -pull * x - drag * u), (w, -pull * z - drag * w - peer.gravity)]
    restitution = restitution_curve(peer)
    events = []
    for p in range(bobs - 1):
        (x0, z0, _, _), (x1, z1, _, _) = places[p : p + 2]
        apart = (x1 - x0 + peer.spacing) ** 2 + (z1 - z0) ** 2 - 4.0 * peer.radius**2
        falling = heyoka.event_direction.negative
        events.append(heyoka.t_event(apart, direction=falling, callback=_Impact(p, peer.spacing, restitution)))

    start = np.zeros((bobs, 4))
    start[:, 1] = -peer.hanging
    start[-1, :2] = peer.hanging * np.sin(angle), -peer.hanging * np.cos(angle)
    taylor = heyoka.taylor_adaptive(system, start.ravel().tolist(), tol=tol, t_events=events)

    def run(times: np.ndarray) -> np.ndarray:
        taylor.time = 0.0
        taylor.state[:] = start.ravel()
        taylor.reset_cooldowns()
        outcome, *_, states = taylor.propagate_grid(times)
        if outcome != heyoka.taylor_outcome.time_limit:
            raise RuntimeError(f"heyoka stopped at {taylor.time:g} s: {outcome}")
        states = states.reshape(len(times), bobs, 4)
        if (np.hypot(np.hypot(states[..., 0], states[..., 1]), peer.pivot_half_spacing) < peer.string_length).any():
            raise RuntimeError("a string went slack, which this peer leaves out")
        return np.arctan2(states[..., 0], -states[..., 1])

    return run


class _Impact:
    """What heyoka calls when the bobs p and p + 1 meet: changes their velocities and goes on."""

    def __init__(self, p: int, spacing: float, restitution: Callable[[float], float]) -> None:
        self.first, self.spacing, self.restitution = 4 * p, spacing, restitution

    def __call__(self, taylor: Any, _: int) -> bool:
        state, k = taylor.state, self.first
        x0, z0, u0, w0, x1, z1, u1, w1 = state[k : k + 8].tolist()
        dx, dz = x1 - x0 + self.spacing, z1 - z0
        distance = hypot(dx, dz)
        nx, nz = dx / distance, dz / distance
        speed = (u0 - u1) * nx + (w0 - w1) * nz
        if speed > 0.0:
            half = 0.5 * (1.0 + self.restitution(speed)) * speed
            state[k + 2 : k + 4] = u0 - half * nx, w0 - half * nz
            state[k + 6 : k + 8] = u1 + half * nx, w1 + half * nz
        return True
