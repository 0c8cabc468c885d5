"""A smooth law for what no effect of the catalogue explains: few terms of a fixed library, learned from the data.

Terms are chosen in windows of time with start states of their own, where a force shows where it acts, and in the free
run, which tells more where the misfit is small: the best subset of each size, of them the one with the most evidence,
and smaller ones; without forces in time, and with them. A law must predict: as one free run, fitted to the first two
thirds of the training part, it must do better on the rest of it than the model alone. Fitted to all of that part, what
it leaves over the noise shows further terms. What is held out is never looked at.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cradle_env.threads import each_in_threads, in_threads
from identification.diagnosis.criteria import MISSPECIFIED_GAP, Criteria, only_noise
from identification.diagnosis.learned_law.periodic_force import add_periodic_terms
from identification.diagnosis.learned_law.terms import (
    LinearModel,
    Scales,
    Term,
    selection_cost,
    selection_cost_beside,
    with_terms,
)
from identification.diagnosis.residuals.multiple_shooting import can_be_segmented, fit_multiple_shooting
from identification.diagnosis.selection.inner_validation import hold_out_last_third, validate_inner
from identification.diagnosis.selection.model_comparison import log_evidence
from identification.diagnosis.selection.search import Searcher, fit_key
from identification.experiment.experiment import Experiment
from identification.experiment.noise import gap_of_noise
from identification.experiment.train_test import training_rows
from identification.experiment.unit_check import swings_read
from identification.inference.fit_result import Fitted, colour
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.least_squares import cost, refine
from identification.inference.mode_search import climb_ladder
from identification.inference.nonsmooth import ROUNDS, polish
from identification.inference.start_points import placed
from identification.inference.unknowns import SEARCH
from identification.progress import Progress

#: Terms of a law at most.
_MAX_TERMS = 10
#: Shares of the linear model's coefficients at which refits start.
_START_SHARES = (1.0, 0.5, 0.2, 0.05)
#: Evaluations of these refits.
_EVALUATIONS = 20
#: How often further terms are looked for in the residuals of a law.
_ROUNDS = 3
#: Training gap [noise] up to which a free run is in step with the data, so that the linear model holds there.
_IN_STEP_GAP = 3.0
#: Residual [share of the motion] up to which it is in step, too.
_IN_STEP_SHARE = 0.1
#: Inner gap of a law, over that of the effects named instead, up to which the law is completed.
_MAX_GAP_OVER_RIVAL = 1.15
#: Rounds of the nonsmooth descent for an inner prediction. Only a law that predicts is fitted to the end.
_INNER_ROUNDS = 2
#: Distance of κ from its stated value [widths of its search] from which the missing law may have moved it.
_DISTORTED = 2.0


@dataclass(frozen=True, eq=False)
class LearnedLaw:
    """A learned law: the model without it and with it, both fitted to the training part; its terms, and their scales;
    gaps of the inner prediction without and with it."""

    before: Fitted
    fitted: Fitted
    terms: tuple[Term, ...]
    scales: Scales
    inner_gap_before: float
    inner_gap_after: float

    @property
    def log_evidence(self) -> float:
        """Over the model without it."""
        return self.evidence(*self.fitted.coloured)

    def evidence(self, inflation: float, effective: float) -> float:
        """The same, of data whose residuals are so coloured, less what it costs that the terms were chosen."""
        more = len(self.fitted.point) - len(self.before.point)
        gained = log_evidence(self.before.chi2 - self.fitted.chi2, more, inflation, effective)
        return gained - selection_cost_beside(self.before, len(self.terms))

    def is_better_than(self, other: LearnedLaw) -> bool:
        """Whether it has more evidence, both judged by the residuals that the nearer to the data leaves."""
        coloured = min((self, other), key=lambda law: law.fitted.chi2).fitted.coloured
        return self.evidence(*coloured) > other.evidence(*coloured)


@dataclass(frozen=True, eq=False)
class _Draft:
    """A law as yet fitted to the first two thirds of the training part alone: all its terms and the new ones, what was
    found of these, scales, and the gap of the inner prediction."""

    terms: tuple[Term, ...]
    new: tuple[Term, ...]
    values: dict[str, float]
    scales: Scales
    gap: float


def learn_law(fitted: Fitted, searcher: Searcher, progress: Progress, rival: Fitted | None = None) -> LearnedLaw | None:
    """The law that a fitted model lacks; None where none predicts better than the model alone, or with so
    many unknowns more that it explains nothing; or where it begins to predict far worse than a rival, the model with
    effects named instead."""
    if fitted.learned or "b" not in fitted.likelihood.names:
        return None
    progress("law", 0.0, "window by window")
    scales = law_scales(fitted)
    cut = LinearModel.of(fit_multiple_shooting(fitted), scales) if can_be_segmented(fitted.cradle) else None
    progress("law", 0.4, "which terms")
    part = hold_out_last_third(fitted.experiment)
    none = LearnedLaw(
        fitted, fitted, (), scales, *[_fit_free_run(fitted, searcher, part, scales, (), {}).held_out_gap()] * 2
    )
    most = math.inf if rival is None else _MAX_GAP_OVER_RIVAL * validate_inner(rival, searcher)[1]
    free = _linearize_free_run(none) if cut is None or _is_in_step(fitted) else []
    views = free if cut is None else [cut, *free]
    drafts = [_draft_extensions(none, searcher, part, scales, view, candidate_subsets(view), most) for view in views]
    progress("law", 0.6, "forces in time")
    if cut is not None and (timed := add_periodic_terms(cut, scales, best_subset(cut))) is not None:
        linear, at = timed
        several = candidate_subsets(linear)
        swinging = tuple(i for i in several[0] if linear.term(i).in_time) if several else ()
        if swinging:
            # Near the frequency of the swing a force in time bends to whatever swings with the bobs, for a while.
            most = min(most, gap_of_noise(part.runs, training_rows(part)[1]))
            for some in ([swinging], several):
                drafts.append(_draft_extensions(none, searcher, part, at, linear, some, most))
    law = _complete_best(none, searcher, part, drafts)
    if law is None:
        return None
    for i in range(_ROUNDS):
        if only_noise(law.fitted, searcher.criteria):  # terms that bend to noise spoil what the law predicts
            break
        progress("law", 0.8 + 0.05 * i, "what the law leaves")
        views = ((view, best_subset(view)) for view in _linearize_free_run(law))
        wider = [_draft_extensions(law, searcher, part, law.scales, view, [best]) for view, best in views if best]
        further = _complete_best(law, searcher, part, wider)
        if further is None:
            break
        law = further
    return law


def _is_in_step(fitted: Fitted) -> bool:
    """Whether a free run stays near enough to the data for what a term does to it to add up to what it misses."""
    likelihood, motion = fitted.likelihood, 0.0
    for run, rows, noise in zip(fitted.experiment.runs, likelihood.rows, likelihood.noise_model.weights, strict=True):
        motion += float(np.nansum((swings_read(run, rows)[rows] / noise) ** 2))
    return fitted.training_gap() <= _IN_STEP_GAP or fitted.chi2 <= _IN_STEP_SHARE**2 * motion


def _linearize_free_run(law: LearnedLaw) -> list[LinearModel]:
    """What the free run of a law shows of further terms: of those common to all bobs alone, and of all."""
    linear = LinearModel.of(law.fitted, law.scales, law.terms)
    return [linear] if law.fitted.cradle.bobs == 1 else [linear.with_common_terms(), linear]


def candidate_subsets(linear: LinearModel) -> list[tuple[int, ...]]:
    """The best subset of all sizes, then those of the path with half as many terms, a quarter, and one: more terms may
    bend to what they were fitted to."""
    path, best = linear.subset_path(_MAX_TERMS), best_subset(linear)
    sizes = dict.fromkeys((len(best) // 2, len(best) // 4, 1))
    return [best, *(path[size - 1] for size in sizes if 0 < size < len(best))] if best else []


def _draft_extensions(
    law: LearnedLaw, searcher: Searcher, part: Experiment, scales: Scales, linear: LinearModel,
    several: list[tuple[int, ...]], most: float = math.inf,
) -> Iterator[_Draft]:  # fmt: skip
    """The law with each of several subsets of further terms that predicts better; near the noise, where all are asked
    for, found side by side."""
    workers = 1 if law.before.training_gap() > MISSPECIFIED_GAP else searcher.workers
    drafted = each_in_threads(
        lambda subset: _draft_extension(law, searcher, part, scales, linear, subset, most), several, workers
    )  # fmt: skip
    return (draft for draft in drafted if draft is not None)


def _draft_extension(
    law: LearnedLaw, searcher: Searcher, part: Experiment, scales: Scales, linear: LinearModel, subset: tuple[int, ...],
    most: float,
) -> _Draft | None:  # fmt: skip
    """The law with further terms; None where that predicts no better, or with a gap of `most` or above."""
    new, values = tuple(map(linear.term, subset)), linear.values(subset)
    return _fit_draft(law, searcher, part, scales, (*law.terms, *new), new, values, min(law.inner_gap_after, most))


def _fit_draft(
    law: LearnedLaw, searcher: Searcher, part: Experiment, scales: Scales, terms: tuple[Term, ...],
    new: tuple[Term, ...], values: dict[str, float], below: float,
) -> _Draft | None:  # fmt: skip
    """A law with these terms instead, fitted to the first two thirds; None where its gap is not below that asked."""
    try:
        gap = _fit_free_run(law.before, searcher, part, scales, terms, values, new).held_out_gap()
    except ImpossibleModelError:  # a law under which the cradle cannot swing
        return None
    return _Draft(terms, new, values, scales, gap) if gap < below else None


def _complete_best(
    law: LearnedLaw, searcher: Searcher, part: Experiment, several: Sequence[Iterator[_Draft]]
) -> LearnedLaw | None:
    """The law of one of the drafts of several choices that has more evidence, fitted to the whole, than the law so far;
    None where there is none: what holds for no longer than it was fitted is no law, whatever it explains there.

    Those that predict as well as the best, but for what noise does to a gap, are fitted, and that with the most
    evidence is taken; where none of these will do, the next best. Far above the noise, where how well each predicts one
    stretch of time says little about the next, a choice stands for its first draft until that will not do.
    """
    if law.before.training_gap() <= MISSPECIFIED_GAP:
        several = [iter([draft]) for draft in itertools.chain.from_iterable(several)]
    by_noise = gap_of_noise(part.runs, training_rows(part)[1])
    left = [(draft, choice) for choice in several for draft in itertools.islice(choice, 1)]
    while left:
        least = min(draft.gap for draft, _ in left)
        equal = [one for one in left if one[0].gap <= by_noise * least]
        if found := _fit_better(law, searcher, [draft for draft, _ in equal]):
            coloured = min(found, key=lambda one: one.fitted.chi2).fitted.coloured
            best = max(found, key=lambda one: one.evidence(*coloured))
            return _drop_weak_terms(best, searcher, part, by_noise * best.inner_gap_after)
        left = [one for one in left if one not in equal]
        left += [(draft, choice) for _, choice in equal for draft in itertools.islice(choice, 1)]
    return None


def _drop_weak_terms(law: LearnedLaw, searcher: Searcher, part: Experiment, below: float) -> LearnedLaw:
    """The law without the least certain terms, as long as it then has more evidence, and an inner gap below that asked:
    the linear model by which terms were chosen holds only near where the model without them had its mode. Far above
    the noise, where evidence says little, all stay."""
    while len(law.terms) > 1 and law.before.training_gap() <= MISSPECIFIED_GAP:
        values, sd = law.fitted.values, np.sqrt(np.diag(law.fitted.smooth))
        sizes = {name: abs(values[name]) / own for name, own in zip(law.fitted.likelihood.names, sd, strict=True)}
        least = min(law.terms, key=lambda term: sizes[term.name])
        terms = tuple(term for term in law.terms if term != least)
        draft = _fit_draft(law, searcher, part, law.scales, terms, (), values, below)
        fewer = None if draft is None else _fit_whole(law, searcher, draft)
        if fewer is None or not fewer.is_better_than(law):
            break
        law = fewer
    return law


def _fit_better(law: LearnedLaw, searcher: Searcher, drafts: Sequence[_Draft]) -> list[LearnedLaw]:
    """Those of the drafts, fitted to the whole, with more evidence than the law so far."""
    whole = in_threads(lambda draft: _fit_whole(law, searcher, draft), drafts, searcher.workers)
    return [one for one in whole if one is not None and one.is_better_than(law)]


def _fit_whole(law: LearnedLaw, searcher: Searcher, draft: _Draft) -> LearnedLaw | None:
    """A draft fitted to the whole training part; None where that cannot swing."""
    fitted = law.before
    try:
        whole = _fit_free_run(fitted, searcher, fitted.experiment, draft.scales, draft.terms, draft.values, draft.new)
        whole.held_out_gap()  # raises where the run ends before the readings do
    except ImpossibleModelError:
        return None
    return LearnedLaw(fitted, whole, draft.terms, draft.scales, law.inner_gap_before, draft.gap)


def best_subset(linear: LinearModel) -> tuple[int, ...]:
    """The subset of the path with the most evidence, without terms that lessen it; () where none has any."""
    path = linear.subset_path(_MAX_TERMS)
    if not path:
        return ()
    left = linear.solve(path[-1])[0]
    evidence = functools.partial(_evidence, linear, *colour(left[: linear.fitted.count], linear.fitted.readings))
    best = max([(), *path], key=evidence)
    while best:
        fewer = max((tuple(j for j in best if j != i) for i in best), key=evidence)
        if evidence(fewer) <= evidence(best):
            break
        best = fewer
    return best


def _evidence(linear: LinearModel, inflation: float, effective: float, subset: tuple[int, ...]) -> float:
    return linear.log_evidence(subset, inflation, effective)


def _fit_free_run(
    fitted: Fitted, searcher: Searcher, experiment: Experiment, scales: Scales, terms: tuple[Term, ...],
    values: dict[str, float], new: tuple[Term, ...] = (),
) -> Fitted:  # fmt: skip
    """The fit as one free run, near the values found in windows, those of new terms or less of them: a free run alone
    would bend terms to its drift; to the whole, also from other κ about there. Raises ImpossibleModelError where
    none of these can be simulated."""
    likelihood = searcher.likelihood(with_terms(experiment, scales, terms))
    begun = sorted(values.items()), [term.name for term in new]
    what = experiment.digest, scales, [term.name for term in terms], fitted.point.tolist(), *begun
    key, meet = fit_key("law", experiment, *what), experiment.cradle.bobs > 1

    def find() -> np.ndarray:
        # All that a linear model found at once may throw a long run out of step, where part of it does not.
        parts = _START_SHARES if meet else _START_SHARES[:1]
        reached = []
        for origin in _start_origins(fitted):
            begin = {**fitted.values, **values, **origin}
            starts = [
                placed(likelihood, {**begin, **{term.name: part * values[term.name] for term in new}}) for part in parts
            ]
            costs = in_threads(lambda z: cost(likelihood, z), starts, likelihood.workers)
            reached.append(refine(likelihood, starts[int(np.argmin(costs))], _EVALUATIONS))
        point, least = min(reached, key=lambda pair: pair[1])
        if not math.isfinite(least):
            raise ImpossibleModelError("the law cannot be simulated where its fit begins")
        whole = experiment is fitted.experiment
        if whole and "kappa" in likelihood.names:  # where a law may begin, the model without it made up for it by κ
            point = refine(likelihood, climb_ladder(likelihood, point, least)[0], _EVALUATIONS)[0]
        return polish(likelihood, point, ROUNDS if whole else _INNER_ROUNDS, thorough=True) if meet else point

    return Fitted(likelihood, searcher.store.point(key, find))


def _start_origins(fitted: Fitted) -> list[dict[str, float]]:
    """What begins otherwise than in the model without a law, each time it is fitted: nothing, and, where that took κ
    far from what was stated, perhaps to make up for what it lacks, κ."""
    stated = fitted.likelihood.values(fitted.likelihood.start()).get("kappa")
    if stated is None or abs(math.log(fitted.values["kappa"] / stated)) < _DISTORTED * SEARCH["kappa"]:
        return [{}]
    return [{}, {"kappa": stated}]


def evidence_over_effects(law: LearnedLaw, named: Fitted) -> float:
    """Log evidence of a model with a law over one with effects named in its stead, on the training part: the unknowns
    of both counted, and the terms that the law was free to choose from. The library holds the like of some effects:
    a law that only copies an effect comes out near 0 or below."""
    rival = law.fitted
    inflation, effective = min((named, rival), key=lambda one: one.chi2).coloured
    more = len(rival.point) - len(named.point)
    return log_evidence(named.chi2 - rival.chi2, more, inflation, effective) - selection_cost(
        rival.cradle, len(law.terms)
    )


def can_outdo(before: Fitted, named: Fitted, criteria: Criteria) -> bool:
    """Whether a law on a model could have the `advantage` over effects that leave nothing but noise: by fewer unknowns
    than they have, for what more it explains by chance pays no more than the choice of its terms."""
    inflation, effective = named.coloured
    spared = len(named.point) - len(before.point)
    several = range(1, _MAX_TERMS + 1)
    return criteria.equivalent_log_odds <= max(
        log_evidence(0.0, k - spared, inflation, effective) - selection_cost(before.cradle, k) for k in several
    )


def law_scales(fitted: Fitted) -> Scales:
    """angle [rad] and speed [m/s]: the largest swing fitted, and that of a swing of this size; frequency
    [Hz]: that of a swing, until a force in time has another."""
    largest = 0.0
    for run, rows in zip(fitted.experiment.runs, fitted.likelihood.rows, strict=True):
        if rows.any():
            unit = 1.0 if run.quantity == "theta" else fitted.cradle.length
            largest = max(largest, float(np.nanmax(np.abs(swings_read(run, rows)))) / unit)
    return {"angle": largest, "speed": largest * math.sqrt(fitted.cradle.gravity * fitted.cradle.length),
            "frequency": 1.0 / fitted.cradle.period}  # fmt: skip
