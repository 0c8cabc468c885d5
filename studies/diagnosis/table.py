"""The tables of a study of diagnoses: python -m studies.diagnosis.table DIR

The cases finished in DIR join those kept in docs/study.jsonl, one a line, and take the place of their like;
docs/study.md is made of all.
"""

from __future__ import annotations

import functools
import itertools
import json
import math
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

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
    values_covered,
)
from studies.diagnosis.study import EARLIER, HELD_OUT, LATEST, ROUNDS, STIFFENED, Apparatus, cases
from studies.kept_rows import format_count, read_rows

#: Cases by what the best wrong model, refitted, leaves over the right one, by the oracle [Δχ²].
BINS = ((-math.inf, 35.0, "about 15"), (35.0, 100.0, "about 50"), (100.0, math.inf, "about 200"))
_UNKNOWNS = ("k_f", "kappa", "b")
#: Errors of fewer cases say nothing.
FEWEST = 5
#: The parts of the study, by their rounds; which are held out.
PARTS = {f"held out, {LATEST} and {ROUNDS - 1}": range(LATEST, ROUNDS),
         f"held out, {EARLIER} to {LATEST - 1}": range(EARLIER, LATEST),
         "held out before": range(HELD_OUT, EARLIER), "looked at": range(HELD_OUT)}  # fmt: skip
HELD = tuple(name for name, rounds in PARTS.items() if rounds.start >= HELD_OUT)
#: How many cases of each of KINDS were planned in the rounds before HELD_OUT.
PLANNED = (120, 180, 36, 0, 48)

ROWS, PAGE = (Path(__file__).parents[2] / "docs" / name for name in ("study.jsonl", "study.md"))

#: How long impacts of the stiffened reference last, as a share of real ones.
SHORTENED = STIFFENED**-0.4

