"""The tables of a study of diagnoses: python -m studies.diagnosis.table DIR

The cases finished in DIR join those kept in docs/study.jsonl, one a line, and take the place of their like;
docs/study.md is made of all.
"""

from __future__ import annotations

import argparse
import functools
import itertools
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from cradle_env.plot_style import BLUE, GREY, png, styled
from studies.diagnosis.errors import REPETITIONS, choose_rows
from studies.diagnosis.errors import ROWS as AGAIN_ROWS
from studies.diagnosis.rows import (
    CONFOUNDED,
    KINDS,
    Row,
    below_detection_limit,
    comes_first,
    is_confounded,
    is_exact,
    kind,
    reported_names,
    rightly_named,
    stated_probabilities,
    values_covered,
)
from studies.diagnosis.study import HELD_OUT, ROUNDS, SEARCH, STIFFENED, Apparatus, cases
from studies.kept_rows import format_count, read_rows, wilson_interval

#: Cases by what the best wrong model, refitted, leaves over the right one, by the oracle [Δχ²].
BINS = ((-math.inf, 35.0, "about 15"), (35.0, 100.0, "about 50"), (100.0, math.inf, "about 200"))
_UNKNOWNS = ("k_f", "kappa", "b")
#: Errors of fewer cases say nothing.
FEWEST = 5
#: The parts of the study, by their rounds: those of the search by evidence, and those of the selection before it.
BY_EVIDENCE = "search by evidence, held out"
PARTS = {BY_EVIDENCE: range(SEARCH, ROUNDS), "earlier selection, held out": range(HELD_OUT, SEARCH),
         "earlier selection, looked at": range(HELD_OUT)}  # fmt: skip
HELD = tuple(name for name, rounds in PARTS.items() if rounds.start >= HELD_OUT)
#: Stated probabilities between which explanations are counted together.
RELIABILITY = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 1.0)
#: How many cases of each of KINDS were planned in the rounds before HELD_OUT.
PLANNED = (120, 180, 36, 0, 48)

ROWS, MISSES, PAGE, PICTURE = (
    Path(__file__).parents[2] / "docs" / name
    for name in ("study.jsonl", "study_misses.jsonl", "study.md", "reliability.png")
)

#: How long impacts of the stiffened reference last, as a share of real ones.
SHORTENED = STIFFENED**-0.4

HEAD = f"""# How often a diagnosis is right

Made by `python -m studies.diagnosis.study DIR` and `python -m studies.diagnosis.table DIR` from docs/study.jsonl,
which keeps every case. A case is an experiment of 45 s with one run and one lifted bob, simulated by the
soft-contact reference. It hides one effect, two or three effects, none, or a force that is in no catalogue. Δχ² is
the excess in χ² of the best wrong model over the right one on noiseless data. For a force of no catalogue it is the χ²
that the best set of up to two effects leaves. Brackets hold 95 % intervals.

**The search by evidence** judged rounds {SEARCH} and later: fresh seeds, each case once, each round by one commit that
was made before it. **The earlier selection** added effects one by one. It judged rounds {HELD_OUT} to {SEARCH - 1} once
each, but its rules changed with the misses of some of them; rounds 0 to {HELD_OUT - 1} had been looked at. Of what the
earlier selection missed in rounds {HELD_OUT} to {SEARCH - 1}, the search by evidence has judged the same data again
(`--misses`); the table below tells old from new.
That table contains only what the earlier selection missed, so it can only show gains. Compare the two by the first
table.

In the rounds before {HELD_OUT}, Δχ² is the χ² of the best wrong model itself, frames that differ from their formula
cannot be told from it, all bobs start unstretched, no frame is missing, and the noise is white and stated in the file.

**Stated correctly** are lengths, masses, δ, how bobs start, and the noise if it is stated. The start values of k_f,
κ and b are wrong by up to 15 %, and the release angle by its stated uncertainty of 1 mrad. The held-out cases vary,
each property independently: half start hanging, a quarter do not state the noise, a quarter miss 3 % of the frames,
and in an eighth the noise, which is stated, has a correlation of 0.3 from frame to frame. Impacts of the reference
last {SHORTENED:.4f} of real ones, unless their duration is the hidden effect. With three or more bobs that hang
unevenly they last as long as real ones, and the file says so.
"""

RELIABLE = """## Whether the probabilities are right

`sets` of `diagnosis.json` has a probability for each explanation: a set of effects, a law, nothing. If they are
calibrated, of the explanations with a probability of 0.9 nine in ten are right. Effects that are the same in all data
count as one. A law is right if the hidden force is in no catalogue. What a test refuted counts as well.

![Share of right explanations against their stated probability](reliability.png)
"""


