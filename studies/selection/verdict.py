"""The verdict of a search over models: sets that the data do not tell apart, and two absolute tests."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.criteria import DEFAULT_CRITERIA, exceeds_allowed_gap
from identification.diagnosis.residuals.residual_tests import scan_residuals
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import with_known_noise
from studies.selection.model_search import Model, ModelSearch

#: Replicates of the residual scan: at 1 % of 400, four are above.
REPLICATES = 400


@dataclass(frozen=True)
class Selection:
    """What was found.

    verdict: as in diagnosis.json. sets: of effect names within 3 nats of the best, with their log odds, the best first;
    one that holds the best or is part of it is no rival explanation, and only takes its share of the probability.
    probability: of the best set among all sets compared. margin: its log evidence over the best set of other names.
    scan_p: of the residual scan. gap, gap_bound: held-out gap, and its 99 % bound. path: a line for each round.
    """

    verdict: str
    sets: tuple[tuple[tuple[str, ...], float], ...]
    probability: float
    margin: float
    scan_p: float
    gap: float
    gap_bound: float
    chi2: float
    readings: int
    path: tuple[str, ...]


def select_effects(experiment: Experiment, seed: int = 0, workers: int | None = 1) -> Selection:
    """Which effects are missing in the model of an experiment.

    The scan of the residuals at 1 % says "unknown" of any model. Held-out data refute names only: a base model that
    leaves only noise stays right, for its own uncertainty makes long predictions fail by chance.
    """
    estimated = tuple(run.noise is None for run in experiment.runs)
    search = ModelSearch(with_known_noise(experiment), workers)
    best = search.run()
    scan_p = _scan(best, estimated, seed)
    gap, bound = best.fitted.held_out_gap(), best.fitted.predictive_bound
    level = DEFAULT_CRITERIA.significance_level
    refuted = bool(best.names) and exceeds_allowed_gap(gap, bound)
    merged = _merge(search, search.ranked(best))
    first = frozenset(merged[0][0])
    rivals = [(names, odds) for names, odds in merged[1:] if not (first <= {*names} or first >= {*names})]
    limit = merged[0][1] - DEFAULT_CRITERIA.equivalent_log_odds
    sets = (merged[0], *((names, odds) for names, odds in rivals if odds > limit))
    if scan_p < level or refuted:
        verdict = "unknown"
    elif not best.names:
        verdict = "nothing_missing"
    else:
        verdict = "named" if len(sets) == 1 else "equivalent"
    weights = np.exp([odds - merged[0][1] for _, odds in merged])
    margin = merged[0][1] - merged[1][1] if len(merged) > 1 else math.inf
    return Selection(
        verdict, sets, float(weights[0] / weights.sum()), margin, scan_p, gap, bound, best.chi2, best.fitted.count,
        tuple(search.path),
    )  # fmt: skip


def _scan(model: Model, estimated: tuple[bool, ...], seed: int) -> float:
    replicates = model.fitted.replicates(REPLICATES, np.random.default_rng(seed), estimated)
    return scan_residuals(model.fitted, replicates).p


def _merge(search: ModelSearch, ranked: list[tuple[frozenset[str], float]]) -> list[tuple[tuple[str, ...], float]]:
    """Sets of effects instead of candidates: of an effect's forms, with values alike or not, the better counts."""
    found: dict[tuple[str, ...], float] = {}
    for names, odds in ranked:
        found.setdefault(tuple(sorted(search.models[names].effects)), odds)
    return list(found.items())
