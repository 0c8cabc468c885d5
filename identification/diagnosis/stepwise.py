"""The course of a repair: the models examined, from the base on, the effects taken in between, and those replaced."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np

from identification.diagnosis.criteria import DEFAULT_CRITERIA, Criteria, only_noise
from identification.diagnosis.learned_law.law import LearnedLaw
from identification.diagnosis.learned_law.learning import learn_law
from identification.diagnosis.residuals.residual_tests import ResidualScan, replicate_p_value, scan_residuals
from identification.diagnosis.selection.candidates import list_candidates
from identification.diagnosis.selection.model_comparison import (
    Decision,
    again,
    beside,
    decide,
    from_anywhere,
    hidden,
    log_evidence,
    of_the_period,
    refitted,
    that_stands,
    worth_refitting,
)
from identification.diagnosis.selection.score_test import ScoreTest, score
from identification.diagnosis.selection.search import Searcher
from identification.inference.fit_result import FitResult
from identification.progress import Progress

#: Replicates of each model.
_REPLICATES = 400
#: So many effects taken, another is found only where its score foretells it: one unknown cause is more probable.
_FORETOLD = 2
#: p from which on what a model leaves is settled to be noise. Below, candidates are refitted even where it is not
#: significant: far from the right mode first order foretells too little of them.
SETTLED = 0.1
#: Share of an effect's gain in χ² that another mode of the model without it must have to be looked at before anything
#: is named.
_MODE = 0.05


@dataclass(frozen=True, eq=False)
class ExaminedModel:
    """A model under scrutiny: its fit, where it fails, the scores of what may be missing, and p of both together."""

    fitted: FitResult
    residual_scan: ResidualScan
    score_test: ScoreTest
    p: float
    criteria: Criteria

    @property
    def significant(self) -> bool:
        """Whether the model leaves more than noise, by the verdict's test (see `only_noise` for the quick one)."""
        return self.p < self.criteria.significance_level


@dataclass(frozen=True, eq=False)
class Step:
    """One effect added: the model before, what decided, and the fits without and with it (a requirement of the chosen
    one has steps of its own)."""

    effect: str
    before: FitResult
    after: FitResult
    probability: float
    decision: Decision | None


@dataclass(frozen=True, eq=False)
class Visit:
    """One line of the path of a selection: what was done, the model that it led to or was about, and, where candidates
    were compared, the decision between them."""

    done: str
    model: ExaminedModel
    decision: Decision | None = None


