"""Log evidence of a model by Laplace's approximation, tempered by the effective sample size, with explicit priors.

ln Z = −χ²/(2c) + ln π + ½ gᵀH⁻¹g + (D/2) ln 2π − ½ ln det H + Σ ln Φ,  H = JᵀJ/c + curvature of −ln π,

at the maximum of exp(−χ²/2) π, where the logarithm of exp(−χ²/2c) π has the gradient g. Φ is the share of the normal
distribution in which a strength that cannot be negative is positive. c is the inflation that correlated or excessive
residuals of a *reference* model ask for; it divides χ² of the readings, not that of stated priors. Models are compared
under one and the same c. Source: Gelman et al., BDA3, 13.3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr, logsumexp

from identification.diagnosis.criteria import EARLY_PRIORS, SHAPE_SD
from identification.diagnosis.selection.candidates import parameter_of
from identification.diagnosis.selection.score_test import CandidateScore
from identification.inference.fit_result import FitResult
from identification.inference.least_squares import difference_jacobian, has_impact_order, refine
from identification.inference.likelihood import Likelihood
from identification.inference.unknowns import Unknown

#: Least eigenvalue of the scaled Hessian that counts: less is rounding of finite differences.
_LEAST_EIGENVALUE = 1e-9
#: Change of the readings [noise] below which a strength is as good as none.
_EDGE = 0.01
#: What priors must add to ln Z by the parabola about the minimum of χ² for their own maximum to be looked for.
_NOTABLE_PULL = 0.1
#: Evaluations of this search, which begins near.
_EVALUATIONS = 10


class PriorTerms(NamedTuple):
    """ln density of a prior at a coordinate, its derivative, and the curvature of its negative.

    below: how far ln density is below its maximum. room: how far the coordinate is above the least one allowed;
    infinite if nothing bounds it.
    """

    log_density: float
    slope: float = 0.0
    curvature: float = 0.0
    below: float = 0.0
    room: float = math.inf

    @property
    def residual(self) -> float:
        """Half its square is `below`."""
        return math.copysign(math.sqrt(2.0 * max(self.below, 0.0)), -self.slope)


class _Posterior:
    """The residuals of a likelihood, then those of its priors: half their sum of squares is −ln of the posterior."""

    def __init__(self, likelihood: Likelihood):
        self.experiment, self.unknowns, self.workers = likelihood.experiment, likelihood.unknowns, likelihood.workers
        self._likelihood = likelihood

    def residuals(self, point: np.ndarray) -> np.ndarray:
        """Residuals (R + P + D,) at a point (D,)."""
        return np.concatenate([self._likelihood.residuals(point), [p.residual for p in _priors(self.unknowns, point)]])


@dataclass(frozen=True, eq=False)
class LaplaceTerms:
    """What the evidence of a model needs, at the maximum of the posterior.

    point (D,): of the maximum. chi2, gradient (D,), information (D, D): χ² of the readings, half its derivatives, and
    its Fisher information. stated: the same of the stated normal priors. priors: of each unknown, what is not stated.
    """

    point: np.ndarray
    chi2: float
    gradient: np.ndarray
    information: np.ndarray
    stated: tuple[float, np.ndarray, np.ndarray]
    priors: tuple[PriorTerms, ...]

    @classmethod
    def of(cls, fitted: FitResult) -> LaplaceTerms:
        """Those of a fit to χ² alone."""
        terms = cls._at(fitted, balanced=False)
        if terms._pull() < _NOTABLE_PULL:
            return terms
        point = refine(_Posterior(fitted.likelihood), fitted.point, _EVALUATIONS)[0]
        return cls._at(FitResult(fitted.likelihood, point), balanced=True)

    @classmethod
    def _at(cls, fitted: FitResult, balanced: bool) -> LaplaceTerms:
        """balanced: whether the readings pull as hard as all priors, and not as the stated ones alone."""
        r, R, priors = fitted.residuals, fitted.count, _priors(fitted.likelihood.unknowns, fitted.point)
        # Where readings jump, derivatives over narrow differences depend on where the jumps happen to be.
        narrow = not has_impact_order(fitted.cradle)
        J = difference_jacobian(fitted.likelihood, fitted.point, r) if narrow else fitted.jacobian
        stated = float(r[R:] @ r[R:]), J[R:].T @ r[R:], J[R:].T @ J[R:]
        slopes, room = (np.array([getattr(prior, key) for prior in priors]) for key in ("slope", "room"))
        with np.errstate(invalid="ignore"):  # no room in a strength that no reading depends on
            is_at_edge = room * np.linalg.norm(J, axis=0) < _EDGE
        gradient = np.where(is_at_edge, J[:R].T @ r[:R], (slopes if balanced else 0.0) - stated[1])
        return cls(fitted.point, float(r[:R] @ r[:R]), gradient, J[:R].T @ J[:R], stated, priors)

    @property
    def all_information(self) -> np.ndarray:
        """Fisher information (D, D) of the readings and the stated priors."""
        return self.information + self.stated[2]

    def _pull(self) -> float:
        """What the priors that are not stated add to ln Z by the parabola about a minimum of χ²."""
        H = self.all_information + np.diag([prior.curvature for prior in self.priors])
        g = np.array([prior.slope for prior in self.priors])
        return 0.5 * float(g @ np.linalg.lstsq(H, g)[0])

    def log_evidence(self, inflation: float) -> float:
        """ln Z up to a constant that all models share; inflation c: of χ²."""
        chi2, gradient, information = self.stated
        return _log_integral(
            -0.5 * (self.chi2 / inflation + chi2), -self.gradient / inflation - gradient,
            self.information / inflation + information, self.priors,
        )  # fmt: skip


def _priors(unknowns: Sequence[Unknown], point: np.ndarray) -> tuple[PriorTerms, ...]:
    return tuple(log_prior(u, float(z)) for u, z in zip(unknowns, point, strict=True))


def _log_integral(
    height: float, gradient: np.ndarray, information: np.ndarray, priors: tuple[PriorTerms, ...]
) -> float:
    """ln of the integral of exp(height + gradientᵀδ − ½ δᵀ information δ) times the priors over steps δ (D,)."""
    g = gradient + [prior.slope for prior in priors]
    H = information + np.diag([prior.curvature for prior in priors])
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    values, vectors = np.linalg.eigh(H / np.outer(scale, scale))
    values, vectors = np.maximum(values, _LEAST_EIGENVALUE), vectors / scale[:, None]
    along = vectors.T @ g
    step, sd = vectors @ (along / values), np.sqrt(np.sum(vectors**2 / values, axis=1))
    log_det = 2.0 * float(np.sum(np.log(scale))) + float(np.sum(np.log(values)))
    inside = float(np.sum(log_ndtr(([prior.room for prior in priors] + step) / sd)))
    height += sum(prior.log_density for prior in priors) + 0.5 * float(np.sum(along**2 / values))
    return height + 0.5 * len(g) * math.log(2.0 * math.pi) - 0.5 * log_det + inside


def linear_log_odds(fitted: FitResult, score: CandidateScore, inflation: float) -> float:
    """ln evidence of a fit with a candidate over that without, to first order in its strengths.

    The mean over the shapes of the candidate. Strengths have the priors of `log_prior`.
    """
    found = []
    one_sided = all(p.one_sided for p in score.candidate.declaration.strengths)
    for sensitivity in score.sensitivities:
        S = fitted.project(sensitivity.S)
        free = np.linalg.lstsq(S, -fitted.residuals)[0]
        x, information = np.maximum(free, 0.0) if one_sided else free, S.T @ S / inflation
        gain = float(np.sum(fitted.residuals**2) - np.sum((fitted.residuals + S @ x) ** 2))
        priors = tuple(_cauchy(float(value), 1.0, one_sided) for value in x)
        found.append(_log_integral(0.5 * gain / inflation, information @ (free - x), information, priors))
    return float(logsumexp(found)) - math.log(len(found))


def schwarz_evidence(gain: float, unknowns: int, inflation: float, effective: float) -> float:
    """½ (Δχ²/c − k ln n_eff): log evidence of k more unknowns without declared priors that gain Δχ².

    inflation c, effective n_eff: of the better model. Source: Schwarz, Ann. Stat. 6, 461 (1978).
    """
    return 0.5 * (gain / inflation - unknowns * math.log(effective))


def log_prior(u: Unknown, coordinate: float) -> PriorTerms:
    """The prior of an unknown in its sampled coordinate, there.

    That of a stated normal prior lacks what is among the residuals. A prior that all models share cancels, and is 0.
    """
    if not math.isnan(u.sd):
        return PriorTerms(-math.log(u.sd * math.sqrt(2.0 * math.pi)))
    if has_early_prior(u):
        return _normal(coordinate - u.coordinate(u.start), EARLY_PRIORS[u.name])
    if "." not in u.name or "@" in u.name:
        return PriorTerms(0.0)
    p = parameter_of(u.name)
    if p.log and not u.log:  # a stated uniform prior
        return PriorTerms(0.0)
    if math.isinf(p.absent):
        return _inverse_cauchy(p.scale / float(u.value(coordinate)))
    if p.is_strength:
        return _cauchy((coordinate - p.absent) / p.scale, 1.0 / p.scale, p.one_sided)
    if u.log:
        return _normal(coordinate - math.log(p.scale), SHAPE_SD)
    return _cauchy(coordinate / p.scale, 1.0 / p.scale, one_sided=p.low >= 0.0)


def has_early_prior(u: Unknown) -> bool:
    """Whether an unknown has one of EARLY_PRIORS, which are of logarithms: those without a stated prior."""
    return u.name in EARLY_PRIORS and u.log


def _normal(distance: float, sd: float) -> PriorTerms:
    below = 0.5 * (distance / sd) ** 2
    return PriorTerms(-below - math.log(sd * math.sqrt(2.0 * math.pi)), -distance / sd**2, 1.0 / sd**2, below)


def _cauchy(x: float, rate: float, one_sided: bool) -> PriorTerms:
    """A Cauchy density in x, half-Cauchy from 0 if one-sided, as that of a coordinate with dx/dcoordinate = rate.

    The curvature is that of the even parabola above −ln π that touches it at x, for −ln π itself is concave where
    |x| > 1.
    """
    peak, below = math.log((2.0 if one_sided else 1.0) * rate / math.pi), math.log1p(x**2)
    weight, room = 2.0 / (1.0 + x**2), x / rate if one_sided else math.inf
    return PriorTerms(peak - below, -weight * x * rate, weight * rate**2, below, room)


def _inverse_cauchy(x: float) -> PriorTerms:
    """A half-Cauchy density in x, as that of the coordinate −ln x."""
    below = math.log((1.0 + x**2) / (2.0 * x))
    return PriorTerms(-below - math.log(math.pi), (x**2 - 1.0) / (1.0 + x**2), 4.0 * x**2 / (1.0 + x**2) ** 2, below)
