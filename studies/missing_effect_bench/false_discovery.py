"""The rival with control of false discoveries: sparse regression of the residuals on the candidates.

The model as stated is fitted, and its residuals are regressed on what each candidate would change to first order, less
what the fit absorbs. Forward selection adds the candidate with the least p-value of an F test as long as the procedure
of Benjamini & Gavrilov (Ann. Appl. Stat. 3, 179, 2009, eq. 2.2) keeps the expected share of false ones below q. A
periodogram says whether what it has selected leaves noise.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from identification.experiment.experiment import Experiment
from identification.inference.fit_result import FitResult
from studies.missing_effect_bench.candidates import EQUIVALENTS, UNKNOWN, Names, merge
from studies.missing_effect_bench.regression import (
    FALSE_ALARM,
    Direction,
    false_alarm_probability,
    find_directions,
    fit_as_stated,
    left_by,
)

#: Expected share of false discoveries.
Q = 0.05


def discover(experiment: Experiment, prior: Mapping[Names, float]) -> dict[Names, float]:
    """The set that is discovered has the probability 1 − q; the rest is spread as before the data."""
    fitted = fit_as_stated(experiment)
    directions = {
        name: direction
        for name, direction in find_directions(fitted).items()
        if frozenset({name}) in prior and name not in EQUIVALENTS[1:]
    }
    names = select(fitted, directions)
    peak = false_alarm_probability(fitted, left_by(fitted, [directions[name] for name in names]))
    found = UNKNOWN if peak < FALSE_ALARM else merge(names)
    others = {some: p for some, p in prior.items() if some != found}
    total = sum(others.values())
    return {found: 1.0 - Q, **{some: Q * p / total for some, p in others.items()}}


def select(fitted: FitResult, directions: Mapping[str, Direction]) -> list[str]:
    """The names that forward selection adds."""
    chosen: list[str] = []
    for step in range(1, len(directions) + 1):
        p = {name: f_test(fitted, directions, chosen, name) for name in directions if name not in chosen}
        best = min(p, key=p.__getitem__)
        if p[best] > Q * step / (len(directions) + 1 - step * (1.0 - Q)):
            break
        chosen.append(best)
    return chosen


def f_test(fitted: FitResult, directions: Mapping[str, Direction], chosen: list[str], name: str) -> float:
    """The p-value of one more candidate, over noise that is as correlated as the residuals."""
    before = left_by(fitted, [directions[one] for one in chosen])
    after = left_by(fitted, [directions[one] for one in (*chosen, name)])
    parameters = directions[name].parameters
    size = fitted.count / fitted.noise_inflation
    gain = float(np.sum(before**2) - np.sum(after**2))
    return float(stats.f.sf(gain / fitted.noise_inflation / parameters, parameters, size))
