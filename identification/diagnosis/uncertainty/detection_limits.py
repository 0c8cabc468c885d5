"""What data cannot exclude: how strong an absent effect may yet be, and how far off k_f, κ and b would then be.

A strength s changes the residuals r by S s, of which a refit leaves S⊥ s. Data that show nothing of it
leave s = −S⊥·r/|S⊥|² ± √c/|S⊥|, cut at its bounds (c: see `decide`); and with s the unknowns move by
−J⁺ S s, to first order. Where the readings there are others than that, as κ makes up for added mass over hundreds of
its standard deviations, refits follow to where the data do exclude s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.stats import truncnorm

from cradle_env.effects import Parameter
from cradle_env.threads import in_threads
from identification.diagnosis.selection.candidates import Candidate, with_effects
from identification.diagnosis.selection.score_test import (
    MIN_VISIBLE_SHARE,
    CandidateScore,
    Sensitivity,
    residual_change,
)
from identification.diagnosis.selection.search import PointCache, compute_uncached, fit_key
from identification.diagnosis.uncertainty.profile_likelihood import REFIT_EVALUATIONS, find_profile_end
from identification.inference import impact_order_noise
from identification.inference.fit_result import Fitted
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.least_squares import SEVERAL, bounds, cost, refine
from identification.inference.likelihood import Likelihood
from identification.inference.linear_algebra import on_one_thread
from identification.inference.nonsmooth import lengths_of, polish

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
    """An effect that data may hide: the parameter that is its strength, 95 % limit on that (a least value where the
    effect is absent at infinity; None where the data see nothing of it), and by how many of their standard deviations
    the unknowns would move there."""

    effect: str
    shared: bool
    parameter: Parameter
    limit: float | None
    shifts_sd: dict[str, float]

    def content(self) -> dict[str, object]:
        """As diagnosis.json has it."""
        kind = "least" if math.isinf(self.parameter.absent) else "most"
        return {
            "effect": self.effect, "alike": self.shared, "parameter": self.parameter.key, "unit": self.parameter.unit,
            kind: self.limit, "moves_sd": self.shifts_sd,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class _LinearLimit:
    """What data may hide of a shape of a candidate, to first order: its strength between bounds [scales], None where
    they see nothing of it; the change of the residuals by each scale there, (R + P,), and how the point moves, (D,)."""

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
    fitted: Fitted, scores: Sequence[CandidateScore], cache: PointCache = compute_uncached
) -> tuple[DetectionLimit, ...]:
    """Of each absent effect with one strength, how much data may hide, in that of its shapes of which they may to first
    order hide what moves unknowns most; what would move unknowns most comes first. keep: of limits."""
    several = []
    for own in scores:
        strengths = own.candidate.declaration.strengths
        if len(strengths) == 1:
            single = (sensitivity for sensitivity in own.sensitivities if sensitivity.S.shape[1] == 1)
            several += [(own.candidate, sensitivity, strengths[0]) for sensitivity in single]
    sd = np.sqrt(np.diag(fitted.covariance))
    workers, farthest = fitted.likelihood.workers, {}
    for one in in_threads(lambda shape: _linear_limit(fitted, *shape), several, workers):
        known = farthest.get(one.candidate, one)
        farthest[one.candidate] = max(
            known, one, key=lambda one: _largest_shift(_detection_limit(fitted, sd, one, _linear_shift(one)))
        )
    found = in_threads(lambda one: _find_detection_limit(fitted, sd, one, cache), list(farthest.values()), workers)
    return tuple(sorted(found, key=_largest_shift, reverse=True))


def _largest_shift(one: DetectionLimit) -> float:
    return max(map(abs, one.shifts_sd.values()), default=math.inf)


def _linear_shift(one: _LinearLimit) -> np.ndarray:
    """The limit [scales] and how far the point moves there, (1 + D,); (0,) where there is none."""
    return np.array([]) if one.limit is None else one.limit * np.array([1.0, *one.slope])


def _detection_limit(fitted: Fitted, sd: np.ndarray, one: _LinearLimit, reached: np.ndarray) -> DetectionLimit:
    """As it is reported. sd (D,): the point's standard deviations; reached: as `_to_first_order` has it."""
    candidate, parameter = one.candidate, one.parameter
    if not len(reached):
        return DetectionLimit(candidate.name, candidate.shared, parameter, None, {})
    limit, *moved = map(float, reached)
    moves = {
        name: float(moved[i] / sd[i])
        for i, name in enumerate(fitted.likelihood.names) if name in ("k_f", "kappa", "b")
    }  # fmt: skip
    return DetectionLimit(candidate.name, candidate.shared, parameter, parameter.at_strength(limit), moves)