FILMED_AGAIN = """Noise can make a verdict right by chance. Held-out cases of N ≤ 3 with effects of the catalogue,
made by their formulas, {several}, were therefore filmed {again} times more, each with other noise and another error
of the release. The right model was refitted from the true values (`python -m studies.diagnosis.errors`). No verdict
selected these cases. Frames, attraction and drag near neighbours were repeated after intervals came to cover other
shapes; before, 311 of the values of N = 2 lay within their intervals.
"""


def format_share(rows: Iterable[Row], test: Callable[[Row], bool]) -> str:
    """ "k of n (95 % interval of the share)"."""
    found = [test(row) for row in rows]
    return format_count(sum(found), len(found))


def table(header: Iterable[str], lines: Iterable[Iterable[object]]) -> list[str]:
    """A table in Markdown."""
    header = list(header)
    return ["| " + " | ".join(header) + " |", "|" + "---|" * len(header),
            *("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines), ""]  # fmt: skip


def summary(rows: list[Row]) -> dict[str, str]:
    """Shares of some cases, by what they are of."""
    nulls, singles, pairs, triples, unknown = ([row for row in rows if kind(row) == name] for name in KINDS)
    found = {
        "nothing hidden: found something (≤ 3 %)": format_share(nulls, lambda r: r["verdict"] != "nothing_missing")
    }
    for low, high, name in BINS:
        some = [row for row in singles if low <= row["oracle"] < high]
        promise = " (≥ 95 %)" if low >= BINS[1][0] else ""
        found |= {
            f"one effect, Δχ² {name}: it comes first{promise}": format_share(some, comes_first),
            f"one effect, Δχ² {name}: it is in the reported set (≥ 98 %)":
                format_share(some, lambda r: r["hidden"][0] in reported_names(r)),
            f"one effect, Δχ² {name}: exactly right, and all that is the same is mentioned":
                format_share(some, is_exact),
        }  # fmt: skip
    varied = [row for row in singles if row["variant"] and row["oracle"] >= BINS[1][0]]
    sizes = Counter(max(1, len(row["one of"])) for row in singles if is_exact(row))
    good = [row for row in rows if kind(row) in KINDS[1:-1] and is_exact(row)]
    values = [value for row in good if not row["variant"] for value in values_covered(row)]
    seconds = np.array([row["seconds"] for row in rows])
    return found | {
        "of these from 35 on, by an apparatus that differs from the formula: it comes first": format_share(
            varied, comes_first
        ),
        "one effect, exactly right: so many sets reported": ", ".join(f"{k}: {sizes[k]}" for k in sorted(sizes)),
        "two effects: both named (≥ 85 %)": format_share(pairs, lambda r: set(r["hidden"]) <= reported_names(r)),
        "two effects: exactly right": format_share(pairs, is_exact),
        "three effects: all named (≥ 60 %)": format_share(triples, lambda r: set(r["hidden"]) <= reported_names(r)),
        "three effects: exactly right": format_share(triples, is_exact),
        "in no catalogue: unknown (≥ 85 %)": format_share(unknown, lambda r: r["verdict"] == "unknown"),
        "in no catalogue: a wrong name (≤ 5 %)": format_share(unknown, lambda r: bool(reported_names(r))),
        "named rightly: held-out gap ≤ 1.05 (all)": format_share(good, lambda r: r["gap after"] <= 1.05),
        "named rightly: values of what is hidden within their 95 % intervals (93–97 %)": format_count(
            sum(values), len(values)
        ),
        "seconds of one core a case, without advice: median, largest": f"{np.median(seconds):.0f}, {seconds.max():.0f}",
    }


def errors_table(parts: dict[str, list[Row]]) -> list[str]:
    """Errors of k_f, κ and b over their standard deviations, where the verdict is right."""
    groups = {
        "nothing hidden": lambda r: not r["hidden"],
        "named": lambda r: r["hidden"] and not r["one of"],
        "one of several, intervals widened to hold whichever": lambda r: bool(r["one of"]),
    }
    lines = []
    for (part, rows), (group, test), (bobs, some) in itertools.product(
        parts.items(), groups.items(), (("N ≤ 3", {1, 2, 3}), ("N = 5", {5}))
    ):
        own = [row["errors"] for row in rightly_named(rows) if row["bobs"] in some and test(row)]
        cells = [_spread([one[key] for one in own if key in one]) for key in _UNKNOWNS]
        if set(cells) != {"–"}:
            lines.append((part, group, bobs, *cells))
    return table(("", "", "", "k_f", "κ", "b"), lines)


def _spread(errors: list[float]) -> str:
    if len(errors) < FEWEST:
        return "–"
    return f"{np.mean(errors):+.2f}, {np.sqrt(np.mean(np.square(errors))):.2f} ({len(errors)})"


def filmed_again(rows: list[Row]) -> list[str]:
    """The same of right models that no verdict chose, and whether intervals hold what is hidden."""
    lines = [
        (f"N = {bobs}", *(_spread([row["errors"][key] for row in own if key in row["errors"]]) for key in _UNKNOWNS),
         format_count(sum(inside := [value for row in own for value in values_covered(row)]), len(inside)))
        for bobs in (1, 2, 3) if (own := [row for row in rows if row["bobs"] == bobs])
    ]  # fmt: skip
    return table(("", "k_f", "κ", "b", "values of what is hidden within their 95 % intervals"), lines)


def by_effect(rows: list[Row]) -> list[str]:
    """Every effect: in how many cases it was hidden alone, and what was found."""
    singles = [row for row in rows if kind(row) == "one effect"]
    lines = []
    for name in sorted({row["hidden"][0] for row in singles}):
        own = [row for row in singles if row["hidden"][0] == name]
        strong = [row for row in own if row["oracle"] >= BINS[1][0]]
        lines.append((f"`{name}`", len(own), len(strong), sum(map(comes_first, strong)),
                      sum(name in reported_names(row) for row in strong)))  # fmt: skip
    return table(("hidden", "cases", "with Δχ² ≥ 35", "of these first", "in the set"), lines)


def by_setting(rows: list[Row]) -> list[str]:
    """Whether it matters how an experiment was filmed and described."""
    settings: dict[str, Callable[[Row], bool]] = {
        "starts unstretched": lambda s: s["start"] == "unstretched",
        "starts hanging": lambda s: s["start"] == "hanging",
        "noise stated": lambda s: s["noise_stated"],
        "noise not stated": lambda s: not s["noise_stated"],
        "frames missing": lambda s: s["missing"] > 0.0,
        "noise correlated": lambda s: s["correlation"] > 0.0,
    }
    lines = []
    for name, test in settings.items():
        some = [row for row in rows if test(row["settings"])]
        nulls = [row for row in some if kind(row) == "nothing hidden"]
        strong = [row for row in some if kind(row) == "one effect" and row["oracle"] >= BINS[1][0]]
        lines.append(
            (name, format_share(nulls, lambda r: r["verdict"] != "nothing_missing"), format_share(strong, comes_first))
        )
    return table(("", "nothing hidden: found something", "one effect, Δχ² ≥ 35: it comes first"), lines)


@functools.cache
def _planned(part: str) -> Counter[tuple[str, int]]:
    """How many cases of a held-out part there are to be, by kind and number of bobs."""
    found: Counter[tuple[str, int]] = Counter()
    for case in cases([*PARTS[part]]):
        apparatus = Apparatus(case)
        name = KINDS[-1 if apparatus.in_no_catalogue else len(case.kinds)]
        found[name, apparatus.bobs] += 1
    return found


def progress_table(parts: dict[str, list[Row]]) -> list[str]:
    """How much of the study is done."""
    lines = []
    for part, rows in parts.items():
        planned = _planned(part) if PARTS[part].start >= HELD_OUT else None
        for name, earlier in zip(KINDS, PLANNED, strict=True):
            counts = Counter(row["bobs"] for row in rows if kind(row) == name)
            each = [f"{counts[n]} of {planned[name, n]}" if planned else counts[n] for n in (1, 2, 3, 5)]
            total = sum(count for (one, _), count in planned.items() if one == name) if planned else earlier
            lines.append((part, name, *each, f"{counts.total()} of {total}"))
    return table(("", "", "N = 1", "2", "3", "5", "all"), lines)


def reliability_bins(rows: list[Row]) -> list[tuple[float, float, list[float], list[bool]]]:
    """(low, high, stated probabilities, whether each is right) of all explanations of some cases; see RELIABILITY."""
    pairs = [pair for row in rows for pair in stated_probabilities(row)]
    found = []
    for low, high in itertools.pairwise(RELIABILITY):
        own = [(p, right) for p, right in pairs if low <= p < high or p == high == 1.0]
        found.append((low, high, [p for p, _ in own], [right for _, right in own]))
    return found


def reliability_table(rows: list[Row]) -> list[str]:
    """Stated probabilities, and how many of them were right."""
    lines = [
        (f"{low:g} to {high:g}", f"{np.mean(stated):.2f}" if stated else "–", format_count(sum(right), len(right)))
        for low, high, stated, right in reliability_bins(rows)
    ]
    return table(("stated probability", "mean", "right"), lines)


@styled
def draw_reliability(rows: list[Row], path: Path) -> None:
    """The reliability diagram."""
    figure = Figure(figsize=(4.2, 3.8), layout="constrained")
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [0.0, 1.0], color=GREY, linestyle="--", label="calibrated")
    for _, _, stated, right in reliability_bins(rows):
        if right:
            low, high = wilson_interval(sum(right), len(right))
            share, at = float(np.mean(right)), float(np.mean(stated))
            axes.errorbar(at, share, [[share - low], [high - share]], fmt="o", color=BLUE, capsize=3)
            end, gap = (low, -10) if share > 0.5 else (high, 4)
            axes.annotate(
                f"of {len(right)}", (at, end), (0, gap), textcoords="offset points", ha="center", fontsize="small"
            )
    axes.set(xlabel="stated probability of an explanation", ylabel="share of them that is right, 95 % interval")
    axes.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02), aspect="equal")
    axes.legend(loc="upper left")
    path.write_bytes(png(figure))


