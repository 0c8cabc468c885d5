"""results.md: what the joint posteriors say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from studies.joint.made import ARMS
from studies.kept_rows import format_count

_SOURCES = ("trajectories", "impacts", "string", "ringdown")
_NAMES = ("k_f", "kappa", "b", "lambda")
_WRONG = {"other string": "string", "other balls": "impacts", "group drag": "ringdown"}


def page(rows: Sequence[dict[str, Any]]) -> str:
    """The whole page."""
    return "\n".join([*_head(), *_coverage([row for row in rows if row["arm"] == "nothing"]), *_warnings(rows), ""])


def _head() -> Iterator[str]:
    yield from (
        "# Joint posteriors of a run and three instruments",
        "",
        "`python -m studies.joint`. A case is a run of two bobs (6 to 20 s, 60 readings a second, 1 to 3 mrad), a",
        "table of 30 impacts on two bobs at rest, cycles of a string, and the ring-down of one bob. k_f, κ and b are",
        "drawn at random; what is stated of them is up to 10 % off. All data come from the simulators of",
        "`tests/reference`. Each instrument is measured by its own command; `[[impacts]]`, `[[string]]` and",
        "`[[ringdown]]` join them. The joint posterior is taken in its normal approximation. Behind counts: 95 %",
        "Wilson interval.",
        "",
    )


def _coverage(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield from (
        f"## Nothing is wrong: {len(rows)} cases",
        "",
        "z: (median − truth)/sd. Last column: standard deviation over that by the trajectories alone, median.",
        "",
        "| value | from | told | inside 95 % | RMS z | sd over that of trajectories |",
        "|---|---|---|---|---|---|",
    )
    ways = [("all", lambda row: row["joint"])]
    ways += [(f"{name} alone", lambda row, name=name: row["alone"][name]) for name in _SOURCES]
    ways += [(f"all without {name}", lambda row, name=name: row["without"][name]) for name in _SOURCES]
    for value in _NAMES:
        for way, part in ways:
            told = [(part(row)[value], row) for row in rows if part(row).get(value) is not None]
            if not told:
                continue
            truths = [row["truth"][value] for _, row in told]
            pairs = list(zip((one for one, _ in told), truths, strict=True))
            inside = sum(one["ci95"][0] <= truth <= one["ci95"][1] for one, truth in pairs)
            z = float(np.sqrt(np.mean([((one["median"] - truth) / one["sd"]) ** 2 for one, truth in pairs])))
            own = [row["alone"]["trajectories"].get(value) for _, row in told]
            ratios = [one["sd"] / base["sd"] for (one, _), base in zip(told, own, strict=True) if base]
            ratio = f"{np.median(ratios):.2g}" if ratios else "–"
            yield f"| {value} | {way} | {len(told)} | {format_count(inside, len(told))} | {z:.2f} | {ratio} |"
    yield ""


def _warnings(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield from (
        "## Warnings that two sources disagree",
        "",
        "The other string is 5 % stiffer, the other balls have 25 % more k_f. Group drag: b doubles for a bob that has",
        "a neighbour in touch (`group_drag`); the ring-down of one bob does not show it. These runs last 30 to 45 s",
        "and have 1 mrad.",
        "",
        "| what is wrong | cases | warned | the wrong source among them | `diagnose` names it or an equivalent |",
        "|---|---|---|---|---|",
    )
    for arm in ARMS:
        own = [row for row in rows if row["arm"] == arm]
        warned = [row for row in own if row["disagreements"]]
        wrong, named = "–", "–"
        if arm in _WRONG:
            hit = sum(any(_WRONG[arm] in one["between"] for one in row["disagreements"]) for row in own)
            wrong = format_count(hit, len(own))
        if arm == "group drag":
            told = [row for row in own if "verdict" in row]
            sets = [[row["named"], *row["equivalent"]] for row in told]
            right = sum(any("group_drag" in names for names in each) for each in sets)
            named = format_count(right, len(told))
        yield f"| {arm} | {len(own)} | {format_count(len(warned), len(own))} | {wrong} | {named} |"
