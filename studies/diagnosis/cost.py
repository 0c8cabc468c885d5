"""What a diagnosis costs on an idle machine: python -m studies.diagnosis.cost

`cradle diagnose` as one types it, report and advice included, of cases of the study at 60 frames/s, and of two of them
at 120 and 240: seconds by the clock, and of the processor. Kernels are compiled before. Rows go to
docs/diagnosis-cost.jsonl as they are found, docs/diagnosis-cost.md is made of all that is kept, and the same command
goes on. Nothing else may run beside it.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from identification.bench.diagnosis import is_right
from studies.diagnosis.rows import Row
from studies.diagnosis.study import Apparatus, cases
from studies.diagnosis.table import ROWS as STUDY
from studies.diagnosis.table import table
from studies.kept_rows import committed_code, keep_row, read_rows

DOCS = Path(__file__).parents[2] / "docs"
ROWS, PAGE = DOCS / "diagnosis-cost.jsonl", DOCS / "diagnosis-cost.md"
_RATE = 60.0
#: What is diagnosed at `_RATE`, and the seconds by the clock that were wanted.
CASES = {
    "N = 2, nothing missing": (5.0, ("28-nothing-1", "27-nothing-0", "28-nothing-0")),
    "N = 2, one effect": (
        15.0,
        ("28-angle_offset", "28-contact_duration", "28-frame_compliance", "28-length_mismatch", "28-spacer_offset"),
    ),
    "N = 2, in no catalogue": (30.0, ("28-unknown-vibration", "28-unknown-side_wind", "28-unknown-magnet")),
    "N = 3": (40.0, ("28-nothing-5", "28-angle_scale", "28-clock_scale", "28-quadratic_drag")),
    "N = 5": (90.0, ("27-nothing-1", "27-nothing-4", "28-exposure_blur")),
}
#: What is diagnosed at other rates, too: at them it should take no more than in proportion.
AT_RATES = {name: (120.0, 240.0) for name in ("28-nothing-1", "28-spacer_offset")}
_ASKED = [(name, _RATE) for _, names in CASES.values() for name in names] + [
    (name, rate) for name, rates in AT_RATES.items() for rate in rates
]


def measure(name: str, rate: float, of_study: Row) -> Row:
    """The row of a case at a number of frames per second."""
    case = next(case for case in cases([int(name[:2])]) if case.name == name)
    apparatus = Apparatus(case)
    apparatus.rate = rate
    with tempfile.TemporaryDirectory() as folder:
        path = apparatus.write(Path(folder), apparatus.record(of_study["strengths"], True))
        command = [sys.executable, "-m", "identification", "diagnose", str(path), "--out", f"{folder}/out"]
        used, began = _processor_seconds(), time.monotonic()
        subprocess.run(command, check=True, capture_output=True)
        seconds, used = time.monotonic() - began, _processor_seconds() - used
        found = json.loads(Path(folder, "out", "diagnosis.json").read_text(encoding="utf-8"))
    named, several = [step["effect"] for step in found["steps"]], found["equivalent"]
    return {
        "case": name, "bobs": apparatus.bobs, "rate": rate, "cores": os.cpu_count(), "seconds": round(seconds, 1),
        "processor": round(used, 1), "verdict": found["verdict"],
        "right": is_right(found["verdict"], named, several, of_study["hidden"]),
        "commit": committed_code(Path(__file__).parent),
    }  # fmt: skip


def _processor_seconds() -> float:
    """Of all programs that this one has run."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def page(rows: Sequence[Row]) -> str:
    """docs/diagnosis-cost.md."""
    by_case = {(row["case"], row["rate"]): row for row in rows}
    lines, rates = [], []
    for words, (wanted, names) in CASES.items():
        for i, name in enumerate(names):
            if row := by_case.get((name, _RATE)):
                lines.append((words if i == 0 else "", wanted if i == 0 else "", *_cells(row)))
    for name, several in AT_RATES.items():
        base = by_case.get((name, _RATE))
        for rate in several:
            if base and (row := by_case.get((name, rate))):
                rates.append((name, rate, rate / _RATE, f"{row['seconds'] / base['seconds']:.1f}", row["seconds"]))
    made = ", ".join(sorted({f"{row['cores']} cores, commit {row['commit']}" for row in rows}))
    return "\n".join([
        _HEAD, *table(("", "wanted [s]", "case", "by the clock [s]", "of the processor [s]", "verdict"), lines),
        "With more frames per second, beside 60:\n",
        *table(("case", "frames/s", "times the frames", "times the seconds", "by the clock [s]"), rates), f"{made}.\n",
    ])  # fmt: skip


_HEAD = """# What a diagnosis costs

Made by `python -m studies.diagnosis.cost` from docs/diagnosis-cost.jsonl. `cradle diagnose` as one types it, with its
report and its advice, of experiments of 45 s at 60 frames/s. They are cases of [the study](study.md), which draws
other rates for some of them. Nothing else ran on the machine. An asterisk marks a wrong verdict.
"""


def _cells(row: Row) -> tuple[object, ...]:
    verdict = row["verdict"] if row["right"] else f"{row['verdict']} *"
    return row["case"], row["seconds"], row["processor"], verdict.replace("_", " ")


def main() -> None:
    """Measures what is not yet kept, and writes the page, also when interrupted."""
    of_study, kept = {row["case"]: row for row in read_rows(STUDY)}, read_rows(ROWS)
    left = [pair for pair in _ASKED if pair not in {(row["case"], row["rate"]) for row in kept}]
    try:
        if left:
            measure(*_ASKED[0], of_study[_ASKED[0][0]])  # compiles kernels
        for name, rate in left:
            row = measure(name, rate, of_study[name])
            keep_row(ROWS, row)
            print(f"{name} at {rate:g} frames/s: {row['seconds']} s, {row['verdict']}", file=sys.stderr, flush=True)
    finally:
        PAGE.write_text(page(read_rows(ROWS)), encoding="utf-8")


if __name__ == "__main__":
    main()
