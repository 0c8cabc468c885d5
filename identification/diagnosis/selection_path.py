"""The path of a selection: the models visited, the candidates compared, and what decided, for JSON and as a table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from identification.diagnosis.repair import RepairResult
from identification.diagnosis.selection.model_comparison import Comparison
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.number_format import format_number, format_ratio, typographic_minus

#: Candidates of a comparison that the table shows: the most probable.
_SHOWN = 5
#: p below which the table says no more than that: what is so improbable is judged by extrapolation.
_LEAST_P = 1e-4
#: The columns of the table. χ² and ln evidence of a candidate are over the model that it is added to.
COLUMNS = ("what was done", "model or candidate", "unknowns", "χ²", "ln evidence", "p", "held-out gap")


def path_content(repaired: RepairResult) -> list[dict[str, Any]]:
    """The path as diagnosis.json has it, in order.

    Each entry: done; effects that the model has beyond the base; unknowns; chi2 and readings of the training part;
    p that this misfit is noise; held_out_gap; candidates compared, the most probable first, None if none were.
    """
    base = {*repaired.path[0].model.fitted.cradle.effects} if repaired.path else set()
    return [
        {
            "done": visit.done,
            "effects": [name for name in visit.model.fitted.cradle.effects if name not in base],
            "unknowns": len(visit.model.fitted.point),
            "chi2": visit.model.fitted.chi2,
            "readings": visit.model.fitted.count,
            "p": visit.model.p,
            "held_out_gap": _held_out_gap(visit.model.fitted),
            "candidates": None if visit.comparison is None else _candidates(visit.comparison),
        }
        for visit in repaired.path
    ]


def _candidates(comparison: Comparison) -> list[dict[str, Any]]:
    return [
        {
            "effect": refit.candidate.name,
            "alike": refit.candidate.shared,
            "unknowns": refit.unknowns,
            "delta_chi2": refit.gain,
            "log_evidence": refit.log_evidence,
            "p": refit.p,
            "held_out_gap": refit.gap if math.isfinite(refit.gap) else None,
            "chosen": comparison.chosen is not None and refit.candidate == comparison.chosen.candidate,
        }
        for refit in comparison.refits
    ]


def _held_out_gap(fitted: FitResult) -> float | None:
    """The held-out gap; None if the model ends before the readings do, or if nothing is held out."""
    try:
        gap = fitted.held_out_gap()
    except ImpossibleModelError:
        return None
    return gap if math.isfinite(gap) else None


def path_rows(path: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """The rows of the table of `path_content`, by `COLUMNS`: a row for each entry, then its candidates."""
    rows = []
    for entry in path:
        model = " + ".join(["base", *entry["effects"]])
        known = str(entry["unknowns"]), f"{entry['chi2']:.1f} of {entry['readings']}", ""
        rows.append((entry["done"], model, *known, _p(entry["p"]), _gap(entry["held_out_gap"])))
        candidates = entry["candidates"] or []
        chosen = [c for c in candidates[_SHOWN:] if c["chosen"]]
        for candidate in [*candidates[:_SHOWN], *chosen]:
            label = f"{candidate['effect']}{', all alike' if candidate['alike'] else ''}"
            gained = f"−{candidate['delta_chi2']:.1f}" if candidate["delta_chi2"] >= 0.0 else "no less"
            evidence = typographic_minus(f"{candidate['log_evidence']:+.1f}")
            rows.append(
                ("  chosen" if candidate["chosen"] else "", f"  {label}", f"+{candidate['unknowns']}", gained, evidence,
                 _p(candidate["p"]), _gap(candidate["held_out_gap"]))
            )  # fmt: skip
        more = len(candidates) - _SHOWN - len(chosen)
        if more > 0:
            rows.append(("", f"  {more} more, less probable", *[""] * 5))
        if entry["candidates"] is not None and not any(c["chosen"] for c in candidates):
            rows.append(("  none chosen", *[""] * 6))
    return rows


def _p(p: float) -> str:
    return format_number(p, 2) if p >= _LEAST_P else f"< {_LEAST_P:g}"


def _gap(gap: float | None) -> str:
    return "–" if gap is None else format_ratio(gap)
