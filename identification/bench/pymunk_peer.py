"""The cradle as one would write it with pymunk: discs on springs, restitution at one speed.

Strings are elastic, without hysteresis, their pivots in one line (pivot_half_spacing = 0): pymunk's springs are then
those of Lee & Hong, arXiv:2401.16693, eqs. 4-6; its restitution is that of the KK contact (eq. 1) at one speed. SI
units, radians.
"""

import importlib
from collections.abc import Callable
from math import cos, exp, sin, sqrt
from typing import Any

import numpy as np

from identification.bench.scipy_contact import Peer, restitution_curve


def integrator(bobs: int, *, angle: float, step: float, **cradle: Any) -> Callable[[np.ndarray], np.ndarray]:
    """Prepare the cradle whose last bob is let go at `angle` [rad], its strings as long as at rest, the others hanging.

    `step` is pymunk's [s], a whole part of the distance of samples; `cradle` as in `Peer`. Returns a function that
    simulates from the start: of times (T,) [s], evenly spaced from 0, it makes theta (T, N) [rad].
    """
    pymunk: Any = importlib.import_module("pymunk")  # of the extra `bench`

    peer = Peer(bobs, strings="elastic", pivot_half_spacing=0.0, **cradle)
    stiffness = 4.0 * peer.kappa
    restitution = restitution_curve(peer)(peer.first_speed(angle))
    pivots = peer.spacing * np.arange(bobs)

    def run(times: np.ndarray) -> np.ndarray:
        space = pymunk.Space()
        space.gravity, space.damping = (0.0, -peer.gravity), exp(-peer.b / peer.mass)
        space.collision_slop, space.collision_bias = 0.0, 0.0
        bodies = []
        for i, x in enumerate(pivots):
            body = pymunk.Body(peer.mass, float("inf"))
            theta = angle if i == bobs - 1 else 0.0
            body.position = x + peer.hanging * sin(theta), -peer.hanging * cos(theta)
            disc = pymunk.Circle(body, peer.radius)
            disc.elasticity, disc.friction = sqrt(restitution), 0.0  # pymunk multiplies those of both discs
            string = pymunk.DampedSpring(space.static_body, body, (x, 0.0), (0.0, 0.0), peer.length, stiffness, 0.0)
            space.add(body, disc, string)
            bodies.append(body)
        places = [[body.position for body in bodies]]
        for _ in times[1:]:
            for _ in range(round((times[1] - times[0]) / step)):
                space.step(step)
            places.append([body.position for body in bodies])
        x, z = np.moveaxis(np.array(places), -1, 0)
        return np.arctan2(x - pivots, -z)

    return run