def _linear_limit(fitted: Fitted, candidate: Candidate, sensitivity: Sensitivity, parameter: Parameter) -> _LinearLimit:
    """What data may hide of a shape of a candidate, to first order."""
    if math.isinf(parameter.absent):
        low, high = 0.0, parameter.scale / parameter.low if parameter.low > 0.0 else math.inf
    else:
        low, high = sorted((bound - parameter.absent) / parameter.scale for bound in (parameter.low, parameter.high))
    limit, S = _strength_limit(fitted, candidate, sensitivity, low, high)
    return _LinearLimit(candidate, sensitivity, parameter, low, high, limit, S, _compensating_step(fitted, S))


def _find_detection_limit(fitted: Fitted, sd: np.ndarray, one: _LinearLimit, cache: PointCache) -> DetectionLimit:
    """How much of an effect the data may hide."""
    what = one.candidate.label, one.limit, one.slope.tolist()
    key = fit_key("limit", fitted.experiment, fitted.point.tolist(), *what)
    return _detection_limit(fitted, sd, one, cache(key, lambda: _follow_where_nonlinear(fitted, one)))


def _follow_where_nonlinear(fitted: Fitted, one: _LinearLimit) -> np.ndarray:
    """As `_to_first_order` has it, followed by refits where that is not as foretold."""
    if one.limit is None or (rounds := _nonsmooth_rounds(fitted, one, one.limit)) is None:
        return _linear_shift(one)
    return _follow_profile(fitted, one, rounds)


def _strength_limit(
    fitted: Fitted, candidate: Candidate, sensitivity: Sensitivity, low: float, high: float
) -> tuple[float | None, np.ndarray]:
    """The strength [scales] between its bounds that is as far from none as the data allow, and the change of the
    residuals there by each scale, (R + P,), to first order; None where the data do not see the effect, or not within
    its bounds."""
    S, limit, inflation = sensitivity.S[:, 0], math.nan, fitted.coloured[0]
    for _ in range(_SECANT_ROUNDS):  # what grows as a square, such as a blur, is followed by secants to where it ends
        left = fitted.project(S)
        size = float(left @ left)
        if size <= MIN_VISIBLE_SHARE**2 * float(S @ S) or inflation > size * max(abs(low), high) ** 2:
            return None, S
        best, sd = min(max(-float(left @ fitted.residuals) / size, low), high), math.sqrt(inflation / size)
        found = float(
            max(truncnorm.ppf(_tail_probabilities(low), (low - best) / sd, (high - best) / sd, best, sd), key=abs)
        )
        limit = found if math.isnan(limit) or found * limit <= 0.0 else math.copysign(math.sqrt(found * limit), found)
        try:
            S = residual_change(fitted, candidate, sensitivity.values(np.array([limit]))) / limit
        except ImpossibleModelError:  # too strong for this cradle to swing
            break
    return limit, S


def _compensating_step(fitted: Fitted, S: np.ndarray) -> np.ndarray:
    """−J⁺ S, (D,)."""
    lengths = lengths_of(fitted.jacobian)
    return -np.linalg.lstsq(fitted.jacobian / lengths, S)[0] / lengths


