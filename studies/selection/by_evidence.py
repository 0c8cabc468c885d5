"""The search by evidence in the place of the selection of `diagnose`: the same result, by another way.

`diagnose_by_evidence` is the whole diagnosis with it: learned law, intervals, detection limits and report included.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from unittest import mock

from identification.diagnosis import workflow
from identification.diagnosis.criteria import fails_prediction
from identification.diagnosis.learned_law.law import LearnedLaw, evidence_over_effects
from identification.diagnosis.learned_law.learning import learn_law
from identification.diagnosis.repair import RepairResult
from identification.diagnosis.result import Diagnosis
from identification.diagnosis.selection.candidates import Candidate, list_candidates
from identification.diagnosis.selection.model_comparison import Decision, judged
from identification.diagnosis.selection.search import Searcher
from identification.diagnosis.stepwise import ExaminedModel, Step, Visit, examine
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.progress import Progress
from studies.selection.model import Model
from studies.selection.model_search import ModelSearch
from studies.selection.verdict import probability_of, rivals


def diagnose_by_evidence(experiment: Experiment, **options) -> Diagnosis:
    """`diagnose` with the search by evidence."""
    with mock.patch.object(workflow, "repair", repair_by_evidence):
        return workflow.diagnose(experiment, **options)


def repair_by_evidence(
    fitted: FitResult, searcher: Searcher, seed: int, estimated: tuple[bool, ...], progress: Progress
) -> RepairResult:  # fmt: skip
    """The set of effects with the most evidence, unless a test refutes it or a learned law has more.

    Names are refuted if the residual scan finds more than noise with them, or if held-out data contradict them.
    """
    search = ModelSearch(
        fitted.experiment, searcher.store, searcher.workers, searcher.criteria, seed=seed, estimated=estimated
    )  # fmt: skip
    best = search.run([fitted.point], progress)
    compared = search.ranked(best)
    for model in search.models.values():
        if model.modes:
            searcher.best(model.fitted)

    def scan(model: Model) -> ExaminedModel:
        found = examine(model.fitted, seed, estimated, searcher.criteria)
        return dataclasses.replace(found, p=found.residual_scan.p)

    base = scan(search.models[frozenset()])
    decision = _decision(search, base, best, probability_of(search, best, compared))
    path = [Visit("the base model", base), Visit("compared, alone", base, decision)]
    law = None
    if best.names:
        last = scan(best)
        path.append(Visit(f"{' + '.join(sorted(best.names))}: the most evidence", last))
        law, why = _refutation(base, last, len(best.effects), searcher, progress)
        if not why:
            steps = _steps(search, best, decision)
            return RepairResult(
                (base, last), (decision,), steps, (), _alternatives(search, best, compared), last, None, tuple(path)
            )  # fmt: skip
        path.append(Visit(f"{', '.join(sorted(best.effects))} taken back: {why}", base))
    if law is None and base.significant:
        law = learn_law(base.fitted, searcher, progress)
    removed = tuple(sorted(best.effects))
    return RepairResult((base,), (decision,), (), removed, (), base, law if base.significant else None, tuple(path))


def _refutation(
    base: ExaminedModel, last: ExaminedModel, count: int, searcher: Searcher, progress: Progress
) -> tuple[LearnedLaw | None, str]:  # fmt: skip
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


def _decision(search: ModelSearch, base: ExaminedModel, best: Model, probability: float) -> Decision:
    """The comparison of the candidates alone, as `diagnose` keeps it."""
    inflation, effective = best.fitted.effective_sample
    first = search.log_evidence(search.models[frozenset()], inflation)
    candidates = {c.label: c for c in list_candidates(search.experiment.cradle)}
    refits = []
    for names, model in search.models.items():
        if len(names) != 1 or not model.modes:
            continue
        (label,) = names
        maxima = base.score_test.replicate_maxima
        try:
            refit = judged(base.fitted, candidates[label], model.fitted, maxima, inflation, effective)
        except ImpossibleModelError:
            continue
        evidence = search.log_evidence(model, inflation) - first
        refits.append(dataclasses.replace(refit, log_evidence=evidence))
    refits.sort(key=lambda refit: -refit.log_evidence)
    chosen = next((refit for refit in refits if best.names == {refit.candidate.label}), None)
    return Decision(tuple(refits), chosen, probability, inflation, effective)


def _steps(search: ModelSearch, best: Model, decision: Decision) -> tuple[Step, ...]:
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
            steps.append(Step(name, before, between, decision.probability, decision))
            before = between
        steps.append(Step(candidate.name, before, after.fitted, decision.probability, decision))
        model = after
        left.discard(label)
    return tuple(steps)


def _alternatives(
    search: ModelSearch, best: Model, compared: Sequence[tuple[Model, float]]
) -> tuple[tuple[Candidate, ...], ...]:  # fmt: skip
    """The candidates of the best model and of each rival, less what all of them share; () if there are no rivals."""
    others = [model for model, _ in rivals(best, compared)]
    if not others:
        return ()
    common = frozenset.intersection(best.names, *(model.names for model in others))
    candidates = list_candidates(search.experiment.cradle)
    return tuple(tuple(c for c in candidates if c.label in model.names - common) for model in (best, *others))
