"""results.md: the tables of all entrants of this project on the public set, and every case."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from studies.missing_effect_bench.candidates import EQUIVALENTS, Names, merge
from studies.missing_effect_bench.entrants import judge_blind
from studies.missing_effect_bench.scoring import Judged, Truth, judge, table

ROWS, PAGE = (Path(__file__).parent / name for name in ("results.jsonl", "results.md"))

HEAD = """# The Missing-Effect Bench: results

Made by `python -m studies.missing_effect_bench results DIR` from results.jsonl and public_set.jsonl.
[README.md](README.md) defines the lines of the tables. Parentheses hold 95 % Wilson intervals.

- `nothing` always says that nothing is missing. `prior` knows how often each kind of case comes, and looks at no data.
- `regression` fits the model as stated and regresses its residuals on what each candidate would change.
- `false discovery` selects from the same regression with control of the expected share of false discoveries.
- `Gaussian process` models the residuals as a process over time: it says whether something is missing, not what.
- `PySINDy` learns sparse dynamics of what the readings hold beyond the model, in the flights between impacts.
- `diagnose` is `cradle diagnose`, which searches sets of effects by evidence. It has a column once it has answered.
- `earlier diagnose` is the one of version 0.2.0, which added effects one by one. Its answers are kept, not made anew.
"""


def page(rows: Sequence[dict[str, Any]], truths: Sequence[Truth]) -> str:
    """The page of these rows."""
    by_case = {truth["case"]: truth for truth in truths}
    entrants = list(dict.fromkeys(row["entrant"] for row in rows))
    answered = {(row["case"], row["entrant"]) for row in rows}
    cases = [name for name in sorted(by_case) if all((name, entrant) in answered for entrant in entrants)]
    rows = [row for row in rows if row["case"] in cases]
    blind = judge_blind([by_case[name] for name in cases])
    judged = {entrant: dict(zip(cases, some, strict=True)) for entrant, some in blind.items()}
    seconds: dict[str, list[float]] = {}
    for row in rows:
        judged.setdefault(row["entrant"], {})[row["case"]] = judge(row["answer"], by_case[row["case"]])
        seconds.setdefault(row["entrant"], []).append(row["seconds"])
    took = [f"`{name}` {statistics.median(some):.0f} s, {max(some):.0f} s" for name, some in seconds.items()]
    versions = ", ".join(sorted({row["version"] for row in rows}))
    lines = [
        HEAD, f"{len(cases)} of the {len(truths)} cases{_missing(by_case, cases)}. Version {versions}.", "",
        table({name: list(some.values()) for name, some in judged.items()}),
        f"Seconds of one core for a case, median and largest: {'; '.join(took)}.", "",
        "## Every case", "",
        "Δχ² is that of the best wrong model over the right one, on noiseless data. The most probable answer of each",
        "entrant follows, with its probability. Asterisks mark a wrong one.", "",
        "| case | hidden | N | Δχ² | " + " | ".join(seconds) + " |", "|---" * (4 + len(seconds)) + "|",
    ]  # fmt: skip
    for name in cases:
        cells = [_cell(judged[entrant][name]) for entrant in seconds]
        lines.append("| " + " | ".join([name, *_facts(by_case[name]), *cells]) + " |")
    return "\n".join([*lines, ""])


def _facts(truth: Truth) -> list[str]:
    """What is hidden, N and Δχ²."""
    names = " + ".join(truth["made_by"]) or "nothing"
    return [
        f"{names} (unknown)" if truth["kind"] == "unknown" else names,
        str(truth["bobs"]),
        f"{truth['delta_chi2']:.0f}",
    ]


def _missing(by_case: dict[str, Truth], cases: Sequence[str]) -> str:
    """How many cases of each number of bobs nobody has answered yet."""
    left = Counter(truth["bobs"] for name, truth in by_case.items() if name not in cases)
    return "".join(f"; not answered: {count} with N = {bobs}" for bobs, count in sorted(left.items()))


def _cell(judged: Judged) -> str:
    mark = "" if judged.right else "**"
    return f"{mark}{'a tie' if judged.top is None else _words(judged.top)}{mark}, {judged.probability:.2f}"


def _words(names: Names) -> str:
    return " + ".join(sorted("equivalents" if {name} == merge(EQUIVALENTS) else name for name in names)) or "nothing"
