"""The Missing-Effect Bench.

    python -m studies.missing_effect_bench write DIR [--seed 0] [--cases 30]
    python -m studies.missing_effect_bench score ANSWERS DIR
    python -m studies.missing_effect_bench answer ENTRANT DIR ANSWERS
    python -m studies.missing_effect_bench results DIR

write: the task of a seed; that of seed 0 is the public set. score: the table of the answers in a folder. answer: lets
an entrant of this project answer. results: lets them all answer the public set in DIR, and writes results.md. All go
on where they stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from cradle_env import __version__
from identification.storage.files import write_file, write_json
from studies.kept_rows import keep_row, read_rows
from studies.missing_effect_bench.cases import PUBLIC_CASES, PUBLIC_SEED, public_truths, write
from studies.missing_effect_bench.entrants import BLIND, ENTRANTS, answer_case, judge_blind
from studies.missing_effect_bench.page import PAGE, ROWS, page
from studies.missing_effect_bench.scoring import judge, read_answers, table


def main() -> int:
    """Does what is asked."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.missing_effect_bench",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    command = commands.add_parser("write", help="write the task of a seed")
    command.add_argument("folder", type=Path)
    command.add_argument("--seed", type=int, default=PUBLIC_SEED)
    command.add_argument("--cases", type=int, default=PUBLIC_CASES)
    command = commands.add_parser("score", help="score the answers of any program")
    command.add_argument("answers", type=Path)
    command.add_argument("folder", type=Path)
    command = commands.add_parser("answer", help="let an entrant of this project answer")
    command.add_argument("entrant", choices=list(ENTRANTS))
    command.add_argument("folder", type=Path)
    command.add_argument("answers", type=Path)
    command = commands.add_parser("results", help="let the entrants of this project answer the public set")
    command.add_argument("folder", type=Path)
    asked = parser.parse_args()
    with threadpool_limits(1):
        try:
            _run(asked)
        except ValueError as problem:  # an answer or a folder that cannot be used
            print(problem, file=sys.stderr)
            return 2
    return 0


def _run(asked: argparse.Namespace) -> None:
    if asked.command == "write":
        write(asked.folder, asked.seed, asked.cases)
    elif asked.command == "score":
        print(score(asked.answers, asked.folder), end="")
    elif asked.command == "answer":
        let_answer(asked.entrant, asked.folder, asked.answers)
    else:
        keep_results(asked.folder)


def score(answers: Path, folder: Path) -> str:
    """The table of the answers in a folder to the task in another, beside entrants that look at no data."""
    truths = [json.loads(path.read_text(encoding="utf-8")) for path in sorted((folder / "truth").glob("*.json"))]
    if not truths:
        raise ValueError(f"{folder}: has no truth/*.json; name the folder that `write` wrote")
    judged = [judge(*pair) for pair in zip(read_answers(answers, truths), truths, strict=True)]
    return table({answers.name: judged, **judge_blind(truths)})


def let_answer(entrant: str, folder: Path, answers: Path) -> None:
    """Writes the answers of an entrant that are not there yet."""
    for case in json.loads((folder / "task.json").read_text(encoding="utf-8"))["cases"]:
        path = answers / f"{case['case']}.json"
        if not path.is_file():
            write_json(path, answer_case(entrant, folder / "cases" / case["case"], case["bobs"]))
            print(path, file=sys.stderr, flush=True)


def keep_results(folder: Path) -> None:
    """Adds a row for each answer to the public set that is not kept yet, and writes the page, also when interrupted."""
    write(folder, PUBLIC_SEED, PUBLIC_CASES)
    done = {(row["case"], row["entrant"]) for row in read_rows(ROWS)}
    asked = [(truth, entrant) for truth in public_truths() for entrant in ENTRANTS if entrant not in BLIND]
    left = [(truth, entrant) for truth, entrant in asked if (truth["case"], entrant) not in done]
    try:
        for truth, entrant in sorted(left, key=lambda pair: pair[0]["bobs"]):  # three bobs take minutes
            _keep_row(folder, truth, entrant)
    finally:
        write_file(PAGE, page(read_rows(ROWS), public_truths()))


def _keep_row(folder: Path, truth: Mapping[str, Any], entrant: str) -> None:
    began = time.process_time()
    answer = answer_case(entrant, folder / "cases" / truth["case"], truth["bobs"])
    row: dict[str, Any] = {"case": truth["case"], "entrant": entrant, "version": __version__}
    row |= {"seconds": round(time.process_time() - began, 1), "answer": answer}
    keep_row(ROWS, row)
    print(f"{truth['case']} {entrant} {row['seconds']} s", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