HEAD = f"""# How often a diagnosis is right

Made by `python -m studies.diagnosis.study DIR` and `python -m studies.diagnosis.table DIR` from docs/study.jsonl,
which keeps every case. A case is an experiment of 45 s with one run and one lifted bob, simulated by the
soft-contact reference. It hides one effect, two effects, none, or a force that is in no catalogue. Δχ² is the
excess in χ² of the best wrong model over the right one on noiseless data. Brackets hold 95 % intervals.

**All rows were judged by an earlier selection**, which added effects one by one. The search by evidence has replaced
it; `studies/selection/results.md` compares the two on cases of this table.

**Held out** are rounds {HELD_OUT} to {ROUNDS - 1}. Each case was judged once, by a procedure that was not tuned to
it. If a miss led to a change of the procedure, only later rounds were judged with it. During the rounds before
{EARLIER} the procedure was still being changed. Three changes came from misses of these rounds:

- `12-clock_scale` led to a global search for a clock error.
- `20-length_mismatch` led to a global search for any effect if the first one leaves more than noise.
- The wrong names of rounds 18 to 20 led to the rule that held-out data refute an effect whose model predicts them
  worse than right models do.

One commit, with all three changes, judged rounds {EARLIER} to {LATEST - 1}. Another commit judged rounds {LATEST}
and later. It also has the changes to which rounds {EARLIER} to {LATEST - 1} led:

- `23-added_mass`: the diagnosis repeats its decisions if an effect leads to a better mode.
- Intervals of frames were too narrow: intervals now cover other shapes of an effect. In 17 separate cases with N =
  2 and 3, 33 of 51 hidden values lay within their intervals before this change, and 49 of 51 since.
- Weak effects were missed: the diagnosis also refits if noise alone leaves as much in one of ten experiments. In 72
  separate cases with N = 1 and 2 and nothing hidden, 6 met this condition, and no effect was named.
- Effects were named for kinks of strings: laws can now act along the strings, and bobs rest where such forces let
  them.

A later review of that code corrected fits of laws that never ended, and the rest positions of bobs in a shaking
room. No row shows these corrections.

The procedure was developed on rounds 0 to {HELD_OUT - 1}. The misses of odd rounds, too, had been printed while the
searches were changed. Other code made these rounds, that of the commits below. In them Δχ² is the χ² of the best
wrong model itself, frames that differ from their formula cannot be told from it, all bobs start unstretched, no
frame is missing, and the noise is white and stated in the file.

**Stated correctly** are lengths, masses, δ, how bobs start, and the noise if it is stated. The start values of k_f,
κ and b are wrong by up to 15 %, and the release angle by its stated uncertainty of 1 mrad. The held-out cases vary,
each property independently: half start hanging, a quarter do not state the noise, a quarter miss 3 % of the frames,
and in an eighth the noise, which is stated, has a correlation of 0.3 from frame to frame. Impacts of the reference
last {SHORTENED:.4f} of real ones, unless their duration is the hidden effect. With three or more bobs that hang
unevenly they last as long as real ones, and the file says so.
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
    nulls, singles, pairs, unknown = ([row for row in rows if kind(row) == name] for name in KINDS)
    found = {
        "nothing hidden: found something (≤ 5 %)": format_share(nulls, lambda r: r["verdict"] != "nothing_missing")
    }
    for low, high, name in BINS:
        some = [row for row in singles if low <= row["oracle"] < high]
        promise = " (≥ 90 %)" if low >= BINS[1][0] else ""
        found |= {
            f"one effect, Δχ² {name}: it comes first{promise}": format_share(some, comes_first),
            f"one effect, Δχ² {name}: it is in the reported set (≥ 98 %)":
                format_share(some, lambda r: r["hidden"][0] in reported_names(r)),
            f"one effect, Δχ² {name}: exactly right, and all that is the same is mentioned":
                format_share(some, is_exact),
        }  # fmt: skip
    varied = [row for row in singles if row["variant"] and row["oracle"] >= BINS[1][0]]
    sizes = Counter(max(1, len(row["one of"])) for row in singles if is_exact(row))
    good = [row for row in rows if kind(row) in ("one effect", "two effects") and is_exact(row)]
    values = [value for row in good if not row["variant"] for value in values_covered(row)]
    seconds = np.array([row["seconds"] for row in rows])
    return found | {
        "of these from 35 on, by an apparatus that differs from the formula: it comes first": format_share(
            varied, comes_first
        ),
        "one effect, exactly right: so many sets reported": ", ".join(f"{k}: {sizes[k]}" for k in sorted(sizes)),
        "two effects: both named (≥ 70 %)": format_share(pairs, lambda r: set(r["hidden"]) <= reported_names(r)),
        "in no catalogue: unknown (≥ 80 %)": format_share(unknown, lambda r: r["verdict"] == "unknown"),
        "in no catalogue: a wrong name (≤ 5 %)": format_share(unknown, lambda r: bool(reported_names(r))),
        "named rightly: held-out gap ≤ 1.05 (all)": format_share(good, lambda r: r["gap after"] <= 1.05),
        "named rightly: values of what is hidden within their 95 % intervals": format_count(sum(values), len(values)),
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


def render_page(rows: list[Row], again: list[Row]) -> str:
    """The whole page. again: the rows of `study_errors`."""
    counted = [row for row in rows if not is_confounded(row)]
    parts = _split_by_part(counted)
    shares = [summary(some) if some else {} for some in parts.values()]
    lines = ((name, *(one.get(name, "–") for one in shares)) for name in next(filter(None, shares)))
    commits = ", ".join(f"{n} by {commit}" for commit, n in Counter(row["commit"] for row in rows).most_common())
    page = [HEAD, *table(("", *(f"{name}: {len(some)} cases" for name, some in parts.items())), lines)]
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
    page += ["## Errors beyond 3 standard deviations where the verdict is right\n", *large_errors_table(counted)]
    if len(counted) < len(rows):
        page += [f"## Counted nowhere: the right model itself leaves a χ² of more than {CONFOUNDED:g}\n",
                 *confounded_table([row for row in rows if is_confounded(row)])]  # fmt: skip
    return "\n".join(page)


def main() -> None:
    """Adds the cases of a folder to those kept, and writes the page anew."""
    rows = {row["case"]: row for row in read_rows(ROWS)}
    for row in map(load_row, Path(sys.argv[1]).glob("*/result.json")):
        known = {key: value for key, value in rows.get(row["case"], {}).items() if key == "reason"}
        rows[row["case"]] = {**known, **row}  # a reason may have been found since
    kept = [rows[case] for case in sorted(rows)]
    ROWS.write_text("".join(json.dumps(row) + "\n" for row in kept), encoding="utf-8")
    PAGE.write_text(render_page(kept, read_rows(AGAIN_ROWS)), encoding="utf-8")


if __name__ == "__main__":
    main()
