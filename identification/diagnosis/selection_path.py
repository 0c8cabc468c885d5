"""The path of a selection: the rounds of the search, the sets compared, and what decided, for JSON and as a table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from identification.diagnosis.repair import RepairResult
from identification.diagnosis.selection.model_search import Round
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.number_format import format_number, format_ratio, typographic_minus

#: Sets of a round that the table shows: the most probable.
_SHOWN = 5
#: p below which the table says no more than that: 400 replicates show no less.
_LEAST_P = 0.0025
#: The columns of the table. Unknowns, χ² and ln evidence of a set are over the model of its round.
COLUMNS = ("what was done", "model", "unknowns", "χ²", "ln evidence", "p", "held-out gap")


def path_content(repaired: RepairResult) -> list[dict[str, Any]]:
    """The path as diagnosis.json has it, in order.

    Each entry: done; effects that the model has beyond the base; unknowns; chi2 and readings of the training part;
    p of its residual scan, None if that decided nothing; held_out_gap; candidates: the sets compared, the most evidence
    first, None if none were; others: number of sets that were too far in χ² to be compared.
    """
    base = {*repaired.examined[0].fitted.cradle.effects}
    return [
        {
            "done": visit.done,
            "effects": [name for name in visit.fitted.cradle.effects if name not in base],
            "unknowns": len(visit.fitted.point),
            "chi2": visit.fitted.chi2,
            "readings": visit.fitted.count,
            "p": visit.p,
            "held_out_gap": held_out_gap(visit.fitted),
            "candidates": None if visit.round is None else _compared(visit.round),
            "others": 0 if visit.round is None else visit.round.count - len(visit.round.compared),
        }
        for visit in repaired.path
    ]


def _compared(one: Round) -> list[dict[str, Any]]:
    return [
        {
            "effects": sorted(model.effects),
            "labels": sorted(model.names),
            "unknowns": len(model.fitted.point) - len(one.before.fitted.point),
            "delta_chi2": one.before.chi2 - model.chi2,
            "log_evidence": odds,
            "chosen": model is one.chosen,
        }
        for model, odds in one.compared
    ]


def held_out_gap(fitted: FitResult) -> float | None:
    """The held-out gap; None if the model ends before the readings do, or if nothing is held out."""
    try:
        gap = fitted.held_out_gap()
    except ImpossibleModelError:
        return None
    return gap if math.isfinite(gap) else None


def path_rows(path: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """The rows of the table of `path_content`, by `COLUMNS`: a row for each entry, then the sets compared."""
    rows = []
    for entry in path:
        model = " + ".join(["base", *entry["effects"]])
        known = str(entry["unknowns"]), f"{entry['chi2']:.1f} of {entry['readings']}", ""
        gap = "–" if entry["held_out_gap"] is None else format_ratio(entry["held_out_gap"])
        rows.append((entry["done"], model, *known, _p(entry["p"]), gap))
        compared = entry["candidates"] or []
        for one in compared[:_SHOWN]:
            gained = f"−{one['delta_chi2']:.1f}" if one["delta_chi2"] >= 0.0 else f"+{-one['delta_chi2']:.1f}"
            evidence = typographic_minus(f"{one['log_evidence']:+.1f}")
            more = typographic_minus(f"{one['unknowns']:+d}")
            rows.append(
                ("  chosen" if one["chosen"] else "", f"  {' + '.join(one['labels'])}", more, gained, evidence, "", "")
            )
        if (more := len(compared[_SHOWN:]) + entry["others"]) > 0:
            rows.append(("", f"  {more} more, less probable", *[""] * 5))
        if entry["candidates"] is not None and not any(one["chosen"] for one in compared):
            rows.append(("  none chosen", *[""] * 6))
    return rows


def _p(p: float | None) -> str:
    return "" if p is None else format_number(p, 2) if p >= _LEAST_P else f"< {_LEAST_P:g}"
