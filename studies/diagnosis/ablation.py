"""What each rule of a diagnosis buys: python -m studies.diagnosis.ablation [--longest 200] [--processes 1]

Cases of the study with at most two bobs are diagnosed again, each time with one rule left out. Those that took longer
than `--longest` seconds are left out, for each costs as much again for some rules. The verdicts say how often each rule
makes a diagnosis right, and how often wrong. They chose nothing: the rules were written before. Rows go to
docs/ablation.jsonl as they are found, docs/ablation.md is made of all that is kept, and the same command goes on.
"""

from __future__ import annotations

import argparse
import functools
import json
import multiprocessing
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import numpy as np

from identification.bench.diagnosis import is_right
from identification.diagnosis import repair
from identification.diagnosis.selection import model_search
from identification.diagnosis.selection.evidence import LaplaceTerms
from identification.diagnosis.selection.fit_cache import FitCache
from studies.diagnosis.rows import KINDS, Row, is_confounded, kind
from studies.diagnosis.study import SEARCH, Apparatus, Case, cases, diagnose_without_advice
from studies.diagnosis.table import ROWS as STUDY
from studies.diagnosis.table import format_verdict, table
from studies.kept_rows import committed_code, format_count, keep_row, read_rows

DOCS = Path(__file__).parents[2] / "docs"
ROWS, PAGE = DOCS / "ablation.jsonl", DOCS / "ablation.md"
#: The diagnosis with all of its rules.
WHOLE = "all rules"
_MOST_BOBS = 2


@dataclass(frozen=True)
class Rule:
    """A rule, in the words of the table, and what takes it out. fits: whether models are fitted otherwise without it,
    or others; then no fit made with it serves, and its seconds can be compared."""

    words: str
    without: Callable[[], AbstractContextManager]
    fits: bool = False


def _replaced(owner: object, name: str, value: object) -> Callable[[], AbstractContextManager]:
    return lambda: mock.patch.object(owner, name, value)


def _untempered() -> AbstractContextManager:
    whole = LaplaceTerms.log_evidence
    return mock.patch.object(LaplaceTerms, "log_evidence", lambda self, _: whole(self, 1.0))


def _residuals_refute_nothing() -> AbstractContextManager:
    whole = repair._refutation
    left = "more than noise is left"
    return mock.patch.object(repair, "_refutation", lambda *of: whole(*of).replace(left, ""))


#: The rules, each left out in its turn.
RULES = (
    Rule("candidates start on early data, too", _replaced(model_search, "EARLY_STRENGTHS", ()), fits=True),
    Rule("modes are shared among models", _replaced(model_search.ModelSearch, "share_modes", lambda *_: None)),
    Rule("the best three models of a size are extended", _replaced(model_search, "BEAM", 1)),
    Rule("each effect can be dropped again", _replaced(model_search.ModelSearch, "_drop_each", lambda _, model: model)),
    Rule(
        "what leaves only noise is extended by what first order shows",
        _replaced(model_search, "SETTLED", 2.0),
        fits=True,
    ),
    Rule("evidence is tempered by correlated residuals", _untempered),
    Rule("an effect has prior odds", _replaced(model_search.ModelSearch, "log_prior", lambda *_: 0.0)),
    Rule("a learned law competes", _replaced(repair, "learn_law", lambda *_: None)),
    Rule("held-out data can refute names", _replaced(repair, "fails_prediction", lambda *_: False)),
    Rule("residuals that are more than noise refute names", _residuals_refute_nothing),
)


def judge(path: Path, hidden: Sequence[str], store: FitCache) -> Row:
    """The verdict of an experiment, what it names, whether that is right, and seconds of the processor."""
    began = time.process_time()
    with mock.patch.object(FitCache, "of", lambda *_: store):
        found = diagnose_without_advice(path)
    named, several = [*found.effects], [[*names] for names in found.equivalent]
    return {
        "verdict": found.verdict, "named": named, "one of": several,
        "right": is_right(found.verdict, named, several, hidden),
        "seconds": round(time.process_time() - began, 1),
    }  # fmt: skip


def ablate(case: Case, row: Row, done: Sequence[str] = ()) -> Iterator[Row]:
    """Rows of a case: by all rules, and without each of them; but those that are done. row: that of the study."""
    apparatus, commit = Apparatus(case), committed_code(Path(__file__).parent)
    new = functools.partial(FitCache, None, "")
    shared = new()
    with tempfile.TemporaryDirectory() as folder:
        path = apparatus.write(Path(folder), apparatus.record(row["strengths"], True))
        for words, rule in ((WHOLE, None), *((rule.words, rule) for rule in RULES)):
            if words in done:
                continue
            with rule.without() if rule else nullcontext():
                found = judge(path, row["hidden"], new() if rule and rule.fits else shared)
            yield {"case": case.name, "without": words, "hidden": row["hidden"], "commit": commit} | found


