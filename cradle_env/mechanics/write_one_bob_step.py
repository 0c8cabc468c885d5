"""Writes one_bob_step.py: the step of one bob with the method's coefficients in place.

Run it after a change to tableau.py or to this file: `python -m cradle_env.mechanics.write_one_bob_step`.
"""

from pathlib import Path

import numpy as np

from cradle_env.mechanics.tableau import A, B, C

TARGET = Path(__file__).with_name("one_bob_step.py")

_HEADER = '''"""One eighth-order step of a bob that moves alone; local variables make it 4 times as fast as loops.

Written by `python -m cradle_env.mechanics.write_one_bob_step`; edit that instead.
"""

from cradle_env.mechanics.forces import pivot_at, rates
from cradle_env.mechanics.jit import jit
from cradle_env.mechanics.layout import BROUGHT, CONTACT_LOSS, DRAG, OUT, RATE0, START, T0, TENSION


@jit
def step_one_bob(cradle, bobs, S, W, i, h):
    """Advances bob i by h [s] from the start of its segment, into W[:, OUT]."""
    bob = bobs[i]
    drive = bob.drive
    t0, t1, t2 = S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2]  # memory of the strings
    x0, z0, vx0, vz0 = S[i, START], S[i, START + 1], S[i, START + 2], S[i, START + 3]

    # Stage 0. Rates of stage k: uk, wk of the coordinates, axk, azk of the velocities, pk of the energy lost to drag,
    # qk of the energy that a moving pivot brings in.
    u0, w0, ax0, az0 = S[i, RATE0], S[i, RATE0 + 1], S[i, RATE0 + 2], S[i, RATE0 + 3]
    p0, q0 = S[i, RATE0 + DRAG], S[i, RATE0 + BROUGHT]
'''

_STAGE = """
    # Stage {s}
    t = S[i, T0] + {c!r} * h
{weights}
    x = x0 + h * ({u})
    z = z0 + h * ({w})
    u{s} = vx0 + h * ({ax})
    w{s} = vz0 + h * ({az})
    ax{s}, az{s}, {power}, {pull} = rates(cradle, bob, t0, t1, t2, t, pivot_at(bob, t), drive, x, z, u{s}, w{s})
"""

_ENERGY = """    q{s} = -drive * pull
"""

_RESULT = """
    # Result
{weights}
    W[i, OUT] = x0 + h * ({u})
    W[i, OUT + 1] = z0 + h * ({w})
    W[i, OUT + 2] = vx0 + h * (
        {ax}
    )
    W[i, OUT + 3] = vz0 + h * (
        {az}
    )
    W[i, OUT + DRAG] = S[i, START + DRAG] + h * (
        {p}
    )
    W[i, OUT + BROUGHT] = S[i, START + BROUGHT] + h * (
        {q}
    )
    W[i, OUT + CONTACT_LOSS] = S[i, START + CONTACT_LOSS]
"""


def source() -> str:
    """The text of one_bob_step.py."""
    stages = "".join(_stage(s) for s in range(1, len(C)))
    return _HEADER + stages + _RESULT.format(**_sums(B))


def _stage(s: int) -> str:
    # Stages of no weight in the result need no energies.
    power, pull, energy = (f"p{s}", "pull", _ENERGY.format(s=s)) if B[s] != 0.0 else ("_", "_", "")
    return _STAGE.format(s=s, c=float(C[s]), power=power, pull=pull, **_sums(A[s])) + energy


def _sums(weights: np.ndarray) -> dict[str, str]:
    """The weights as variables, and the weighted sum of each rate of the stages, without zeros."""
    used = np.flatnonzero(weights)
    sums = {rate: " + ".join(f"c{k} * {rate}{k}" for k in used) for rate in ("u", "w", "ax", "az", "p", "q")}
    return sums | {"weights": "\n".join(f"    c{k} = {float(weights[k])!r}" for k in used)}


if __name__ == "__main__":
    TARGET.write_text(source(), encoding="utf-8")
