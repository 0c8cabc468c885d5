"""The diagnosis of an experiment: check the data, test the residuals, name what is missing, plan the next run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from identification.diagnosis.criteria import DEFAULT_CRITERIA, Criteria
from identification.diagnosis.data_checks.instrument_faults import check_instrument_faults
from identification.diagnosis.data_checks.readings import check_readings, without_clicks
from identification.diagnosis.data_checks.run_consistency import check_run_consistency
from identification.diagnosis.data_checks.stated_values import warn_of_stated_values
from identification.diagnosis.next_experiment.expected_information import Advice, advise, advise_on_lambda
from identification.diagnosis.repair import RepairResult, repair
from identification.diagnosis.result import Diagnosis
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.rigid_strings import choose_base_model, describe_removed_effects
from identification.diagnosis.selection.searcher import Searcher
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import FitResult, noise_is_estimated, with_known_noise
from identification.inference.linear_algebra import on_one_thread
from identification.progress import Progress
from identification.storage.lock import locks_output


@locks_output
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
    """Finds where a model and measured runs differ, which effect is missing, and what to measure next.

    Parameters
    ----------
    experiment : Experiment
        The measured runs and the model.
    out : path, optional
        Folder that keeps finished fits, so that the same call goes on after an interruption.
    seed : int
        Of the random numbers.
    workers : int, optional
        Threads; all cores if omitted.
    progress : callable, optional
        Called with a stage, a fraction done, and a text.
    criteria : Criteria
        The thresholds of all decisions, see `identification.diagnosis.criteria.Criteria`.

    Returns
    -------
    Diagnosis
        The training part chooses the effects and their order. The gaps are those of held-out data, which can refute an
        effect but never choose one.

    Raises
    ------
    ValueError
        If the readings are too few, in a wrong unit, of clicks alone, or hold a fault of the instrument.

    Examples
    --------
    Simulated data of one bob, to which the model fits:

    >>> import numpy as np
    >>> from cradle_env import Cradle, Release, simulate
    >>> from identification import Experiment, diagnose
    >>> cradle, release = Cradle(bobs=1), Release(angle=0.2)
    >>> run = simulate(cradle, release, duration=12.0, sample_rate=50.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal(run.theta.shape)
    >>> experiment = Experiment.from_arrays(cradle, run.t, run.theta + noise, release, noise=1e-3)
    >>> diagnose(experiment).verdict
    'nothing_missing'
    """
    progress = progress or (lambda *_: None)
    experiment, left_out = without_clicks(experiment)
    estimated = noise_is_estimated(experiment)
    known = with_known_noise(experiment)
    store = FitCache.of(out, experiment, seed)
    searcher = Searcher(store, seed, workers, criteria)
    warnings = (*left_out, *check_readings(known, criteria))
    progress("search", 0.0, "the model as given")
    given = searcher.fit_global(known, progress)
    progress("check", 0.0, "runs and instrument")
    whole = searcher.fit_all_data(given)
    check_run_consistency(whole, seed, progress, criteria)
    check_instrument_faults(whole, criteria)
    base = choose_base_model(given, searcher, progress)
    repaired = repair(base, searcher, seed, estimated, progress)
    if any(given.cradle.has(step.effect) for step in repaired.steps):  # the data need what was taken out
        base = given
        repaired = repair(base, searcher, seed, estimated, progress)
    doubts = warn_of_stated_values(repaired.last.fitted)
    warnings = (*criteria.changes(), *warnings, *doubts, *describe_removed_effects(base, given))
    progress("advise", 0.0, "the next experiment")
    last = repaired.last.fitted if repaired.law is None else repaired.law.fitted
    final, *modes = sorted(map(searcher.fit_all_data, (last, *repaired.modes)), key=lambda fit: fit.chi2)
    others = [searcher.fit_all_data(fitted) for fitted in repaired.others]
    advice = _advise(repaired, others, searcher, seed, progress)
    return Diagnosis(experiment, repaired, final, advice, seed, warnings, tuple(others), tuple(modes), store.point)


def _advise(
    repaired: RepairResult, others: Sequence[FitResult], searcher: Searcher, seed: int, progress: Progress
) -> Advice | None:
    """The run that separates equivalent sets; if there are none, the run that constrains λ.

    others: models with the other sets, fitted to all data. Returns None if no run can be planned, or if the model
    lacks something that has no name.
    """
    fitted = searcher.fit_all_data(repaired.last.fitted)
    if not repaired.alternatives:
        return None if repaired.lacks_a_name else advise_on_lambda(fitted, progress)
    names = [tuple(candidate.name for candidate in several) for several in repaired.alternatives]
    return advise([fitted, *others], names, seed, progress, searcher.criteria)
