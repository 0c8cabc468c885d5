"""Search over sets of missing effects: add, exchange and drop effects as long as the evidence rises.

The χ² of a model is meant to be a function of the model, not of the path to it. Each new model is therefore fitted by
continuation from early data, and the best modes are shared among models until none gains a unit of χ².
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cradle_env.threads import in_threads
from identification.diagnosis.criteria import DEFAULT_CRITERIA, Criteria, only_noise
from identification.diagnosis.residuals.residual_tests import REPLICATES, scan_residuals
from identification.diagnosis.selection.candidates import (
    Candidate,
    list_candidates,
    matching_candidate,
    starts,
    with_effects,
)
from identification.diagnosis.selection.continuation import (
    MAX_DISTANCE,
    Minimum,
    early_chi2,
    early_unit,
    follow_early,
    screen_starts,
)
from identification.diagnosis.selection.evidence import linear_log_odds
from identification.diagnosis.selection.model import Model, Names
from identification.diagnosis.selection.ranking import Ranking
from identification.diagnosis.selection.score_test import score
from identification.diagnosis.selection.search import FitCache
from identification.experiment.experiment import Experiment
from identification.experiment.train_test import training_rows
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.least_squares import cost
from identification.inference.likelihood import Likelihood
from identification.inference.start_points import flatten_values, point_at
from identification.progress import Progress

#: Strengths from which a candidate starts on early data [declared scales]: basins exist in strengths, too.
EARLY_STRENGTHS = (0.1, 1.0, 3.0, 10.0)
#: Early starts refined from the stated values and from the parent's, each: those with the least misfit.
EARLY_STARTS = 2
#: Strengths from which a candidate starts at its parent's mode, over all data; the best few are refined.
LATE_STRENGTHS, LATE_STARTS = (0.01, 0.1, 1.0), 2
#: Distance from the best model of a size within which others are compared [units of χ²]: 20 is e⁻¹⁰ in likelihood.
FINISH_WITHIN = 20.0
#: p of the residual scan from which on a model leaves so little that what it lacks is seen to first order.
SETTLED = 0.1
#: Least gain in χ² to first order for which a candidate of a model that leaves only noise is fitted. Fewer units
#: cannot pay for the prior of an effect, ln 30, and its strength.
WORTH_A_FIT = 4.0
#: Prior probability of each further effect over that of none further.
ANOTHER = 0.5
#: Models of each size that are extended where the best leaves more than noise; else the best alone is.
BEAM = 3
#: Effects added at most.
MAX_EFFECTS = 4
#: Models whose modes are tried in the others: the best.
SHARED_FROM = 3


@dataclass(frozen=True, eq=False)
class Round:
    """The models with one candidate more, compared with the best one so far.

    compared: all of them, the most evidence first, those too far in χ² last. odds: ln evidence over `before`, of those
    near enough. chosen: the best one, or a part of it; None if no evidence is above that of `before`.
    """

    before: Model
    compared: tuple[Model, ...]
    odds: tuple[float, ...]
    chosen: Model | None


@dataclass(frozen=True, eq=False)
class Beginning:
    """A model that extends its parent by a candidate, and what the early data say of it.

    early: where they led, with χ² over the last horizon before all data; none for a model that was met before.
    parent_chi2: that of the parent's mode, where the candidate is absent.
    """

    parent: Model
    candidate: Candidate
    model: Model
    early: list[Minimum]
    parent_chi2: float

    @property
    def chi2(self) -> float:
        """The least χ² over the early data that is known to be possible."""
        return min([self.parent_chi2, *(one.chi2 for one in self.early)])


@dataclass(eq=False)
class ModelSearch:
    """All models visited, by the labels of their candidates, and the rounds of the search.

    experiment: with its noise stated. store: keeps what was found. workers: threads. criteria: say what noise is.
    seed: of the residual scans. estimated: of each run, whether its noise was.
    unfitted: ln odds over a set of one candidate more, by their labels, that was judged to first order alone.
    """

    experiment: Experiment
    store: FitCache
    workers: int | None = None
    criteria: Criteria = DEFAULT_CRITERIA
    seed: int = 0
    estimated: tuple[bool, ...] = ()
    models: dict[Names, Model] = field(default_factory=dict)
    unfitted: dict[tuple[Names, str], float] = field(default_factory=dict)
    rounds: list[Round] = field(default_factory=list)
    _scans: dict[tuple[float, ...], float] = field(default_factory=dict)

    def run(self, known: Sequence[np.ndarray], progress: Progress) -> Model:
        """The model with the most evidence. known: points (D,) near modes of the base."""
        best = self.fit_base(known)
        front = [best]
        for size in range(1, MAX_EFFECTS + 1):
            children = {child.names: child for child in self.extend(front, progress)}
            near = self._finish_near_the_best([*children.values()])
            if not near:
                break
            self.share_modes([*front, *near])
            c = min(near, key=lambda m: m.chi2).inflation
            near.sort(key=lambda m: -self.log_evidence(m, c))
            before = self.log_evidence(best, c)
            odds = tuple(self.log_evidence(m, c) - before for m in near)
            compared = (*near, *sorted({*children.values()} - {*near}, key=lambda m: m.chi2))
            chosen = self.drop_each(near[0]) if odds[0] > 0.0 else None
            self.rounds.append(Round(best, compared, odds, chosen))
            if chosen is None:
                break
            best = chosen
            front = [best] if only_noise(best.fitted, self.criteria) else near[:BEAM]
            progress("refit", size / MAX_EFFECTS, best.label)
        return best

    def fit_base(self, known: Sequence[np.ndarray] = ()) -> Model:
        """The model with nothing added. known: points (D,) near its modes."""
        likelihood = self._likelihood(self.experiment)
        base = Model(frozenset(), frozenset(), likelihood, self.store)
        base.approach("base", lambda: [*known, *follow_early(likelihood, [likelihood.start()])])
        base.finish()
        if not base.modes:
            raise ImpossibleModelError("no point near the stated values has a motion: state values nearer to the truth")
        self.models[base.names] = base
        return base

    def extend(self, parents: Sequence[Model], progress: Progress) -> list[Model]:
        """Each parent with each candidate more, approached from early data and from the parent's mode.

        All follow the early data first. Those that are then far behind the best of them go no further.
        """
        pairs = [(parent, candidate) for parent in parents for candidate in self._worth_a_fit(parent)]

        def begin(i: int) -> Beginning | None:
            parent, candidate = pairs[i]
            progress("refit", 0.5 * i / len(pairs), f"{parent.label} + {candidate.label}")
            return self._begin(parent, candidate)

        def approach(i: int) -> Model:
            progress("refit", 0.5 + 0.5 * i / len(begun), begun[i].model.label)
            return self._approach(begun[i])

        begun = [one for one in in_threads(begin, range(len(pairs)), self.workers) if one is not None]
        best = min(begun, key=lambda one: one.chi2, default=None)
        if best is not None:
            limit = best.chi2 + MAX_DISTANCE * early_unit(best.model.likelihood, best.chi2)
            begun = [one for one in begun if one.chi2 <= limit]
        return [model for model in in_threads(approach, range(len(begun)), self.workers) if model.modes]

    def _worth_a_fit(self, parent: Model) -> list[Candidate]:
        """All candidates; of a model that leaves only noise those that gain enough to first order, and those that are
        not seen to first order."""
        known = parent.likelihood.experiment.cradle
        candidates = [c for c in list_candidates(self.experiment.cradle) if not known.has(c.name)]
        if self.scan_p(parent) < SETTLED:
            return candidates
        scores = score(parent.fitted, np.zeros((len(parent.fitted.residuals), 0))).scores
        small = {s.candidate.label: s for s in scores if s.sensitivities and s.gain < WORTH_A_FIT}
        count = len({c.name for c in list_candidates(self.experiment.cradle)})
        for label, one in small.items():
            odds = linear_log_odds(parent.fitted, one, parent.inflation) + math.log(ANOTHER / count)
            self.unfitted[parent.names, label] = odds
        return [c for c in candidates if c.label not in small]

    def extended(self, parent: Model, label: str) -> Model:
        """The parent with a candidate more, finished; ImpossibleModelError if it has no motion."""
        model = self.models.get(parent.names | {label})
        if model is None or not model.modes:
            candidate = next(c for c in list_candidates(self.experiment.cradle) if c.label == label)
            begun = self._begin(parent, candidate)
            model = None if begun is None else self._approach(begun)
        if model is None or not model.modes:
            raise ImpossibleModelError(f"no motion with {label}")
        model.finish()
        return model

    def drop_each(self, model: Model) -> Model:
        """The model, or what is better without one of its members, under the inflation of its own residuals."""
        best = model
        for label in sorted(model.names) if len(model.names) > 2 else ():  # smaller sets were all visited
            smaller = self._rebuild(model.names - {label})
            if smaller is not None:
                self._approach_from(smaller, model)
                if self.log_evidence(smaller, model.inflation) > self.log_evidence(best, model.inflation):
                    best = smaller
        return best

    def share_modes(self, models: Sequence[Model]) -> None:
        """Refits every model from every better model's mode that lies in another basin, until none gains a unit."""
        tried: set[tuple] = set()
        gained = True
        while gained:
            gained = False
            for other in sorted(models, key=lambda m: m.chi2)[:SHARED_FROM]:
                for model in models:
                    key = (model.names, other.names, round(other.chi2, 1))
                    if other is model or other.chi2 >= model.chi2 or key in tried:
                        continue
                    tried.add(key)
                    before = model.chi2
                    self._approach_from(model, other)
                    gained = gained or model.chi2 < before - model.unit

    def log_evidence(self, model: Model, inflation: float) -> float:
        """ln Z of a model, with the prior of its set: ANOTHER for each effect, shared by all candidates."""
        count = len({c.name for c in list_candidates(self.experiment.cradle)})
        return model.terms.log_evidence(inflation) + len(model.effects) * math.log(ANOTHER / count)

    def rank(self, best: Model) -> Ranking:
        """The visited models near the best one and the base, compared under the inflation of the best; of an effect's
        forms, with values alike or not, the better one alone."""
        limit = best.chi2 + 2.0 * FINISH_WITHIN * best.unit
        near = [m for m in self.models.values() if m.modes and (m.chi2 < limit or not m.names)]
        first = self.log_evidence(best, best.inflation)
        odds = sorted(((m, self.log_evidence(m, best.inflation) - first) for m in near), key=lambda pair: -pair[1])
        found: dict[frozenset[str], tuple[Model, float]] = {}
        for model, own in odds:
            found.setdefault(model.effects, (model, own))
        effects = {c.label: frozenset(c.effects) for c in list_candidates(self.experiment.cradle)}
        unfitted = tuple(
            (best.effects | effects[label], odds)
            for (parent, label), odds in self.unfitted.items() if parent == best.names
        )  # fmt: skip
        return Ranking(best, tuple(found.values()), unfitted, self.criteria)

    def scan_p(self, model: Model) -> float:
        """p of the residual scan of a model."""
        key = tuple(model.fitted.point)
        if key not in self._scans:
            rng = np.random.default_rng(self.seed)
            self._scans[key] = scan_residuals(model.fitted, model.fitted.replicates(REPLICATES, rng, self.estimated)).p
        return self._scans[key]

    def _likelihood(self, experiment: Experiment) -> Likelihood:
        return Likelihood(experiment, training_rows(experiment)[0], 1)

    def _begin(self, parent: Model, candidate: Candidate) -> Beginning | None:
        """The parent with a candidate, followed over the early data if it is new; None where there is no motion."""
        names, parent_chi2 = parent.names | {candidate.label}, early_chi2(parent.likelihood, parent.fitted.point)
        if names in self.models:
            return Beginning(parent, candidate, self.models[names], [], parent_chi2)
        experiment = parent.likelihood.experiment
        own = matching_candidate(experiment.cradle, candidate)
        try:
            values = next(starts(own.declaration, experiment.cradle.bobs, (1.0,)))
            added = {name: {} for name in own.effects if name != own.name} | {own.name: values}
            likelihood = self._likelihood(with_effects(experiment, added, own.unknown))
        except ImpossibleModelError:
            return None
        self.models[names] = new = Model(names, parent.effects | {*own.effects}, likelihood, self.store)
        what = f"early from {sorted(parent.names)} at {parent.fitted.point.tolist()}"
        return Beginning(parent, candidate, new, new.early(what, lambda: _early(parent, new, own)), parent_chi2)

    def _approach(self, begun: Beginning) -> Model:
        """A model that was begun, approached from where the early data led and from the parent's mode."""
        parent, model, candidate = begun.parent, begun.model, begun.candidate
        model.approach(
            f"{len(begun.early)} from {sorted(parent.names)} at {parent.fitted.point.tolist()}",
            lambda: [*(one.point for one in begun.early), *self._late_starts(parent, model, candidate)],
        )
        return model

    def _approach_from(self, model: Model, other: Model) -> None:
        """Finishes a model from the mode of another one, unless that lies in the basin of its best mode."""
        shared = {key: value for key, value in other.fitted.values.items() if key in model.fitted.values}
        start = point_at(model.likelihood, {**model.fitted.values, **shared})
        if not model.in_best_basin(start):
            model.approach(f"at {start.tolist()}", lambda: [start])
            model.finish()  # only what lies in another basin

    def _late_starts(self, parent: Model, model: Model, candidate: Candidate) -> list[np.ndarray]:
        """The parent's mode with the candidate at some strengths: those points with the least χ²."""
        points = [
            point_at(model.likelihood, {**parent.fitted.values, **flatten_values(candidate.name, values)})
            for values in starts(candidate.declaration, self.experiment.cradle.bobs, LATE_STRENGTHS)
        ]
        costs = [cost(model.likelihood, point) for point in points]
        return [points[i] for i in np.argsort(costs)[:LATE_STARTS] if math.isfinite(costs[i])]

    def _rebuild(self, names: Names) -> Model | None:
        """The model with these candidates, built one by one from the base; None where there is no motion."""
        model = self.models[frozenset()]
        for candidate in list_candidates(self.experiment.cradle):
            if candidate.label in names:
                try:
                    model = self.extended(model, candidate.label)
                except ImpossibleModelError:
                    return None
        return model

    def _finish_near_the_best(self, models: Sequence[Model]) -> list[Model]:
        """The models near the one with the least χ², all of them finished; none of none."""
        if not models:
            return []
        best = min(models, key=lambda m: m.chi2)
        best.finish()
        near = [m for m in models if m.chi2 < best.chi2 + MAX_DISTANCE * best.unit]
        in_threads(Model.finish, near, self.workers)
        best = min(near, key=lambda m: m.chi2)
        return [m for m in near if m.chi2 < best.chi2 + FINISH_WITHIN * best.unit]


def _early(parent: Model, model: Model, candidate: Candidate) -> list[np.ndarray]:
    """Where continuation from early data leads, begun at the stated values and at the parent's."""
    likelihood, bobs = model.likelihood, parent.likelihood.experiment.cradle.bobs
    begun = []
    for known in ({}, parent.fitted.values):
        every = [
            point_at(likelihood, {**known, **flatten_values(candidate.name, values)})
            for values in starts(candidate.declaration, bobs, EARLY_STRENGTHS)
        ]
        begun += screen_starts(likelihood, every, EARLY_STARTS)
    return follow_early(likelihood, begun)
