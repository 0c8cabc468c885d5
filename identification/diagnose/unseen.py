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
from cradle_env.simulation import SimulationError, in_threads
from identification.diagnose.candidates import Candidate, is_strength, strength, with_effects
from identification.diagnose.fitted import Fitted
from identification.diagnose.profile import EVALUATIONS, profile_end
from identification.diagnose.score import LEAST_SEEN, Score, Sensed, change
from identification.fit import bounds, cost, refine
from identification.likelihood import Likelihood
from identification.linear_algebra import on_one_thread
from identification.rough import lengths_of, polish

#: Probability that the true strength is below its limit; rounds in which that is found.
_SURE, _ROUNDS = 0.95, 4
#: χ² over the inflation by which readings at a limit may differ from what they are to first order.
_BENT = 0.5
#: Profiles: standard deviations up to which they are followed, strengths at which their probability is summed.
_END, _GRID = 3.0, 2001


@dataclass(frozen=True)
class Unseen:
    """An effect that data may hide: the parameter that is its strength, 95 % limit on that (a least value where the
    effect is absent at infinity; None where the data see nothing of it), and by how many of their standard deviations
    the unknowns would move there."""

    effect: str
    alike: bool
    parameter: Parameter
    limit: float | None
    moves: dict[str, float]

    def content(self) -> dict[str, object]:
        """As diagnosis.json has it."""
        kind = "least" if math.isinf(self.parameter.absent) else "most"
        return {
            "effect": self.effect, "alike": self.alike, "parameter": self.parameter.key, "unit": self.parameter.unit,
            kind: self.limit, "moves_sd": self.moves,
        }  # fmt: skip


@on_one_thread
def unseen(fitted: Fitted, scores: Sequence[Score]) -> tuple[Unseen, ...]:
    """Of each absent effect with one strength, how much data may hide; what would move unknowns most comes first."""
    several = []
    for own in scores:
        strengths = [p for p in own.candidate.declaration.parameters if is_strength(p)]
        if len(strengths) == 1:
            single = (sensed for sensed in own.sensed if sensed.S.shape[1] == 1)
            several += [(own.candidate, sensed, strengths[0]) for sensed in single]
    found: dict[Candidate, Unseen] = {}
    sd = np.sqrt(np.diag(fitted.covariance))
    hidden: list[Unseen] = in_threads(lambda shape: _hidden(fitted, sd, *shape), several, fitted.likelihood.workers)
    for (candidate, *_), one in zip(several, hidden, strict=True):
        found[candidate] = max(found.get(candidate, one), one, key=_farthest)
    return tuple(sorted(found.values(), key=_farthest, reverse=True))


def _farthest(one: Unseen) -> float:
    return max(map(abs, one.moves.values()), default=math.inf)


def _hidden(fitted: Fitted, sd: np.ndarray, candidate: Candidate, sensed: Sensed, parameter: Parameter) -> Unseen:
    """How much of a shape of a candidate the data may hide; sd (D,): the point's standard deviations."""
    if math.isinf(parameter.absent):
        low, high = 0.0, parameter.scale / parameter.low if parameter.low > 0.0 else math.inf
    else:
        low, high = sorted((bound - parameter.absent) / parameter.scale for bound in (parameter.low, parameter.high))
    found = _limit(fitted, candidate, sensed, low, high)
    if found is None:
        return Unseen(candidate.name, candidate.alike, parameter, None, {})
    limit, S = found
    slope = _absorbs(fitted, S)
    moved = limit * slope
    if _is_bent(fitted, candidate, sensed, limit, S, slope):
        followed = _follow(fitted, candidate, sensed, S, slope, low, high)
        if followed is None:
            return Unseen(candidate.name, candidate.alike, parameter, None, {})
        limit, moved = followed
    moves = {
        name: float(moved[i] / sd[i])
        for i, name in enumerate(fitted.likelihood.names) if name in ("k_f", "kappa", "b")
    }  # fmt: skip
    return Unseen(candidate.name, candidate.alike, parameter, strength(parameter, limit), moves)


