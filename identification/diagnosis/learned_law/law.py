"""A learned law as a result, its evidence, and its comparison with effects of the catalogue."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.learned_law.terms import Scales, Term, selection_cost_beside
from identification.diagnosis.selection.evidence import schwarz_evidence
from identification.experiment.unit_check import readings_from_rest
from identification.inference.fit_result import FitResult


@dataclass(frozen=True, eq=False)
class LearnedLaw:
    """A learned law.

    before, fitted: fits to the training part without and with it. terms: of the library. scales: see `law_scales`.
    inner_gap_before, inner_gap_after: gaps of the inner prediction without and with it (see `inner_validation`).
    """

    before: FitResult
    fitted: FitResult
    terms: tuple[Term, ...]
    scales: Scales
    inner_gap_before: float
    inner_gap_after: float

    @property
    def log_evidence(self) -> float:
        """Log evidence over the model without the law."""
        return self.evidence(*self.fitted.effective_sample)

    def evidence(self, inflation: float, effective: float) -> float:
        """The same for a given inflation of χ² and effective number of readings.

        It subtracts what the choice of the terms from the library costs.
        """
        more = len(self.fitted.point) - len(self.before.point)
        gained = schwarz_evidence(self.before.chi2 - self.fitted.chi2, more, inflation, effective)
        return gained - selection_cost_beside(self.before, len(self.terms))

    def is_better_than(self, other: LearnedLaw) -> bool:
        """Whether this law has more evidence; the residuals of the one with less χ² give the inflation of both."""
        coloured = min((self, other), key=lambda law: law.fitted.chi2).fitted.effective_sample
        return self.evidence(*coloured) > other.evidence(*coloured)


def law_scales(fitted: FitResult) -> Scales:
    """Scales of the library's variables.

    angle [rad]: of the largest swing that was fitted. speed [m/s]: of a pendulum with that amplitude. frequency [Hz]:
    of the swing, until a periodic force has another.
    """
    largest = 0.0
    for run, rows in zip(fitted.experiment.runs, fitted.likelihood.rows, strict=True):
        if rows.any():
            unit = 1.0 if run.quantity == "theta" else fitted.cradle.length
            largest = max(largest, float(np.nanmax(np.abs(readings_from_rest(run, rows)))) / unit)
    return {"angle": largest, "speed": largest * math.sqrt(fitted.cradle.gravity * fitted.cradle.length),
            "frequency": 1.0 / fitted.cradle.period}  # fmt: skip