def choose(rows: Sequence[Row], longest: float) -> list[Row]:
    """The rows of the study that are judged again, in an order that has nothing to do with what they hide."""
    chosen = [
        row for row in rows
        if int(row["case"][:2]) >= SEARCH and row["bobs"] <= _MOST_BOBS and row["seconds"] <= longest
        and not is_confounded(row)
    ]  # fmt: skip
    np.random.default_rng(0).shuffle(chosen)  # type: ignore[arg-type]
    return chosen


def page(rows: Sequence[Row]) -> str:
    """docs/ablation.md."""
    by_rule = {words: {row["case"]: row for row in rows if row["without"] == words} for words in _WORDS}
    whole, lines, changed = by_rule[WHOLE], [], []
    for words, own in by_rule.items():
        both = [case for case in own if case in whole]
        shares = []
        for one in KINDS:
            some = [own[case] for case in both if kind(own[case]) == one]
            shares.append(f"{sum(row['right'] for row in some)} of {len(some)}")
        lost = [case for case in both if whole[case]["right"] > own[case]["right"]]
        won = [case for case in both if whole[case]["right"] < own[case]["right"]]
        right = format_count(sum(own[case]["right"] for case in both), len(both))
        spent, before = (sum(of[case]["seconds"] for case in both) for of in (own, whole))
        seconds = f"{spent / before:.2f}" if both and words in _TIMED else "–"
        lines.append((words, right, *shares, len(lost), len(won), seconds))
        changed += [(words, case, format_verdict(whole[case]), format_verdict(own[case])) for case in (*lost, *won)]
    header = ("without the rule that", "right", *KINDS, "made wrong", "made right", "times the seconds")
    return "\n".join([
        _HEAD, *table(header, lines),
        "## Every verdict that changed between right and wrong\n",
        *table(("without the rule that", "case", "with it", "without it"), changed),
        "Cases by the commit that judged them: " + ", ".join(
            f"{len({row['case'] for row in rows if row['commit'] == commit})} by {commit}"
            for commit in sorted({row["commit"] for row in rows})
        ) + ".\n",
    ])  # fmt: skip


_WORDS = (WHOLE, *(rule.words for rule in RULES))
_TIMED = {WHOLE, *(rule.words for rule in RULES if rule.fits)}
_HEAD = f"""# What each rule of a diagnosis buys

Made by `python -m studies.diagnosis.ablation` from docs/ablation.jsonl. Cases of [the study](study.md), rounds {SEARCH}
and later, with one or two bobs, are diagnosed again with one rule left out. Those that took longest are left out.
Parentheses hold 95 % Wilson intervals. The first line has all rules. A rule whose absence makes nothing wrong is not
useless: these cases did not need it, or another rule did its work. Seconds are of one core's processor, without
intervals and detection limits, over those of the same cases with all rules. They are left out where fits made with all
rules served again.
"""


def _ablate(asked: tuple[Case, Row, list[str]]) -> None:
    for found in ablate(*asked):
        keep_row(ROWS, found)
        print(json.dumps({key: found[key] for key in ("case", "without", "right", "seconds")}), flush=True)


def main() -> None:
    """Judges what is not yet kept, and writes the page, also when interrupted."""
    parser = argparse.ArgumentParser(description="What each rule of a diagnosis buys.")
    parser.add_argument("--longest", type=float, default=200.0, help="seconds that a case took in the study, at most")
    parser.add_argument("--processes", type=int, default=1)
    asked = parser.parse_args()
    kept = read_rows(ROWS)
    rows = {row["case"]: row for row in choose(read_rows(STUDY), asked.longest)}
    made = {case.name: case for case in cases(sorted({int(name[:2]) for name in rows}))} if rows else {}
    left = [(made[name], row, [one["without"] for one in kept if one["case"] == name]) for name, row in rows.items()]
    try:
        with multiprocessing.get_context("spawn").Pool(asked.processes) as pool:
            pool.map(_ablate, [one for one in left if len(one[2]) < len(_WORDS)], chunksize=1)
    finally:
        PAGE.write_text(page(read_rows(ROWS)), encoding="utf-8")


if __name__ == "__main__":
    main()
