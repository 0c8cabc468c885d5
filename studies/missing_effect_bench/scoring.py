"""Reads answers, and scores them against the truths.

The score of a case is Brier's: the sum of (p − o)² over all answers that data can tell apart, where o is 1 for the
truth and 0 for the others. Equivalents count as one answer. 0 is the best, and 2 the worst. README.md says why this
rule.
"""

from __future__ import annotations

import functools
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cradle_env.errors import one_line
from identification.storage.files import read_text
from studies.kept_rows import format_count
from studies.missing_effect_bench.candidates import EQUIVALENTS, KINDS, NOTHING, UNKNOWN, Names, all_names, merge

#: Probabilities of an answer may differ from a sum of 1 by so much: rounding.
SUM_TOLERANCE = 1e-6
#: The answers of a credible set have at least this probability together.
CREDIBLE = 0.95
#: A share of one name, of the probability that all equivalents have, from which an answer claims too much.
OVERCLAIM = 0.9
#: Ends of the bins of the table of probabilities.
BINS = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)

Answer = Mapping[str, Any]
Truth = Mapping[str, Any]


@dataclass(frozen=True)
class Judged:
    """One answer beside its truth.

    kind, truth: of the case. probabilities: of each merged set. top: the most probable one, None of a tie.
    probability: that of the top. credible: the most probable sets, as few as have CREDIBLE together. overclaims:
    whether the equivalents are the top, but one of their names has nearly all of their probability.
    """

    kind: str
    truth: Names
    probabilities: Mapping[Names, float]
    top: Names | None
    probability: float
    credible: frozenset[Names]
    overclaims: bool

    @property
    def right(self) -> bool:
        """Whether the most probable answer is the truth."""
        return self.top == self.truth

    @property
    def score(self) -> float:
        """Brier's, from 0 to 2."""
        others = sum(p**2 for names, p in self.probabilities.items() if names != self.truth)
        return others + (1.0 - self.probabilities.get(self.truth, 0.0)) ** 2


def read_answers(folder: Path, truths: Sequence[Truth]) -> list[Answer]:
    """The answers to the cases of these truths, in their order. ValueError, with the file, if one cannot be scored."""
    return [check_answer(_read(folder / f"{truth['case']}.json"), truth["case"], folder) for truth in truths]


def _read(path: Path) -> Any:
    text, _ = read_text(path)
    try:
        return json.loads(text)
    except ValueError as problem:
        raise ValueError(f"{path}: not valid JSON: {problem}") from None


@functools.cache
def _validator() -> Any:
    from jsonschema import Draft202012Validator

    return Draft202012Validator(json.loads((Path(__file__).parent / "answer.schema.json").read_text(encoding="utf-8")))


def check_answer(answer: Any, case: str, where: Path | str) -> Answer:
    """The answer, if it is one to this case: as the schema says, of known names, with a sum of 1."""
    from jsonschema.exceptions import best_match

    at = f"{where}, answer to {case}"
    problem = best_match(_validator().iter_errors(answer))
    if problem is not None:
        wanted = problem.schema.get("description", problem.message) if isinstance(problem.schema, dict) else ""
        field = problem.json_path.removeprefix("$.").removeprefix("$") or "the file"
        raise ValueError(f"{at}: {field} is {one_line(problem.instance)}; expected {wanted} (answer.schema.json)")
    if answer["case"] != case:
        raise ValueError(f"{at}: is of {one_line(answer['case'])}; name each file as its case")
    for name in {name for entry in answer["sets"] for name in entry["effects"]}:
        if name not in all_names():
            raise ValueError(f"{at}: {one_line(name)} is no candidate; task.json lists them")
    total = answer["nothing"] + answer["unknown"] + sum(entry["probability"] for entry in answer["sets"])
    if not math.isclose(total, 1.0, abs_tol=SUM_TOLERANCE):
        raise ValueError(f"{at}: probabilities sum to {total:.6g}; they must sum to 1")
    return answer


def judge(answer: Answer, truth: Truth) -> Judged:
    """One answer beside its truth."""
    found: dict[Names, float] = {NOTHING: answer["nothing"], UNKNOWN: answer["unknown"]}
    by_name: dict[str, float] = {}
    for entry in answer["sets"]:
        names, p = merge(entry["effects"]), entry["probability"]
        found[names] = found.get(names, 0.0) + p
        for name in {*entry["effects"]}.intersection(EQUIVALENTS):
            by_name[name] = by_name.get(name, 0.0) + p
    ranked = sorted(found.items(), key=lambda item: -item[1])
    (top, probability), second = ranked[0], ranked[1][1]
    reached = np.cumsum([p for _, p in ranked])
    count = min(int(np.searchsorted(reached, CREDIBLE - SUM_TOLERANCE)) + 1, len(ranked))
    last = ranked[count - 1][1]
    equivalents = merge(EQUIVALENTS[:1])
    return Judged(
        truth["kind"], merge(truth["effects"]), found, top if probability > second else None, probability,
        frozenset(names for names, p in found.items() if p >= last > 0.0),
        bool(top & equivalents) and max(by_name.values()) > OVERCLAIM * sum(by_name.values()),
    )  # fmt: skip


def summarize(judged: Sequence[Judged]) -> dict[str, str]:
    """What the table says of one entrant, by the name of the line."""

    def count(some: Sequence[Judged], test: Any) -> str:
        return format_count(sum(map(test, some)), len(some))

    of = {kind: [one for one in judged if one.kind == kind] for kind in KINDS}
    scores = np.array([one.score for one in judged])
    error = f" ± {scores.std(ddof=1) / math.sqrt(len(scores)):.2f}" if len(scores) > 1 else ""
    lines = {"score (0 best, 2 worst): mean ± standard error": f"{scores.mean():.2f}{error}" if len(scores) else "–"}
    lines["right"] = count(judged, lambda one: one.right)
    lines |= {f"right, {kind}": count(of[kind], lambda one: one.right) for kind in KINDS}
    return lines | {
        f"in the {100 * CREDIBLE:.0f} % credible set": count(judged, lambda one: one.truth in one.credible),
        "answers in that set, median": f"{np.median([len(one.credible) for one in judged]):g}" if judged else "–",
        "nothing: false alarm": count(of["nothing"], lambda one: one.top not in (NOTHING, None)),
        "unknown: wrong name": count(of["unknown"], lambda one: one.top not in (NOTHING, UNKNOWN, None)),
        "equivalent: sure of one name": count(of["equivalent"], lambda one: one.right and one.overclaims),
    }


def reliability(judged: Sequence[Judged]) -> dict[str, str]:
    """How often the most probable answer is right, by the probability that was stated for it."""
    found = {}
    for low, high in itertools.pairwise(BINS):
        some = [one for one in judged if low < one.probability <= high]
        found[f"{low:g} to {high:g}"] = format_count(sum(one.right for one in some), len(some))
    return found


def table(by_entrant: Mapping[str, Sequence[Judged]]) -> str:
    """Both tables, in Markdown, with a column for each entrant."""
    parts = []
    for title, summary in (("", summarize), ("stated probability of the most probable answer: right", reliability)):
        columns = {name: summary(judged) for name, judged in by_entrant.items()}
        keys = next(iter(columns.values())).keys()
        lines = [[title, *columns], ["---"] * (1 + len(columns))]
        lines += [[key, *(column[key] for column in columns.values())] for key in keys]
        parts.append("\n".join("| " + " | ".join(line) + " |" for line in lines))
    return "\n\n".join(parts) + "\n"
