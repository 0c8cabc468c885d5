"""The model with rigid strings, where the data are far from what it says and hold no evidence that strings stretch."""

from __future__ import annotations

from identification.diagnose.candidates import without_effect
from identification.diagnose.decide import coloured, log_evidence
from identification.diagnose.fitted import Fitted
from identification.diagnose.inner import FAR
from identification.diagnose.search import Searcher
from identification.fit import Progress

#: The one effect of the models with unknowns of its own: κ, and where states are free three of each bob.
_ELASTIC = "radial_elasticity"


def simpler(fitted: Fitted, searcher: Searcher, tell: Progress) -> Fitted:
    """The fit of the same model with rigid strings, where that is the more evident; else the fit as it is. Near the
    noise, or where κ has a prior, nothing is taken out of a model."""
    if fitted.training_gap() < FAR or not fitted.cradle.has(_ELASTIC) or "kappa" in fitted.experiment.infer:
        return fitted
    tell("search", 0.0, "the model with rigid strings")
    model = fitted.experiment
    for name in (*(own.name for own in fitted.cradle.composition if _ELASTIC in own.requires), _ELASTIC):
        model = without_effect(model, name)
    rigid = searcher.globally(model, tell)
    inflation, effective = coloured(min((fitted, rigid), key=lambda one: one.chi2))
    more = len(fitted.point) - len(rigid.point)
    return rigid if log_evidence(rigid.chi2 - fitted.chi2, more, inflation, effective) < 0.0 else fitted


def taken_out(fitted: Fitted, given: Fitted) -> list[str]:
    """What to know where that was done."""
    names = [own.name for own in given.cradle.composition if not fitted.cradle.has(own.name)]
    if not names:
        return []
    return [
        f"{' and '.join(names)} taken out of the model: the readings are far from what it says with or without, and "
        f"hold no evidence for them that would be worth {len(given.point) - len(fitted.point)} unknowns more"
    ]
