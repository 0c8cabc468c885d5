"""A smooth law for what no effect of the catalogue explains: few terms of a fixed library, chosen by prediction.

Where the terms act shows in windows of time with start states of their own; there the best subsets are found. How many
terms, and which of nearly equal ones, is decided by what is needed: fitted to the first part of the training data, the
law must predict the rest of it free-running. What is held out is never looked at.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import math
from dataclasses import dataclass

import numpy as np

from cradle_env.effects import LEARNED
from cradle_env.simulation import SimulationError
from identification.diagnose.decide import coloured
from identification.diagnose.fitted import Fitted
from identification.diagnose.search import Searcher, placed
from identification.diagnose.terms import Linear, Scales, Term, extended
from identification.diagnose.windows import windowed
from identification.experiment import Experiment
from identification.fit import Progress, refine, training_rows

#: Terms at most; and how many more are tried on, one at a time, where prediction could still improve.
_MOST, _TRIED = 6, 6
#: Parts of the training time after which the inner predictions begin.
_SPLITS = (0.5, 2.0 / 3.0)
#: Evaluations of a refit, and what a term must take from the gap of the inner prediction to stay.
_EVALUATIONS, _WORTH = 15, 0.97


@dataclass(frozen=True, eq=False)
class Law:
    """A learned law: the model without it and with it, both fitted to the training part; its terms; gaps of the inner
    prediction without and with it."""

    before: Fitted
    fitted: Fitted
    terms: tuple[Term, ...]
    inner_before: float
    inner_after: float

    @functools.cached_property
    def log_evidence(self) -> float:
        """Over the model without it, complexity counted and residuals taken as coloured."""
        return log_evidence(self.before, self.fitted)


def learn(fitted: Fitted, searcher: Searcher, tell: Progress) -> Law | None:
    """The law that a fitted model lacks; None where none predicts better than the model alone."""
    if any(fitted.cradle.has(declared.name) for declared in LEARNED) or "b" not in fitted.likelihood.names:
        return None
    tell("law", 0.0, "window by window")
    scales = scales_of(fitted)
    linear = Linear.of(windowed(fitted), scales)
    trial = _Trial(fitted, searcher, scales, linear)
    alone = trial.gap(())
    best, least = (), alone
    for i, subset in enumerate(linear.path(_MOST)):
        tell("law", (i + 1) / (_MOST + 3), f"{i + 1} terms")
        if trial.gap(subset) < _WORTH * least:
            best, least = subset, trial.gap(subset)
    while best and len(best) < _MOST + 2:
        tell("law", 0.8, "other terms")
        wider = sorted(linear.wider(best), key=linear.saved)[-_TRIED:]
        fewer = [tuple(j for j in best if j != i) for i in best]
        better = min([*wider, *fewer], key=trial.gap)
        if trial.gap(better) >= _WORTH * least:
            break
        best, least = better, trial.gap(better)
    for i in best:  # backwards: what predicts as well without goes
        fewer = tuple(j for j in best if j != i)
        if fewer and trial.gap(fewer) <= least / _WORTH:
            best, least = fewer, trial.gap(fewer)
    if not best:
        return None
    return Law(fitted, trial.whole(best), trial.terms(best), alone, least)


class _Trial:
    """Laws tried: each fitted to the inner training part and judged on what follows it."""

    def __init__(self, fitted: Fitted, searcher: Searcher, scales: Scales, linear: Linear):
        self.fitted, self.searcher, self.scales, self.linear = fitted, searcher, scales, linear
        self.inner = [inner(fitted.experiment, share) for share in _SPLITS]
        self._gaps: dict[tuple[int, ...], float] = {}

    def terms(self, subset: tuple[int, ...]) -> tuple[Term, ...]:
        return tuple(map(self.linear.term, subset))

    def gap(self, subset: tuple[int, ...]) -> float:
        """That of the inner predictions, their geometric mean; infinite where the law cannot be simulated."""
        if subset not in self._gaps:
            try:
                gaps = [self._fit(part, subset, f"inner {i}").held_out_gap() for i, part in enumerate(self.inner)]
                self._gaps[subset] = math.prod(gaps) ** (1.0 / len(gaps))
            except (SimulationError, ValueError):
                self._gaps[subset] = math.inf
        return self._gaps[subset]

    def whole(self, subset: tuple[int, ...]) -> Fitted:
        """The law fitted to all of the training part."""
        return self._fit(self.fitted.experiment, subset, "whole")

    def _fit(self, experiment: Experiment, subset: tuple[int, ...], what: str) -> Fitted:
        wider = extended(experiment, self.scales, self.terms(subset))
        likelihood = self.searcher.likelihood(wider)
        start = {name: value for name, value in self.linear.values(subset).items() if "@" not in name}
        points = [placed(likelihood, {**self.fitted.values, **start}), placed(likelihood, self.fitted.values)]
        key = _key(what, [term.name for term in self.terms(subset)], self.fitted.point.tolist())

        def find() -> np.ndarray:
            reached = [refine(likelihood, point, _EVALUATIONS) for point in points[: len(subset) + 1]]
            return min(reached, key=lambda pair: pair[1])[0]

        return Fitted(likelihood, self.searcher.store.point(key, find))


def scales_of(fitted: Fitted) -> dict[str, float]:
    """angle [rad] and speed [m/s]: the largest of the readings fitted, and that of a swing of this size."""
    largest = 0.0
    for run, rows in zip(fitted.experiment.runs, fitted.likelihood.rows, strict=True):
        if rows.any():
            unit = 1.0 if run.quantity == "theta" else fitted.cradle.length
            largest = max(largest, float(np.nanmax(np.abs(run.readings[rows]))) / unit)
    return {"angle": largest, "speed": largest * math.sqrt(fitted.cradle.gravity * fitted.cradle.length)}


def inner(experiment: Experiment, share: float) -> Experiment:
    """The training part alone, of which what lies beyond a share of its time is held out."""
    runs = []
    for run, rows in zip(experiment.runs, training_rows(experiment)[0], strict=True):
        if rows.any():
            times = run.times[rows]
            split = float(times[0] + share * (times[-1] - times[0]))
            runs.append(dataclasses.replace(run, times=times, readings=run.readings[rows], fit_to=split))
    return dataclasses.replace(experiment, runs=tuple(runs), digest="inner")


def log_evidence(before: Fitted, after: Fitted) -> float:
    """½ (Δχ²/c − k ln n_eff) of k unknowns more, see `decide`."""
    inflation, effective = coloured(after)
    more = len(after.point) - len(before.point)
    return 0.5 * ((before.chi2 - after.chi2) / inflation - more * math.log(effective))


def _key(*what: object) -> str:
    return hashlib.sha256(json.dumps(["law", *what]).encode()).hexdigest()[:20]
