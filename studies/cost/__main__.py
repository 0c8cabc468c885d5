"""Measure processor time and memory against the number of bobs, of cradles in a batch, and the duration.

    python -m studies.cost [--table]

Each case runs in a process of its own, three times after a first one that compiles; the best time counts. Rows are
kept in results.json, and results.md and cost.png are made of them; `--table` makes these alone.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from cradle_env import Cradle, Release, __version__, simulate, simulate_batch

_HERE = Path(__file__).parent
_REPEATS = 3


def bobs(size: int) -> None:
    """N bobs, δ = 0.01 of their diameter, for 20 s."""
    _run(Cradle(bobs=size, delta=0.01), 20.0)


def touching(size: int) -> None:
    """N bobs that touch at rest (δ = 0), for 20 s."""
    _run(Cradle(bobs=size), 20.0)


def duration(size: int) -> None:
    """Two bobs for a duration [s], not sampled."""
    _run(Cradle(bobs=2), float(size))


def batch(size: int) -> None:
    """A batch of cradles of two bobs, all different, for 1 s each, on one thread."""
    cradles = [Cradle(bobs=2, k_f=k_f) for k_f in np.linspace(10e3, 30e3, size)]
    simulate_batch(cradles, Release(angle=0.228), 1.0, 1.0, workers=1)


def _run(cradle: Cradle, seconds: float) -> None:
    simulate(cradle, Release(angle=0.228), duration=seconds, sample_rate=1.0 / seconds, ledger=False)


CASES: dict[str, tuple[Callable[[int], None], tuple[int, ...]]] = {
    "bobs": (bobs, (1, 2, 3, 5, 10, 20, 50, 100)),
    "touching": (touching, (1, 2, 3, 5, 10, 20, 50, 100)),
    "duration": (duration, (1, 10, 100, 1_000, 10_000)),
    "batch": (batch, (1, 10, 100, 1_000, 10_000, 100_000)),
}


def measure(case: str, size: int) -> dict[str, float]:
    """Best processor time [s] of one case in this process, and the most memory that it took [MiB]."""
    run = CASES[case][0]
    run(min(size, 10))
    times = []
    for _ in range(_REPEATS):
        start = time.process_time()
        run(size)
        times.append(time.process_time() - start)
    return {"seconds": min(times), "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0}


def exponent(rows: list[dict]) -> tuple[float, float]:
    """Exponent of the time against the size, above a tenth of the largest size, and its standard deviation."""
    sizes, times = np.array([(row["size"], row["seconds"]) for row in rows if row["size"] >= rows[-1]["size"] / 10]).T
    if len(sizes) < 3:
        return float(np.diff(np.log(times))[-1] / np.diff(np.log(sizes))[-1]), np.nan
    fit, spread = np.polyfit(np.log(sizes), np.log(times), 1, cov="unscaled")
    left = np.log(times) - np.polyval(fit, np.log(sizes))
    return float(fit[0]), float(np.sqrt(spread[0, 0] * np.sum(left**2) / (len(sizes) - 2)))


def table(found: dict[str, list[dict]]) -> Iterator[str]:
    """Lines of results.md."""
    yield "# What runs cost, against their size"
    yield ""
    yield "`python -m studies.cost`. Processor time of one core, best of three, not sampled. Memory is the most that"
    yield "the process took, with Python and the packages. Exponents of the time are those between a tenth of the"
    yield "largest size and the largest."
    yield ""
    yield "![Time against size](cost.png)"
    for case, rows in found.items():
        value, sd = exponent(rows)
        yield from ("", f"## {case}", "", (CASES[case][0].__doc__ or "").strip(), "")
        yield f"Exponent {value:.2f}" + (f" ± {sd:.2f}." if np.isfinite(sd) else ".")
        yield ""
        yield "| size | time [ms] | memory [MiB] |"
        yield "|---|---|---|"
        yield from (f"| {row['size']} | {1e3 * row['seconds']:.3g} | {row['memory']:.0f} |" for row in rows)
    yield ""


def picture(found: dict[str, list[dict]]) -> None:
    """Draws cost.png."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 3, figsize=(10, 3.2), layout="constrained", sharey=True)
    wanted = (("number of bobs", ("bobs", "touching")), ("duration [s]", ("duration",)), ("cradles", ("batch",)))
    names = {"bobs": "δ = 0.01", "touching": "δ = 0", "duration": "two bobs", "batch": "two bobs, 1 s"}
    for panel, (label, cases) in zip(panels, wanted, strict=True):
        for case, marker in zip(cases, "os", strict=False):
            rows = found[case]
            name = f"{names[case]}: exponent {exponent(rows)[0]:.2f}"
            panel.loglog([row["size"] for row in rows], [row["seconds"] for row in rows], marker=marker, label=name)
        panel.set_xlabel(label)
        panel.legend(fontsize="small")
    panels[0].set_ylabel("processor time [s]")
    figure.savefig(_HERE / "cost.png", dpi=120)


def main() -> int:
    """Measures each case in a process of its own, and writes the page."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.cost", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--table", action="store_true", help="make results.md and cost.png of what is kept")
    parser.add_argument("--case", nargs=2, metavar=("CASE", "SIZE"), help="measure one case in this process")
    asked = parser.parse_args()
    if asked.case:
        print(json.dumps(measure(asked.case[0], int(asked.case[1]))))
        return 0
    path = _HERE / "results.json"
    if not asked.table:
        found: dict[str, list[dict]] = {}
        for case, (_, sizes) in CASES.items():
            for size in sizes:
                command = [sys.executable, "-m", "studies.cost", "--case", case, str(size)]
                run = subprocess.run(command, capture_output=True, text=True, check=True)
                found.setdefault(case, []).append({"size": size, **json.loads(run.stdout)})
                print(case, found[case][-1], file=sys.stderr)
        path.write_text(json.dumps({"version": __version__, "found": found}, indent=1) + "\n", encoding="utf-8")
    found = json.loads(path.read_text(encoding="utf-8"))["found"]
    (_HERE / "results.md").write_text("\n".join(table(found)), encoding="utf-8")
    picture(found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