def _likelihood_at(fitted: Fitted, one: _LinearLimit, s: float) -> Likelihood:
    """The likelihood of the model with an effect of strength s [scales]."""
    model = with_effects(fitted.experiment, {one.candidate.name: one.sensitivity.values(np.array([s]))}, ())
    return Likelihood(model, fitted.likelihood.rows, 1)


def _nonsmooth_rounds(fitted: Fitted, one: _LinearLimit, limit: float) -> int | None:
    """Rounds over a rough misfit of each refit that follows an effect to its limit: some where readings jump there, of
    three bobs and more alone. None where none is needed, for the readings there, the unknowns moved to where they make
    up for it to first order, are what they are to first order."""
    several, most = fitted.cradle.bobs >= SEVERAL, _MAX_NONLINEAR_CHI2 * fitted.coloured[0]
    try:
        held = _likelihood_at(fitted, one, limit)
        point = np.clip(fitted.point + limit * one.slope, *bounds(held))
        off = held.residuals(point) - (fitted.residuals + limit * fitted.project(one.S))
    except ImpossibleModelError:  # the cradle cannot swing where first order leads
        return _DESCENT_ROUNDS if several else 0
    if float(off @ off) <= most:
        return None
    jump = several and impact_order_noise.size(held, point, fitted.jacobian, fitted.smooth) > most
    return _DESCENT_ROUNDS if jump else 0


def _follow_profile(fitted: Fitted, one: _LinearLimit, rounds: int) -> np.ndarray:
    """The strength [scales] between its bounds that is as far from none as the data allow, by the profile of χ², and
    how far the point moves there, (1 + D,); (0,) where the data hardly exclude what is beyond its bounds. rounds: over
    a rough misfit, of each refit."""
    inflation = fitted.coloured[0]
    sd = math.sqrt(inflation) / float(np.linalg.norm(fitted.project(one.S)))
    visited = {0.0: (fitted.chi2, fitted.point)}

    def refit(s: float, start: np.ndarray) -> tuple[np.ndarray, float]:
        held = _likelihood_at(fitted, one, s)
        point, chi2 = refine(held, start, REFIT_EVALUATIONS)
        if math.isfinite(chi2):
            polished = polish(held, point, rounds, widths=fitted.widths)
            if not np.array_equal(polished, point):
                point, chi2 = polished, cost(held, polished)
            visited[s] = chi2, point
        return point, math.sqrt((chi2 - min(chi2 for chi2, _ in visited.values())) / inflation)

    for bound in (bound for bound in (one.low, one.high) if bound != 0.0):
        if fitted.chi2 - min(chi2 for chi2, _ in visited.values()) > _PROFILE_END_SD**2 * inflation:
            continue  # beyond the end already: the other side holds better
        step = math.copysign(sd, bound)
        u, point = find_profile_end(
            lambda u, start, step=step: refit(u * step, start),
            fitted.point, step * one.slope, abs(bound) / sd, _PROFILE_END_SD,
        )  # fmt: skip
        if u >= abs(bound) / sd and refit(bound, point)[1] < 1.0:
            return np.array([])
    several = sorted(visited)
    chi2 = PchipInterpolator(several, [visited[s][0] for s in several])
    grid = np.linspace(several[0], several[-1], _PROFILE_POINTS)
    density = np.exp(-0.5 * (chi2(grid) - chi2(grid).min()) / inflation)
    limit = float(max(np.interp(_tail_probabilities(one.low), np.cumsum(density) / density.sum(), grid), key=abs))
    points = np.array([visited[s][1] for s in several])
    moved = np.array([np.interp(limit, several, column) for column in points.T]) - fitted.point
    return np.array([limit, *moved])


def _tail_probabilities(low: float) -> tuple[float, ...]:
    """The probabilities between which the true strength is, or below which; low: its lower bound."""
    return (_CONFIDENCE,) if low == 0.0 else (0.5 * (1.0 - _CONFIDENCE), 0.5 * (1.0 + _CONFIDENCE))