def old_and_new_table(rows: list[Row], again: list[Row]) -> list[str]:
    """What the earlier selection missed, and what the search by evidence says of the same data. again: its rows."""
    old = {row["case"]: row for row in rows}
    lines = [
        (*_what(row), *map(format_verdict, (old[row["case"]], row)),
         "right" if is_exact(row) else "missed", f"{old[row['case']]['seconds']:.0f} → {row['seconds']:.0f}")
        for row in again
    ]  # fmt: skip
    return table((*_WHAT, "earlier selection", "search by evidence", "now", "CPU s"), lines)


def misses_table(rows: list[Row]) -> list[str]:
    """Every case that is not right. margin: the Δχ² of the fits to these very data; errors of k_f, κ and b."""
    lines = []
    for row in rows:
        if not is_exact(row):
            off = ", ".join(f"{row['errors'][key]:+.1f}" for key in _UNKNOWNS if key in row["errors"])
            lines.append((*_what(row), row.get("margin", ""), row["verdict"], _found(row), off,
                          below_detection_limit(row), row.get("reason", "")))  # fmt: skip
    header = (*_WHAT, "margin", "verdict", "found", "errors", "below limit", "reason")
    return table(header, lines)


def confounded_table(rows: list[Row]) -> list[str]:
    """The cases that count nowhere."""
    return table(
        (*_WHAT, "the right model leaves", "verdict", "found"),
        ((*_what(row), row.get("formula leaves", row["right leaves"]), row["verdict"], _found(row)) for row in rows),
    )


