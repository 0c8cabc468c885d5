"""Add, refit, repeat: from a base model to one that leaves nothing but noise, or as near as the catalogue leads."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cradle_env.effects import effect
from identification.diagnosis.criteria import Criteria, fails_prediction, is_misspecified
from identification.diagnosis.learned_law.law import LearnedLaw, can_outdo, evidence_over_effects
from identification.diagnosis.learned_law.learning import learn_law
from identification.diagnosis.selection.candidates import Candidate, candidate_of_effect, without_effect
from identification.diagnosis.selection.inner_validation import predictions
from identification.diagnosis.selection.model_comparison import (
    Decision,
    judged,
    log_evidence,
)
from identification.diagnosis.selection.search import Searcher
from identification.diagnosis.selection.start_values import standing_in
from identification.diagnosis.stepwise import SETTLED, Course, ExaminedModel, Step, Visit
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.progress import Progress

#: How many effects may be added.
_MOST_STEPS = 6
#: So many models, the base among them, are examined where it is asked whether a law does better than names.
_OVERTAKEN = 3
#: Share of the excess that an effect must explain to be named where more than noise is left in the end.
_SHARE = 0.5
#: Several effects that leave less than this share of the excess χ², and yet more than noise, only bend towards it.
_BENT = 0.1
#: Share of an effect's gain in χ² that another must have had to be tried in its place.
_RIVAL = 0.3


@dataclass(frozen=True, eq=False)
class RepairResult:
    """All models examined, the base first; the steps kept; names withdrawn or taken out again; alternatives: sets of
    effects of which each would do as well as the last steps, the chosen ones first, () where there is no doubt; law:
    what was learned of the remainder, None where there is none or it predicts nothing; path: all that was done."""

    examined: tuple[ExaminedModel, ...]
    decisions: tuple[Decision, ...]
    steps: tuple[Step, ...]
    removed: tuple[str, ...]
    alternatives: tuple[tuple[Candidate, ...], ...]
    last: ExaminedModel
    law: LearnedLaw | None
    path: tuple[Visit, ...] = ()


def repair(
    fitted: FitResult, searcher: Searcher, seed: int, estimated: tuple[bool, ...], progress: Progress
) -> RepairResult:  # fmt: skip
    """Adds the most probable effect as long as the model leaves more than noise and an effect helps, and what the base
    model hides by a wrong mode; then tries what was added for removal, and for exchange against what was nearly as
    good. What was held out chooses no name, but refutes those that predict worse than right ones do."""
    progress("locate", 0.0, "where model and data part")
    course = Course(searcher, seed, estimated, progress)
    course.examined.append(course.settle(fitted))
    course.note("the base model")
    _add(course)
    if course.steps and fails_prediction(course.examined[-1].fitted) and course.anew():
        _add(course)
    withdrawn = _withdraw(course)
    law = _outdoing(course)
    if law is not None:
        withdrawn += course.back_to(law.before, "a learned law is more probable than the names")
    last, kept, removed = _without_the_needless(course, course.examined[-1], course.steps)
    alternatives = _exchanges(last, kept, searcher, progress)
    if alternatives:  # what several could do may be done by none
        last, kept, more = _without_the_needless(course, last, kept)
        if more:
            removed, alternatives = [*removed, *more], _exchanges(last, kept, searcher, progress)
    if kept and law is None and fails_prediction(last.fitted):  # by any name: the cause is unknown
        withdrawn += course.back_to(course.examined[0].fitted, "held-out data refute the names")
        last, kept, removed, alternatives = course.examined[0], [], [], ()
    if alternatives:
        sets = " | ".join(" + ".join(candidate.label for candidate in several) for several in alternatives)
        course.note(f"equivalent: {sets}", last)
    law = _law_of(last, law, searcher, progress)
    path = tuple(course.path)
    if removed:
        kept = _joined(kept, course.examined[0].fitted, last.fitted, searcher)
    names = {step.effect for step in kept}
    gone = tuple(name for name in dict.fromkeys([*course.replaced, *withdrawn, *removed]) if name not in names)
    if removed and not kept:  # what was added only led to a better mode of the base model
        return RepairResult((last,), (), (), gone, (), last, law, path)
    examined, decisions = tuple(course.examined), tuple(course.decisions)
    return RepairResult(examined, decisions, tuple(kept), gone, alternatives, last, law, path)


def _add(course: Course) -> None:
    """Adds effects as long as more than noise is left and one helps, or noise alone only seems to be left; but no
    third where a law does better than two."""
    more = True
    while more and len(course.steps) < _MOST_STEPS and not _overtaken(course):
        more = course.go_on() if course.examined[-1].significant else course.look_elsewhere()


def _overtaken(course: Course) -> bool:
    """Whether, near the noise, a law on the base model does better than several names that leave more than noise: yet
    another would only bend towards one unknown cause."""
    base, last = course.examined[0].fitted, course.examined[-1]
    if len(course.examined) != _OVERTAKEN or not last.significant or is_misspecified(base):
        return False
    law = course.law_beside(base, last.fitted)
    return law is not None and evidence_over_effects(law, last.fitted) >= course.searcher.criteria.equivalent_log_odds


def _withdraw(course: Course) -> list[str]:
    """Takes back names that leave most of what they were to explain: where more than noise remains, something unknown
    is at work, and an effect that only bends towards it is not what is missing; nor are several that together come
    close to the data and not to the noise: one unknown cause is more probable than they and yet another. Returns the
    names."""
    withdrawn, examined = [], course.examined
    while course.steps and examined[-1].significant:
        first, after = _excess(examined[0]), _excess(examined[-1])
        bent = after < _BENT * first and sum(_bends(step.effect) for step in course.steps) > 1
        if _explains(examined[-2], examined[-1], course.searcher) and not bent:
            break
        why = "together they only bend towards what is missing" if bent else "most of the misfit is left"
        withdrawn += course.back_to(examined[0 if bent else -2].fitted, why)
    return withdrawn


def _explains(before: ExaminedModel, after: ExaminedModel, searcher: Searcher) -> bool:
    """Whether the last effect explains most of what the model before it left: of its predictions, where they tell."""
    gaps = predictions(before.fitted, after.fitted, searcher)
    first, left = (_excess(before), _excess(after)) if gaps is None else (gaps[0] ** 2 - 1.0, gaps[1] ** 2 - 1.0)
    return left < (1.0 - _SHARE) * first


def _excess(examined: ExaminedModel) -> float:
    return examined.fitted.chi2 - examined.fitted.count


def _bends(name: str) -> bool:
    """Whether an effect has a strength by which it could stand in for another cause."""
    return bool(effect(name).strengths)


def _outdoing(course: Course) -> LearnedLaw | None:
    """The law of a model with fewer names that does better than all names do: an effect is named only if it is still
    needed once a law is allowed. Where the names settle it, a law can only do better by fewer unknowns than several
    of them have. Of laws about as good the one that takes the place of most; None where names stand."""
    *before, last = course.examined
    if not course.steps or (len(before) == 1 and last.p > SETTLED):
        return None
    models = [
        m.fitted for m in before
        if m.significant and (last.p <= SETTLED or can_outdo(m.fitted, last.fitted, course.searcher.criteria))
    ]  # fmt: skip
    found = (course.law_beside(model, last.fitted) for model in models)
    laws = [law for law in found if law is not None]
    over = [evidence_over_effects(law, last.fitted) for law in laws]
    close = course.searcher.criteria.equivalent_log_odds
    if not over or max(over) < close:
        return None
    return next(law for law, own in zip(laws, over, strict=True) if own > max(over) - close)


def _without_the_needless(
    course: Course, last: ExaminedModel, steps: Sequence[Step]
) -> tuple[ExaminedModel, list[Step], list[str]]:  # fmt: skip
    """The last model without what it no longer needs, the steps that remain, and names of what went. Where modes are
    many, an effect may only have led to a better one of the model without it."""
    searcher, kept, removed = course.searcher, list(steps), []
    for step in reversed(steps):  # what another requires, after that
        required = any(step.effect in _required(other.effect) for other in kept)
        if required:
            continue
        model = without_effect(last.fitted.experiment, step.effect)
        try:
            fit = searcher.fit_from_mode(searcher.fit_from_values(model, last.fitted.values), last.fitted)
        except ImpossibleModelError:
            continue
        inflation, effective = last.fitted.effective_sample
        fewer = len(last.fitted.point) - len(fit.point)
        if (fit.chi2 - last.fitted.chi2) / inflation < fewer * np.log(effective):
            last = course.examine(fit)
            course.note(f"{step.effect} removed: the model does without it", last)
            kept.remove(step)
            removed.append(step.effect)
    return last, kept, removed


def _law_of(last: ExaminedModel, known: LearnedLaw | None, searcher: Searcher, progress: Progress) -> LearnedLaw | None:
    """What is learned of what the last model leaves, where that is more than noise."""
    if not last.significant:
        return None
    return known if known is not None and known.before is last.fitted else learn_law(last.fitted, searcher, progress)


def _joined(kept: Sequence[Step], base: FitResult, last: FitResult, searcher: Searcher) -> list[Step]:
    """The steps that remain, from the base model to the last one: what was removed is in none of them."""
    joined, after = [], last
    for step in reversed(kept):
        before = base
        if step is not kept[0]:
            before = step.before  # where the model without cannot be simulated from there
            with contextlib.suppress(ImpossibleModelError):
                before = searcher.fit_from_values(without_effect(after.experiment, step.effect), after.values)
        joined.append(dataclasses.replace(step, before=before, after=after))
        after = before
    return joined[::-1]


def _required(name: str) -> tuple[str, ...]:
    return effect(name).requires


def _exchanges(
    last: ExaminedModel, steps: Sequence[Step], searcher: Searcher, progress: Progress
) -> tuple[tuple[Candidate, ...], ...]:
    """Sets of effects that complete the other steps as well as those chosen, the chosen ones first; each effect once,
    as it did best. What is in the place of another may lead to a better mode of the model without either, which is
    looked for from there."""
    inflation, effective = last.fitted.effective_sample
    rivals: dict[tuple[str, str], tuple[Candidate, Candidate]] = {}
    for step in steps:
        others = _rivals(step, searcher.criteria)
        if not others or any(step.effect in _required(other.effect) for other in steps):
            continue
        model = without_effect(last.fitted.experiment, step.effect)
        try:
            base = searcher.fit_from_values(model, last.fitted.values)
            own = log_evidence(
                base.chi2 - last.fitted.chi2, len(last.fitted.point) - len(base.point), inflation, effective
            )
        except ImpossibleModelError:
            continue
        taken = candidate_of_effect(last.fitted.experiment, model, step.effect)
        for i, candidate in enumerate(others):
            progress("exchange", i / len(others), f"{candidate.label} for {step.effect}")
            if base.cradle.has(candidate.name) or (step.effect, candidate.name) in rivals:
                continue
            try:
                searcher.fit_with_candidate(base, candidate)
                fit = searcher.fit_with_candidate_from_mode(
                    base, candidate, last.fitted, standing_in(base, last.fitted, candidate)
                )
                refit = judged(base, candidate, fit, last.score_test.replicate_maxima, inflation, effective)
            except ImpossibleModelError:
                continue
            if own - refit.log_evidence < searcher.criteria.equivalent_log_odds:
                rivals[step.effect, candidate.name] = taken, candidate
                searcher.fit_from_mode(base, fit)
    doubtful = tuple(dict.fromkeys(own for own, _ in rivals.values()))
    exchanged = (tuple(rival if one == own else one for one in doubtful) for own, rival in rivals.values())
    return tuple(dict.fromkeys((doubtful, *exchanged))) if rivals else ()


def _rivals(step: Step, criteria: Criteria) -> list[Candidate]:
    """Candidates that were significant where a step was decided and could stand in its place."""
    if step.decision is None or step.decision.chosen is None:
        return []
    least = _RIVAL * step.decision.chosen.gain
    return [
        refit.candidate for refit in step.decision.refits
        if refit.candidate.name != step.effect and len(refit.candidate.effects) == 1
        and refit.p < criteria.significance_level and refit.gain >= least
    ]  # fmt: skip
