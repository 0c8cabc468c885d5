"""From the base model to the one with what is missing: a search by evidence, and two tests that can refute it.

1. `ModelSearch` finds the set of effects with the most evidence.
2. The names are refuted if the residual scan finds more than noise with them, or if held-out data contradict them.
3. Of two names or more, a learned law takes the place if it has clearly more evidence.
4. Where the model leaves more than noise, a law is learned from what is left.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

from identification.diagnosis.criteria import fails_prediction
from identification.diagnosis.examined_model import ExaminedModel, examine
from identification.diagnosis.learned_law.law import LearnedLaw, evidence_over_effects
from identification.diagnosis.learned_law.learning import learn_law
from identification.diagnosis.selection.candidates import Candidate, list_candidates
from identification.diagnosis.selection.model import Model
from identification.diagnosis.selection.model_comparison import Comparison, compare
from identification.diagnosis.selection.model_search import ModelSearch, Round
from identification.diagnosis.selection.ranking import Ranking
from identification.diagnosis.selection.search import Searcher
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.number_format import typographic_minus
from identification.progress import Progress


@dataclass(frozen=True, eq=False)
class Step:
    """One effect added: fits without and with it, and the probability of the set that it belongs to.

    What an effect requires has a step of its own.
    """

    effect: str
    before: FitResult
    after: FitResult
    probability: float


@dataclass(frozen=True, eq=False)
class Visit:
    """A line of the path: what was done, the model that it led to or was about, and the candidates compared."""

    done: str
    model: ExaminedModel
    comparison: Comparison | None = None


@dataclass(frozen=True, eq=False)
class RepairResult:
    """What a repair found.

    Parameters
    ----------
    examined : tuple of ExaminedModel
        The base, and the repaired model if effects were named.
    comparison : Comparison or None
        Each candidate alone, added to the base.
    steps : tuple of Step
        The effects named, one by one.
    removed : tuple of str
        Effects with the most evidence that a test refuted.
    alternatives : tuple of tuple of Candidate
        Sets that complete the other steps equally well, the chosen one first; () without doubt.
    sets : tuple of (tuple of str, float)
        Sets of effects with their probabilities, the most probable first; () is the base.
    law : LearnedLaw or None
        What was learned of what the last model leaves.
    path : tuple of Visit
        All that was done, in order.
    """

    examined: tuple[ExaminedModel, ...]
    comparison: Comparison | None
    steps: tuple[Step, ...]
    removed: tuple[str, ...]
    alternatives: tuple[tuple[Candidate, ...], ...]
    law: LearnedLaw | None
    sets: tuple[tuple[tuple[str, ...], float], ...] = ()
    path: tuple[Visit, ...] = ()

    @property
    def last(self) -> ExaminedModel:
        """The repaired model; the base if nothing was named."""
        return self.examined[-1]


def repair(
    fitted: FitResult, searcher: Searcher, seed: int, estimated: tuple[bool, ...], progress: Progress
) -> RepairResult:
    """Finds the set of effects with the most evidence, unless a test refutes it or a learned law has more.

    estimated: of each run, whether its noise was.
    """
    progress("locate", 0.0, "where model and data part")
    search = ModelSearch(
        fitted.experiment, searcher.store, searcher.workers, searcher.criteria, seed=seed, estimated=estimated
    )
    best = search.run([fitted.point], progress)
    for model in search.models.values():
        if model.modes:
            searcher.best(model.fitted)
    ranking = search.rank(best)
    base = examine(search.models[frozenset()].fitted, seed, estimated, searcher.criteria)
    alone = _compare_alone(search, base, best)
    path = [Visit("the base model", base), Visit("compared", base, alone)]
    law = None
    if best.names:
        last = examine(best.fitted, seed, estimated, searcher.criteria)
        path += [Visit(_said(round_), last) for round_ in search.rounds[1:]]
        path.append(Visit(f"{', '.join(sorted(best.effects))} added", last))
        law, why = _refute(base, last, len(best.effects), searcher, progress)
        if not why:
            steps, alternatives = _steps(search, best, ranking), _alternatives(search, best, ranking)
            if alternatives:
                sets = " | ".join(" + ".join(c.label for c in several) for several in alternatives)
                path.append(Visit(f"equivalent: {sets}", last))
            return RepairResult((base, last), alone, steps, (), alternatives, None, ranking.probabilities, tuple(path))
        path.append(Visit(f"{', '.join(sorted(best.effects))} taken back: {why}", base))
    if not base.significant:
        law = None
    elif law is None:
        law = learn_law(base.fitted, searcher, progress)
    removed = tuple(sorted(best.effects))
    return RepairResult((base,), alone, (), removed, (), law, ranking.probabilities, tuple(path))


def _said(round_: Round) -> str:
    """A round of the search in words."""
    first = round_.compared[0]
    evidence = typographic_minus(f"{round_.odds[0]:+.1f}")
    return f"{len(round_.compared)} larger sets; best: {first.label}, ln evidence {evidence}"


def _refute(
    base: ExaminedModel, last: ExaminedModel, count: int, searcher: Searcher, progress: Progress
) -> tuple[LearnedLaw | None, str]:
    """The law of the base model if it refutes names, and what refutes them; "" if nothing does."""
    if last.significant:
        return None, "more than noise is left"
    if fails_prediction(last.fitted):
        return None, "held-out data refute it"
    if count > 1:
        law = learn_law(base.fitted, searcher, progress, last.fitted)
        if law is not None and evidence_over_effects(law, last.fitted) >= searcher.criteria.equivalent_log_odds:
            return law, "a learned law has more evidence"
    return None, ""


def _compare_alone(search: ModelSearch, base: ExaminedModel, best: Model) -> Comparison:
    """Each candidate alone, added to the base, as far as it was fitted."""
    inflation = best.inflation
    first = search.log_evidence(search.models[frozenset()], inflation)
    candidates = {c.label: c for c in list_candidates(search.experiment.cradle)}
    refits = []
    for names, model in search.models.items():
        if len(names) != 1 or not model.modes:
            continue
        (label,) = names
        evidence = search.log_evidence(model, inflation) - first
        try:
            maxima = base.score_test.replicate_maxima
            refits.append(compare(base.fitted, candidates[label], model.fitted, maxima, evidence))
        except ImpossibleModelError:  # it ends before the readings do
            continue
    refits.sort(key=lambda refit: -refit.log_evidence)
    chosen = next((refit for refit in refits if best.names == {refit.candidate.label}), None)
    return Comparison(tuple(refits), chosen)


def _steps(search: ModelSearch, best: Model, ranking: Ranking) -> tuple[Step, ...]:
    """The effects of the best set one by one, each time the one that leaves the least χ²."""
    model, steps, left = search.models[frozenset()], [], {*best.names}
    while left:
        several = [(label, search.extended(model, label)) for label in sorted(left)]
        label, after = min(several, key=lambda pair: pair[1].chi2)
        before = model.fitted
        candidate = next(c for c in list_candidates(before.cradle) if c.label == label)
        for name in candidate.effects[:-1]:  # what it requires comes first, with a fit of its own
            required = next(c for c in list_candidates(before.cradle) if c.name == name)
            between = search.extended(model, required.label).fitted
            steps.append(Step(name, before, between, ranking.probability))
            before = between
        steps.append(Step(candidate.name, before, after.fitted, ranking.probability))
        model = after
        left.discard(label)
    steps[-1] = dataclasses.replace(steps[-1], after=best.fitted)
    return tuple(steps)


def _alternatives(search: ModelSearch, best: Model, ranking: Ranking) -> tuple[tuple[Candidate, ...], ...]:
    """The candidates of the best model and of each rival, less what all of them share; () if there are no rivals."""
    others: Sequence[Model] = ranking.rivals
    if not others:
        return ()
    common = frozenset.intersection(best.names, *(model.names for model in others))
    candidates = list_candidates(search.experiment.cradle)
    return tuple(tuple(c for c in candidates if c.label in model.names - common) for model in (best, *others))
