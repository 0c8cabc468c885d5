"""`python -m studies.selection DIR`: selects effects in cases of docs/study.jsonl, beside the diagnosis's own answers.

Each case is made again from its seed and the strengths in its row, and goes to DIR; the same command goes on where it
stopped. What is done is kept in studies/selection/results.jsonl, and its tables in results.md.
"""

from __future__ import annotations

import argparse
import json
import shutil
import time
import traceback
from dataclasses import asdict
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from identification.bench.diagnosis import is_right
from identification.experiment.experiment import Experiment
from studies.diagnosis.rows import Row
from studies.diagnosis.study import Apparatus, Case, cases
from studies.kept_rows import read_rows
from studies.selection.table import write_page
from studies.selection.verdict import Selection, select_effects

#: Rounds by which the procedure may be developed, and rounds by which nothing is chosen.
DEVELOPMENT, HELD_OUT = tuple(range(12, 20)), tuple(range(20, 27))
#: Bobs of a case at most: selection at three bobs and more is not tested.
MOST_BOBS = 2
HERE = Path(__file__).parent


def run_case(case: Case, old: Row, folder: Path) -> Row:
    """The row of a case: what is hidden, the selection, the processor's seconds, and the old row's answer."""
    apparatus = Apparatus(case)
    path = apparatus.write(folder, apparatus.record(old["strengths"], True))
    hidden = old["hidden"]
    row: Row = {key: old[key] for key in ("case", "bobs", "noise", "rate", "oracle", "hidden")}
    row["development"] = int(case.name[:2]) in DEVELOPMENT
    row["old"] = {key: old[key] for key in ("verdict", "named", "one of", "right", "seconds", "commit")}
    began = time.process_time()
    try:
        selection = select_effects(Experiment.load(path))
        row |= asdict(selection) | {"right": is_right(*_as_steps(selection), hidden)}
    except Exception as problem:  # a crash is a miss, to be listed as such
        row |= {"verdict": f"crashed: {problem!r}", "sets": [], "right": False, "trace": traceback.format_exc()}
    shutil.rmtree(folder)
    return row | {"seconds": round(time.process_time() - began, 1)}


def _as_steps(selection: Selection) -> tuple[str, list[str], list[list[str]]]:
    """(verdict, names, equivalent sets) as diagnosis.json has them."""
    if selection.verdict in ("unknown", "nothing_missing"):
        return selection.verdict, [], []
    sets = [list(names) for names, _ in selection.sets]
    return selection.verdict, [], sets


def _line(row: Row) -> str:
    said, old = " | ".join("+".join(names) or "base" for names, _ in row["sets"]), row["old"]
    return (
        f"{row['case']:26} N = {row['bobs']} Δχ² {row['oracle']:6.0f} {row['hidden']} → {row['verdict']} {said}, "
        f"{row['seconds']} s {'' if row['right'] else 'NOT RIGHT'} (diagnose: {old['verdict']}, {old['seconds']} s)"
    )


def main() -> None:
    """Runs what is not yet there, then writes the tables."""
    parser = argparse.ArgumentParser(prog="python -m studies.selection", description=__doc__)
    parser.add_argument("folder", type=Path, help="scratch folder of the experiments")
    parser.add_argument("--rounds", type=int, nargs="+", default=[*DEVELOPMENT, *HELD_OUT])
    parser.add_argument("--results", type=Path, default=HERE / "results.jsonl")
    asked = parser.parse_args()
    old = {row["case"]: row for row in read_rows(HERE.parents[1] / "docs" / "study.jsonl")}
    done = {row["case"] for row in read_rows(asked.results)}
    left = [case for case in cases(asked.rounds) if case.name in old and case.name not in done]
    np.random.default_rng(0).shuffle(left)  # type: ignore[arg-type]  # what is done when it stops is a fair part
    left = sorted((case for case in left if old[case.name]["bobs"] <= MOST_BOBS), key=lambda c: old[c.name]["bobs"])
    with threadpool_limits(1):
        for case in left:
            row = run_case(case, old[case.name], asked.folder / case.name)
            with asked.results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row, ensure_ascii=False) + "\n")
            print(_line(row), flush=True)
    write_page(read_rows(asked.results), HERE / "results.md")


if __name__ == "__main__":
    main()
