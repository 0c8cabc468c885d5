"""Search over sets of missing effects: add, exchange and drop effects as long as the evidence rises.

The χ² of a model is meant to be a function of the model, not of the path to it. Each new model is therefore fitted by
continuation from early data, and the best modes are shared among models until none gains a unit of χ².
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from identification.diagnosis.selection.candidates import (
    Candidate,
    list_candidates,
    matching_candidate,
    starts,
    with_effects,
)
from identification.experiment.experiment import Experiment
from identification.experiment.train_test import training_rows
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.least_squares import cost
from identification.inference.likelihood import Likelihood
from identification.inference.start_points import flatten_values, point_at
from studies.selection.continuation import Basin, Minimum, follow_modes, refine_over_all, screen_starts, unit_of_chi2
from studies.selection.evidence import LaplaceTerms

#: Strengths from which a candidate starts on early data [declared scales]: basins exist in strengths, too.
EARLY_STRENGTHS = (0.1, 1.0, 3.0, 10.0)
#: Strengths from which a candidate starts at its parent's mode, over all data; the best few are refined.
LATE_STRENGTHS, LATE_STARTS = (0.01, 0.1, 1.0), 2
#: Distance from the best model of a size within which others are compared [units of χ²]: 20 is e⁻¹⁰ in likelihood.
FINISH_WITHIN = 20.0
#: Prior probability of each further effect over that of none further.
ANOTHER = 0.5
#: Models of each size that are extended.
BEAM = 3
#: Effects added at most.
MAX_EFFECTS = 4
#: Models whose modes are tried in the others: the best. Modes kept of each model.
SHARED_FROM, MODES_KEPT = 6, 5
#: Early starts refined from the stated values and from the parent's, each: those with the least misfit.
EARLY_STARTS = 6

Names = frozenset[str]


@dataclass(eq=False)
class Model:
    """A set of candidates over the base, and its modes, the best first."""

    names: Names
    effects: Names
    likelihood: Likelihood
    modes: list[Minimum]
    _fitted: FitResult | None = None
    _terms: LaplaceTerms | None = None

    @property
    def chi2(self) -> float:
        """That of the best mode; infinite if there is none."""
        return self.modes[0].chi2 if self.modes else math.inf

    @property
    def unit(self) -> float:
        """What one unit of χ² is worth beside what this model leaves."""
        return unit_of_chi2(self.likelihood)(self.chi2)

    @property
    def fitted(self) -> FitResult:
        """The best mode as a fit."""
        if self._fitted is None:
            self._fitted = FitResult(self.likelihood, self.modes[0].point)
        return self._fitted

    @property
    def terms(self) -> LaplaceTerms:
        """What its evidence needs."""
        if self._terms is None:
            self._terms = LaplaceTerms.of(self.fitted)
        return self._terms

    @property
    def inflation(self) -> float:
        """c of its residuals."""
        return self.fitted.effective_sample.inflation

    def add_modes(self, modes: Iterable[Minimum]) -> bool:
        """Adds modes; returns whether the best improved by a unit."""
        before = self.chi2
        self.modes = sorted([*self.modes, *modes], key=lambda mode: mode.chi2)[:MODES_KEPT]
        if self.chi2 < before:
            self._fitted = self._terms = None
        return bool(self.modes) and self.chi2 < before - self.unit

    def in_best_basin(self, point: np.ndarray) -> bool:
        """Whether a point (D,) lies in the basin of the best mode."""
        chi2 = cost(self.likelihood, point)
        return Basin(self.modes[0], self.terms.information, self.unit).holds(point, chi2)


@dataclass(eq=False)
class ModelSearch:
    """All models visited, by the names of their candidates, and a line for each round. experiment: noise stated."""

    experiment: Experiment
    workers: int | None = 1
    models: dict[Names, Model] = field(default_factory=dict)
    path: list[str] = field(default_factory=list)

    def run(self) -> Model:
        """The model with the most evidence."""
        best = self.fit_base()
        front = [best]
        for size in range(1, MAX_EFFECTS + 1):
            children = list({child.names: child for parent in front for child in self.extend(parent)}.values())
            children = [child for child in children if child.modes]
            if not children:
                break
            lowest = min(children, key=lambda m: m.chi2)
            near = [m for m in children if m.chi2 < lowest.chi2 + FINISH_WITHIN * lowest.unit]
            self.share_modes([*front, *near])
            c = best.inflation
            near.sort(key=lambda m: -self.log_evidence(m, c))
            self._note(size, best, near, c)
            if self.log_evidence(near[0], c) <= self.log_evidence(best, c):
                break
            best = self.drop_each(near[0])
            front = near[:BEAM]
        return best

    def fit_base(self) -> Model:
        """The model with nothing added."""
        likelihood = self._likelihood(self.experiment)
        base = Model(frozenset(), frozenset(), likelihood, follow_modes(likelihood, [likelihood.start()]))
        if not base.modes:
            raise ImpossibleModelError("no point near the stated values has a motion: state values nearer to the truth")
        self.models[base.names] = base
        return base

    def extend(self, parent: Model) -> list[Model]:
        """The parent with each candidate more: modes found on early data, and those from the parent's mode."""
        found = []
        for candidate in list_candidates(self.experiment.cradle):
            if candidate.name in parent.effects:
                continue
            model = self._model(parent, candidate)
            if model is not None:
                model.add_modes(refine_over_all(model.likelihood, self._late_starts(parent, model, candidate)))
                found.append(model)
        return found

    def drop_each(self, model: Model) -> Model:
        """The model, or what is better without one of its members, under the inflation of its own residuals."""
        best = model
        for name in model.names if len(model.names) > 2 else ():  # smaller sets were all visited
            smaller = self._rebuild(model.names - {name})
            if smaller is not None:
                shared = point_at(smaller.likelihood, model.fitted.values)
                smaller.add_modes(refine_over_all(smaller.likelihood, [shared]))
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
                    shared = {k: v for k, v in other.fitted.values.items() if k in model.fitted.values}
                    start = point_at(model.likelihood, {**model.fitted.values, **shared})
                    if model.in_best_basin(start):
                        continue
                    if model.add_modes(refine_over_all(model.likelihood, [start])):
                        self.path.append(f"{_label(model.names)} gains from {_label(other.names)}: χ² {model.chi2:.1f}")
                        gained = True

    def log_evidence(self, model: Model, inflation: float) -> float:
        """ln Z of a model, with the prior of its set: ANOTHER for each effect, shared by all candidates."""
        count = len({c.name for c in list_candidates(self.experiment.cradle)})
        return model.terms.log_evidence(inflation) + len(model.names) * math.log(ANOTHER / count)

    def ranked(self, best: Model) -> list[tuple[Names, float]]:
        """(names, log evidence over that of the best) of the visited models near it and of the base, under the best
        model's inflation; the most evidence first."""
        limit = best.chi2 + 2.0 * FINISH_WITHIN * best.unit
        near = [m for m in self.models.values() if m.modes and (m.chi2 < limit or not m.names)]
        c = best.inflation
        first = self.log_evidence(best, c)
        return sorted(((m.names, self.log_evidence(m, c) - first) for m in near), key=lambda pair: -pair[1])

    def _likelihood(self, experiment: Experiment) -> Likelihood:
        return Likelihood(experiment, training_rows(experiment)[0], self.workers)

    def _model(self, parent: Model, candidate: Candidate) -> Model | None:
        """The parent with a candidate, fitted by continuation when it is met first; None where there is no motion."""
        names = parent.names | {candidate.label}
        if names in self.models:
            return self.models[names]
        experiment = parent.likelihood.experiment
        own = matching_candidate(experiment.cradle, candidate)
        try:
            values = next(starts(own.declaration, experiment.cradle.bobs, (1.0,)))
            added = {name: {} for name in own.effects if name != own.name} | {own.name: values}
            likelihood = self._likelihood(with_effects(experiment, added, own.unknown))
        except ImpossibleModelError:
            return None
        early = []
        for known in ({}, parent.fitted.values):
            every = [
                point_at(likelihood, {**known, **flatten_values(own.name, values)})
                for values in starts(own.declaration, experiment.cradle.bobs, EARLY_STRENGTHS)
            ]
            early += screen_starts(likelihood, every, EARLY_STARTS)
        model = Model(names, parent.effects | {candidate.name}, likelihood, follow_modes(likelihood, early))
        self.models[names] = model
        return model

    def _late_starts(self, parent: Model, model: Model, candidate: Candidate) -> list[np.ndarray]:
        """The parent's mode with the candidate at some strengths: those points with the least χ²."""
        bobs = model.likelihood.experiment.cradle.bobs
        points = [
            point_at(model.likelihood, {**parent.fitted.values, **flatten_values(candidate.name, values)})
            for values in starts(candidate.declaration, bobs, LATE_STRENGTHS)
        ]
        costs = [cost(model.likelihood, point) for point in points]
        return [points[i] for i in np.argsort(costs)[:LATE_STARTS] if math.isfinite(costs[i])]

    def _rebuild(self, names: Names) -> Model | None:
        """The model with these candidates, built one by one from the base."""
        model: Model | None = self.models[frozenset()]
        for candidate in list_candidates(self.experiment.cradle):
            if model is not None and candidate.label in names:
                model = self._model(model, candidate)
        return model if model is not None and model.modes else None

    def _note(self, size: int, before: Model, near: Sequence[Model], c: float) -> None:
        first = self.log_evidence(before, c)
        tried = "; ".join(
            f"{_label(m.names)} χ² {m.chi2:.1f}, ln odds {self.log_evidence(m, c) - first:+.1f}" for m in near[:5]
        )
        self.path.append(f"size {size}: {_label(before.names)} χ² {before.chi2:.1f}, c {c:.2f}; {tried}")


def _label(names: Names) -> str:
    return " + ".join(sorted(names)) or "base"