_WHAT = ("case", "hidden", "N", "noise", "Δχ²")


def _what(row: Row) -> tuple[object, ...]:
    """A case and what it hides."""
    what = row["case"].split("-", 2)[-1] if row["hidden"] == ["?"] else ", ".join(row["hidden"]) or "nothing"
    return row["case"], what, row["bobs"], f"{1e3 * row['noise']:g} mrad", f"{row['oracle']:.0f}"


def _found(row: Row) -> str:
    """What was found, in words."""
    several = " / ".join("+".join(names) for names in row["one of"])
    return ", ".join(row["named"]) + (" + one of " if row["named"] and several else "") + several


def format_verdict(row: Row) -> str:
    """A verdict and what was found, in words."""
    return f"{row['verdict']}: {_found(row) or '–'}"


def large_errors_table(rows: list[Row]) -> list[str]:
    """Every unknown of the right model beyond 3 of its standard deviations."""
    lines = []
    for row in rightly_named(rows):
        for key, error in row["errors"].items():
            if abs(error) > 3.0:
                case, _, *what = _what(row)
                apparatus = "the apparatus differs from the formula" if row["variant"] else ""
                lines.append((case, *what, key, f"{error:+.1f}", apparatus or row.get("reason", "")))
    return table(("case", "N", "noise", "Δχ²", "unknown", "error over its sd", "reason"), lines)


def load_row(path: Path) -> Row:
    """The row of a case; with the reason of a miss that its data explain."""
    row = json.loads(path.read_text(encoding="utf-8"))
    details = path.parent / "out" / "diagnosis.json"
    if {*row["named"]} - {*row["hidden"]} == {"contact_duration"} and details.is_file():
        scale = json.loads(details.read_text(encoding="utf-8"))["parameters"]["contact_duration.scale"]["median"]
        if SHORTENED / 3.0 < scale < 3.0 * SHORTENED:
            row["reason"] = f"impacts of the reference last {SHORTENED:.4f} of real ones; found: {scale:.4f}"
    return row


