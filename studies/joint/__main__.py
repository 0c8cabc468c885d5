"""Join runs with instruments, and count how often intervals hold the truth and warnings are right.

    python -m studies.joint [--cases 60] [--wrong 20]

What was found is kept in studies/joint/results.jsonl, a line for each case; the same command goes on from there.
results.md is made of all that is kept.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import tempfile
from pathlib import Path

from cradle_env import __version__
from studies.joint.judge import judge
from studies.joint.made import ARMS, draw, write
from studies.joint.page import page
from studies.kept_rows import keep_row, read_rows

_HERE = Path(__file__).parent
_ROWS = _HERE / "results.jsonl"


def main() -> int:
    """Judge the cases that are not kept yet, and write the page."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.joint", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=60, help="in which nothing is wrong; 0: results.md alone")
    parser.add_argument("--wrong", type=int, default=20, help="of each kind in which something is")
    asked = parser.parse_args()
    done = {(row["arm"], row["number"]) for row in read_rows(_ROWS)}
    for arm in ARMS:
        for number in range(asked.cases if arm == "nothing" else asked.wrong if asked.cases else 0):
            if (arm, number) in done:
                continue
            case = draw(arm, number)
            with tempfile.TemporaryDirectory() as folder:
                experiment = write(case, Path(folder))
                found = judge(experiment, case.truth, with_diagnosis=arm == "group drag")
            row = {"version": __version__, **dataclasses.asdict(case), **found}
            keep_row(_ROWS, row)
            print(f"{arm} {number}: {len(row['disagreements'])} warnings", file=sys.stderr, flush=True)
    (_HERE / "results.md").write_text(page(read_rows(_ROWS)), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
