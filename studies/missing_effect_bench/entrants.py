"""The entrants of this project: two that look at no data, `cradle diagnose`, a search by evidence, and a regression.

An entrant is a function from the folder of a case and its number of bobs to the probabilities of sets of names.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from identification.diagnosis.result import Diagnosis
from identification.experiment.experiment import Experiment
from studies.diagnosis.study import diagnose_without_advice
from studies.missing_effect_bench.candidates import COMMON_LENGTH, NOTHING, UNKNOWN, Names, prior
from studies.missing_effect_bench.regression import probability_of_unknown, regress
from studies.missing_effect_bench.scoring import Answer, Judged, Truth, check_answer, judge
from studies.selection.verdict import select_effects

Probabilities = Mapping[Names, float]

#: Sets less probable than this are left out of an answer: a hundred of them have 1 % together.
LEAST_PROBABILITY = 1e-4
#: diagnosis.json states no probability for these verdicts. This share of them was right in the held-out cases of
#: docs/study.jsonl with N ≤ 3 and without variants, with the same weight for each kind of case.
VERDICT_PROBABILITY = {"nothing_missing": 0.82, "unknown": 0.94}


def answer_nothing(_: Path, __: int) -> Probabilities:
    """Nothing is ever missing."""
    return {NOTHING: 1.0}


def answer_prior(_: Path, bobs: int) -> Probabilities:
    """What is known before the data."""
    return prior(bobs)


def answer_regression(folder: Path, bobs: int) -> Probabilities:
    """Fits the model as stated, and regresses its residuals on what each candidate would change."""
    return regress(Experiment.load(folder / "experiment.toml"), prior(bobs))


def answer_diagnose(folder: Path, bobs: int) -> Probabilities:
    """`cradle diagnose`."""
    return read_diagnosis(verdict_content(diagnose_without_advice(folder / "experiment.toml")), bobs)


def answer_evidence(folder: Path, bobs: int) -> Probabilities:
    """The search of studies/selection over sets of effects, by evidence.

    What its residual scan or its held-out data refute is unknown with the probability that the rival's periodogram has.
    """
    selection = select_effects(Experiment.load(folder / "experiment.toml"))
    weights: dict[Names, float] = {}
    for labels, odds in selection.compared:
        alike = [label.removesuffix(", all alike") for label in labels if label.endswith(", all alike")]
        names = frozenset(_own_name(label.removesuffix(", all alike"), alike, bobs) for label in labels)
        weights[names] = max(weights.get(names, 0.0), math.exp(odds))
    unknown = probability_of_unknown(prior(bobs)[UNKNOWN], selection.verdict == "unknown")
    share = (1.0 - unknown) / math.fsum(weights.values())
    return {UNKNOWN: unknown, **{names: share * weight for names, weight in weights.items()}}


ENTRANTS: dict[str, Callable[[Path, int], Probabilities]] = {
    "nothing": answer_nothing,
    "prior": answer_prior,
    "regression": answer_regression,
    "evidence": answer_evidence,
    "diagnose": answer_diagnose,
}
#: Those that look at no data.
BLIND = ("nothing", "prior")


def verdict_content(diagnosis: Diagnosis) -> dict[str, Any]:
    """The part of diagnosis.json that an answer needs, without the intervals, which take minutes."""
    steps = [step for step in diagnosis.repaired.steps if step.effect in diagnosis.effects]
    return {
        "verdict": diagnosis.verdict,
        "steps": [{"effect": step.effect, "probability": step.probability} for step in steps],
        "equivalent": [list(names) for names in diagnosis.equivalent],
        "alike": list(diagnosis.shared_effects),
    }


def read_diagnosis(content: Mapping[str, Any], bobs: int) -> Probabilities:
    """The content of diagnosis.json as probabilities.

    The named effects have the product of the probabilities of their steps, shared evenly by sets that are equivalent.
    What is left is spread as before the data.
    """
    if content["verdict"] in VERDICT_PROBABILITY:
        probability = VERDICT_PROBABILITY[content["verdict"]]
        found = {NOTHING if content["verdict"] == "nothing_missing" else UNKNOWN: probability}
    else:
        probability = math.prod(step["probability"] for step in content["steps"])
        named = [step["effect"] for step in content["steps"]]
        sets = [frozenset(_own_name(name, content["alike"], bobs) for name in (*named, *names))
                for names in content["equivalent"] or [[]]]  # fmt: skip
        found = {names: probability / len(sets) for names in sets}
    others = {names: p for names, p in prior(bobs).items() if names not in found}
    left = (1.0 - probability) / sum(others.values())
    return {**found, **{names: left * p for names, p in others.items()}}


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
