"""How near the kernel is to what its arithmetic takes at least.

    python -m studies.instructions.limit

Counts the operations of one expansion by running its text on numbers that count, and the expansions of a run; divides
by the time of the run and by the instructions kept in counts.json.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from cradle_env import Cradle, Release
from cradle_env.mechanics import event_loop, restitution
from cradle_env.mechanics import layout as p
from cradle_env.mechanics.lanes import WIDTH
from cradle_env.mechanics.taylor import Forces, flight
from cradle_env.simulation import TOLERANCE, prepare
from studies.instructions.workloads import SECONDS

#: Multiplications, and additions, of a vector that a core of AMD's Zen 2 and later begins in a cycle.
_PER_CYCLE = 2
#: Cycles of a core in a second, about, of the machine that ran the study: it tells no more.
_CLOCK = 3.0e9


class _Counted:
    """A number that counts what is done to it."""

    counts: ClassVar[Counter[str]] = Counter()

    def _add(self, _: object) -> _Counted:
        self.counts["additions"] += 1
        return self

    def _multiply(self, _: object) -> _Counted:
        self.counts["multiplications"] += 1
        return self

    def _divide(self, _: object) -> _Counted:
        self.counts["divisions"] += 1
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = _add
    __mul__ = __rmul__ = _multiply
    __truediv__ = __rtruediv__ = _divide

    def root(self) -> _Counted:
        """Counts a square root."""
        self.counts["square roots"] += 1
        return self


def operations() -> Counter[str]:
    """Operations of one expansion, whether of one bob or of four at once."""
    before = Counter(_Counted.counts)
    one: Any = _Counted()
    flight(one, one, one, one, Forces(*[one] * len(Forces._fields)), p.ORDER, _Counted.root)
    return _Counted.counts - before


def expansions(bobs: int, duration: float) -> tuple[float, float]:
    """(expansions of single bobs, processor time [s]) of a run that is not sampled; the best of five."""
    best, flown = np.inf, 0.0
    for _ in range(5):
        c, records, S, W = prepare(Cradle(bobs=bobs), Release(angle=0.228), TOLERANCE)
        motion, energy, impacts = np.empty((1, bobs, 4)), np.empty((0, bobs, 7)), np.empty((100_000, 4))
        table, status, count, flown = restitution.universal_curves(), event_loop.PAUSED, 0, 0.0
        start = time.process_time()
        while status == event_loop.PAUSED:
            flown, S[0, p.FLOWN] = flown + S[0, p.FLOWN], 0.0
            status, count = event_loop.run(
                c[0], records, table, S, W, duration, np.array([duration]), motion, energy, impacts, count
            )
        best = min(best, time.process_time() - start)
        flown += S[0, p.FLOWN]
    return flown, best


def main() -> int:
    """Prints the figures."""
    done = operations()
    print(f"one expansion of order {p.ORDER}: " + ", ".join(f"{count} {name}" for name, count in done.items()))
    cycles = max(done["multiplications"], done["additions"]) / _PER_CYCLE
    kept = json.loads((Path(__file__).parent / "counts.json").read_text(encoding="utf-8"))["counts"]
    for bobs, name in ((2, "two bobs, not sampled"), (5, "five bobs, not sampled")):
        duration = SECONDS[bobs]
        flown, seconds = expansions(bobs, duration)
        vectors = flown / WIDTH
        share = vectors * done.total() / kept[name]
        least = vectors * cycles / _CLOCK
        print(
            f"N = {bobs}: {flown / duration:.0f} expansions of bobs and {kept[name] / duration:.3g} instructions a"
            f" simulated second, of which {100 * share:.0f} % are the arithmetic of expansions with all lanes in use;"
            f" {1e6 * seconds / duration:.0f} µs, of which that arithmetic takes {1e6 * least / duration:.1f} µs"
            f" ({100 * least / seconds:.0f} %) at {_CLOCK / 1e9:g} GHz"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
