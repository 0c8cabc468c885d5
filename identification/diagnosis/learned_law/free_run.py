"""Fits of a law as one free run, without start states in between."""

from __future__ import annotations

import math

import numpy as np

from cradle_env.threads import in_threads
from identification.diagnosis.learned_law.terms import Scales, Term, with_terms
from identification.diagnosis.selection.fit_cache import fit_key
from identification.diagnosis.selection.searcher import Searcher
from identification.experiment.experiment import Experiment
from identification.experiment.unit_check import readings_from_rest
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.least_squares import cost, refine
from identification.inference.mode_search import search_kappa_modes
from identification.inference.nonsmooth import descend
from identification.inference.start_points import point_at
from identification.inference.unknowns import SEARCH_WIDTHS

#: Shares of the linear model's coefficients at which refits start.
_START_SHARES = (1.0, 0.5, 0.2, 0.05)
#: Evaluations of these refits.
_EVALUATIONS = 20
#: Training gap [noise] up to which a free run is in step with the data, so that the linear model holds there.
_IN_STEP_GAP = 3.0
#: Residual [share of the motion] up to which it is in step, too.
_IN_STEP_SHARE = 0.1
#: Rounds of the nonsmooth descent for an inner prediction. Only a law that predicts is fitted to the end.
_INNER_ROUNDS = 2
#: Distance of κ from its stated value [widths of its search] from which the missing law may have moved it.
_DISTORTED = 2.0


def is_in_step(fitted: FitResult) -> bool:
    """Whether a free run is so near the data that the effects of a term add up linearly."""
    likelihood, motion = fitted.likelihood, 0.0
    for run, rows, noise in zip(fitted.experiment.runs, likelihood.rows, likelihood.noise_model.weights, strict=True):
        motion += float(np.nansum((readings_from_rest(run, rows)[rows] / noise) ** 2))
    return fitted.training_gap() <= _IN_STEP_GAP or fitted.chi2 <= _IN_STEP_SHARE**2 * motion


def fit_free_run(
    fitted: FitResult, searcher: Searcher, experiment: Experiment, scales: Scales, terms: tuple[Term, ...],
    values: dict[str, float], new: tuple[Term, ...] = (),
) -> FitResult:  # fmt: skip
    """The fit of a law to an experiment as one free run.

    It starts at `values`, found by the linear model, with new terms also at smaller shares of their values: a fit of
    the free run from zero would bias terms by its accumulated error. A fit to the whole training part also tries other
    κ. Raises ImpossibleModelError if no start can be simulated.
    """
    likelihood = searcher.likelihood(with_terms(experiment, scales, terms))
    begun = sorted(values.items()), [term.name for term in new]
    what = experiment.digest, scales, [term.name for term in terms], fitted.point.tolist(), *begun
    key, meet = fit_key("law", experiment, *what), experiment.cradle.bobs > 1

    def find() -> np.ndarray:
        # All of the coefficients at once may put a long run out of step, where part of them does not.
        shares = _START_SHARES if meet else _START_SHARES[:1]
        ends = []
        for origin in _start_origins(fitted):
            begin = {**fitted.values, **values, **origin}
            starts = [
                point_at(likelihood, {**begin, **{term.name: share * values[term.name] for term in new}})
                for share in shares
            ]
            costs = in_threads(lambda z: cost(likelihood, z), starts, likelihood.workers)
            ends.append(refine(likelihood, starts[int(np.argmin(costs))], _EVALUATIONS))
        point, least = min(ends, key=lambda pair: pair[1])
        if not math.isfinite(least):
            raise ImpossibleModelError("the law cannot be simulated where its fit begins")
        whole = experiment is fitted.experiment
        if whole and "kappa" in likelihood.names:  # the model without the law may have compensated it by κ
            point = refine(likelihood, search_kappa_modes(likelihood, point, least)[0], _EVALUATIONS)[0]
        return descend(likelihood, point, None if whole else _INNER_ROUNDS, thorough=True) if meet else point

    return FitResult(likelihood, searcher.store.point(key, find))


def _start_origins(fitted: FitResult) -> list[dict[str, float]]:
    """Values that replace those of the fit without the law at a start: none, and the stated κ where the fit without
    the law moved κ far from it, perhaps to compensate the law."""
    stated = fitted.likelihood.values(fitted.likelihood.start()).get("kappa")
    if stated is None or abs(math.log(fitted.values["kappa"] / stated)) < _DISTORTED * SEARCH_WIDTHS["kappa"]:
        return [{}]
    return [{}, {"kappa": stated}]
