"""The tables of a study of diagnoses: python -m tests.study_table DIR

The cases finished in DIR join those kept in docs/study.jsonl, one a line, and take the place of their like;
docs/study.md is made of all.
"""

from __future__ import annotations

import itertools
import json
import math
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from .study import STIFFENED, held_out

#: Cases by what the best wrong model, refitted, leaves over the right one, by the oracle [Δχ²].
BINS = ((-math.inf, 35.0, "about 15"), (35.0, 100.0, "about 50"), (100.0, math.inf, "about 200"))

ROWS, PAGE = (Path(__file__).parents[1] / "docs" / name for name in ("study.jsonl", "study.md"))

#: How long impacts of the stiffened reference last, as a share of real ones.
SHORTENED = STIFFENED**-0.4

Row = dict


def reported(row: Row) -> set[str]:
    """Every name that a diagnosis mentions."""
    return {*row["named"], *(name for names in row["one of"] for name in names)}


def first(row: Row) -> bool:
    """Whether what is hidden is the first name, or in the first place among equals."""
    return row["hidden"][0] in (row["named"][:1] or [name for names in row["one of"] for name in names])


def share(rows: Iterable[Row], test: Callable[[Row], bool]) -> str:
    """ "k of n (95 % interval of the share)"."""
    found = [test(row) for row in rows]
    if not found:
        return "–"
    n, k, z = len(found), sum(found), 1.96
    middle, half = (k + z**2 / 2) / (n + z**2), z * math.sqrt(k * (n - k) / n + z**2 / 4) / (n + z**2)
    return f"{k} of {n} ({100 * max(0.0, middle - half):.0f}–{100 * min(1.0, middle + half):.0f} %)"


