"""Fits of one model: from anywhere, with more effort, and to all data."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.criteria import DEFAULT_CRITERIA, Criteria
from identification.diagnosis.selection.fit_cache import FitCache, fit_key
from identification.experiment.experiment import Experiment
from identification.experiment.train_test import training_rows
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.least_squares import refine
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import find_mode
from identification.inference.nonsmooth import descend, descend_among_kappa_modes
from identification.progress import Progress

#: Evaluations of least squares at most to a mode.
_EVALUATIONS = 40
#: Searches from anywhere at most until two agree on a mode.
_ATTEMPTS = 4


class Searcher:
    """Fits of a model to the training part, or to all that may be fitted; each is done once.

    store: keeps them. seed: of the random draws. workers: threads. criteria: of the diagnosis.
    """

    def __init__(self, store: FitCache, seed: int, workers: int | None, criteria: Criteria = DEFAULT_CRITERIA):
        self.store, self.seed, self.workers, self.criteria = store, seed, workers, criteria

    def fit_global(self, experiment: Experiment, progress: Progress | None = None, attempt: int = 0) -> FitResult:
        """A mode of a model, from anywhere; each attempt draws other starts."""
        likelihood, seed = self.likelihood(experiment), self.seed + attempt

        def find() -> np.ndarray:
            mode = find_mode(likelihood, seed, progress)[1].point
            return descend_among_kappa_modes(likelihood, descend(likelihood, mode))

        return FitResult(likelihood, self.store.point(fit_key("globally", experiment, seed), find))

    def refit_multistart(self, fitted: FitResult, progress: Progress | None = None) -> FitResult:
        """The best mode of a model again, with more effort.

        It searches from anywhere until one search comes to the same χ² as the best so far, for modes multiply with the
        bobs, and then among the modes of κ about the best.
        """
        best = fitted
        for attempt in range(1, _ATTEMPTS):
            try:
                found = self.fit_global(fitted.experiment, progress, attempt)
            except ImpossibleModelError:  # from these draws nowhere
                continue
            agreed = abs(found.chi2 - best.chi2) < best.chi2_scale
            best = min(best, found, key=lambda fit: fit.chi2)
            if agreed:
                break
        key = fit_key("settled", best.experiment, best.point.tolist())
        point = self.store.point(key, lambda: descend_among_kappa_modes(best.likelihood, best.point))
        return min(best, FitResult(best.likelihood, point), key=lambda fit: fit.chi2)

    def fit_all_data(self, fitted: FitResult) -> FitResult:
        """The fit moved to all readings that may be fitted, which choose nothing any more.

        A model with a law moves to no other mode of κ, for its terms go with the mode of the other unknowns.
        """
        likelihood = Likelihood(fitted.experiment, None, self.workers)
        key = fit_key("on everything", fitted.experiment, fitted.point.tolist())

        def find() -> np.ndarray:
            point = refine_to_mode(likelihood, fitted.point)
            return point if fitted.has_learned_law else descend_among_kappa_modes(likelihood, point)

        return FitResult(likelihood, self.store.point(key, find))

    def likelihood(self, experiment: Experiment) -> Likelihood:
        """That of the training part."""
        return Likelihood(experiment, training_rows(experiment)[0], self.workers)


def refine_to_mode(likelihood: Likelihood, point: np.ndarray, thorough: bool = False) -> np.ndarray:
    """The mode near a point, (D,); thorough: see `descend`."""
    return descend(likelihood, refine(likelihood, point, _EVALUATIONS)[0], thorough=thorough)
