"""The rival: what a physicist would do without refitting any candidate.

The model as stated is fitted, and its residuals are regressed on what each candidate, or two, would change to first
order, less what the fit absorbs. Bayes' information criterion counts the parameters (Schwarz, Annals of Statistics 6,
461, 1978). A periodogram says whether the best regression leaves noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.selection.candidates import Candidate, list_candidates
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.score_test import compute_sensitivities
from identification.diagnosis.selection.searcher import Searcher
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import FitResult, orthonormal_basis, with_known_noise
from studies.missing_effect_bench.candidates import COMMON_LENGTH, UNKNOWN, Names

#: False-alarm probability of a peak of the periodogram below which it is no noise.
FALSE_ALARM = 0.01
#: Share of the forces in no catalogue that leave such a peak: assumed, not measured.
POWER = 0.8
#: Sensitivities of which the fit leaves less than this share are rounding.
LEAST_SHARE = 1e-4


@dataclass(frozen=True)
class Direction:
    """An orthonormal basis (R + P, k) of what a candidate changes, and its number of parameters."""

    basis: np.ndarray
    parameters: int


def regress(experiment: Experiment, prior: Mapping[Names, float]) -> dict[Names, float]:
    """The probabilities of the sets of a prior."""
    fitted = fit_as_stated(experiment)
    directions = find_directions(fitted)
    evidence = {
        names: log_evidence(fitted, [directions[name] for name in names])
        for names in prior
        if names != UNKNOWN and names <= directions.keys()
    }
    best = max(evidence, key=lambda names: evidence[names] + math.log(prior[names]))
    peak = false_alarm_probability(fitted, left_by(fitted, [directions[name] for name in best]))
    weights = {names: prior[names] * math.exp(value - evidence[best]) for names, value in evidence.items()}
    unknown = probability_of_unknown(prior[UNKNOWN], peak < FALSE_ALARM)
    share = (1.0 - unknown) / math.fsum(weights.values())
    return {UNKNOWN: unknown, **{names: share * weight for names, weight in weights.items()}}


def fit_as_stated(experiment: Experiment) -> FitResult:
    """The model as stated, fitted to all readings."""
    searcher = Searcher(FitCache(None, ""), 0, 1)
    return searcher.fit_all_data(searcher.fit_global(with_known_noise(experiment)))


def probability_of_unknown(before: float, significant: bool) -> float:
    """That of a force in no catalogue, `before` the data, after a test at FALSE_ALARM of what the best model leaves."""
    if_unknown, if_known = (POWER, FALSE_ALARM) if significant else (1.0 - POWER, 1.0 - FALSE_ALARM)
    return before * if_unknown / (before * if_unknown + (1.0 - before) * if_known)


def find_directions(fitted: FitResult) -> dict[str, Direction]:
    """Of each candidate that can be seen, the shape that the residuals like best."""
    found: dict[str, Direction] = {}
    for candidate in list_candidates(fitted.cradle):
        for sensitivity in compute_sensitivities(fitted, candidate):
            lengths = np.linalg.norm(sensitivity.S, axis=0)
            columns = fitted.project(sensitivity.S / np.where(lengths > 0.0, lengths, 1.0))
            columns = columns[:, np.linalg.norm(columns, axis=0) > LEAST_SHARE]
            if columns.shape[1] == 0:
                continue
            basis = orthonormal_basis(columns)
            shape = sum(not p.is_strength for p in candidate.declaration.parameters)
            direction, name = Direction(basis, basis.shape[1] + shape), _own_name(candidate, fitted.cradle.bobs)
            if name not in found or log_evidence(fitted, [direction]) > log_evidence(fitted, [found[name]]):
                found[name] = direction
    return found


def _own_name(candidate: Candidate, bobs: int) -> str:
    common = candidate.name == "length_mismatch" and (candidate.shared or bobs == 1)
    return COMMON_LENGTH if common else candidate.name


def log_evidence(fitted: FitResult, directions: list[Direction]) -> float:
    """½ (Δχ² − k ln n) of these candidates together, with Δχ² over the inflation of noise that is correlated."""
    gain = fitted.chi2 - float(np.sum(left_by(fitted, directions) ** 2))
    parameters = sum(direction.parameters for direction in directions)
    return 0.5 * (gain / fitted.noise_inflation - parameters * math.log(fitted.count))


def left_by(fitted: FitResult, directions: list[Direction]) -> np.ndarray:
    """The residuals less their regression on these candidates, (R + P,)."""
    if not directions:
        return fitted.residuals
    basis = orthonormal_basis(np.column_stack([direction.basis for direction in directions]))
    return fitted.residuals - basis @ (basis.T @ fitted.residuals)


def false_alarm_probability(fitted: FitResult, residuals: np.ndarray) -> float:
    """That noise alone has as high a peak in the periodogram of a bob (Scargle, ApJ 263, 835, 1982)."""
    highest, count = 0.0, 0
    for bob in range(fitted.cradle.bobs):
        power = np.abs(np.fft.rfft(residuals[: fitted.count][fitted.readings.bob == bob])) ** 2
        own = power[1:] / np.sum(fitted.readings.bob == bob) / fitted.noise_inflation
        highest, count = max(highest, float(own.max())), count + len(own)
    return -math.expm1(count * math.log1p(-math.exp(-min(highest, 700.0)))) if highest > 1e-9 else 1.0
