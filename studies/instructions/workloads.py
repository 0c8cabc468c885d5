"""What is counted: runs of cradles, by name.

    python -m studies.instructions.workloads NAME PART

runs PART (0 to 1) of a workload in this process.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import gymnasium
import numpy as np

from cradle_env import Cradle, Release, simulate

#: Simulated seconds of the whole of a workload: a billion instructions. The count of a process differs from run to run
#: by 15 million.
SECONDS = {2: 2000.0, 5: 400.0}
#: Control steps of the environment.
_STEPS = 20_000


def _run(bobs: int, part: float, rate: float = 1.0, **options) -> None:
    duration = max(part * SECONDS[bobs], 2.0)
    simulate(Cradle(bobs=bobs), Release(angle=0.228), duration=duration, sample_rate=rate, ledger=False, **options)


def _ledger(part: float) -> None:
    simulate(Cradle(bobs=5), Release(angle=0.228), duration=max(part * SECONDS[5], 2.0), sample_rate=1.0, ledger=True)


def _derivatives(part: float) -> None:
    _run(2, 0.3 * part, sensitivities=("k_f", "kappa", "b", "release_angle"))


def _environment(part: float) -> None:
    env = gymnasium.make("NewtonCradle-v0", bobs=5)
    over = True
    for k in range(max(int(part * _STEPS), 2)):
        if over:
            env.reset(seed=0)
        *_, terminated, truncated, _ = env.step(np.full(2, 0.5 * np.sin(0.3 * k), np.float32))
        over = terminated or truncated


WORKLOADS: dict[str, Callable[[float], None]] = {
    "two bobs, not sampled": lambda part: _run(2, part),
    "five bobs, not sampled": lambda part: _run(5, part),
    "five bobs, 240 samples/s": lambda part: _run(5, part, 240.0),
    "five bobs, energy ledger": _ledger,
    "two bobs, four derivatives, 600 s": _derivatives,
    "environment of five bobs, 20 000 steps": _environment,
}

if __name__ == "__main__":
    WORKLOADS[sys.argv[1]](float(sys.argv[2]))
