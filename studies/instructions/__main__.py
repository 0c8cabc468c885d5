"""Count the machine instructions of fixed workloads, and compare them with those kept.

    python -m studies.instructions [--keep]

Times differ from run to run and from machine to machine; the number of instructions does so by less than a percent.
Valgrind counts them (https://valgrind.org). Each workload runs whole and not at all, and the difference counts. The
kernels are compiled before, for processors with AVX2. Exits with 1 where a workload takes 10 % more than is kept in
counts.json; `--keep` keeps what was found.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba

from cradle_env import __version__
from studies.instructions.workloads import WORKLOADS

_KEPT = Path(__file__).parent / "counts.json"
#: More instructions than kept by this share fail.
_RISE = 0.10
_RUN = [sys.executable, "-m", "studies.instructions.workloads"]
_COUNT = ["valgrind", "--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null"]
# What Valgrind knows of processors ends with AVX2, and code for another processor would be compiled while it counts.
_ENVIRONMENT = os.environ | {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": "", "PYTHONHASHSEED": "0"}


def count(name: str, part: float) -> int:
    """Instructions of a process that runs a part of a workload."""
    run = subprocess.run(
        [*_COUNT, *_RUN, name, str(part)], env=_ENVIRONMENT, capture_output=True, text=True, check=True
    )
    found = re.search(r"I +refs: +([\d,]+)", run.stderr)
    if found is None:
        raise RuntimeError(f"Valgrind has counted nothing:\n{run.stderr}")
    print(f"{name}, {100 * part:g} %: {found[1]} instructions", file=sys.stderr)
    return int(found[1].replace(",", ""))


def main() -> int:
    """Counts, prints a table, and compares."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.instructions",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--keep", action="store_true", help="keep these counts in counts.json")
    asked = parser.parse_args()
    if shutil.which("valgrind") is None:
        print("Valgrind is not installed: nothing is counted.", file=sys.stderr)
        return 2
    for name in WORKLOADS:  # compiles
        subprocess.run([*_RUN, name, "1"], env=_ENVIRONMENT, check=True)
    parts = [(name, part) for name in WORKLOADS for part in (0.0, 1.0)]
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda one: count(*one), parts))
    counts = {name: found[2 * k + 1] - found[2 * k] for k, name in enumerate(WORKLOADS)}
    kept = json.loads(_KEPT.read_text(encoding="utf-8"))["counts"] if _KEPT.exists() else {}
    rose = False
    for name, instructions in counts.items():
        change = instructions / kept[name] - 1.0 if name in kept else 0.0
        rose |= change > _RISE
        print(f"{name:<40} {instructions / 1e6:9.1f} million  {100 * change:+.1f} %")
    if asked.keep:
        content = {"version": __version__, "numba": numba.__version__, "counts": counts}
        _KEPT.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    elif rose:
        print(f"A workload takes over {100 * _RISE:g} % more instructions than is kept; see {_KEPT.name}.")
    return int(rose and not asked.keep)


if __name__ == "__main__":
    sys.exit(main())
