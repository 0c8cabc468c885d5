"""Log evidence of a model by Laplace's approximation, tempered by the effective sample size, with explicit priors.

ln Z = −χ²/(2c) + ln π(mode) + (D/2) ln 2π − ½ ln det H,  H = JᵀJ/c + curvature of −ln π,

where c is the inflation that correlated or excessive residuals of a *reference* model ask for (Gelman et al., BDA3,
13.3, for the approximation). Models are compared under one and the same c.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from cradle_env.effects.declaration import Parameter
from identification.diagnosis.criteria import EARLY_PRIORS, SHAPE_SD
from identification.diagnosis.selection.candidates import parameter_of
from identification.diagnosis.selection.score_test import CandidateScore
from identification.inference.fit_result import FitResult
from identification.inference.least_squares import difference_jacobian
from identification.inference.unknowns import Unknown

#: Least eigenvalue of the scaled Hessian that counts: less is rounding of finite differences.
_LEAST_EIGENVALUE = 1e-9


@dataclass(frozen=True, eq=False)
class LaplaceTerms:
    """What the evidence of a model needs: χ², the Fisher information (D, D) of the data, and of the priors at the mode
    their log density and the curvature (D,) of its negative."""

    chi2: float
    information: np.ndarray
    log_prior: float
    curvature: np.ndarray

    @classmethod
    def of(cls, fitted: FitResult) -> LaplaceTerms:
        """Those of a fit."""
        likelihood = fitted.likelihood
        J = difference_jacobian(likelihood, fitted.point, fitted.residuals)
        terms = [log_prior(u, float(z)) for u, z in zip(likelihood.unknowns, fitted.point, strict=True)]
        return cls(fitted.chi2, J.T @ J, sum(t[0] for t in terms), np.array([t[1] for t in terms]))

    def log_evidence(self, inflation: float) -> float:
        """ln Z up to a constant that all models share; inflation c: of χ²."""
        D = len(self.curvature)
        H = self.information / inflation + np.diag(self.curvature)
        scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
        values = np.linalg.eigvalsh(H / np.outer(scale, scale))
        log_det = 2.0 * float(np.sum(np.log(scale))) + float(np.sum(np.log(np.maximum(values, _LEAST_EIGENVALUE))))
        return -0.5 * self.chi2 / inflation + self.log_prior + 0.5 * D * math.log(2.0 * math.pi) - 0.5 * log_det


def linear_log_odds(fitted: FitResult, score: CandidateScore, inflation: float) -> float:
    """ln evidence of a fit with a candidate over that without, to first order in its strengths.

    The mean over the shapes of the candidate. Strengths have the priors of `log_prior`.
    """
    found = []
    one_sided = all(p.one_sided for p in score.candidate.declaration.strengths)
    for sensitivity in score.sensitivities:
        S = fitted.project(sensitivity.S)
        x = np.linalg.lstsq(S, -fitted.residuals)[0]
        x = np.maximum(x, 0.0) if one_sided else x
        gain = float(np.sum(fitted.residuals**2) - np.sum((fitted.residuals + S @ x) ** 2))
        terms = [_cauchy(float(value), 1.0, one_sided) for value in x]
        H = S.T @ S / inflation + np.diag([curvature for _, curvature in terms])
        log_det = float(np.linalg.slogdet(H)[1])
        prior = sum(density for density, _ in terms)
        found.append(0.5 * gain / inflation + prior + 0.5 * len(x) * math.log(2.0 * math.pi) - 0.5 * log_det)
    return float(logsumexp(found)) - math.log(len(found))


def schwarz_evidence(gain: float, unknowns: int, inflation: float, effective: float) -> float:
    """½ (Δχ²/c − k ln n_eff): log evidence of k more unknowns without declared priors that gain Δχ².

    inflation c, effective n_eff: of the better model. Source: Schwarz, Ann. Stat. 6, 461 (1978).
    """
    return 0.5 * (gain / inflation - unknowns * math.log(effective))


def log_prior(u: Unknown, coordinate: float) -> tuple[float, float]:
    """(log density of an unknown's prior in its sampled coordinate, curvature of its negative) there.

    A stated normal prior is already among the residuals, and what all models share cancels: both give (0, 0).
    """
    if not math.isnan(u.sd):
        return 0.0, 0.0
    if u.name in EARLY_PRIORS:
        return _normal(coordinate - u.coordinate(u.start), EARLY_PRIORS[u.name])
    if "." not in u.name or "@" in u.name:
        return 0.0, 0.0
    p = parameter_of(u.name)
    if p.is_strength:
        return _strength_prior(p, u, coordinate)
    if u.log:
        return _normal(coordinate - math.log(p.scale), SHAPE_SD)
    return _cauchy(coordinate / p.scale, 1.0 / p.scale, one_sided=p.low >= 0.0)


def _normal(distance: float, sd: float) -> tuple[float, float]:
    return -0.5 * (distance / sd) ** 2 - math.log(sd * math.sqrt(2.0 * math.pi)), 1.0 / sd**2


def _cauchy(x: float, slope: float, one_sided: bool) -> tuple[float, float]:
    """A Cauchy density in x, half-Cauchy if one-sided, as that of a coordinate with dx/dcoordinate = slope."""
    density = (2.0 if one_sided else 1.0) / (math.pi * (1.0 + x**2)) * abs(slope)
    return math.log(density), slope**2 / (1.0 + x**2)


def _strength_prior(p: Parameter, u: Unknown, coordinate: float) -> tuple[float, float]:
    """Cauchy in units of the declared scale about the value at which the effect is absent."""
    value = float(u.value(coordinate))
    if math.isinf(p.absent):  # the strength is the inverse of the parameter
        x = p.scale / value
        return _cauchy(x, x if u.log else x / value, one_sided=True)
    return _cauchy((value - p.absent) / p.scale, (value if u.log else 1.0) / p.scale, p.one_sided)
