"""From an experiment to its diagnosis: locate, name, repair, advise."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path

from identification.diagnosis.data_checks.instrument_faults import check_slips
from identification.diagnosis.data_checks.readings import check_readings
from identification.diagnosis.data_checks.run_consistency import check_agreement
from identification.diagnosis.next_experiment.expected_information import Advice, advise, advise_on_lambda
from identification.diagnosis.repair import Repaired, repair
from identification.diagnosis.result import Diagnosis
from identification.diagnosis.selection.candidates import Names, added_as, without_effect
from identification.diagnosis.selection.rigid_strings import said, simpler
from identification.diagnosis.selection.search import Searcher, Store
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import Fitted, with_known_noise
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.linear_algebra import on_one_thread
from identification.progress import Progress
from identification.storage.lock import holds_out


@holds_out
@on_one_thread
def diagnose(
    experiment: Experiment,
    *,
    out: str | Path | None = None,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Where a model and measured runs part, what is missing, what the model with it looks like, what to measure next.

    out: folder in which finished fits are kept, so that the same call goes on where it was interrupted. Effects and
    their order are chosen on the training part alone; gaps are of what was held out, which can refute a choice.
    Raises ValueError for what cannot be diagnosed.
    """
    tell = progress or (lambda *_: None)
    estimated = tuple(run.noise is None for run in experiment.runs)
    known = with_known_noise(experiment)
    store = Store.of(out, experiment, seed)
    searcher = Searcher(store, seed, workers)
    warnings = check_readings(known)
    tell("search", 0.0, "the model as given")
    given = searcher.globally(known, tell)
    tell("check", 0.0, "whether the readings hang together")
    whole = searcher.on_everything(given)
    check_agreement(whole, seed, tell)
    check_slips(whole)
    base = simpler(given, searcher, tell)
    repaired = repair(base, searcher, seed, estimated, tell)
    if any(given.cradle.has(step.effect) for step in repaired.steps):  # what was taken out shows after all
        base = given
        repaired = repair(base, searcher, seed, estimated, tell)
    warnings = (*warnings, *said(base, given))
    tell("advise", 0.0, "the next experiment")
    final = searcher.on_everything(repaired.last.fitted if repaired.law is None else repaired.law.fitted)
    others = _others(repaired, searcher)
    advice = _advice(repaired, others, searcher, seed, tell)
    return Diagnosis(experiment, repaired, final, advice, seed, warnings, tuple(others.values()), store.point)


def _advice(
    repaired: Repaired, others: Mapping[Names, Fitted], searcher: Searcher, seed: int, tell: Progress
) -> Advice | None:  # fmt: skip
    """The experiment that tells equivalent sets apart; without such, the one that makes λ certain, by a model that
    leaves only noise."""
    if not repaired.alternatives:
        last = repaired.last
        return None if last.significant else advise_on_lambda(searcher.on_everything(last.fitted), tell)
    if not others:
        return None
    models = [searcher.on_everything(repaired.last.fitted), *others.values()]
    return advise(models, [tuple(c.name for c in repaired.alternatives[0]), *others], seed, tell)


def _others(repaired: Repaired, searcher: Searcher) -> dict[Names, Fitted]:
    """The models with what would do as well as the sets chosen, by what it is, fitted to all data."""
    if not repaired.alternatives:
        return {}
    last, found = repaired.last.fitted, {}
    chosen, *others = repaired.alternatives
    model = last.experiment
    for candidate in chosen:
        model = without_effect(model, candidate.name)
    without = searcher.nearby(model, last.values)
    for several in others:
        fit = without
        with contextlib.suppress(ImpossibleModelError):
            for candidate in several:
                fit = searcher.adding(fit, added_as(fit.cradle, candidate))
            found[tuple(c.name for c in several)] = searcher.on_everything(fit)
    return found
