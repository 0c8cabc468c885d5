"""From an experiment to its diagnosis: locate, name, repair, advise."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path

from identification.diagnosis.criteria import DEFAULT_CRITERIA, Criteria
from identification.diagnosis.data_checks.instrument_faults import check_instrument_faults
from identification.diagnosis.data_checks.readings import check_readings
from identification.diagnosis.data_checks.run_consistency import check_run_consistency
from identification.diagnosis.next_experiment.expected_information import Advice, advise, advise_on_lambda
from identification.diagnosis.repair import RepairResult, repair
from identification.diagnosis.result import Diagnosis
from identification.diagnosis.selection.candidates import EffectNames, matching_candidate, without_effect
from identification.diagnosis.selection.rigid_strings import choose_base_model, describe_removed_effects
from identification.diagnosis.selection.search import FitCache, Searcher
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
    criteria: Criteria = DEFAULT_CRITERIA,
) -> Diagnosis:
    """Where a model and measured runs part, what is missing, what the model with it looks like, what to measure next.

    out: folder in which finished fits are kept, so that the same call goes on where it was interrupted. Effects and
    their order are chosen on the training part alone; gaps are of what was held out, which can refute a choice.
    Raises ValueError for what cannot be diagnosed.
    """
    progress = progress or (lambda *_: None)
    estimated = tuple(run.noise is None for run in experiment.runs)
    known = with_known_noise(experiment)
    store = FitCache.of(out, experiment, seed)
    searcher = Searcher(store, seed, workers, criteria)
    warnings = check_readings(known, criteria)
    progress("search", 0.0, "the model as given")
    given = searcher.fit_global(known, progress)
    progress("check", 0.0, "whether the readings hang together")
    whole = searcher.fit_all_data(given)
    check_run_consistency(whole, seed, progress, criteria)
    check_instrument_faults(whole, criteria)
    base = choose_base_model(given, searcher, progress)
    repaired = repair(base, searcher, seed, estimated, progress)
    if any(given.cradle.has(step.effect) for step in repaired.steps):  # what was taken out shows after all
        base = given
        repaired = repair(base, searcher, seed, estimated, progress)
    warnings = (*criteria.changes(), *warnings, *describe_removed_effects(base, given))
    progress("advise", 0.0, "the next experiment")
    final = searcher.fit_all_data(repaired.last.fitted if repaired.law is None else repaired.law.fitted)
    others = _fit_equivalent_models(repaired, searcher)
    advice = _advise(repaired, others, searcher, seed, progress)
    return Diagnosis(experiment, repaired, final, advice, seed, warnings, tuple(others.values()), store.point)


def _advise(
    repaired: RepairResult, others: Mapping[EffectNames, Fitted], searcher: Searcher, seed: int, progress: Progress
) -> Advice | None:  # fmt: skip
    """The experiment that tells equivalent sets apart; without such, the one that makes λ certain, by a model that
    leaves only noise."""
    if not repaired.alternatives:
        last = repaired.last
        return None if last.significant else advise_on_lambda(searcher.fit_all_data(last.fitted), progress)
    if not others:
        return None
    models = [searcher.fit_all_data(repaired.last.fitted), *others.values()]
    return advise(models, [tuple(c.name for c in repaired.alternatives[0]), *others], seed, progress, searcher.criteria)


def _fit_equivalent_models(repaired: RepairResult, searcher: Searcher) -> dict[EffectNames, Fitted]:
    """The models with what would do as well as the sets chosen, by what it is, fitted to all data."""
    if not repaired.alternatives:
        return {}
    last, found = repaired.last.fitted, {}
    chosen, *others = repaired.alternatives
    model = last.experiment
    for candidate in chosen:
        model = without_effect(model, candidate.name)
    without = searcher.fit_from_values(model, last.values)
    for several in others:
        fit = without
        with contextlib.suppress(ImpossibleModelError):
            for candidate in several:
                fit = searcher.fit_with_candidate(fit, matching_candidate(fit.cradle, candidate))
            found[tuple(c.name for c in several)] = searcher.fit_all_data(fit)
    return found
