"""An effect of one's own, from outside the package: a magnet below the cradle brakes each bob as it passes.

    python examples/own_effect.py

Everything that simulator, experiment files, calibration and report need to know stands in the one declaration.
"""

import math

import numpy as np

from cradle_env import Cradle, Effect, Parameter, Release, register, simulate


def force(t, r, theta, v_r, v_theta, parameters):
    """(F_r, F_theta) [N] on a bob at radius r [m], angle theta [rad], velocity (v_r, v_theta) [m/s]; compiled."""
    strength, width = parameters[0], parameters[1]
    brake = strength * math.exp(-((theta / width) ** 2))
    return -brake * v_r, -brake * v_theta


eddy_brake = register(
    Effect(
        name="eddy_brake",
        symbol="c_m",
        acts_on="bob",
        summary="eddy currents in a bob that passes over a magnet",
        equation="F = −c_m exp(−(θ/w)²) v",
        reference="Wiederick et al., Am. J. Phys. 55, 500 (1987)",
        energy="takes c_m exp(−(θ/w)²) v²",
        looks_like="drag at the bottom of the swing only: small swings decay fastest",
        parameters=(
            Parameter("strength", "c_m", "kg/s", "drag above the magnet", absent=0.0, low=0.0, high=1.0, scale=1e-2),
            Parameter("width", "w", "rad", "reach of the magnet", absent=math.nan, low=1e-3, high=1.0, scale=0.05),
        ),
        force=force,
    )
)


def main(duration: float = 20.0) -> float:
    """Simulates a cradle without and with the magnet; prints both ledgers; the energy [J] that the magnet took."""
    taken = {}
    for name, effects in (("plain", {}), ("with a magnet", {"eddy_brake": {"strength": 0.01, "width": 0.03}})):
        run = simulate(Cradle(bobs=3, effects=effects), Release(angle=0.228), duration)
        energy = run.energy()
        taken[name] = energy.drag[-1]
        print(f"{name}: λ = {run.newton_exponent():.4f} 1/s; after {duration:g} s [mJ]:")
        for key in ("kinetic", "gravity", "strings", "drag", "impacts"):
            values = getattr(energy, key)
            print(f"  {key:<8} {1e3 * (values[-1] - values[0]):+9.3f}")
        print(f"  {'total':<8} {1e3 * np.ptp(energy.total):9.6f} is how far it strays")
    return taken["with a magnet"] - taken["plain"]


if __name__ == "__main__":
    main()
