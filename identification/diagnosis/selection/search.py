"""Fits of models to the training part, from many starts, kept in a file so that an interrupted search goes on."""

from __future__ import annotations

import hashlib
import json
import math
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cradle_env.effects import effect, known_effects
from cradle_env.threads import in_threads
from identification.diagnosis.criteria import DEFAULT_CRITERIA, Criteria
from identification.diagnosis.selection.candidates import Candidate, Values, starts, with_effects
from identification.experiment.experiment import Experiment
from identification.experiment.train_test import training_rows
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.least_squares import cost, refine, refine_each
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import early_rows, find_mode
from identification.inference.nonsmooth import descend, descend_among_kappa_modes
from identification.inference.start_points import flatten_values, point_at
from identification.progress import Progress
from identification.storage.files import ExperimentError, json_text, write_together
from identification.storage.provenance import program_hash
from identification.storage.schema import read_json

#: Strengths at which a search starts, in scales of the parameter: from as good as none, which is no worse than without.
_FACTORS = (0.01, 0.1, 1.0, 3.0)
#: Starts that are followed.
_FOLLOWED = 3
#: Evaluations by which each is followed.
_FIRST = 6
#: Starts that are followed to the end.
_KEPT = 2
#: Evaluations at most to the end.
_LAST = 40
#: Rounds of the nonsmooth descent before a model is given up.
_FEW = 2
#: Searches from anywhere at most until two agree on a mode.
_ATTEMPTS = 4
#: How the result of long work, a vector, is kept: the key of the work, and the work.
PointCache = Callable[[str, Callable[[], np.ndarray]], np.ndarray]


def compute_uncached(_: str, find: Callable[[], np.ndarray]) -> np.ndarray:
    """What is found, kept nowhere."""
    return find()


class FitCache:
    """Points of finished fits by what was fitted, in a file (None: in memory only). inputs: "program/data", of which
    fits of other data are refused (ExperimentError), and those by another program made anew."""

    def __init__(self, path: Path | None, inputs: str):
        self.path, self.inputs, self.points = path, inputs, {}
        self._writing = threading.Lock()
        if path is not None and path.is_file():
            known = read_json(path, "fits", "remove it to begin anew, or choose another --out")
            data, points = known["inputs"].partition("/")[2], known["points"]
            if data != inputs.partition("/")[2]:
                raise ExperimentError(
                    f"{path}: holds the fits of another experiment, or with another seed, which would be lost; "
                    "choose another --out"
                )
            self.points = points if known["inputs"] == inputs else {}  # of another program: begin anew

    @classmethod
    def of(cls, out: str | Path | None, experiment: Experiment, seed: int) -> FitCache:
        """That of an experiment in folder `out` (None: in memory); fits by other code are not taken over."""
        path = None if out is None else Path(out) / "fits.json"
        return cls(path, f"{program_hash(known_effects())}/{experiment.digest}/{seed}")

    def point(self, key: str, find: Callable[[], np.ndarray]) -> np.ndarray:
        """The point of that key, found if it is not known; of several threads at once, too."""
        if key not in self.points:
            found = [float(z) for z in find()]
            with self._writing:
                self.points[key] = found
                if self.path is not None:
                    kept = {k: z for k, z in self.points.items() if np.isfinite(z).all()}  # JSON knows no others
                    text = json_text({"inputs": self.inputs, "points": kept})
                    write_together(self.path.parent, {self.path.name: text})
        return np.array(self.points[key])


