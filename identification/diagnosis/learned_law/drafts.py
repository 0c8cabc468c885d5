"""Drafts of a law: fitted to the first two thirds of the training part, compared by what they predict, then completed.

A draft must predict the last third of the training part better than the model without it. Held-out data play no part.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cradle_env.threads import each_in_threads, in_threads
from identification.diagnosis.criteria import is_misspecified
from identification.diagnosis.learned_law.free_run import fit_free_run
from identification.diagnosis.learned_law.law import LearnedLaw
from identification.diagnosis.learned_law.terms import LinearModel, Scales, Term
from identification.diagnosis.selection.searcher import Searcher
from identification.experiment.experiment import Experiment
from identification.experiment.noise import noise_gap_bound
from identification.experiment.train_test import training_rows
from identification.inference.impossible_model import ImpossibleModelError


@dataclass(frozen=True, eq=False)
class Draft:
    """A law fitted to the first two thirds of the training part alone.

    terms: all of them. new: those that the law before it does not have. values: of the linear model, where the fit
    starts. gap: of its prediction of the last third.
    """

    terms: tuple[Term, ...]
    new: tuple[Term, ...]
    values: dict[str, float]
    scales: Scales
    gap: float


def draft_extensions(
    law: LearnedLaw, searcher: Searcher, part: Experiment, scales: Scales, linear: LinearModel,
    subsets: list[tuple[int, ...]], most: float = math.inf,
) -> Iterator[Draft]:  # fmt: skip
    """Drafts of the law with each subset of further terms, those alone that predict better than the law.

    They are fitted when asked for. A model that is not misspecified needs all of them, so threads fit them in parallel.
    """
    workers = 1 if is_misspecified(law.before) else searcher.workers
    drafts = each_in_threads(
        lambda subset: _draft_extension(law, searcher, part, scales, linear, subset, most), subsets, workers
    )  # fmt: skip
    return (draft for draft in drafts if draft is not None)


def _draft_extension(
    law: LearnedLaw, searcher: Searcher, part: Experiment, scales: Scales, linear: LinearModel, subset: tuple[int, ...],
    most: float,
) -> Draft | None:  # fmt: skip
    """The law with further terms; None unless its gap is below that of the law and below `most`."""
    new, values = tuple(map(linear.term, subset)), linear.values(subset)
    return _fit_draft(law, searcher, part, scales, (*law.terms, *new), new, values, min(law.inner_gap_after, most))


def _fit_draft(
    law: LearnedLaw, searcher: Searcher, part: Experiment, scales: Scales, terms: tuple[Term, ...],
    new: tuple[Term, ...], values: dict[str, float], below: float,
) -> Draft | None:  # fmt: skip
    """A draft with these terms; None unless its gap is below `below`."""
    try:
        gap = fit_free_run(law.before, searcher, part, scales, terms, values, new).held_out_gap()
    except ImpossibleModelError:  # the cradle cannot swing under this law
        return None
    return Draft(terms, new, values, scales, gap) if gap < below else None


def complete_best(
    law: LearnedLaw, searcher: Searcher, part: Experiment, choices: Sequence[Iterator[Draft]]
) -> LearnedLaw | None:
    """The best draft of several choices, fitted to the whole training part; None if none has more evidence than `law`.

    1. The drafts whose gap equals the smallest one within its noise are fitted to the whole training part.
    2. The one with the most evidence is taken. If none has more evidence than the law, the next best drafts follow.
    3. The terms that the evidence does not support are dropped.

    Of a misspecified model, a prediction of one stretch of time says little about the next. There each choice is
    represented by its first draft, and by its next one only if that fails.
    """
    if not is_misspecified(law.before):
        choices = [iter([draft]) for draft in itertools.chain.from_iterable(choices)]
    by_noise = noise_gap_bound(part.runs, training_rows(part)[1])
    remaining = [(draft, choice) for choice in choices for draft in itertools.islice(choice, 1)]
    while remaining:
        least = min(draft.gap for draft, _ in remaining)
        equal = [one for one in remaining if one[0].gap <= by_noise * least]
        if better := _fit_better(law, searcher, [draft for draft, _ in equal]):
            coloured = min(better, key=lambda one: one.fitted.chi2).fitted.effective_sample
            best = max(better, key=lambda one: one.evidence(*coloured))
            return _drop_weak_terms(best, searcher, part, by_noise * best.inner_gap_after)
        remaining = [one for one in remaining if one not in equal]
        remaining += [(draft, choice) for _, choice in equal for draft in itertools.islice(choice, 1)]
    return None


def _drop_weak_terms(law: LearnedLaw, searcher: Searcher, part: Experiment, below: float) -> LearnedLaw:
    """The law without its least certain terms, as long as the evidence grows and the inner gap stays below `below`.

    The linear model that chose the terms holds only near the mode without them. All terms of a misspecified model stay,
    for there the evidence says little.
    """
    while len(law.terms) > 1 and not is_misspecified(law.before):
        values, sd = law.fitted.values, np.sqrt(np.diag(law.fitted.laplace_covariance))
        sizes = {name: abs(values[name]) / own for name, own in zip(law.fitted.likelihood.names, sd, strict=True)}
        weakest = min(law.terms, key=lambda term: sizes[term.name])
        terms = tuple(term for term in law.terms if term != weakest)
        draft = _fit_draft(law, searcher, part, law.scales, terms, (), values, below)
        fewer = None if draft is None else _fit_whole(law, searcher, draft)
        if fewer is None or not fewer.is_better_than(law):
            break
        law = fewer
    return law


def _fit_better(law: LearnedLaw, searcher: Searcher, drafts: Sequence[Draft]) -> list[LearnedLaw]:
    """The drafts that have more evidence than the law, fitted to the whole training part."""
    fits = in_threads(lambda draft: _fit_whole(law, searcher, draft), drafts, searcher.workers)
    return [one for one in fits if one is not None and one.is_better_than(law)]


def _fit_whole(law: LearnedLaw, searcher: Searcher, draft: Draft) -> LearnedLaw | None:
    """A draft fitted to the whole training part; None if it cannot be simulated to the end of the run."""
    fitted = law.before
    try:
        whole = fit_free_run(fitted, searcher, fitted.experiment, draft.scales, draft.terms, draft.values, draft.new)
        whole.held_out_gap()  # raises if the run ends before the readings do
    except ImpossibleModelError:
        return None
    return LearnedLaw(fitted, whole, draft.terms, draft.scales, law.inner_gap_before, draft.gap)
