"""Diagnoses of experiments whose answers are known: python -m identification.bench.diagnosis FOLDER --out DIR

FOLDER holds answers.json, {case: {"effects": [names], "truth": {parameter: value}}}, and a folder per case with its
experiment.toml. The effect "?" stands for one that is not in the catalogue. Each finished case is kept, so that the
same command resumes. DIR/study.md is the table of all cases, misses included.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cradle_env.effects import CATALOGUE
from cradle_env.parameter_name import ParameterName
from identification.diagnosis.report import save
from identification.diagnosis.workflow import diagnose
from identification.experiment.experiment import Experiment
from identification.storage.files import json_text, write_together

_COLUMNS = ("case", "hidden", "verdict", "named", "one of", "gap before", "gap after", "left", "seconds", "right")


def study(folder: Path, out: Path, seed: int = 0, workers: int | None = None) -> list[dict[str, Any]]:
    """Diagnose every case that is not yet finished; return the rows of the table."""
    answers = json.loads((folder / "answers.json").read_text(encoding="utf-8"))
    rows = []
    for name, answer in answers.items():
        done = out / name / "result.json"
        if not done.is_file():
            result_row = {
                "case": name,
                **diagnose_case(folder / name / "experiment.toml", out / name, answer, seed, workers),
            }
            write_together(done.parent, {done.name: json_text(result_row)})
        rows.append(json.loads(done.read_text(encoding="utf-8")))
        print(_markdown_row(rows[-1]), flush=True)
        write_together(out, {"study.md": markdown_table(rows)})
    return rows


def diagnose_case(
    path: Path, out: Path, answer: Mapping[str, Any], seed: int, workers: int | None
) -> dict[str, Any]:  # fmt: skip
    """Diagnose one case; return its row with the time that it took."""
    began = time.monotonic()
    content = save(diagnose(Experiment.load(path), seed=seed, workers=workers), out)
    return row(content, answer) | {"seconds": round(time.monotonic() - began, 1)}


def row(content: Mapping[str, Any], answer: Mapping[str, Any]) -> dict[str, Any]:
    """Compare a diagnosis with the answer.

    The row has the hidden and the named effects and whether they agree, the intervals of the hidden effects'
    parameters, and their detection limits. content: of diagnosis.json.
    """
    found = [step["effect"] for step in content["steps"]]
    hidden = [str(name) for name in answer["effects"]]
    known = {effect.name for effect in CATALOGUE}
    possible = set(hidden) <= known | {"?"}
    return {
        "hidden": hidden,
        "verdict": content["verdict"],
        "named": found,
        "one of": content["equivalent"],
        "gap before": content["gap_first"],
        "gap after": content["gap_last"],
        "left": content["remainder"]["significant"],
        "right": is_right(content["verdict"], found, content["equivalent"], hidden) if possible else None,
        "errors": parameter_errors(content["parameters"], answer.get("truth", {})),
        "intervals": {
            name: entry for name, entry in content["parameters"].items() if ParameterName.parse(name).effect in hidden
        },
        "unseen": [entry for entry in content["unseen"] if entry["effect"] in hidden],
    }


def is_right(verdict: str, found: Sequence[str], equivalent: Sequence[Sequence[str]], hidden: Sequence[str]) -> bool:
    """Whether the verdict is right for these hidden effects."""
    if not hidden:
        return verdict == "nothing_missing"
    if "?" in hidden:
        return verdict == "unknown"
    return any(sorted([*found, *names]) == sorted(hidden) for names in equivalent or [[]])


def parameter_errors(parameters: Mapping[str, Any], truth: Mapping[str, float]) -> dict[str, float]:
    """Errors of the cradle's parameters in units of their standard deviation. parameters: of diagnosis.json."""
    found = {}
    for name, value in truth.items():
        if name in parameters:
            entry = parameters[name]
            sd = (entry["ci95"][1] - entry["ci95"][0]) / (2.0 * 1.96)
            found[name] = round((entry["median"] - value) / sd, 2) if sd > 0.0 else float("nan")
    return found


def markdown_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Write the rows as a table in Markdown, and count the right ones."""
    lines = ["| " + " | ".join(_COLUMNS) + " |", "|" + "---|" * len(_COLUMNS)]
    lines += [_markdown_row(row) for row in rows]
    counted = [row for row in rows if row["right"] is not None]
    lines += ["", f"{sum(row['right'] for row in counted)} of {len(counted)} right."]
    if len(counted) < len(rows):
        lines.append(f"{len(rows) - len(counted)} cases hide effects that this catalogue does not have.")
    return "\n".join([*lines, ""])


def _markdown_row(row: Mapping[str, Any]) -> str:
    cells = []
    for key in _COLUMNS:
        value = row[key]
        if key == "right":
            value = {True: "yes", False: "**no**", None: "not in the catalogue"}[value]
        elif key == "one of":
            value = " or ".join(" + ".join(names) for names in value)
        elif isinstance(value, list):
            value = ", ".join(value)
        elif isinstance(value, float) and key != "seconds":
            value = f"{value:.3g}"
        cells.append(str(value))
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Diagnoses of experiments whose answers are known.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int)
    chosen = parser.parse_args()
    study(chosen.folder, chosen.out, chosen.seed, chosen.workers)
