"""The verdicts on a calibration in words, the same in report and terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from identification.number_format import format_number, format_ratio, unit_plain


def convergence_verdict(summary: Mapping[str, Any]) -> str:
    """Whether the chains may be trusted, in a sentence or two."""
    figures = (
        f"R̂ at most {format_number(summary['rhat_max'], 4)}, effective samples at least {summary['ess_min']:.0f},"
        f" {summary['steps']} steps with an autocorrelation time of {format_number(summary['tau_max'])} at most"
    )
    if summary["converged"]:
        return f"The chains have converged: {figures}."
    reasons = "; ".join(summary["not_converged_because"]) or figures
    return (
        f"The chains have not converged: {reasons}. The intervals are provisional;"
        " run the same command again with more --steps or --max-steps to go on from here."
    )


def model_verdict(summary: Mapping[str, Any]) -> str:
    """Whether the model describes the data, in words; and whether a posterior is cut off."""
    gap = summary["gap"]
    figures = f"the residuals are {format_ratio(gap['train'])} times the noise where it was fitted"
    if gap["held_out"] is not None and math.isfinite(gap["held_out"]):
        figures += f" and {format_ratio(gap['held_out'])} times on data held out (1 is the floor)"
    verdicts = {
        "none": f"The model describes these data: {figures}. A good fit does not show that nothing is"
        " missing; `cradle diagnose` looks for it.",
        "small": f"The model describes these data but for a little: {figures}, more than chance leaves. What is small"
        " against the noise may be many standard deviations of a parameter: `cradle diagnose` looks for what is"
        " missing, unless the noise is more than stated.",
        "large": f"The model does not describe these data: {figures}. The intervals must not be trusted: they would"
        " hold if the model were right, and it is not. Something is missing from it, or wrong in what is stated as"
        " known.",
    }
    return verdicts[summary["misfit"]] + "".join(
        f" The posterior of {name} is cut off: it was looked for from {format_number(low, 4)} to"
        f" {format_number(high, 4)} {unit_plain(summary['parameters'][name]['unit'])}; state a value nearer to it in"
        " [cradle], or a prior in [infer]."
        for name, (low, high) in summary["at_bounds"].items()
    )
