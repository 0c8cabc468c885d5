"""The content of diagnosis.json."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from cradle_env import __version__
from cradle_env.parameter_name import ParameterName
from identification.diagnosis.learned_law.law_words import describe_law, describe_terms
from identification.diagnosis.repair import Step
from identification.diagnosis.residuals.residual_tests import describe_phase
from identification.diagnosis.selection.rigid_strings import removed_effects
from identification.diagnosis.selection_path import held_out_gap, path_content
from identification.diagnosis.uncertainty.intervals import Interval
from identification.progress import Progress

if TYPE_CHECKING:
    from identification.diagnosis.result import Diagnosis

#: The format that diagnosis.json states.
FORMAT = "cradle-diagnosis/1"


def diagnosis_content(diagnosis: Diagnosis, progress: Progress) -> dict[str, Any]:
    """The content of diagnosis.json. It computes the intervals and the detection limits, which takes minutes."""
    repaired = diagnosis.repaired
    first, last = repaired.examined[0], repaired.last
    progress("limits", 0.0, "confidence intervals")
    parameters = diagnosis.parameters
    progress("limits", 0.5, "detection limits")
    limits = [limit.content() for limit in diagnosis.detection_limits]
    return {
        "format": FORMAT,
        "version": __version__,
        "seed": diagnosis.seed,
        "inputs": diagnosis.experiment.digest,
        "verdict": diagnosis.verdict,
        "warnings": list(diagnosis.warnings),
        "where": list(first.residual_scan.where),
        "energy": [
            {"run": diagnosis.experiment.runs[e.run].file, "t": e.time, "excess": e.energy, "sd": e.sd}
            for e in first.residual_scan.energy_excess
        ],
        "steps": diagnosis.steps,
        "equivalent": [list(names) for names in diagnosis.equivalent],
        "sets": [dataclasses.asdict(one) | {"effects": [*one.effects]} for one in repaired.sets],
        "alike": list(diagnosis.shared_effects),
        "taken_out": removed_effects(diagnosis.base.cradle, diagnosis.experiment.cradle),
        "gap_first": diagnosis.gap_first,
        "gap_last": diagnosis.gap_last,
        "gap_allowed": diagnosis.gap_allowed,
        "remainder": {
            "significant": last.significant,
            "p": last.p,
            "described": describe_remainder(last.residual_scan.where) if last.significant else "",
            "law": _law_content(diagnosis),
        },
        "unseen": limits,
        "removed": list(repaired.removed),
        "candidates": _candidates_content(diagnosis),
        "path": path_content(repaired),
        "parameters": {
            name: {"unit": interval.unit, "median": interval.median, "ci95": list(interval.ci95)}
            for name, interval in parameters.items()
        },
        "advice": None if diagnosis.advice is None else diagnosis.advice.content(),
    }


def step_content(diagnosis: Diagnosis, step: Step) -> dict[str, Any]:
    """One entry of `steps`."""
    return {
        "effect": step.effect,
        "parameters": effect_parameters(diagnosis.parameters, step.effect),
        "probability": step.probability,
        "gap_before": step.before.held_out_gap(),
        "gap_after": step.after.held_out_gap(),
        "train_before": step.before.training_gap(),
        "train_after": step.after.training_gap(),
    }


def _law_content(diagnosis: Diagnosis) -> dict[str, Any] | None:
    law, shape = diagnosis.law, diagnosis.shape
    if law is None or shape is None:
        return None
    return {
        "terms": describe_terms(law, diagnosis.parameters),
        "words": describe_law(shape),
        "energy_taken": {"unit": "J", "value": shape.energy_taken()},
        "log_evidence": law.log_evidence,
        "gap_before": law.before.held_out_gap(),
        "gap_after": law.fitted.held_out_gap(),
        "inner_gap_before": law.inner_gap_before,
        "inner_gap_after": law.inner_gap_after,
    }


def _candidates_content(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """The score of every candidate against the base model, and the result of its refit if there was one."""
    refits = {refit.candidate: refit for refit in diagnosis.repaired.alone}
    rows = []
    for score in diagnosis.repaired.examined[0].score_test.scores:
        refit = refits.get(score.candidate)
        rows.append(
            {
                "effect": score.candidate.name,
                "alike": score.candidate.shared,
                "predicted_delta_chi2": score.gain if score.directions else None,
                "p": score.p if score.directions else None,
                "parallel": [other.label for other in score.parallel],
                "delta_chi2": None if refit is None else refit.gain,
                "log_evidence": None if refit is None else refit.log_evidence,
                "gap": None if refit is None else held_out_gap(refit.fitted),
            }
        )
    return rows


def effect_parameters(intervals: Mapping[str, Interval], name: str) -> dict[str, Any]:
    """Median and ci95 of each parameter of an effect, by key; lists of them if each bob or gap has its own value."""
    parameters: dict[str, Any] = {}
    for text, interval in intervals.items():
        address = ParameterName.parse(text)
        if address.effect != name:
            continue
        key = address.key
        if address.element is None:
            parameters[key] = {"median": interval.median, "ci95": list(interval.ci95)}
        else:
            entry = parameters.setdefault(key, {"median": [], "ci95": []})
            entry["median"].append(interval.median)
            entry["ci95"].append(list(interval.ci95))
    return parameters


def describe_remainder(where: tuple[dict, ...]) -> str:
    """Where the last model fails most, in words."""
    if not where:
        return "no single test is significant, but all of them together are"
    worst = where[0]
    bob = "all bobs" if worst["bob"] is None else f"bob {worst['bob']}"
    begin, end = worst["t"]
    return f"most of all in {worst['run']} at {bob}, {begin:.3g} to {end:.3g} s: {describe_phase(worst['phase'])}"
