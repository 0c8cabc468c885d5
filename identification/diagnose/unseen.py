"""What data cannot exclude: how strong an absent effect may yet be, and how far off k_f, κ and b would then be.

A strength s changes the residuals r by S s, of which a refit leaves S⊥ s. Data that show nothing of it
leave s = −S⊥·r/|S⊥|² ± √c/|S⊥|, cut at its bounds (c: see `decide`); and with s the unknowns move by
−J⁺ S s, to first order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import truncnorm

from cradle_env.effects import Parameter
from cradle_env.simulation import SimulationError
from identification.diagnose.candidates import Candidate, is_strength, strength
from identification.diagnose.fitted import Fitted
from identification.diagnose.score import LEAST_SEEN, Score, Sensed, change

#: Probability that the true strength is below its limit; rounds in which that is found.
_SURE, _ROUNDS = 0.95, 4


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


def unseen(fitted: Fitted, scores: Sequence[Score]) -> tuple[Unseen, ...]:
    """Of each absent effect with one strength, how much data may hide; what would move unknowns most comes first."""
    deviations = np.sqrt(np.diag(fitted.covariance))
    names = [name for name in ("k_f", "kappa", "b") if name in fitted.likelihood.names]
    places = [fitted.likelihood.names.index(name) for name in names]
    lengths = np.linalg.norm(fitted.jacobian, axis=0)
    lengths[lengths == 0.0] = 1.0
    found = []
    for own in scores:
        strengths = [p for p in own.candidate.declaration.parameters if is_strength(p)]
        single = [sensed for sensed in own.sensed if sensed.S.shape[1] == 1]
        if len(strengths) != 1 or not single:
            continue
        limits = [_limit(fitted, own.candidate, sensed, strengths[0]) for sensed in single]
        if None in limits:
            found.append(Unseen(own.candidate.name, own.candidate.alike, strengths[0], None, {}))
            continue
        several = []
        for limit, column in filter(None, limits):
            moved = -(np.linalg.lstsq(fitted.jacobian / lengths, column)[0] / lengths / deviations)[places]
            moves = dict(zip(names, map(float, moved), strict=True))
            several.append(
                Unseen(own.candidate.name, own.candidate.alike, strengths[0], strength(strengths[0], limit), moves)
            )
        found.append(max(several, key=_farthest))
    return tuple(sorted(found, key=_farthest, reverse=True))


def _farthest(one: Unseen) -> float:
    return max(map(abs, one.moves.values()), default=math.inf)


def _limit(
    fitted: Fitted, candidate: Candidate, sensed: Sensed, parameter: Parameter
) -> tuple[float, np.ndarray] | None:
    """The strength [scales] that is as far from none as the data allow, and the change of the residuals there; None
    where the data do not see the effect, or not within its bounds."""
    if math.isinf(parameter.absent):
        low, high = 0.0, math.inf
    else:
        low, high = sorted((bound - parameter.absent) / parameter.scale for bound in (parameter.low, parameter.high))
    tails = (_SURE,) if low == 0.0 else (0.5 * (1.0 - _SURE), 0.5 * (1.0 + _SURE))
    S, limit, inflation = sensed.S[:, 0], math.nan, fitted.coloured[0]
    for _ in range(_ROUNDS):  # what grows as a square, such as a blur, is followed by secants to where it ends
        left = fitted.project(S)
        size = float(left @ left)
        if size <= LEAST_SEEN**2 * float(S @ S) or inflation > size * max(abs(low), high) ** 2:
            return None
        best, sd = min(max(-float(left @ fitted.residuals) / size, low), high), math.sqrt(inflation / size)
        found = float(max(truncnorm.ppf(tails, (low - best) / sd, (high - best) / sd, best, sd), key=abs))
        limit = found if math.isnan(limit) or found * limit <= 0.0 else math.copysign(math.sqrt(found * limit), found)
        try:
            S = change(fitted, candidate, sensed.values(np.array([limit]))) / limit
        except (SimulationError, ValueError):  # too strong for this cradle to swing
            break
    return limit, S * limit
