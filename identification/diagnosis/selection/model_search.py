"""Search over sets of missing effects: add, exchange and drop effects as long as the evidence rises.

The χ² of a model is meant to be a function of the model, not of the path to it. Each new model is therefore fitted by
continuation from early data, and the best modes are shared among models until none gains a unit of χ².
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cradle_env.threads import in_threads
from identification.diagnosis.criteria import (
    ANOTHER,
    BEAM,
    COMPARED_WITHIN,
    DEFAULT_CRITERIA,
    EARLY_STRENGTHS,
    LATE_STRENGTHS,
    MAX_DISTANCE,
    MAX_EFFECTS,
    SETTLED,
    STARTS,
    WORTH_A_FIT,
    Criteria,
)
from identification.diagnosis.selection.candidates import (
    Candidate,
    list_candidates,
    matching_candidate,
    starts,
    with_effects,
)
from identification.diagnosis.selection.continuation import follow_early, least, least_early
from identification.diagnosis.selection.evidence import linear_log_odds
from identification.diagnosis.selection.examined_model import ExaminedModel, examine
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.model import Model, Names
from identification.experiment.experiment import Experiment
from identification.experiment.train_test import training_rows
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.likelihood import Likelihood
from identification.inference.start_points import flatten_values, point_at
from identification.progress import Progress


@dataclass(frozen=True, eq=False)
class Round:
    """The models of one size, compared with the best smaller one.

    compared: those near enough in χ², with their ln evidence over `before`, the most first. count: of all that were
    fitted. chosen: the best one, or a part of it; None if no evidence is above that of `before`.
    """

    before: Model
    compared: tuple[tuple[Model, float], ...]
    count: int
    chosen: Model | None


class Ranked(NamedTuple):
    """A set of effects, its ln evidence over the best one, and its model; None if it was judged to first order."""

    effects: frozenset[str]
    log_odds: float
    model: Model | None


@dataclass(eq=False)
class ModelSearch:
    """All models visited, by the labels of their candidates, and the rounds of the search.

    experiment: with its noise stated. store: keeps what was found. workers: threads. criteria: say what noise is.
    seed: of the replicates of residuals. estimated: of each run, whether its noise was.
    unfitted: ln odds of sets that were judged to first order alone, over the set that they extend.
    """

    experiment: Experiment
    store: FitCache
    workers: int | None = None
    criteria: Criteria = DEFAULT_CRITERIA
    seed: int = 0
    estimated: tuple[bool, ...] = ()
    models: dict[Names, Model] = field(default_factory=dict)
    rounds: list[Round] = field(default_factory=list)
    unfitted: dict[Names, dict[str, float]] = field(default_factory=dict)
    _examined: dict[tuple[float, ...], ExaminedModel] = field(default_factory=dict)

    @functools.cached_property
    def candidates(self) -> list[Candidate]:
        """All candidates of the base model."""
        return list_candidates(self.experiment.cradle)

    def run(self, known: Sequence[np.ndarray], progress: Progress) -> Model:
        """The model with the most evidence. known: points (D,) near modes of the base."""
        best = self.fit_base(known)
        front = [best]
        for size in range(1, MAX_EFFECTS + 1):
            progress("refit", (size - 1) / MAX_EFFECTS, best.label)
            children = self._extend(front)
            near = self._finish_near_the_best(children)
            if not near:
                break
            self.share_modes([*front, *near])
            odds = self._log_odds(near, best)
            if odds[0][1] > 0.0 and self._follow_again(odds[0][0]):
                self.share_modes([*front, *near])
                odds = self._log_odds(near, best)
            chosen = self._drop_each(odds[0][0]) if odds[0][1] > 0.0 else None
            self.rounds.append(Round(best, tuple(odds), len(children), chosen))
            if chosen is None:
                break
            best = chosen
            front = [best] if self.is_settled(best) else [m for m, _ in odds[:BEAM]]
        return best

    def fit_base(self, known: Sequence[np.ndarray] = ()) -> Model:
        """The model with nothing added. known: points (D,) near its modes."""
        base = self._model(frozenset())
        likelihood = base.likelihood
        base.approach("base", lambda: [*known, *follow_early(likelihood, [likelihood.start()])])
        base.finish()
        if not base.modes:
            raise ImpossibleModelError("no point near the stated values has a motion: state values nearer to the truth")
        return base

    def extended(self, parent: Model, label: str) -> Model:
        """The parent with a candidate more, finished; ImpossibleModelError if it has no motion."""
        candidate = next(c for c in self.candidates if c.label == label)
        model = self.models.get(parent.names | {label}) or self._approach(parent, candidate)
        if model is None or not model.modes:
            raise ImpossibleModelError(f"no motion with {label}")
        model.finish()
        return model

    def share_modes(self, models: Sequence[Model]) -> None:
        """Refits every model from every better model's mode that lies in another basin, until none gains a unit."""
        tried: set[tuple] = set()
        gained = True
        while gained:
            gained = False
            for other in sorted(models, key=lambda m: m.chi2)[:BEAM]:
                for model in models:
                    key = (model.names, other.names, round(other.chi2, 1))
                    if other is not model and other.chi2 < model.chi2 and key not in tried:
                        tried.add(key)
                        before = model.chi2
                        model.finish_from(_point_from(model, other))
                        gained = gained or model.chi2 < before - model.unit

    def log_evidence(self, model: Model, inflation: float) -> float:
        """ln Z of a model, with the prior of its set."""
        return model.terms.log_evidence(inflation) + self.log_prior(len(model.effects))

    def log_prior(self, effects: int) -> float:
        """ln prior probability of a set of so many effects, over that of none: ANOTHER for each effect, shared by all
        sets of as many."""
        sets = math.comb(len({c.name for c in self.candidates}), effects)
        return effects * math.log(ANOTHER) - math.log(sets)

    def ranked(self, best: Model, inflation: float) -> list[Ranked]:
        """Sets of effects under one inflation of χ².

        The visited models near the best one and the base, the most evidence first; of an effect's forms, with values
        alike or not, the better one alone. Then what extends the best one and was judged to first order alone.
        """
        limit = best.chi2 + 2.0 * COMPARED_WITHIN * best.unit
        near = [m for m in self.models.values() if m.modes and (m.chi2 < limit or not m.names)]
        first = self.log_evidence(best, inflation)
        several = [Ranked(m.effects, self.log_evidence(m, inflation) - first, m) for m in near]
        several.sort(key=lambda one: -one.log_odds)
        effects = {c.label: c.effects for c in self.candidates}
        for label, odds in self.unfitted.get(best.names, {}).items():
            several.append(Ranked(best.effects | {*effects[label]}, odds, None))
        found: dict[frozenset[str], Ranked] = {}
        for one in several:
            found.setdefault(one.effects, one)
        return [*found.values()]

    def examined(self, model: Model) -> ExaminedModel:
        """The residual scan of a model, and the scores of what it may lack."""
        key = tuple(model.fitted.point)
        if key not in self._examined:
            self._examined[key] = examine(model.fitted, self.seed, self.estimated, self.criteria)
        return self._examined[key]

    def is_settled(self, model: Model) -> bool:
        """Whether a model leaves so little that first order shows what it lacks."""
        return self.examined(model).p >= SETTLED

    def _extend(self, parents: Sequence[Model]) -> list[Model]:
        """Each parent with each candidate more that is worth a fit, approached."""
        ways: dict[Names, list[tuple[Model, Candidate]]] = {}
        for parent in parents:
            for candidate in self._worth_a_fit(parent):
                ways.setdefault(parent.names | {candidate.label}, []).append((parent, candidate))
        found = in_threads(lambda names: self._approach_by(ways[names]), [*ways], self.workers)
        return [model for model in found if model is not None and model.modes]

    def _approach_by(self, ways: Sequence[tuple[Model, Candidate]]) -> Model | None:
        """One model, approached from each of several parents in turn."""
        return [self._approach(*way) for way in ways][-1]

    def _worth_a_fit(self, parent: Model) -> list[Candidate]:
        """All candidates; of a model that leaves only noise those that gain enough to first order, and those that are
        not seen to first order."""
        known = parent.likelihood.experiment.cradle
        candidates = [c for c in self.candidates if not known.has(c.name)]
        if not self.is_settled(parent):
            return candidates
        scores = self.examined(parent).score_test.scores
        small = {s.candidate.label: s for s in scores if s.sensitivities and s.gain < WORTH_A_FIT}
        known_effects, before = parent.effects, self.log_prior(len(parent.effects))
        self.unfitted[parent.names] = {
            label: linear_log_odds(parent.fitted, one, parent.inflation)
            + self.log_prior(len(known_effects | {*one.candidate.effects}))
            - before
            for label, one in small.items()
        }
        return [c for c in candidates if c.label not in small]

    def _approach(self, parent: Model, candidate: Candidate) -> Model | None:
        """The parent with a candidate, approached from its mode, and from early data when it is met first; None where
        there is no motion."""
        names = parent.names | {candidate.label}
        is_new = names not in self.models
        try:
            model = self._model(names)
        except ImpossibleModelError:
            return None

        def begin(strengths: tuple[float, ...], values: dict[str, float]) -> list[np.ndarray]:
            several = starts(candidate.declaration, self.experiment.cradle.bobs, strengths)
            return [
                point_at(model.likelihood, {**values, **flatten_values(candidate.name, added)}) for added in several
            ]

        def find() -> list[np.ndarray]:
            early = []
            for values in ({}, parent.fitted.values) if is_new else ():
                early += least_early(model.likelihood, begin(EARLY_STRENGTHS, values), STARTS)
            late = least(model.likelihood, begin(LATE_STRENGTHS, parent.fitted.values), STARTS)
            return [*follow_early(model.likelihood, early), *late] if early else late

        model.approach(f"{is_new} from {sorted(parent.names)} at {parent.fitted.point.tolist()}", find)
        return model

    def _log_odds(self, models: Sequence[Model], best: Model) -> list[tuple[Model, float]]:
        """Models with their ln evidence over another one, the most first, under the inflation of the best in χ²."""
        c = min([best, *models], key=lambda m: m.chi2).inflation
        before = self.log_evidence(best, c)
        return sorted(((m, self.log_evidence(m, c) - before) for m in models), key=lambda pair: -pair[1])

    def _follow_again(self, model: Model) -> bool:
        """Continues a model from early data once more, from its own mode; whether that gains a unit of χ².

        Its starts had guessed strengths. With fitted ones, early data lead to modes that those starts missed.
        """
        before, point = model.chi2, model.modes[0].point
        model.approach(f"again from {point.tolist()}", lambda: follow_early(model.likelihood, [point]))
        model.finish()
        return model.chi2 < before - model.unit

    def _model(self, names: Names) -> Model:
        """The model with these candidates, not fitted if it is new; ImpossibleModelError if it cannot be."""
        if names not in self.models:
            experiment, effects, bobs = self.experiment, set(), self.experiment.cradle.bobs
            for candidate in self.candidates:
                if candidate.label in names and not experiment.cradle.has(candidate.name):
                    own = matching_candidate(experiment.cradle, candidate)
                    values = next(starts(own.declaration, bobs, (1.0,)))
                    added = {name: {} for name in own.effects if name != own.name} | {own.name: values}
                    experiment = with_effects(experiment, added, own.unknown)
                    effects |= {*own.effects}
            likelihood = Likelihood(experiment, training_rows(experiment)[0], self.workers)
            self.models[names] = Model(names, frozenset(effects), likelihood, self.store)
        return self.models[names]

    def _drop_each(self, model: Model) -> Model:
        """The model, or what is better without one of its members, under the inflation of its own residuals."""
        several = [model]
        for label in sorted(model.names) if len(model.names) > 2 else ():  # smaller sets were all visited
            smaller = self._model(model.names - {label})
            smaller.finish_from(_point_from(smaller, model))
            several += [smaller] if smaller.modes else []
        return max(several, key=lambda m: self.log_evidence(m, model.inflation))

    def _finish_near_the_best(self, models: Iterable[Model]) -> list[Model]:
        """The models near the one with the least χ², all of them finished; none of none."""
        ordered = sorted(models, key=lambda m: m.chi2)
        if not ordered:
            return []
        ordered[0].finish()
        limit = ordered[0].chi2 + MAX_DISTANCE * ordered[0].unit
        near = [m for m in ordered if m.chi2 < limit]
        in_threads(Model.finish, near[1:], self.workers)
        best = min(near, key=lambda m: m.chi2)
        return [m for m in near if m.chi2 < best.chi2 + COMPARED_WITHIN * best.unit]


def _point_from(model: Model, other: Model) -> np.ndarray:
    """The point (D,) of a model with the values of another one's mode, as far as they share unknowns."""
    own = model.fitted.values if model.modes else model.likelihood.values(model.likelihood.start())
    return point_at(model.likelihood, {**own, **{k: v for k, v in other.fitted.values.items() if k in own}})
