"""The entrants of this project: two that look at no data, `cradle diagnose`, and its rivals.

An entrant is a function from the folder of a case and its number of bobs to the probabilities of sets of names.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from identification.diagnosis.result import Diagnosis
from identification.experiment.experiment import Experiment
from studies.diagnosis.study import diagnose_without_advice
from studies.missing_effect_bench.candidates import COMMON_LENGTH, NOTHING, UNKNOWN, Names, prior
from studies.missing_effect_bench.false_discovery import discover
from studies.missing_effect_bench.gaussian_process import weigh
from studies.missing_effect_bench.regression import regress
from studies.missing_effect_bench.scoring import Answer, Judged, Truth, check_answer, judge
from studies.missing_effect_bench.sparse_dynamics import vote

Probabilities = Mapping[Names, float]

#: Sets less probable than this are left out of an answer: a hundred of them have 1 % together.
LEAST_PROBABILITY = 1e-4
#: Probability of a force in no list where a test refutes all names: diagnosis.json states none then. This share of
#: such verdicts was right in the held-out cases of docs/study.jsonl with N ≤ 3 and without variants, with the same
#: weight for each kind of case.
PROBABILITY_OF_UNKNOWN = 0.94


def answer_nothing(_: Path, __: int) -> Probabilities:
    """Nothing is ever missing."""
    return {NOTHING: 1.0}


def answer_prior(_: Path, bobs: int) -> Probabilities:
    """What is known before the data."""
    return prior(bobs)


def answer_regression(folder: Path, bobs: int) -> Probabilities:
    """Fits the model as stated, and regresses its residuals on what each candidate would change."""
    return regress(Experiment.load(folder / "experiment.toml"), prior(bobs))


def answer_false_discovery(folder: Path, bobs: int) -> Probabilities:
    """Sparse regression of the same residuals that controls the share of false discoveries."""
    return discover(Experiment.load(folder / "experiment.toml"), prior(bobs))


def answer_gaussian_process(folder: Path, bobs: int) -> Probabilities:
    """A Gaussian process as the discrepancy of the model as stated. Needs the extra `rivals`."""
    return weigh(Experiment.load(folder / "experiment.toml"), prior(bobs))


def answer_pysindy(folder: Path, _: int) -> Probabilities:
    """Sparse dynamics of what the model as stated leaves. Needs the extra `rivals`."""
    return vote(Experiment.load(folder / "experiment.toml"))


def answer_diagnose(folder: Path, bobs: int) -> Probabilities:
    """`cradle diagnose`."""
    return read_diagnosis(verdict_content(diagnose_without_advice(folder / "experiment.toml")), bobs)


ENTRANTS: dict[str, Callable[[Path, int], Probabilities]] = {
    "nothing": answer_nothing,
    "prior": answer_prior,
    "regression": answer_regression,
    "false discovery": answer_false_discovery,
    "Gaussian process": answer_gaussian_process,
    "PySINDy": answer_pysindy,
    "diagnose": answer_diagnose,
}
#: Those that look at no data.
BLIND = ("nothing", "prior")


def verdict_content(diagnosis: Diagnosis) -> dict[str, Any]:
    """The part of diagnosis.json that an answer needs, without the intervals, which take minutes."""
    return {
        "verdict": diagnosis.verdict,
        "sets": [dataclasses.asdict(one) for one in diagnosis.repaired.sets],
        "alike": list(diagnosis.shared_effects),
    }


def read_diagnosis(content: Mapping[str, Any], bobs: int) -> Probabilities:
    """The content of diagnosis.json as probabilities.

    That of all sets without one of their own is spread as before the data.
    """
    found: dict[Names, float] = {}
    for one in content["sets"]:
        names = (
            UNKNOWN if one["kind"] == "law" else {_own_name(name, content["alike"], bobs) for name in one["effects"]}
        )
        if one["kind"] != "other":
            found[frozenset(names)] = found.get(frozenset(names), 0.0) + one["probability"]
    others = {names: p for names, p in prior(bobs).items() if names not in found}
    left = max(0.0, 1.0 - math.fsum(found.values())) / math.fsum(others.values())
    found |= {names: left * p for names, p in others.items()}
    if content["verdict"] != "unknown" or found[UNKNOWN] > PROBABILITY_OF_UNKNOWN:
        return found
    share = (1.0 - PROBABILITY_OF_UNKNOWN) / (1.0 - found[UNKNOWN])
    return {names: PROBABILITY_OF_UNKNOWN if names == UNKNOWN else share * p for names, p in found.items()}


def _own_name(name: str, alike: list[str], bobs: int) -> str:
    common = name == "length_mismatch" and (bobs == 1 or name in alike)
    return COMMON_LENGTH if common else name


def answer_case(entrant: str, folder: Path, bobs: int) -> Answer:
    """The answer of an entrant, as answer.schema.json says."""
    found = ENTRANTS[entrant](folder, bobs)
    kept = {names: p for names, p in found.items() if p > LEAST_PROBABILITY}
    total = math.fsum(kept.values())
    answer = {
        "format": "missing-effect-answer/1",
        "case": folder.name,
        "nothing": kept.pop(NOTHING, 0.0) / total,
        "unknown": kept.pop(UNKNOWN, 0.0) / total,
        "sets": [
            {"effects": sorted(names), "probability": p / total}
            for names, p in sorted(kept.items(), key=lambda item: (-item[1], sorted(item[0])))
        ],
    }
    return check_answer(answer, folder.name, entrant)


def judge_blind(truths: Sequence[Truth]) -> dict[str, list[Judged]]:
    """The entrants that look at no data, beside these truths: what any other should surpass."""
    return {
        entrant: [judge(answer_case(entrant, Path(truth["case"]), truth["bobs"]), truth) for truth in truths]
        for entrant in BLIND
    }
