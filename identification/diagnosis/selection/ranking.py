"""All sets of effects that a search compared, by their evidence: probabilities, and the rivals of the best."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.criteria import Criteria
from identification.diagnosis.selection.model import Model


@dataclass(frozen=True, eq=False)
class Ranking:
    """Sets of effects with their ln evidence over the best one.

    best: the model with the most evidence. compared: models and odds, the best first. unfitted: effects and odds of
    sets that were judged to first order alone.
    """

    best: Model
    compared: tuple[tuple[Model, float], ...]
    unfitted: tuple[tuple[frozenset[str], float], ...]
    criteria: Criteria

    @property
    def rivals(self) -> tuple[Model, ...]:
        """Models that the data do not tell from the best. One that holds its effects, or a part of them, is no rival
        explanation."""
        close, own = -self.criteria.equivalent_log_odds, self.best.effects
        return tuple(m for m, odds in self.compared if odds > close and not (m.effects >= own or m.effects <= own))

    @property
    def probabilities(self) -> tuple[tuple[tuple[str, ...], float], ...]:
        """Sets of effects with their probabilities, the most probable first; () is the base. They sum to one."""
        odds = {model.effects: own for model, own in self.compared}
        for effects, own in self.unfitted:
            odds.setdefault(effects, own)
        total = float(np.logaddexp.reduce([*odds.values()]))
        ordered = sorted(odds.items(), key=lambda pair: -pair[1])
        return tuple((tuple(sorted(effects)), math.exp(own - total)) for effects, own in ordered)

    @property
    def probability(self) -> float:
        """Probability of the best set."""
        return dict(self.probabilities)[tuple(sorted(self.best.effects))]

    @property
    def margin(self) -> float:
        """ln evidence of the best set over the next one; infinite if it is the only one."""
        return self.compared[0][1] - self.compared[1][1] if len(self.compared) > 1 else math.inf