def _limit(
    fitted: Fitted, candidate: Candidate, sensed: Sensed, low: float, high: float
) -> tuple[float, np.ndarray] | None:
    """The strength [scales] between its bounds that is as far from none as the data allow, and the change of the
    residuals there by each scale, (R + P,), to first order; None where the data do not see the effect, or not within
    its bounds."""
    S, limit, inflation = sensed.S[:, 0], math.nan, fitted.coloured[0]
    for _ in range(_ROUNDS):  # what grows as a square, such as a blur, is followed by secants to where it ends
        left = fitted.project(S)
        size = float(left @ left)
        if size <= LEAST_SEEN**2 * float(S @ S) or inflation > size * max(abs(low), high) ** 2:
            return None
        best, sd = min(max(-float(left @ fitted.residuals) / size, low), high), math.sqrt(inflation / size)
        found = float(max(truncnorm.ppf(_tails(low), (low - best) / sd, (high - best) / sd, best, sd), key=abs))
        limit = found if math.isnan(limit) or found * limit <= 0.0 else math.copysign(math.sqrt(found * limit), found)
        try:
            S = change(fitted, candidate, sensed.values(np.array([limit]))) / limit
        except (SimulationError, ValueError):  # too strong for this cradle to swing
            break
    return limit, S


def _absorbs(fitted: Fitted, S: np.ndarray) -> np.ndarray:
    """−J⁺ S, (D,)."""
    lengths = lengths_of(fitted.jacobian)
    return -np.linalg.lstsq(fitted.jacobian / lengths, S)[0] / lengths


def _held(fitted: Fitted, candidate: Candidate, sensed: Sensed, s: float) -> Likelihood:
    """The likelihood of the model with a candidate of strength s [scales]."""
    model = with_effects(fitted.experiment, {candidate.name: sensed.values(np.array([s]))}, ())
    return Likelihood(model, fitted.likelihood.rows, 1)


def _is_bent(
    fitted: Fitted, candidate: Candidate, sensed: Sensed, s: float, S: np.ndarray, slope: np.ndarray
) -> bool:  # fmt: skip
    """Whether the readings at a strength, the unknowns moved by `slope` (D,) to where they make up for it to first
    order, are others than they are to first order."""
    point = np.clip(fitted.point + s * slope, *bounds(fitted.likelihood))
    try:
        off = _held(fitted, candidate, sensed, s).residuals(point) - fitted.residuals - s * fitted.project(S)
    except (SimulationError, ValueError):  # the cradle cannot swing where first order leads
        return True
    return float(off @ off) > _BENT * fitted.coloured[0]


def _follow(
    fitted: Fitted, candidate: Candidate, sensed: Sensed, S: np.ndarray, slope: np.ndarray, low: float, high: float
) -> tuple[float, np.ndarray] | None:  # fmt: skip
    """The strength [scales] between its bounds that is as far from none as the data allow, by the profile of χ², and
    how far the point moves there, (D,), by `slope` (D,) to first order; None where the data hardly exclude what is
    beyond its bounds."""
    inflation = fitted.coloured[0]
    sd = math.sqrt(inflation) / float(np.linalg.norm(fitted.project(S)))
    visited = {0.0: (fitted.chi2, fitted.point)}

    def refit(s: float, start: np.ndarray) -> tuple[np.ndarray, float]:
        held = _held(fitted, candidate, sensed, s)
        point, chi2 = refine(held, start, EVALUATIONS)
        if math.isfinite(chi2) and not np.array_equal(moved := polish(held, point), point):
            point, chi2 = moved, cost(held, moved)
        if math.isfinite(chi2):
            visited[s] = chi2, point
        return point, math.sqrt((chi2 - min(chi2 for chi2, _ in visited.values())) / inflation)

    for bound in (bound for bound in (low, high) if bound != 0.0):
        if fitted.chi2 - min(chi2 for chi2, _ in visited.values()) > _END**2 * inflation:
            continue  # beyond the end already: the other side holds better
        step = math.copysign(sd, bound)
        u, point = profile_end(
            lambda u, start, step=step: refit(u * step, start),
            fitted.point, step * slope, abs(bound) / sd, _END,
        )  # fmt: skip
        if u >= abs(bound) / sd and refit(bound, point)[1] < 1.0:
            return None
    several = sorted(visited)
    chi2 = PchipInterpolator(several, [visited[s][0] for s in several])
    grid = np.linspace(several[0], several[-1], _GRID)
    density = np.exp(-0.5 * (chi2(grid) - chi2(grid).min()) / inflation)
    limit = float(max(np.interp(_tails(low), np.cumsum(density) / density.sum(), grid), key=abs))
    points = np.array([visited[s][1] for s in several])
    return limit, np.array([np.interp(limit, several, column) for column in points.T]) - fitted.point


def _tails(low: float) -> tuple[float, ...]:
    """The probabilities between which the true strength is, or below which; low: its lower bound."""
    return (_SURE,) if low == 0.0 else (0.5 * (1.0 - _SURE), 0.5 * (1.0 + _SURE))
