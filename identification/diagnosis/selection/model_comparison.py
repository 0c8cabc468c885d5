"""Candidates added to one model, one at a time: their fits side by side."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.selection.candidates import Candidate
from identification.diagnosis.selection.score_test import family_p, gain_neg_log10_p
from identification.inference.fit_result import FitResult


@dataclass(frozen=True, eq=False)
class Refit:
    """A model with one candidate more: its fit, Δχ² gained over the model without, k more unknowns, log evidence over
    that model, p among all candidates, and the held-out gap, which chooses nothing."""

    candidate: Candidate
    fitted: FitResult
    gain: float
    unknowns: int
    log_evidence: float
    p: float
    gap: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """Refits, the most evidence first, and the one that was chosen."""

    refits: tuple[Refit, ...]
    chosen: Refit | None


def compare(
    fitted: FitResult, candidate: Candidate, fit: FitResult, replicate_maxima: np.ndarray, evidence: float
) -> Refit:
    """A refit with its figures; replicate_maxima: of the scores of the model without it. Raises ImpossibleModelError if
    the motion ends before the readings that are held out."""
    gain, more = fitted.chi2 - fit.chi2, len(fit.point) - len(fitted.point)
    strengths = candidate.declaration.strengths
    sided = bool(strengths) and all(p.one_sided for p in strengths)
    beyond = max(1.0, fit.effective_sample.inflation / fitted.noise_inflation)  # what the replicates do not have
    own = float(gain_neg_log10_p(np.array(gain / beyond), max(more, 1), sided))
    return Refit(candidate, fit, gain, more, evidence, family_p(own, replicate_maxima), fit.held_out_gap())


def schwarz_evidence(gain: float, unknowns: int, inflation: float, effective: float) -> float:
    """½ (Δχ²/c − k ln n_eff): log evidence of k more unknowns that gain Δχ², of c and n_eff of the better model.

    Source: Schwarz, Ann. Stat. 6, 461 (1978).
    """
    return 0.5 * (gain / inflation - unknowns * math.log(effective))
