"""What a fit says of values that the experiment file states: the noise, and where searches begin."""

from __future__ import annotations

import math

from identification.inference.fit_result import FitResult
from identification.inference.noise_model import rms
from identification.inference.unknowns import SEARCH_WIDTHS
from identification.number_format import format_number

#: Residual of a run [its stated noise] below which the statement is doubted: a factor of two.
_LEAST_GAP = 0.5
#: Distance from a bound of a search, as a share of its width, at which an unknown has reached it.
_AT_BOUND = 1e-3


def warn_of_stated_values(fitted: FitResult) -> tuple[str, ...]:
    """Warnings, one line each, of noise that is stated far too large and of unknowns at a bound of their search."""
    return (*_warn_of_noise(fitted), *_warn_of_bounds(fitted))


def _warn_of_noise(fitted: FitResult) -> list[str]:
    warnings = []
    for k, run in enumerate(fitted.experiment.runs):
        own = fitted.residuals[: fitted.count][fitted.readings.run == k]
        if len(own) and run.noise is not None and (gap := rms(own)) < _LEAST_GAP:
            unit = "rad" if run.quantity == "theta" else "m"
            warnings.append(
                f"{run.file}: noise is stated as {format_number(run.noise)} {unit}, the residuals are"
                f" {format_number(gap * run.noise)} {unit}; nothing smaller than the stated noise can be seen: correct"
                " it, or leave it out"
            )
    return warnings


def _warn_of_bounds(fitted: FitResult) -> list[str]:
    warnings = []
    for u, z in zip(fitted.likelihood.unknowns, fitted.point, strict=True):
        if u.name in SEARCH_WIDTHS and u.log:
            low, high = math.log(u.low), math.log(u.high)
            if min(z - low, high - z) < _AT_BOUND * (high - low):
                warnings.append(
                    f"{u.name} is {format_number(float(u.value(z)))} {u.unit}, at a bound of its search, which is from"
                    f" {format_number(u.low)} to {format_number(u.high)}; another stated value may be wrong, or state"
                    f" {u.name} closer to the truth"
                )
    return warnings