def _split_by_part(rows: list[Row]) -> dict[str, list[Row]]:
    """The cases by PARTS."""
    rounds = {row["case"]: int(row["case"].partition("-")[0]) for row in rows}
    return {name: [row for row in rows if rounds[row["case"]] in own] for name, own in PARTS.items()}


def render_page(rows: list[Row], again: list[Row], misses: list[Row] | None = None) -> str:
    """The whole page. again: the rows of `study_errors`. misses: of the misses that are judged again."""
    counted = [row for row in rows if not is_confounded(row)]
    parts = _split_by_part(counted)
    shares = [summary(some) if some else {} for some in parts.values()]
    lines = ((name, *(one.get(name, "–") for one in shares)) for name in next(filter(None, shares)))
    commits = ", ".join(f"{n} by {commit}" for commit, n in Counter(row["commit"] for row in rows).most_common())
    page = [HEAD, *table(("", *(f"{name}: {len(some)} cases" for name, some in parts.items())), lines)]
    if parts[BY_EVIDENCE]:
        page += [RELIABLE, *reliability_table(parts[BY_EVIDENCE]), "## Errors of the unknowns\n"]
    page += ["Errors of the unknowns over their standard deviations, where the verdict is right: mean (≤ 0.2), rms",
             "(0.8 to 1.25), and in brackets of how many.\n", *errors_table(parts)]  # fmt: skip
    if again:
        several = f"{len({row['case'] for row in again})} of {len(choose_rows(rows))} so far"
        page += [FILMED_AGAIN.format(several=several, again=REPETITIONS), *filmed_again(again)]
    held = [row for name in HELD for row in parts[name]]
    if held:
        page += ["By how the held-out experiments were filmed and described.\n", *by_setting(held)]
    page += ["By effect, all cases.\n", *by_effect(counted)]
    page += ["Done of planned. No more of those looked at are to be judged.\n",
             *progress_table(_split_by_part(rows)), f"Cases by the commit that judged them: {commits}.\n"]  # fmt: skip
    page += ["## Every miss\n",
             "Margin: what Δχ² came to in these very data, where the right effect was refitted. Errors: of k_f, κ and",
             "b over their standard deviations, in the last model (of one bob: κ and b). Below limit: whether what is",
             "hidden is weaker than what the diagnosis says these data may hide, where the row has it.\n"]  # fmt: skip
    for name, some in parts.items():
        page += [f"{name.capitalize()}:\n", *misses_table(some)] if not all(map(is_exact, some)) else []
    if misses:
        right = format_count(sum(map(is_exact, misses)), len(misses))
        page += ["## What the earlier selection missed, judged again\n",
                 f"Right now: {right} of those judged again so far. Seconds are of one core's processor, those of the",
                 "earlier selection on an older and slower simulator.\n",
                 *old_and_new_table(rows, misses)]  # fmt: skip
    page += ["## Errors beyond 3 standard deviations where the verdict is right\n", *large_errors_table(counted)]
    if len(counted) < len(rows):
        page += [f"## Counted nowhere: the right model itself leaves a χ² of more than {CONFOUNDED:g}\n",
                 *confounded_table([row for row in rows if is_confounded(row)])]  # fmt: skip
    return "\n".join(page)


def main() -> None:
    """Adds the cases of a folder to those kept, and writes the page and its picture anew."""
    parser = argparse.ArgumentParser(description="The tables of the study of diagnoses.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--misses", action="store_true", help="the folder holds misses that were judged again")
    chosen = parser.parse_args()
    path = MISSES if chosen.misses else ROWS
    rows = {row["case"]: row for row in read_rows(path)}
    for row in map(load_row, chosen.folder.glob("*/result.json")):
        known = {key: value for key, value in rows.get(row["case"], {}).items() if key == "reason"}
        rows[row["case"]] = {**known, **row}  # a reason may have been found since
    path.write_text("".join(json.dumps(rows[case]) + "\n" for case in sorted(rows)), encoding="utf-8")
    kept = read_rows(ROWS)
    PAGE.write_text(render_page(kept, read_rows(AGAIN_ROWS), read_rows(MISSES)), encoding="utf-8")
    draw_reliability(_split_by_part([row for row in kept if not is_confounded(row)])[BY_EVIDENCE], PICTURE)


if __name__ == "__main__":
    main()