def table(header: Iterable[str], lines: Iterable[Iterable[object]]) -> list[str]:
    """A table in Markdown."""
    header = list(header)
    return ["| " + " | ".join(header) + " |", "|" + "---|" * len(header),
            *("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines), ""]  # fmt: skip


def summary(rows: list[Row]) -> list[str]:
    """Shares and errors of some cases."""
    nulls = [row for row in rows if not row["hidden"]]
    singles = [row for row in rows if len(row["hidden"]) == 1 and row["hidden"] != ["?"]]
    pairs = [row for row in rows if len(row["hidden"]) == 2]
    unknown = [row for row in rows if row["hidden"] == ["?"]]
    lines = [("nothing hidden: found something (≤ 5 %)", share(nulls, lambda r: r["verdict"] != "nothing_missing"))]
    for low, high, name in BINS:
        some = [row for row in singles if low <= row["oracle"] < high]
        lines.append((f"one effect, Δχ² {name}: it comes first (≥ 90 % from 50 on)", share(some, first)))
        lines.append((f"one effect, Δχ² {name}: it is in the reported set (≥ 98 %)",
                      share(some, lambda r: r["hidden"][0] in reported(r))))  # fmt: skip
        lines.append((f"one effect, Δχ² {name}: exactly right", share(some, lambda r: r["right"])))
    varied = [row for row in singles if row["variant"] and row["oracle"] >= BINS[1][0]]
    lines.append(("of these from 35 on, by an apparatus that differs from the formula in detail: it comes first",
                  share(varied, first)))  # fmt: skip
    lines.append(("two effects: both named (≥ 70 %)", share(pairs, lambda r: set(r["hidden"]) <= reported(r))))
    lines.append(("in no catalogue: unknown (≥ 80 %)", share(unknown, lambda r: r["verdict"] == "unknown")))
    lines.append(("in no catalogue: a wrong name (≤ 5 %)", share(unknown, lambda r: bool(reported(r)))))
    good = [row for row in rows if row["hidden"] and row["right"] and row["hidden"] != ["?"]]
    lines.append(("named rightly: held-out gap ≤ 1.05 (all)", share(good, lambda r: r["gap after"] <= 1.05)))
    right = of_the_right_model(rows)
    for key, (bobs, some) in itertools.product(("k_f", "kappa", "b"), (("N ≤ 3", {1, 2, 3}), ("N = 5", {5}))):
        errors = np.array([row["errors"][key] for row in right if key in row["errors"] and row["bobs"] in some])
        if len(errors):
            lines.append((f"error of {key} over its sd, {bobs}: mean (≤ 0.2), rms (0.8–1.25)",
                          f"{errors.mean():+.2f}, {np.sqrt(np.mean(errors**2)):.2f} ({len(errors)})"))  # fmt: skip
    seconds = np.array([row["seconds"] for row in rows])
    lines.append(("seconds of one core a case, without advice: median, largest",
                  f"{np.median(seconds):.0f}, {seconds.max():.0f}"))  # fmt: skip
    return table(("", "measured"), lines)


def by_effect(rows: list[Row]) -> list[str]:
    """Every effect: in how many cases it was hidden alone, and what was found."""
    singles = [row for row in rows if len(row["hidden"]) == 1 and row["hidden"] != ["?"]]
    lines = []
    for name in sorted({row["hidden"][0] for row in singles}):
        own = [row for row in singles if row["hidden"][0] == name]
        strong = [row for row in own if row["oracle"] >= 35.0]
        lines.append((f"`{name}`", len(own), len(strong), sum(map(first, strong)),
                      sum(name in reported(row) for row in strong)))  # fmt: skip
    return table(("hidden", "cases", "with Δχ² ≥ 35", "of these first", "in the set"), lines)


def misses(rows: list[Row]) -> list[str]:
    """Every case that is not right."""
    lines = []
    for row in rows:
        if not row["right"]:
            found = ", ".join(row["named"]) + (" + one of " if row["named"] and row["one of"] else "")
            found += " / ".join("+".join(names) for names in row["one of"])
            what = row["case"].split("-", 2)[-1] if row["hidden"] == ["?"] else ", ".join(row["hidden"]) or "nothing"
            lines.append((row["case"], what, row["bobs"], f"{1e3 * row['noise']:g} mrad", f"{row['oracle']:.0f}",
                          row["verdict"], found, row.get("reason", "")))  # fmt: skip
    return table(("case", "hidden", "N", "noise", "Δχ²", "verdict", "found", "reason"), lines)


def of_the_right_model(rows: list[Row]) -> list[Row]:
    """The cases that are right and whose parameters are those of the right model: of equals they are the first's."""
    return [
        row
        for row in rows
        if row["right"] and sorted([*row["named"], *(row["one of"] or [[]])[0]]) == sorted(row["hidden"])
    ]


def far_off(rows: list[Row]) -> list[str]:
    """Every unknown of the right model beyond 3 of its standard deviations."""
    lines = []
    for row in of_the_right_model(rows):
        for key, error in row["errors"].items():
            if abs(error) > 3.0:
                apparatus = "differs from the formula in detail" if row["variant"] else ""
                lines.append((row["case"], row["bobs"], f"{1e3 * row['noise']:g} mrad", f"{row['oracle']:.0f}",
                              key, f"{error:+.1f}", apparatus))  # fmt: skip
    return table(("case", "N", "noise", "Δχ²", "unknown", "error over its sd", "apparatus"), lines)


def loaded(path: Path) -> Row:
    """The row of a case; with the reason of a miss that its data explain."""
    row = json.loads(path.read_text(encoding="utf-8"))
    details = path.parent / "out" / "diagnosis.json"
    if {*row["named"]} - {*row["hidden"]} == {"contact_duration"} and details.is_file():
        scale = json.loads(details.read_text(encoding="utf-8"))["parameters"]["contact_duration.scale"]["median"]
        if SHORTENED / 3.0 < scale < 3.0 * SHORTENED:
            row["reason"] = f"impacts of the reference last {SHORTENED:.4f} of real ones; found: {scale:.4f}"
    return row


def text(rows: list[Row]) -> str:
    """The whole page."""
    held = [row for row in rows if held_out(row["case"])]
    open_ = [row for row in rows if not held_out(row["case"])]
    commits = ", ".join(f"{n} by {commit}" for commit, n in Counter(row["commit"] for row in rows).most_common())
    head = (
        "# How often a diagnosis is right\n\n"
        "Made by `python -m tests.study DIR` and `python -m tests.study_table DIR`, of docs/study.jsonl,\n"
        "which keeps every case: experiments of 45 s, written by\n"
        "the soft-contact reference, each with one thing hidden, two, none, or a force that is in no catalogue.\n"
        "Δχ² is what the best wrong model leaves over the right one. In brackets 95 % intervals.\n"
        "Odd rounds from the third on are held out: nothing was chosen by looking at them.\n"
        f"Cases by the commit that judged them: {commits}.\n"
    )
    parts = [head]
    for name, some in (("Held out", held), ("Looked at while the procedure was made", open_)):
        if some:
            parts += [f"## {name}: {len(some)} cases\n", "\n".join(summary(some))]
    parts += ["## By effect, all cases\n", "\n".join(by_effect(rows)), "## Every miss\n", "\n".join(misses(rows))]
    parts += ["## Errors beyond 3 standard deviations where the answer is right\n", "\n".join(far_off(rows))]
    return "\n".join(parts)


def main() -> None:
    """Adds the cases of a folder to those kept, and writes the page anew."""
    lines = ROWS.read_text(encoding="utf-8").splitlines() if ROWS.is_file() else []
    rows = {row["case"]: row for row in map(json.loads, lines)}
    rows |= {row["case"]: row for row in map(loaded, Path(sys.argv[1]).glob("*/result.json"))}
    kept = [rows[case] for case in sorted(rows)]
    ROWS.write_text("".join(json.dumps(row) + "\n" for row in kept), encoding="utf-8")
    PAGE.write_text(text(kept), encoding="utf-8")


if __name__ == "__main__":
    main()
