"""The search alone: sets that the data do not tell apart, and two absolute tests, without a learned law."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.criteria import DEFAULT_CRITERIA, exceeds_allowed_gap
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.model_search import ModelSearch, Round
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import with_known_noise


@dataclass(frozen=True)
class Selection:
    """What was found.

    verdict: as in diagnosis.json. sets: of effect names within 3 nats of the best, with their log odds, the best first;
    one that holds the best or is part of it is no rival explanation, and only takes its share of the probability.
    compared: candidates of every set compared, as their labels, with the log odds over the best model.
    probability: of the best set among all sets compared. margin: its log evidence over the best set of other names.
    scan_p: of the residual scan. gap, gap_bound: held-out gap, and its 99 % bound. path: a line for each round.
    """

    verdict: str
    sets: tuple[tuple[tuple[str, ...], float], ...]
    compared: tuple[tuple[tuple[str, ...], float], ...]
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
    search = ModelSearch(
        with_known_noise(experiment), FitCache(None, ""), workers, seed=seed, estimated=estimated
    )  # fmt: skip
    best = search.run([], lambda *_: None)
    scan_p, gap, bound = search.examined(best).p, best.fitted.held_out_gap(), best.fitted.predictive_bound
    refuted = bool(best.names) and exceeds_allowed_gap(gap, bound)
    ranked = search.ranked(best)
    close, own = -DEFAULT_CRITERIA.equivalent_log_odds, best.effects
    rivals = [
        (names, odds) for names, odds, model in ranked
        if model is not None and odds > close and not (names >= own or names <= own)
    ]  # fmt: skip
    sets = [(own, 0.0), *rivals]
    if scan_p < DEFAULT_CRITERIA.significance_level or refuted:
        verdict = "unknown"
    elif not best.names:
        verdict = "nothing_missing"
    else:
        verdict = "named" if len(sets) == 1 else "equivalent"
    odds = [one for _, one, _ in ranked]
    return Selection(
        verdict,
        tuple((tuple(sorted(names)), one) for names, one in sets),
        tuple((tuple(sorted(model.names)), one) for _, one, model in ranked if model is not None),
        float(1.0 / np.exp(odds).sum()),
        odds[0] - odds[1] if len(odds) > 1 else math.inf,
        scan_p,
        gap,
        bound,
        best.chi2,
        best.fitted.count,
        tuple(_line(round_) for round_ in search.rounds),
    )


def _line(round_: Round) -> str:
    """A round of the search in words."""
    tried = "; ".join(f"{m.label} χ² {m.chi2:.1f}, ln odds {odds:+.1f}" for m, odds in round_.compared[:5])
    return f"{round_.before.label} χ² {round_.before.chi2:.1f}; {tried}"
