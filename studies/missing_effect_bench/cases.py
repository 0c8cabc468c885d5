"""The cases: which there are, what each hides, and their files."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from cradle_env import __version__
from identification.storage.files import write_file, write_json
from studies.diagnosis.rows import is_confounded
from studies.diagnosis.study import PAIRS, SAME, SINGLES, TARGETS, UNKNOWNS, Apparatus, Case, Kind, hide
from studies.kept_rows import read_rows
from studies.missing_effect_bench.candidates import (
    EQUIVALENTS,
    KINDS,
    MOST_BOBS,
    UNEVEN,
    all_names,
    candidate_names,
    describe,
)

HERE = Path(__file__).parent
#: The truths of the public set. They are kept, so that a later version of the program writes the same data.
PUBLIC_SET = HERE / "public_set.jsonl"
PUBLIC_SEED, PUBLIC_CASES = 0, 30
#: Δχ² of the best wrong model over the right one, on noiseless data, from which a case says enough.
LEAST_DELTA = 10.0
#: Δχ² asked of each effect of a pair, and of a force in no catalogue, as in the study of diagnoses.
PAIR_TARGET, UNKNOWN_TARGET = 100.0, 200.0
#: Draws of an apparatus until one suits a case.
MOST_DRAWS = 100

_BY_NAME = {kind.name: kind for kind in SINGLES}
_HIDDEN: dict[str, tuple[tuple[Kind, ...], ...]] = {
    "nothing": ((),),
    "single": tuple((kind,) for kind in SINGLES if kind.name not in SAME),
    "pair": tuple(tuple(_BY_NAME[name] for name in pair) for pair in PAIRS),
    "equivalent": tuple((kind,) for kind in SINGLES if kind.name in SAME),
    "unknown": tuple((kind,) for kind in UNKNOWNS),
}


def case_name(number: int) -> str:
    """The name of a case, which says nothing about it."""
    return f"case-{number:03d}"


def plan(seed: int, number: int) -> tuple[str, tuple[Kind, ...], float]:
    """(kind, what is hidden, Δχ² asked) of a case: of each five, one of each kind, in an order drawn by the seed."""
    turn, place = divmod(number, len(KINDS))
    kind = KINDS[np.random.default_rng([seed, 1, turn]).permutation(len(KINDS))[place]]
    several = _HIDDEN[kind]
    order = np.random.default_rng([seed, 2, KINDS.index(kind)]).permutation(len(several))
    target = {"nothing": 0.0, "pair": PAIR_TARGET, "unknown": UNKNOWN_TARGET}.get(kind, TARGETS[turn % len(TARGETS)])
    return kind, several[order[turn % len(several)]], target


def find_truth(seed: int, number: int) -> dict[str, Any]:
    """What a case hides, its strengths found by the oracle of the study of diagnoses, which takes seconds."""
    kind, hidden, target = plan(seed, number)
    names = [one.name for one in hidden]
    for draw in range(MOST_DRAWS):
        own = int(np.random.default_rng([seed, 3, number, draw]).integers(2**31))
        apparatus = Apparatus(Case(case_name(number), hidden, target, False, own))
        bobs = apparatus.bobs
        if bobs > MOST_BOBS or (bobs == MOST_BOBS and UNEVEN & {*names}) or (bobs == 1 and "length_mismatch" in names):
            continue
        with tempfile.TemporaryDirectory() as scratch:
            found = hide(apparatus, Path(scratch))
        if not hidden or (found["oracle"] >= LEAST_DELTA and not is_confounded(found)):
            return {
                "format": "missing-effect-truth/1", "case": case_name(number), "seed": seed, "kind": kind,
                "effects": ["unknown"] if kind == "unknown" else names, "bobs": bobs, "delta_chi2": found["oracle"],
                "made_by": found.get("made by", {}), "cradle": apparatus.truth,
                "target": target, "apparatus_seed": own, "strengths": found["strengths"],
            }  # fmt: skip
    raise RuntimeError(f"{case_name(number)} of seed {seed}: no apparatus suits {names}; choose another seed")


def public_truths() -> list[dict[str, Any]]:
    """The truths of the public set."""
    return read_rows(PUBLIC_SET)


def write(folder: Path, seed: int, count: int) -> None:
    """Writes the task and its cases, and the truths apart; the same call goes on after an interruption."""
    kept = {row["case"]: row for row in public_truths() if row["seed"] == seed}
    truths = []
    for number in range(count):
        name = case_name(number)
        path = folder / "truth" / f"{name}.json"
        if path.is_file():
            truth = json.loads(path.read_text(encoding="utf-8"))
            if truth["seed"] != seed:
                raise ValueError(f"{folder} holds the cases of seed {truth['seed']}; choose another folder")
        else:
            truth = kept.get(name) or find_truth(seed, number)
            write_data(folder / "cases" / name, truth)
            write_json(path, truth)
            print(f"{name}: {number + 1} of {count}", file=sys.stderr, flush=True)
        truths.append(truth)
    write_task(folder, seed, truths)


def write_data(folder: Path, truth: dict[str, Any]) -> Path:
    """The experiment of a case, simulated by the soft-contact reference: experiment.toml and run1.csv."""
    hidden = plan(truth["seed"], int(truth["case"].partition("-")[2]))[1]
    apparatus = Apparatus(Case(truth["case"], hidden, truth["target"], False, truth["apparatus_seed"]))
    return apparatus.write(folder, apparatus.record(truth["strengths"], True))


def write_task(folder: Path, seed: int, truths: list[dict[str, Any]]) -> None:
    """The task in words, for programs, and the schema of an answer."""
    cases = [
        {"case": truth["case"], "bobs": truth["bobs"], "candidates": candidate_names(truth["bobs"])} for truth in truths
    ]
    write_json(folder / "task.json", {
        "format": "missing-effect-task/1", "version": __version__, "seed": seed,
        "candidates": {name: describe(name) for name in all_names()}, "equivalents": EQUIVALENTS,
        "kinds": KINDS, "cases": cases,
    })  # fmt: skip
    for source, name in (("task.md", "README.md"), ("answer.schema.json", "answer.schema.json")):
        write_file(folder / name, (HERE / source).read_bytes())
