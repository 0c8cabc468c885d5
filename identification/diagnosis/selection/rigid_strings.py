"""The model with rigid strings, where the data are far from what it says and hold no evidence that strings stretch."""

from __future__ import annotations

from cradle_env.cradle import Cradle
from cradle_env.parameter_name import ParameterName
from identification.diagnosis.criteria import is_misspecified
from identification.diagnosis.selection.candidates import without_effect
from identification.diagnosis.selection.evidence import schwarz_evidence
from identification.diagnosis.selection.searcher import Searcher
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.progress import Progress

#: The one effect of the models with unknowns of its own: κ, and where states are free three of each bob.
ELASTIC_STRINGS = "radial_elasticity"


def choose_base_model(given: FitResult, searcher: Searcher, tell: Progress) -> FitResult:
    """The fit of the same model with rigid strings, where both are far from the data and it is the more evident; else
    the best mode of the model as it is. What has a prior, or is stated with all its values, is not taken out."""
    going, unknown = _with_dependents(given), given.experiment.unknown_effect_parameters
    priors = map(ParameterName.parse, given.experiment.infer)
    known = {name.effect or name.key for name in priors}
    stated = ((name, {f"{name}.{key}" for key in values}) for name, values in given.cradle.effects.items())
    known |= {name for name, values in stated if values and values.isdisjoint(unknown)}
    if not is_misspecified(given) or not given.cradle.has(ELASTIC_STRINGS) or known & {"kappa", *going}:
        return given
    given = searcher.refit_multistart(given, tell)
    tell("search", 0.0, "the model with rigid strings")
    model = given.experiment
    for name in going:
        model = without_effect(model, name)
    try:
        rigid = searcher.fit_global(model, tell)
    except ImpossibleModelError:  # no cradle at all
        return given
    inflation, effective = min((given, rigid), key=lambda one: one.chi2).effective_sample
    more = len(given.point) - len(rigid.point)
    evident = schwarz_evidence(rigid.chi2 - given.chi2, more, inflation, effective) > 0.0
    return given if evident or not (is_misspecified(given) and is_misspecified(rigid)) else rigid


def removed_effects(cradle: Cradle, given: Cradle) -> list[str]:
    """Names of the effects of the cradle as given that another has not."""
    return [own.name for own in given.composition if not cradle.has(own.name)]


def describe_removed_effects(fitted: FitResult, given: FitResult) -> list[str]:
    """What to know where that was done."""
    names = removed_effects(fitted.cradle, given.cradle)
    more = len(given.point) - len(fitted.point)
    return [
        f"{' and '.join(names)} taken out of the model: the readings are far from what it says with or without, and "
        f"hold no evidence for them that would be worth {more} more unknown{'s' if more > 1 else ''}"
    ] if names else []  # fmt: skip


def _with_dependents(fitted: FitResult) -> list[str]:
    """Elastic strings and what requires them, the last first."""
    names = [ELASTIC_STRINGS]
    for name in names:
        names += [own.name for own in fitted.cradle.composition if name in own.requires and own.name not in names]
    return names[::-1]
