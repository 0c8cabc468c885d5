"""From the base model to the one with what is missing: a search by evidence, and the tests that can refute it.

1. `ModelSearch` finds the set of effects with the most evidence. A part of it is named if the data do not tell the two
   apart.
2. If that is no single effect that leaves hardly more than noise, a law learned from the base competes with it, by the
   same evidence.
3. Held-out data can refute names, but choose none.
4. If names are refuted, or the model leaves more than noise, a law describes what is missing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.criteria import Criteria, fails_prediction
from identification.diagnosis.learned_law.law import LearnedLaw
from identification.diagnosis.learned_law.learning import learn_law
from identification.diagnosis.learned_law.terms import MAX_TERMS, selection_cost
from identification.diagnosis.selection.candidates import Candidate
from identification.diagnosis.selection.evidence import LaplaceTerms
from identification.diagnosis.selection.examined_model import ExaminedModel
from identification.diagnosis.selection.model import Model, Names
from identification.diagnosis.selection.model_search import ModelSearch, Ranked, Round
from identification.diagnosis.selection.searcher import Searcher
from identification.inference.fit_result import FitResult
from identification.progress import Progress


@dataclass(frozen=True, eq=False)
class Step:
    """One effect added: fits without and with it, and the probability of all sets that hold it.

    What an effect requires has a step of its own.
    """

    effect: str
    before: FitResult
    after: FitResult
    probability: float


@dataclass(frozen=True, eq=False)
class Refit:
    """The base with one candidate: its fit, the gain in χ², and ln evidence over the base."""

    candidate: Candidate
    fitted: FitResult
    gain: float
    log_evidence: float


@dataclass(frozen=True)
class Explanation:
    """What may be missing, and its probability. kind: "set" of effects, "law", "nothing", or "other" for all sets of
    effects that the data tell from the best."""

    kind: str
    effects: tuple[str, ...]
    probability: float


@dataclass(frozen=True, eq=False)
class Visit:
    """A line of the path: what was done, the model that it was about, p of its residual scan if that decided, and the
    models compared with it."""

    done: str
    fitted: FitResult
    p: float | None = None
    round: Round | None = None


@dataclass(frozen=True, eq=False)
class RepairResult:
    """What a repair found.

    Parameters
    ----------
    examined : tuple of ExaminedModel
        The base, and the repaired model if effects were named.
    steps : tuple of Step
        The effects named, one by one.
    removed : tuple of str
        Effects with the most evidence that were refuted.
    alternatives : tuple of tuple of Candidate
        Sets that complete the other steps equally well, the chosen one first; () without doubt.
    others : tuple of FitResult
        The models with the other sets.
    modes : tuple of FitResult
        Other modes of the repaired model; () if a law was learned.
    law : LearnedLaw or None
        What was learned of what the last model leaves.
    sets : tuple of Explanation
        What may be missing; the probabilities sum to one.
    alone : tuple of Refit
        Each candidate alone, if it was fitted to its end, the most evidence first.
    path : tuple of Visit
        All that was done, in order.
    """

    examined: tuple[ExaminedModel, ...]
    steps: tuple[Step, ...] = ()
    removed: tuple[str, ...] = ()
    alternatives: tuple[tuple[Candidate, ...], ...] = ()
    others: tuple[FitResult, ...] = ()
    modes: tuple[FitResult, ...] = ()
    law: LearnedLaw | None = None
    sets: tuple[Explanation, ...] = ()
    alone: tuple[Refit, ...] = ()
    path: tuple[Visit, ...] = ()

    @property
    def last(self) -> ExaminedModel:
        """The repaired model; the base if nothing was named."""
        return self.examined[-1]

    @property
    def lacks_a_name(self) -> bool:
        """Whether the last model lacks something that has no name: more than noise is left, or names were refuted."""
        return self.last.significant or bool(self.removed)


def repair(
    fitted: FitResult, searcher: Searcher, seed: int, estimated: tuple[bool, ...], progress: Progress
) -> RepairResult:
    """Finds the set of effects with the most evidence, unless a learned law has more or held-out data refute it.

    estimated: of each run, whether its noise was.
    """
    progress("locate", 0.0, "where model and data part")
    search = ModelSearch(fitted.experiment, searcher.store, searcher.workers, searcher.criteria, seed, estimated)
    found_best = search.run([fitted.point], progress)
    best = _simplest(search, found_best)
    base, last = search.examined(search.models[frozenset()]), search.examined(best)
    path = [Visit("the base model", base.fitted, base.p)]
    path += [Visit(f"compared, {i} more", r.before.fitted, None, r) for i, r in enumerate(search.rounds, 1)]
    if best is not found_best:
        path.append(Visit("the most evidence, but a part of it is as good", found_best.fitted))
    law, law_odds, inflation = None, -math.inf, best.inflation
    doubtful = len(best.effects) > 1 or (bool(best.names) and not search.is_settled(best))
    if last.significant or doubtful:
        law = learn_law(base.fitted, searcher, progress, None if last.significant else last.fitted)
    if law is not None:
        inflation = min((best.fitted, law.fitted), key=lambda fit: fit.chi2).effective_sample.inflation
        law_odds = _law_log_odds(law, search, best, inflation)
        path.append(Visit(f"a learned law, ln evidence {law_odds:+.1f} over these names", law.fitted))
    ranked = search.ranked(best, inflation)
    total = float(np.logaddexp.reduce([law_odds, *(one.log_odds for one in ranked)]))
    found = {"sets": _explanations(ranked, law_odds, total, search.criteria), "alone": _alone(search, best)}
    if not best.names:
        modes = best.other_modes if law is None else ()
        return RepairResult((base,), modes=modes, law=law, path=tuple(path), **found)
    path.append(Visit("the most evidence" if best is found_best else "this part", last.fitted, last.p))
    if why := _refutation(last, law_odds, estimated):
        path.append(Visit(f"taken back: {why}", base.fitted, base.p))
        if law is None:
            law = learn_law(base.fitted, searcher, progress)
        return RepairResult((base,), removed=tuple(sorted(best.effects)), law=law, path=tuple(path), **found)
    rivals = [one.model for one in ranked if one.model is not None and _is_rival(one, best, search.criteria)]
    rivals = [model for model in rivals if not any(other.effects < model.effects for other in rivals)]
    return RepairResult(
        (base, last), _steps(search, best, ranked, total), (), _alternatives(search, best, rivals),
        tuple(model.fitted for model in rivals), best.other_modes, path=tuple(path), **found,
    )  # fmt: skip


def _simplest(search: ModelSearch, best: Model) -> Model:
    """The smallest part of the best set that leaves only noise, and that the data do not tell from it; else the best.

    Names are then those that the data ask for. Of something and nothing, the evidence alone decides.
    """
    least = search.log_evidence(best, best.inflation) - search.criteria.equivalent_log_odds
    parts = [m for m in search.models.values() if m.modes and frozenset() < m.effects < best.effects]
    odds = {m.names: search.log_evidence(m, best.inflation) for m in parts}
    near = sorted((m for m in parts if odds[m.names] > least), key=lambda m: (len(m.effects), -odds[m.names]))
    return next((m for m in near if not search.examined(m).significant), best)


def _refutation(last: ExaminedModel, law_odds: float, estimated: tuple[bool, ...]) -> str:
    """What refutes names; "" if nothing does. estimated: of each run, whether its noise was."""
    if law_odds > 0.0:
        return "a learned law has more evidence"
    if fails_prediction(last.fitted, estimated):
        return "held-out data refute the names"
    if last.significant:
        return "more than noise is left"
    return ""


def _law_log_odds(law: LearnedLaw, search: ModelSearch, best: Model, inflation: float) -> float:
    """ln evidence of the base with a law over the best set, under one inflation of χ².

    The law has the prior of one further cause, shared by all numbers of terms, and by all choices of as many.
    """
    prior = search.log_prior(1) - math.log(MAX_TERMS) - selection_cost(law.before.cradle, len(law.terms))
    return LaplaceTerms.of(law.fitted).log_evidence(inflation) + prior - search.log_evidence(best, inflation)


def _explanations(
    ranked: Sequence[Ranked], law_odds: float, total: float, criteria: Criteria
) -> tuple[Explanation, ...]:
    """All that may be missing; total: ln of the sum of all odds."""
    near = [
        one for one in ranked if one.effects and one.model is not None and one.log_odds > -criteria.equivalent_log_odds
    ]
    found = [Explanation("set", tuple(sorted(one.effects)), math.exp(one.log_odds - total)) for one in near]
    if law_odds > -math.inf:
        found.append(Explanation("law", (), math.exp(law_odds - total)))
    nothing = sum(math.exp(one.log_odds - total) for one in ranked if not one.effects)
    found.append(Explanation("nothing", (), nothing))
    found.append(Explanation("other", (), max(0.0, 1.0 - sum(one.probability for one in found))))
    return tuple(found)


def _is_rival(one: Ranked, best: Model, criteria: Criteria) -> bool:
    """Whether the data do not tell a set from the best one. One that holds it or is part of it is no rival."""
    is_part = one.effects >= best.effects or one.effects <= best.effects
    return one.log_odds > -criteria.equivalent_log_odds and not is_part


def _alone(search: ModelSearch, best: Model) -> tuple[Refit, ...]:
    """Each candidate alone, added to the base; those that were far behind the best were not fitted to their end."""
    base, found = search.models[frozenset()], []
    for candidate in search.candidates:
        model = search.models.get(frozenset({candidate.label}))
        if model is not None and model.modes and model.is_finished:
            odds = search.log_evidence(model, best.inflation) - search.log_evidence(base, best.inflation)
            found.append(Refit(candidate, model.fitted, base.chi2 - model.chi2, odds))
    return tuple(sorted(found, key=lambda refit: -refit.log_evidence))


def _steps(search: ModelSearch, best: Model, ranked: Sequence[Ranked], total: float) -> tuple[Step, ...]:
    """The effects of the best set one by one, each time the one that leaves the least χ²; what it requires first."""
    model, steps, left = search.models[frozenset()], [], {*best.names}
    while left:
        ways = {label: search.extended(model, label) if len(left) > 1 else best for label in sorted(left)}
        label = min(ways, key=lambda label: ways[label].chi2)
        candidate = next(c for c in search.candidates if c.label == label)
        names = [name for name in candidate.effects if name not in model.effects]
        for name in names:
            after = ways[label]
            if name != candidate.name:
                after = search.extended(model, next(c for c in search.candidates if c.name == name).label)
            probability = sum(math.exp(one.log_odds - total) for one in ranked if name in one.effects)
            steps.append(Step(name, model.fitted, after.fitted, probability))
            model = after
        left.discard(label)
    return tuple(steps)


def _alternatives(search: ModelSearch, best: Model, rivals: Sequence[Model]) -> tuple[tuple[Candidate, ...], ...]:
    """The candidates of the best model and of each rival, less what all of them share; () if there are no rivals."""
    if not rivals:
        return ()
    common: Names = frozenset.intersection(best.names, *(model.names for model in rivals))
    return tuple(tuple(c for c in search.candidates if c.label in model.names - common) for model in (best, *rivals))