class Searcher:
    """Fits to the training part, or to all that may be fitted; each is done once, and of a model the best is kept."""

    def __init__(self, store: FitCache, seed: int, workers: int | None, criteria: Criteria = DEFAULT_CRITERIA):
        self.store, self.seed, self.workers, self.criteria = store, seed, workers, criteria
        self._best: dict[str, FitResult] = {}

    def fit_global(self, experiment: Experiment, tell: Progress | None = None) -> FitResult:
        """The best mode of a model, from anywhere."""
        return self.best(self._search(experiment, tell))

    def _search(self, experiment: Experiment, tell: Progress | None, attempt: int = 0) -> FitResult:
        """A mode of a model, from anywhere; each attempt draws other starts."""
        likelihood, seed = self.likelihood(experiment), self.seed + attempt
        key = fit_key("globally", experiment, seed)

        def find() -> np.ndarray:
            return descend_among_kappa_modes(
                likelihood, descend(likelihood, find_mode(likelihood, seed, tell)[1].point)
            )

        return FitResult(likelihood, self.store.point(key, find))

    def refit_multistart(self, fitted: FitResult, tell: Progress | None = None) -> FitResult:
        """The best mode of a model again, with more effort: searches from anywhere until one comes to the same χ² as
        the best so far, for modes multiply with the bobs; then the modes about what is best by now, which may come
        from elsewhere."""
        best = self.best(fitted)
        for attempt in range(1, _ATTEMPTS):
            try:
                found = self._search(fitted.experiment, tell, attempt)
            except ImpossibleModelError:  # from these draws nowhere
                continue
            agreed = abs(found.chi2 - best.chi2) < best.chi2_scale
            best = self.best(found)
            if agreed:
                break
        key = fit_key("settled", best.experiment, best.point.tolist())
        point = self.store.point(key, lambda: descend_among_kappa_modes(best.likelihood, best.point))
        return self.best(FitResult(best.likelihood, point))

    def fit_from_values(self, experiment: Experiment, values: Mapping[str, float]) -> FitResult:
        """The best mode known of a model, or that which is reached from these values of its unknowns."""
        known = self._best.get(fit_key("best", experiment))
        if known is not None:
            return known
        likelihood = self.likelihood(experiment)
        key = fit_key("nearby", experiment, sorted(values.items()))
        point = point_at(likelihood, values)
        return self.best(FitResult(likelihood, self.store.point(key, lambda: refine_to_mode(likelihood, point))))

    def fit_all_data(self, fitted: FitResult) -> FitResult:
        """The fit moved to all readings that may be fitted, which choose nothing any more; with a law, whose terms go
        with their mode of the other unknowns, to no other mode."""
        likelihood = Likelihood(fitted.experiment, None, self.workers)
        key = fit_key("on everything", fitted.experiment, fitted.point.tolist())

        def find() -> np.ndarray:
            point = refine_to_mode(likelihood, fitted.point)
            return point if fitted.has_learned_law else descend_among_kappa_modes(likelihood, point)

        return FitResult(likelihood, self.store.point(key, find))

    def fit_with_candidate(
        self, fitted: FitResult, candidate: Candidate, likely: Sequence[Values] = (), enough: float = math.inf
    ) -> FitResult:
        """The best fit of the model with a candidate added: from the mode without it and from what was stated, at
        several strengths on both sides and where it is `likely`; and, where it brings no parameter or brings other
        effects along, from anywhere. A fit that is far from a χ² of `enough` is left unfinished."""
        own, likelihood = candidate.declaration, self._with(fitted, candidate)
        known = self._best.get(fit_key("best", likelihood.experiment))
        if known is not None and known.chi2 <= fitted.chi2:
            return known

        def find() -> np.ndarray:
            if not own.parameters or len(candidate.effects) > 1:
                return descend(likelihood, find_mode(likelihood, self.seed)[1].point)
            origins = {**likelihood.values(likelihood.start()), **fitted.values}, {}
            several = [flatten_values(own.name, values) for values in starts(own, fitted.cradle.bobs, _FACTORS)]
            tried = [point_at(likelihood, {**origin, **values}) for values in several for origin in origins]
            tried += [point_at(likelihood, {**origins[0], **flatten_values(own.name, values)}) for values in likely]
            return best_of(likelihood, tried, early_too=True, enough=enough)

        begun = [sorted(flatten_values(own.name, values).items()) for values in likely]
        key = fit_key("adding", likelihood.experiment, fitted.point.tolist(), self.seed, begun, enough)
        return self.best(FitResult(likelihood, self.store.point(key, find)))

    def fit_with_candidate_from_mode(
        self, fitted: FitResult, candidate: Candidate, other: FitResult, likely: Sequence[Values] = (),
        enough: float = math.inf,
    ) -> FitResult:  # fmt: skip
        """The best fit of the model with a candidate added, once more: from where another model has its mode. Modes
        that differ in κ are common to all of them, and what bends one model into a wrong one hides from the next. A
        fit that is far from a χ² of `enough` is left unfinished."""
        own, likelihood = candidate.declaration, self._with(fitted, candidate)
        if not own.parameters or len(candidate.effects) > 1:
            return self.fit_with_candidate(fitted, candidate)
        several = [*starts(own, fitted.cradle.bobs, _FACTORS), *likely]
        tried = [point_at(likelihood, {**other.values, **flatten_values(own.name, values)}) for values in several]
        begun = [sorted(flatten_values(own.name, values).items()) for values in likely]
        key = fit_key("beside", likelihood.experiment, fitted.point.tolist(), other.point.tolist(), begun, enough)
        point = self.store.point(key, lambda: best_of(likelihood, tried, early_too=False, enough=enough))
        return self.best(FitResult(likelihood, point))

    def _with(self, fitted: FitResult, candidate: Candidate) -> Likelihood:
        """The likelihood of the model with a candidate added, at its scale."""
        brought = {name: next(starts(effect(name), fitted.cradle.bobs, (1.0,))) for name in candidate.effects}
        return self.likelihood(with_effects(fitted.experiment, brought, candidate.unknown))

    def likelihood(self, experiment: Experiment) -> Likelihood:
        """That of the training part."""
        return Likelihood(experiment, training_rows(experiment)[0], self.workers)

    def best(self, fitted: FitResult) -> FitResult:
        """The best fit of the model of a fit so far."""
        key = fit_key("best", fitted.experiment)
        known = self._best.get(key)
        if known is None or fitted.chi2 < known.chi2:
            self._best[key] = fitted
        return self._best[key]


