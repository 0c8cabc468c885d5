"""The verdicts on a calibration as sentences, for the report and the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from identification.number_format import format_number, format_ratio, format_statistics, rounding_of, unit_plain


def convergence_verdict(summary: Mapping[str, Any]) -> str:
    """State whether the chains have converged."""
    figures = (
        f"R̂ at most {format_number(summary['rhat_max'], 4)}, effective samples at least {summary['ess_min']:.0f},"
        f" {summary['steps']} steps with an autocorrelation time of {format_number(summary['tau_max'])} at most"
    )
    if summary["converged"]:
        return f"The chains have converged: {figures}."
    reasons = "; ".join(summary["not_converged_because"]) or figures
    return (
        f"The chains have not converged: {reasons}. The intervals are provisional;"
        " run the same command again with more --steps or --max-steps to continue."
    )


def model_verdict(summary: Mapping[str, Any]) -> str:
    """State whether the model describes the data, and whether a bound cuts off a posterior."""
    gap = summary["gap"]
    figures = f"the residuals are {format_ratio(gap['train'])} times the noise where it was fitted"
    if gap["held_out"] is not None and math.isfinite(gap["held_out"]):
        figures += f" and {format_ratio(gap['held_out'])} times on data held out (1 is the floor)"
    verdicts = {
        "none": f"The model describes these data: {figures}. A good fit does not show that nothing is"
        " missing; `cradle diagnose` looks for it.",
        "small": f"The model describes these data with a small misfit: {figures}, more than chance explains. An effect"
        " that is small compared with the noise can shift a parameter by many standard deviations. Either the noise is"
        " larger than stated, or an effect is missing; `cradle diagnose` looks for it.",
        "large": f"The model does not describe these data: {figures}. The intervals must not be trusted: they"
        " assume that the model is right. An effect is missing, or a value that is stated as known is wrong.",
    }
    return verdicts[summary["misfit"]] + "".join(
        f" The posterior of {name} is cut off at a bound: the search covered {format_number(low, 4)} to"
        f" {format_number(high, 4)} {unit_plain(summary['parameters'][name]['unit'])}. State a start value closer to"
        " the posterior in [cradle], or a prior in [infer]."
        for name, (low, high) in summary["at_bounds"].items()
    )


def disagreement_warnings(summary: Mapping[str, Any]) -> list[str]:
    """State which measurements disagree beyond their errors, a sentence or two each."""
    found = summary["contributions"]
    return [] if found is None else [_disagreement(found, one) for one in found["disagreements"]]


def _disagreement(found: Mapping[str, Any], one: Mapping[str, Any]) -> str:
    a, b = one["between"]
    chance = f"(p = {format_number(one['p'], 2)})"
    if a == b:
        return (
            f"The {a} disagrees with the model by itself {chance}: no parameters give all that it measured."
            " An effect is missing; `cradle diagnose` looks for it."
        )
    name = one["parameter"]
    shown = "" if name is None else f": {name} is {_value(found, a, name)} by {a}, and {_value(found, b, name)} by {b}"
    return (
        f"{a} and {b} disagree beyond their errors {chance}{shown}. An effect is missing, or one of them is wrong;"
        " `cradle diagnose` tells which effect reconciles them."
    )


def _value(found: Mapping[str, Any], source: str, name: str) -> str:
    """Format a parameter as one source alone gives it."""
    statistics = found["alone"][source][name]
    text, unit = format_statistics(statistics), unit_plain(found["units"][name], rounding_of(statistics).exponent)
    return f"({text['median']} ± {text['sd']}) {unit}"
