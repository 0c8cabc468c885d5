"""A model under scrutiny: where its residuals are more than noise, and what each absent effect would do to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.diagnosis.criteria import DEFAULT_CRITERIA, REPLICATES, Criteria
from identification.diagnosis.residuals.residual_tests import ResidualScan, scan_residuals
from identification.diagnosis.selection.score_test import ScoreTest, score
from identification.inference.fit_result import FitResult


@dataclass(frozen=True, eq=False)
class ExaminedModel:
    """A fit, the scan of its residuals, the scores of what may be missing, and the criteria of the diagnosis."""

    fitted: FitResult
    residual_scan: ResidualScan
    score_test: ScoreTest
    criteria: Criteria

    @property
    def p(self) -> float:
        """Probability that noise alone leaves residuals as structured as these."""
        return self.residual_scan.p

    @property
    def significant(self) -> bool:
        """Whether the model leaves more than noise, by the verdict's test (see `only_noise` for the quick one)."""
        return self.p < self.criteria.significance_level


def examine(
    fitted: FitResult, seed: int, estimated: tuple[bool, ...], criteria: Criteria = DEFAULT_CRITERIA
) -> ExaminedModel:
    """Scans the residuals and scores the candidates, against the same replicates.

    estimated: of each run, whether its noise was.
    """
    replicates = fitted.replicates(REPLICATES, np.random.default_rng(seed), estimated)
    return ExaminedModel(fitted, scan_residuals(fitted, replicates), score(fitted, replicates), criteria)
