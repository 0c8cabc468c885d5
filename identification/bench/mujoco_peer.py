"""The cradle as one would write it with MuJoCo: a hinge and a slide with a spring for each bob, soft contacts.

Strings are elastic, without hysteresis, their pivots in one line (pivot_half_spacing = 0): MuJoCo's springs are then
those of Lee & Hong, arXiv:2401.16693, eqs. 4-6. Its contacts are linear and damped; they take 15 steps and have the
restitution of the KK contact (eq. 1) at one speed. SI units, radians.
"""

import importlib
from collections.abc import Callable
from math import hypot, log, pi
from typing import Any

import numpy as np

from identification.bench.scipy_contact import Peer, restitution_curve

_STEPS_OF_A_CONTACT = 15.0


def integrator(bobs: int, *, angle: float, step: float, **cradle: Any) -> Callable[[np.ndarray], np.ndarray]:
    """Build the cradle whose last bob is let go at `angle` [rad], its strings as long as at rest, the others hanging.

    `step` is MuJoCo's [s], a whole part of the distance of samples; `cradle` as in `Peer`. Returns a function that
    simulates from the start: of times (T,) [s], evenly spaced from 0, it makes theta (T, N) [rad].
    """
    mujoco: Any = importlib.import_module("mujoco")  # of the extra `bench`

    peer = Peer(bobs, strings="elastic", pivot_half_spacing=0.0, **cradle)
    stiffness = 4.0 * peer.kappa
    decay = -log(restitution_curve(peer)(peer.first_speed(angle))) / pi
    damping_ratio = decay / hypot(1.0, decay)
    omega = pi / (_STEPS_OF_A_CONTACT * step)
    contact = f"{-(omega**2):.17g} {-2.0 * damping_ratio * omega:.17g}"
    point = 1e-9 * peer.mass * peer.hanging**2  # MuJoCo takes no moment of inertia of 0
    # The bodies hang along z = 0: x to the right, and gravity down in z.
    rows = "".join(
        f"""<body pos="{i * peer.spacing:.17g} 0 0">
        <joint name="swing{i}" type="hinge" axis="0 -1 0" damping="{peer.b * peer.hanging**2:.17g}"/>
        <joint name="string{i}" type="slide" axis="0 0 -1" stiffness="{stiffness:.17g}"
               springref="{peer.length - peer.hanging:.17g}" damping="{peer.b:.17g}"/>
        <inertial pos="0 0 {-peer.hanging:.17g}" mass="{peer.mass:.17g}" diaginertia="{point} {point} {point}"/>
        <geom type="sphere" pos="0 0 {-peer.hanging:.17g}" size="{peer.radius:.17g}"
              condim="1" solref="{contact}" solimp="0.9999 0.9999 0.001"/>
        </body>"""
        for i in range(bobs)
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{step:.17g}" gravity="0 0 {-peer.gravity:.17g}" integrator="implicitfast"/>
        <worldbody>{rows}</worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)

    def run(times: np.ndarray) -> np.ndarray:
        mujoco.mj_resetData(model, data)
        data.qpos[2 * bobs - 2] = angle
        theta = [data.qpos[::2].copy()]
        for _ in times[1:]:
            mujoco.mj_step(model, data, nstep=round((times[1] - times[0]) / step))
            theta.append(data.qpos[::2].copy())
        return np.array(theta)

    return run
