"""The page of studies/selection: old and new side by side, with Wilson intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from studies.diagnosis.rows import KINDS, Row, kind
from studies.kept_rows import format_count

#: Δχ² from which one effect should be found: below, the data say little.
STRONG = 35.0
GROUPS: tuple[tuple[str, Callable[[Row], bool]], ...] = (
    ("nothing hidden", lambda row: kind(row) == KINDS[0]),
    (f"one effect, Δχ² ≥ {STRONG:.0f}", lambda row: kind(row) == KINDS[1] and row["oracle"] >= STRONG),
    (f"one effect, Δχ² < {STRONG:.0f}", lambda row: kind(row) == KINDS[1] and row["oracle"] < STRONG),
    ("two effects", lambda row: kind(row) == KINDS[2]),
    ("in no catalogue", lambda row: kind(row) == KINDS[-1]),
    ("all", lambda _: True),
)

INTRODUCTION = (
    "# Selection by evidence beside the diagnosis",
    "",
    "Made by `python -m studies.selection DIR`, of results.jsonl. *Right* is what docs/study.md calls right: the",
    "verdict that the hidden effects call for. Parentheses hold 95 % Wilson intervals. Seconds are of processor. Those",
    "of `diagnose` are from docs/study.jsonl: on an older, slower simulator, with more work (intervals, limits, laws),",
    "so that their ratio is no speedup of the algorithm. Asterisks mark a wrong answer; p is the probability of the",
    "first set, scan p that of the residual scan.",
)


def write_page(rows: Sequence[Row], path: Path) -> None:
    """Writes the tables of both parts, and every case that either got wrong."""
    lines = [*INTRODUCTION, ""]
    for title, part in (
        ("Development", [row for row in rows if row["development"]]),
        ("Held out", [row for row in rows if not row["development"]]),
    ):
        if part:
            lines += [f"## {title}", "", *_counts(part), "", *_misses(part), ""]
    path.write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")


def _counts(rows: Sequence[Row]) -> list[str]:
    lines = ["| hidden | selection right | `diagnose` right | only selection | only `diagnose` | CPU s, median |",
             "|---|---|---|---|---|---|"]  # fmt: skip
    for title, belongs in GROUPS:
        own = [row for row in rows if belongs(row)]
        if own:
            new, old = ([bool(row["right"]) for row in part] for part in (own, [row["old"] for row in own]))
            only = [sum(a and not b for a, b in zip(*pair, strict=True)) for pair in ((new, old), (old, new))]
            seconds = sorted(row["seconds"] for row in own)[len(own) // 2]
            before = sorted(row["old"]["seconds"] for row in own)[len(own) // 2]
            lines.append(f"| {title} | {format_count(sum(new), len(own))} | {format_count(sum(old), len(own))} "
                         f"| {only[0]} | {only[1]} | {seconds:.0f} (old {before:.0f}) |")  # fmt: skip
    return lines


def _misses(rows: Sequence[Row]) -> list[str]:
    wrong = [row for row in rows if not (row["right"] and row["old"]["right"])]
    if not wrong:
        return ["No case was missed by either."]
    lines = ["Missed by one or both:", "", "| case | bobs | Δχ² | hidden | selection | p | scan p | `diagnose` |",
             "|---|---|---|---|---|---|---|---|"]  # fmt: skip
    for row in wrong:
        sets = [names for names, _ in row["sets"]]
        old = row["old"]
        said = [old["named"], *old["one of"]] if old["named"] else old["one of"]
        lines.append(f"| {row['case']} | {row['bobs']} | {row['oracle']:.0f} | {', '.join(row['hidden']) or '–'} "
                     f"| {_answer(row, sets)} | {row.get('probability', 0.0):.2f} | {row.get('scan_p', 0.0):.3f} "
                     f"| {_answer(old, said)} |")  # fmt: skip
    return lines


def _answer(row: Row, sets: Sequence[Sequence[str]]) -> str:
    names = " / ".join(" + ".join(names) or "base" for names in sets)
    return f"{'**' if not row['right'] else ''}{row['verdict']}{'**' if not row['right'] else ''}: {names or '–'}"
