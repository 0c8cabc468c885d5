"""Detection limits: how strong an absent effect can be unnoticed, and how far it would bias k_f, κ and b.

To first order a strength s changes the residuals r by S s, of which a refit leaves S⊥ s. The data then allow
s = −S⊥·r/|S⊥|² ± √c/|S⊥|, truncated at its bounds; c is the inflation of χ² by correlated residuals. The unknowns
compensate the strength by moving by −J⁺ S s.

Where first order fails, a profile of χ² over s replaces it. κ, for example, can compensate added mass over hundreds of
its standard deviations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from cradle_env.effects import Parameter
from cradle_env.threads import in_threads
from identification.diagnosis.selection.candidates import Candidate, with_effects
from identification.diagnosis.selection.fit_cache import PointCache, compute_uncached, fit_key
from identification.diagnosis.selection.score_test import (
    MIN_VISIBLE_SHARE,
    CandidateScore,
    Sensitivity,
    residual_change,
)
from identification.diagnosis.uncertainty.profile_likelihood import REFIT_EVALUATIONS, find_profile_end
from identification.inference import impact_order_noise
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.least_squares import bounds, cost, has_impact_order, refine
from identification.inference.likelihood import Likelihood
from identification.inference.linear_algebra import on_one_thread
from identification.inference.nonsmooth import column_norms, descend

#: Probability that the true strength is below its limit.
_CONFIDENCE = 0.95
#: Secant rounds in which the limit of a strength with a nonlinear effect converges.
_SECANT_ROUNDS = 4
#: χ² over the inflation by which readings at the limit may depart from first order, or jump, and need no refits: less
#: than one standard deviation.
_MAX_NONLINEAR_CHI2 = 0.5
#: Standard deviations at which a profile ends: beyond them its probability is 0.1 %.
_PROFILE_END_SD = 3.0
#: Strengths at which the probability of a profile is summed.
_PROFILE_POINTS = 2001
#: Rounds of the nonsmooth descent in each refit. One is enough: the next strength continues where the last one ended.
_DESCENT_ROUNDS = 1


@dataclass(frozen=True)
class DetectionLimit:
    """How strong an absent effect can be.

    parameter: its strength. shared: whether all bobs or gaps have the same value. limit: 95 % limit of the strength, a
    lower one if the effect is absent at infinity; None if the data do not constrain it. shifts_sd: bias of k_f, κ and b
    at the limit, in their standard deviations.
    """

    effect: str
    shared: bool
    parameter: Parameter
    limit: float | None
    shifts_sd: dict[str, float]

    def content(self) -> dict[str, object]:
        """The entry of diagnosis.json."""
        kind = "least" if math.isinf(self.parameter.absent) else "most"
        return {
            "effect": self.effect, "alike": self.shared, "parameter": self.parameter.key, "unit": self.parameter.unit,
            kind: self.limit, "moves_sd": self.shifts_sd,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class _LinearLimit:
    """The detection limit of one shape of a candidate, to first order.

    low, high: bounds of the strength. limit: of the strength; None if the data do not constrain it. All three in scales
    of the parameter. S (R + P,), slope (D,): change of the residuals, and of the refitted point, per scale.
    """

    candidate: Candidate
    sensitivity: Sensitivity
    parameter: Parameter
    low: float
    high: float
    limit: float | None
    S: np.ndarray
    slope: np.ndarray


@on_one_thread
def compute_detection_limits(
    fitted: FitResult, scores: Sequence[CandidateScore], cache: PointCache = compute_uncached
) -> tuple[DetectionLimit, ...]:
    """Detection limits of all absent effects that have one strength, the largest bias first.

    Of an effect with shape parameters, the limit is that of the shape with the largest bias to first order. cache: of
    the limits that need refits.
    """
    shapes = []
    for own in scores:
        strengths = own.candidate.declaration.strengths
        if len(strengths) == 1:
            single = (sensitivity for sensitivity in own.sensitivities if sensitivity.S.shape[1] == 1)
            shapes += [(own.candidate, sensitivity, strengths[0]) for sensitivity in single]
    sd = np.sqrt(np.diag(fitted.covariance))
    workers, largest = fitted.likelihood.workers, {}
    for one in in_threads(lambda shape: _linear_limit(fitted, *shape), shapes, workers):
        known = largest.get(one.candidate, one)
        largest[one.candidate] = max(
            known, one, key=lambda one: _largest_shift(_detection_limit(fitted, sd, one, _linear_shift(one)))
        )
    limits = in_threads(lambda one: _find_detection_limit(fitted, sd, one, cache), list(largest.values()), workers)
    return tuple(sorted(limits, key=_largest_shift, reverse=True))


def _largest_shift(one: DetectionLimit) -> float:
    return max(map(abs, one.shifts_sd.values()), default=math.inf)


def _linear_shift(one: _LinearLimit) -> np.ndarray:
    """The limit [scales] and the shift of the point there, (1 + D,); (0,) if there is no limit."""
    return np.array([]) if one.limit is None else one.limit * np.array([1.0, *one.slope])


def _detection_limit(fitted: FitResult, sd: np.ndarray, one: _LinearLimit, reached: np.ndarray) -> DetectionLimit:
    """The limit as it is reported. sd (D,): of the point. reached: as `_linear_shift` returns it."""
    candidate, parameter = one.candidate, one.parameter
    if not len(reached):
        return DetectionLimit(candidate.name, candidate.shared, parameter, None, {})
    limit, *shift = map(float, reached)
    shifts = {
        name: float(shift[i] / sd[i])
        for i, name in enumerate(fitted.likelihood.names) if name in ("k_f", "kappa", "b")
    }  # fmt: skip
    return DetectionLimit(candidate.name, candidate.shared, parameter, parameter.at_strength(limit), shifts)


def _linear_limit(
    fitted: FitResult, candidate: Candidate, sensitivity: Sensitivity, parameter: Parameter
) -> _LinearLimit:
    """The detection limit of one shape of a candidate, to first order."""
    if math.isinf(parameter.absent):
        low, high = 0.0, parameter.scale / parameter.low if parameter.low > 0.0 else math.inf
    else:
        low, high = sorted((bound - parameter.absent) / parameter.scale for bound in (parameter.low, parameter.high))
    limit, S = _strength_limit(fitted, candidate, sensitivity, low, high)
    return _LinearLimit(candidate, sensitivity, parameter, low, high, limit, S, _compensating_step(fitted, S))


def _find_detection_limit(fitted: FitResult, sd: np.ndarray, one: _LinearLimit, cache: PointCache) -> DetectionLimit:
    """The detection limit of one effect."""
    what = one.candidate.label, one.limit, one.slope.tolist()
    key = fit_key("limit", fitted.experiment, fitted.point.tolist(), *what)
    return _detection_limit(fitted, sd, one, cache(key, lambda: _follow_where_nonlinear(fitted, one)))


def _follow_where_nonlinear(fitted: FitResult, one: _LinearLimit) -> np.ndarray:
    """The limit as `_linear_shift` returns it; by a profile where first order fails."""
    if one.limit is None or (rounds := _nonsmooth_rounds(fitted, one, one.limit)) is None:
        return _linear_shift(one)
    return _follow_profile(fitted, one, rounds)


def _strength_limit(
    fitted: FitResult, candidate: Candidate, sensitivity: Sensitivity, low: float, high: float
) -> tuple[float | None, np.ndarray]:
    """(limit of the strength [scales], change of the residuals per scale there (R + P,)), to first order.

    The limit is None if the data do not constrain the effect within its bounds.
    """
    from scipy.stats import truncnorm

    S, limit, inflation = sensitivity.S[:, 0], math.nan, fitted.effective_sample.inflation
    for _ in range(_SECANT_ROUNDS):  # secants, for an effect that grows as a square, such as blur
        remaining = fitted.project(S)
        size = float(remaining @ remaining)
        if size <= MIN_VISIBLE_SHARE**2 * float(S @ S) or inflation > size * max(abs(low), high) ** 2:
            return None, S
        best, sd = min(max(-float(remaining @ fitted.residuals) / size, low), high), math.sqrt(inflation / size)
        new = float(
            max(truncnorm.ppf(_tail_probabilities(low), (low - best) / sd, (high - best) / sd, best, sd), key=abs)
        )
        limit = new if math.isnan(limit) or new * limit <= 0.0 else math.copysign(math.sqrt(new * limit), new)
        try:
            S = residual_change(fitted, candidate, sensitivity.values(np.array([limit]))) / limit
        except ImpossibleModelError:  # the cradle cannot swing with so strong an effect
            break
    return limit, S


def _compensating_step(fitted: FitResult, S: np.ndarray) -> np.ndarray:
    """−J⁺ S, (D,): the step of the unknowns that compensates a change S of the residuals."""
    lengths = column_norms(fitted.jacobian)
    return -np.linalg.lstsq(fitted.jacobian / lengths, S)[0] / lengths


def _likelihood_at(fitted: FitResult, one: _LinearLimit, s: float) -> Likelihood:
    """The conditional likelihood of the model with an effect of strength s [scales]."""
    model = with_effects(fitted.experiment, {one.candidate.name: one.sensitivity.values(np.array([s]))}, ())
    return Likelihood(model, fitted.likelihood.rows, fitted.likelihood.workers)


def _nonsmooth_rounds(fitted: FitResult, one: _LinearLimit, limit: float) -> int | None:
    """Rounds of the nonsmooth descent that refits at the limit need; None if first order holds and none are needed.

    First order holds if the residuals at the limit, with the unknowns shifted to compensate, are those predicted.
    Rounds are needed where readings jump with the order of impacts, with three bobs or more.
    """
    several = has_impact_order(fitted.cradle)
    most = _MAX_NONLINEAR_CHI2 * fitted.effective_sample.inflation
    try:
        likelihood = _likelihood_at(fitted, one, limit)
        point = np.clip(fitted.point + limit * one.slope, *bounds(likelihood))
        departure = likelihood.residuals(point) - (fitted.residuals + limit * fitted.project(one.S))
    except ImpossibleModelError:  # the cradle cannot swing at the predicted point
        return _DESCENT_ROUNDS if several else 0
    if float(departure @ departure) <= most:
        return None
    jump = (
        several
        and impact_order_noise.impact_order_chi2(likelihood, point, fitted.jacobian, fitted.laplace_covariance) > most
    )
    return _DESCENT_ROUNDS if jump else 0


def _follow_profile(fitted: FitResult, one: _LinearLimit, rounds: int) -> np.ndarray:
    """The limit [scales] by the profile of χ², and the shift of the point there, (1 + D,).

    Returns (0,) if the data do not constrain the strength within its bounds. rounds: of the nonsmooth descent in each
    refit.
    """
    inflation = fitted.effective_sample.inflation
    sd = math.sqrt(inflation) / float(np.linalg.norm(fitted.project(one.S)))
    profile = {0.0: (fitted.chi2, fitted.point)}

    def refit(s: float, start: np.ndarray) -> tuple[np.ndarray, float]:
        likelihood = _likelihood_at(fitted, one, s)
        point, chi2 = refine(likelihood, start, REFIT_EVALUATIONS, jacobian=fitted.jacobian)
        if math.isfinite(chi2):
            polished = descend(likelihood, point, rounds, widths=fitted.widths)
            if not np.array_equal(polished, point):
                point, chi2 = polished, cost(likelihood, polished)
            profile[s] = chi2, point
        return point, math.sqrt((chi2 - min(chi2 for chi2, _ in profile.values())) / inflation)

    for bound in (bound for bound in (one.low, one.high) if bound != 0.0):
        if fitted.chi2 - min(chi2 for chi2, _ in profile.values()) > _PROFILE_END_SD**2 * inflation:
            continue  # the other side fits better by more than the end of a profile
        step = math.copysign(sd, bound)
        u, point = find_profile_end(
            lambda u, start, step=step: refit(u * step, start),
            fitted.point, step * one.slope, abs(bound) / sd, _PROFILE_END_SD,
        )  # fmt: skip
        if u >= abs(bound) / sd and refit(bound, point)[1] < 1.0:
            return np.array([])
    strengths = sorted(profile)
    chi2 = PchipInterpolator(strengths, [profile[s][0] for s in strengths])
    grid = np.linspace(strengths[0], strengths[-1], _PROFILE_POINTS)
    density = np.exp(-0.5 * (chi2(grid) - chi2(grid).min()) / inflation)
    limit = float(max(np.interp(_tail_probabilities(one.low), np.cumsum(density) / density.sum(), grid), key=abs))
    points = np.array([profile[s][1] for s in strengths])
    shift = np.array([np.interp(limit, strengths, column) for column in points.T]) - fitted.point
    return np.array([limit, *shift])


def _tail_probabilities(low: float) -> tuple[float, ...]:
    """Quantiles that bound the strength: two, or the upper one if the strength is not negative (low = 0)."""
    return (_CONFIDENCE,) if low == 0.0 else (0.5 * (1.0 - _CONFIDENCE), 0.5 * (1.0 + _CONFIDENCE))
