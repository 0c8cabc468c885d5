"""What an effect would have to be to do what others do: where a fit with it in their place begins."""

from __future__ import annotations

import numpy as np

from cradle_env.parameter_name import ParameterName
from identification.diagnosis.selection.candidates import Candidate, Values, parameter_of
from identification.diagnosis.selection.score_test import compute_sensitivities
from identification.inference.fit_result import FitResult

#: Strengths of a candidate that do this nearly the same, relatively, are taken together.
_PARALLEL = 1e-6


def standing_in(fitted: FitResult, other: FitResult, candidate: Candidate) -> list[Values]:
    """Values of a candidate, to be added to the model of `fitted`: one for each of its shapes, which does to first
    order what the effects do that `other` has beyond that model, all else being as `other` has it; if it is one of
    these effects itself, its values there, said with their mean where the candidate has them all alike. Two that act
    alike do so however strong they are. None, where nothing can be told."""
    gone = [name for name in other.cradle.effects if not fitted.cradle.has(name)]
    if candidate.name in gone:
        return [_as_in(other, candidate)]
    names = other.likelihood.names
    grown = {i: _grown(other, name) for i, name in enumerate(names) if ParameterName.parse(name).effect in gone}
    if not any(grown.values()) or not np.isfinite(list(grown.values())).all():
        return []
    done = other.jacobian[:, list(grown)] @ list(grown.values())
    return [
        sensitivity.values(np.linalg.lstsq(sensitivity.S, done, rcond=_PARALLEL)[0])
        for sensitivity in compute_sensitivities(other, candidate)
    ]


def _as_in(other: FitResult, candidate: Candidate) -> Values:
    """The values of a candidate in a model that has it."""
    values = other.cradle.effects[candidate.name]
    if not candidate.shared:
        return dict(values)
    each = {p.key: p for p in candidate.declaration.parameters if p.each}
    return {
        key: each[key].repeat(float(np.mean(value)), other.cradle.bobs) if key in each else value
        for key, value in values.items()
    }  # fmt: skip


def _grown(fitted: FitResult, name: str) -> float:
    """The change of an unknown's coordinate by which an effect came in, to first order; 0 of what means nothing
    without it, nan where it came from infinity."""
    parameter = parameter_of(name)
    if not parameter.is_strength:
        return 0.0
    change = fitted.values[name] - parameter.absent
    return change if np.isfinite(change) else np.nan