@dataclass(eq=False)
class Course:
    """examined: the models, the base first; decisions: one for each model but the last, and that of the last where
    nothing could be chosen; steps: the effects taken; replaced: names of those that gave way to others; seen: the
    effects, with what they leave unknown, of each model examined; laws: those learned of a model beside a rival; path:
    all that was done, in order, also what was taken back."""

    searcher: Searcher
    seed: int
    estimated: tuple[bool, ...]
    tell: Progress
    examined: list[ExaminedModel] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    replaced: list[str] = field(default_factory=list)
    seen: set[frozenset[str]] = field(default_factory=set)
    laws: dict[tuple[FitResult, FitResult], LearnedLaw | None] = field(default_factory=dict)
    path: list[Visit] = field(default_factory=list)

    def law_beside(self, fitted: FitResult, rival: FitResult) -> LearnedLaw | None:
        """The law that a model lacks, unless it begins far worse than a rival; learned once."""
        if (fitted, rival) not in self.laws:
            self.laws[fitted, rival] = learn_law(fitted, self.searcher, self.tell, rival)
        return self.laws[fitted, rival]

    def note(self, done: str, model: ExaminedModel | None = None, decision: Decision | None = None) -> None:
        """Adds a line to the path, about the model examined last unless another is given."""
        self.path.append(Visit(done, self.examined[-1] if model is None else model, decision))

    def examine(self, fitted: FitResult) -> ExaminedModel:
        """A model under scrutiny, as all others of this course are."""
        return examine(fitted, self.seed, self.estimated, self.searcher.criteria)

    def settle(self, fitted: FitResult) -> ExaminedModel:
        """Examines a model; where it leaves more than noise, first makes sure that no better mode explains that."""
        found = self.examine(fitted)
        if not found.significant:
            return found
        better = self.searcher.refit_multistart(fitted, self.tell)
        return self.examine(better) if better.chi2 < fitted.chi2 - fitted.chi2_scale else found

    def look_elsewhere(self) -> bool:
        """Takes into a model that leaves no more than noise what it hides by a wrong mode, if that leaves no more than
        noise either; whether there was any."""
        now = self.examined[-1]
        if now.significant or len(self.steps) >= _FORETOLD:
            return False
        known = {} if self.steps else of_the_period(now.fitted, self.searcher, self.tell)
        if now.p < SETTLED:
            known |= refitted(now.fitted, worth_refitting(now.score_test), now.score_test, self.searcher, self.tell)
        if not known:
            return False
        decision = hidden(now.fitted, known, now.score_test, self.searcher, self.tell)
        self.note("compared, for the mode may be wrong", now, decision)
        chosen = decision.chosen
        if chosen is None:
            self.decisions.append(decision)
            return False
        if self._in_a_better_mode(-1, chosen.fitted, _MODE * chosen.gain):
            return True  # the model may hide less than it seemed
        self._take(decision)
        if self.examined[-1].significant:
            self.back_to(now.fitted, "more than noise is left")
            self.decisions[-1] = dataclasses.replace(decision, chosen=None, probability=0.0)
            return False
        self._one_for_two()
        return True

    def go_on(self) -> bool:
        """Takes the most probable effect into the model examined last; whether there was one."""
        now = self.examined[-1]
        known = of_the_period(now.fitted, self.searcher, self.tell) if len(self.examined) == 1 else {}
        exhaust = len(self.steps) < _FORETOLD
        decision = decide(now.fitted, now.score_test, self.searcher, self.tell, exhaust, tuple(known))
        if decision.chosen is None and len(self.examined) == 1:
            decision = from_anywhere(now.fitted, decision, now.score_test, self.searcher, self.tell)
        self.note("compared", now, decision)
        if decision.chosen is None:
            self.decisions.append(decision)
            return False
        if self._in_a_better_mode(-1, decision.chosen.fitted, _MODE * decision.chosen.gain):
            return True  # the model may lack less than it seemed
        self._take(decision)
        self._where_it_led()
        self._another()
        self._one_for_two()
        return True

    def anew(self) -> bool:
        """Takes one effect in the place of all, with which a model from anywhere leaves only noise and predicts what
        was held out; whether there is one."""
        base = self.examined[0]
        decision = that_stands(base.fitted, self.decisions[0], base.score_test, self.searcher, self.tell)
        self.note("compared alone, for held-out data refute the names", base, decision)
        if decision.chosen is None:
            return False
        self._replace(decision, self.back_to(base.fitted, "one effect predicts better"))
        return True

    def back_to(self, fitted: FitResult, why: str) -> list[str]:
        """Takes back the steps beyond a model, with what was examined after it; returns the names."""
        withdrawn = []
        while self.examined[-1].fitted is not fitted:
            decision = self.steps[-1].decision
            while self.steps and self.steps[-1].decision is decision:
                withdrawn.append(self.steps.pop().effect)
            self.examined.pop()
        if withdrawn:
            self.note(f"{', '.join(withdrawn)} taken back: {why}")
        return withdrawn

    def _in_a_better_mode(self, which: int, other: FitResult, enough: float) -> bool:
        """Examines a model again where it has a mode better by `enough` in χ² that another leads to; whether it has."""
        was = self.examined[which].fitted
        better = self.searcher.fit_from_mode(was, other)
        if was.chi2 - better.chi2 <= enough:
            return False
        self.examined[which] = self.examine(better)
        self.note("better mode found from another model", self.examined[which])
        for i, step in enumerate(self.steps):
            before, after = (better if fitted is was else fitted for fitted in (step.before, step.after))
            self.steps[i] = dataclasses.replace(step, before=before, after=after)
        return True

    def _where_it_led(self) -> None:
        """Decides again where the first effect led to a better mode than that it was chosen for, which others may lead
        to as well. (Where later ones do, it may be the model before that has the better mode: see `_one_for_two`.)"""
        was, last = self.decisions[-1], self.examined[-1].fitted
        if len(self.examined) != 2 or was.chosen is None or was.chosen.fitted.chi2 - last.chi2 <= last.chi2_scale:
            return
        self._in_a_better_mode(-2, last, last.chi2_scale)
        before = self.examined[-2]
        decision = again(before.fitted, was, before.score_test, self.searcher, self.tell)
        self.note("compared again, from the better mode", before, decision)
        if decision.chosen is None:
            return
        if decision.chosen.candidate != was.chosen.candidate:
            self._instead(decision, 1)
        else:
            self.decisions[-1] = decision
            self.steps = [
                dataclasses.replace(step, decision=decision, probability=decision.probability)
                if step.decision is was else step
                for step in self.steps
            ]  # fmt: skip

    def _another(self) -> None:
        """Puts another effect in the place of the first, where that leaves more than noise and another, its model
        searched from anywhere, is the more probable."""
        if self.examined[-1].significant and len(self.examined) == 2:
            before, was, last = self.examined[-2], self.decisions[-1], self.examined[-1].fitted

            def enough(fitted: FitResult) -> bool:  # χ² alone may call noise what is more
                return only_noise(fitted, self.searcher.criteria) and fitted.chi2 < last.chi2 - last.chi2_scale

            decision = from_anywhere(before.fitted, was, before.score_test, self.searcher, self.tell, enough)
            self.note("compared again, from anywhere", before, decision)
            if was.chosen and decision.chosen and decision.chosen.candidate != was.chosen.candidate:
                self._instead(decision, 1)

    def _one_for_two(self) -> None:
        """Puts one effect in the place of the last two, where they leave only noise and it does as well: the two may
        have led to the right mode of the other unknowns, far from which nothing foretells what an effect can do; and
        one cause is more probable than two."""
        if len(self.examined) < 3 or self.examined[-1].significant:
            return
        last = self.examined[-1].fitted
        self._in_a_better_mode(-3, last, last.chi2_scale)
        before = self.examined[-3]
        decision = beside(before.fitted, before.score_test, last, self.searcher, self.tell)
        self.note("compared, one effect for the last two", before, decision)
        more = len(last.point) - len(before.fitted.point)
        both = log_evidence(before.fitted.chi2 - last.chi2, more, decision.inflation, decision.effective)
        if (
            decision.chosen is not None
            and decision.chosen.log_evidence > both - self.searcher.criteria.equivalent_log_odds
        ):
            self._instead(decision, 2)

    def _instead(self, decision: Decision, count: int) -> None:
        """Takes what a decision chose in the place of what the last `count` decisions did, unless that was examined
        before: it would come to the same again."""
        assert decision.chosen is not None
        if _effects(decision.chosen.fitted) not in self.seen:
            self._replace(decision, self.back_to(self.examined[-1 - count].fitted, "another is as good or better"))

    def _replace(self, decision: Decision, names: list[str]) -> None:
        """Takes what a decision chose in the place of what the model examined last had beyond it."""
        assert decision.chosen is not None
        self.replaced += [name for name in names if name != decision.chosen.candidate.name]
        del self.decisions[len(self.examined) - 1 :]
        self._take(decision)

    def _take(self, decision: Decision) -> None:
        """Takes what a decision chose into the model examined last, and examines that: what the effect requires comes
        first, each with a fit of its own."""
        chosen, before = decision.chosen, self.examined[-1].fitted
        assert chosen is not None
        for name in chosen.candidate.effects:
            if name == chosen.candidate.name:
                after = chosen.fitted
            else:
                after = self.searcher.fit_with_candidate(
                    before, next(c for c in list_candidates(before.cradle) if c.name == name)
                )
            self.steps.append(Step(name, before, after, decision.probability, decision))
            before = after
        self.decisions.append(decision)
        self.tell("locate", 0.0, f"what is left with {self.steps[-1].effect}")
        self.seen.add(_effects(before))
        self.examined.append(self.settle(before))
        self.steps[-1] = dataclasses.replace(self.steps[-1], after=self.examined[-1].fitted)
        self.note(f"{', '.join(chosen.candidate.effects)} added")


def _effects(fitted: FitResult) -> frozenset[str]:
    return frozenset({*fitted.cradle.effects, *fitted.experiment.unknown_effect_parameters})


def examine(
    fitted: FitResult, seed: int, estimated: tuple[bool, ...], criteria: Criteria = DEFAULT_CRITERIA
) -> ExaminedModel:
    """Locates and scores, against the same replicates; p of the lesser of the two p, by the replicates again."""
    replicates = fitted.replicates(_REPLICATES, np.random.default_rng(seed), estimated)
    located, scored = scan_residuals(fitted, replicates), score(fitted, replicates)
    families = ((located.largest, located.replicate_maxima), (scored.largest, scored.replicate_maxima))
    of_data = min(replicate_p_value(replicate_maxima, largest) for largest, replicate_maxima in families)
    ranks = [1.0 - np.argsort(np.argsort(replicate_maxima)) / len(replicate_maxima) for _, replicate_maxima in families]
    of_replicates = np.minimum(*ranks)
    p = float((1 + np.sum(of_replicates < of_data)) / (1 + len(of_replicates)))
    return ExaminedModel(fitted, located, scored, p, criteria)