def best_of(
    likelihood: Likelihood, tried: list[np.ndarray], early_too: bool, enough: float = math.inf
) -> np.ndarray:  # fmt: skip
    """Where the best of many starts leads: those nearest to the data (and those nearest to the early data alone, over
    which the misfit has fewer modes) go a little way, the best of them to the end, if one came below `enough`."""
    data = [likelihood]
    if early_too:
        rows = early_rows(likelihood)
        data.append(Likelihood(likelihood.experiment, rows, likelihood.workers, likelihood.parameters))
    reached = []
    for some in data:
        costs = np.array(in_threads(lambda z, some=some: cost(some, z), tried, likelihood.workers))
        followed = [tried[i] for i in np.argsort(costs)[:_FOLLOWED] if np.isfinite(costs[i])]
        if some is not likelihood:
            followed = [point for point, _ in refine_each(some, followed, _FIRST)]
        reached += refine_each(likelihood, followed, _FIRST)
    if not reached:
        raise ImpossibleModelError("none of the starting values can be simulated")
    nearest = min(reached, key=lambda pair: pair[1])
    if nearest[1] > enough:
        near = descend(likelihood, nearest[0], _FEW)
        reached.append((near, cost(likelihood, near)))
        if reached[-1][1] > enough:
            return near
    distinct: list[tuple[np.ndarray, float]] = []
    for point, least in sorted(reached, key=lambda pair: pair[1]):
        if all(abs(least - other) > 1e-2 for _, other in distinct):
            distinct.append((point, least))
    ends = refine_each(likelihood, [point for point, _ in distinct[: _KEPT if early_too else 1]], _LAST)
    return descend(likelihood, min(ends, key=lambda pair: pair[1])[0])


def refine_to_mode(likelihood: Likelihood, point: np.ndarray, thorough: bool = False) -> np.ndarray:
    """The mode near a point, (D,); thorough: see `polish`."""
    return descend(likelihood, refine(likelihood, point, _LAST)[0], thorough=thorough)


def fit_key(what: str, experiment: Experiment, *more: Any) -> str:
    """What a fit of a model is stored by: the kind of fit, the model's effects, and what else it depends on."""
    cradle = experiment.cradle
    model = (cradle.model, sorted(cradle.effects), sorted(experiment.unknown_effect_parameters))
    return hashlib.sha256(json.dumps([what, model, *more]).encode()).hexdigest()[:20]
