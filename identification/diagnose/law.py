"""A smooth law for what no effect of the catalogue explains: few terms of a fixed library, learned from the data.

Terms are chosen in windows of time with start states of their own, where a force shows where it acts: the best subset
of each size, and of them the one with the most evidence; without forces in time, and with them. The law is then fitted
to the training part as one free run, and kept if it predicts: fitted to the first two thirds of the training part, it
must do better on the rest of it than the model alone. What is held out is never looked at.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from cradle_env.effects import LEARNED
from cradle_env.simulation import SimulationError
from identification.diagnose.candidates import without_effect
from identification.diagnose.cut import windowed
from identification.diagnose.decide import ALPHA, colour, coloured
from identification.diagnose.fitted import Fitted
from identification.diagnose.in_time import with_time
from identification.diagnose.search import Searcher, placed
from identification.diagnose.terms import Linear, Scales, Term, extended
from identification.experiment import Experiment
from identification.fit import Progress, refine, training_rows

#: Terms at most, evaluations of a refit, and the part of the training time that an inner prediction is fitted to.
_MOST, _EVALUATIONS, _INNER = 10, 20, 2.0 / 3.0
#: Gaps of inner predictions that differ by less than this share are as good as equal.
_EQUAL = 0.01


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
        """Over the model without it."""
        return log_evidence(self.before, self.fitted)


def learn(fitted: Fitted, searcher: Searcher, tell: Progress) -> Law | None:
    """The law that a fitted model lacks; None where none predicts better than the model alone, or with so
    many unknowns more that it explains nothing."""
    if any(fitted.cradle.has(declared.name) for declared in LEARNED) or "b" not in fitted.likelihood.names:
        return None
    tell("law", 0.0, "window by window")
    scales = scales_of(fitted)
    linear = Linear.of(windowed(fitted), scales)
    tell("law", 0.4, "which terms")
    alone = _free(fitted, searcher, inner(fitted.experiment), scales, (), {}).held_out_gap()
    laws = [_predicting(fitted, searcher, linear, scales, choices(linear), alone, tell)]
    tell("law", 0.7, "forces in time")
    if (timed := with_time(linear, scales, chosen(linear))) is not None:
        several = choices(timed[0])
        swinging = tuple(i for i in several[0] if timed[0].term(i).in_time) if several else ()
        if swinging:
            found = [_predicting(fitted, searcher, *timed, some, alone, tell) for some in ([swinging], several)]
            noise = _largest_of_noise(inner(fitted.experiment))
            laws += [law for law in found if law is not None and law.inner_after < noise]
    return _best([law for law in laws if law is not None])


def _largest_of_noise(experiment: Experiment) -> float:
    """The gap on what is held out that noise alone passes once in a hundred times. A force in time is learned only if
    it leaves no more: near the frequency of the swing it bends to whatever swings with the bobs, for a while."""
    held = training_rows(experiment)[1]
    count = sum(int(np.sum(~np.isnan(run.readings[k]))) for run, k in zip(experiment.runs, held, strict=True))
    return math.sqrt(chi2.isf(ALPHA, count) / count)


def _best(laws: list[Law]) -> Law | None:
    """Of the laws that predict as well as any, the one with the most evidence: what holds for no longer than it was
    fitted is no law, whatever it explains there, and of the others the simplest is the most evident."""
    least = min((law.inner_after for law in laws), default=0.0)
    equal = (law for law in laws if law.inner_after <= (1.0 + _EQUAL) * least)
    return max(equal, key=lambda law: law.log_evidence, default=None)


def _predicting(
    fitted: Fitted, searcher: Searcher, linear: Linear, scales: Scales, several: list[tuple[int, ...]], alone: float,
    tell: Progress,
) -> Law | None:  # fmt: skip
    """The law of the first of several subsets that predicts better than the model alone and has evidence."""
    part = inner(fitted.experiment)
    for i, subset in enumerate(several):
        tell("law", 0.6 + 0.1 * i, f"prediction with {len(subset)} terms")
        terms, values = tuple(map(linear.term, subset)), linear.values(subset)
        try:
            gap = _free(fitted, searcher, part, scales, terms, values).held_out_gap()
            if gap < alone:
                law = Law(fitted, _free(fitted, searcher, fitted.experiment, scales, terms, values), terms, alone, gap)
                if law.log_evidence > 0.0:
                    return law
        except SimulationError:  # a law under which the cradle cannot swing
            continue
    return None


def choices(linear: Linear) -> list[tuple[int, ...]]:
    """The best subset of all sizes, then those of the path with half as many terms, and a quarter."""
    path, best = linear.path(_MOST), chosen(linear)
    sizes = dict.fromkeys(len(best) // k for k in (2, 4))
    return [best, *(path[size - 1] for size in sizes if 0 < size < len(best))] if best else []


def chosen(linear: Linear) -> tuple[int, ...]:
    """The subset of the path with the most evidence, without terms that lessen it; () where none has any."""
    path = linear.path(_MOST)
    if not path:
        return ()
    left = linear.solved(path[-1])[0]
    evidence = functools.partial(_evidence, linear, *colour(left[: linear.fitted.count], linear.fitted.readings))
    best = max([(), *path], key=evidence)
    while best:
        fewer = max((tuple(j for j in best if j != i) for i in best), key=evidence)
        if evidence(fewer) <= evidence(best):
            break
        best = fewer
    return best


def _evidence(linear: Linear, inflation: float, effective: float, subset: tuple[int, ...]) -> float:
    return linear.log_evidence(subset, inflation, effective)


def _free(
    fitted: Fitted, searcher: Searcher, experiment: Experiment, scales: Scales, terms: tuple[Term, ...],
    values: dict[str, float],
) -> Fitted:  # fmt: skip
    """The fit as one free run, near the values found in windows: a free run alone would bend terms to its drift."""
    likelihood = searcher.likelihood(extended(experiment, scales, terms))
    key = _key([term.name for term in terms], scales, fitted.point.tolist(), experiment.digest)
    start = placed(likelihood, {**fitted.values, **values})
    return Fitted(likelihood, searcher.store.point(key, lambda: refine(likelihood, start, _EVALUATIONS)[0]))


def still_needed(fitted: Fitted, name: str, searcher: Searcher, tell: Progress) -> float:
    """Log evidence of an effect over the law that would stand in its place; it is needed unless that is below −CLOSE:
    the library holds the like of some effects, and a law that only copies an effect comes out near 0.

    fitted: a model with the effect among those added to its base. The effect is taken out, a law may be learned of
    what is then left, and both models are compared on the training part, their unknowns counted. A law has some
    dozens of terms to choose from, which this does not count: it is the law that is favoured, not the effect.
    """
    without = searcher.nearby(without_effect(fitted.experiment, name), fitted.values)
    law = learn(without, searcher, tell)
    rival = without if law is None else law.fitted
    inflation, effective = coloured(min((fitted, rival), key=lambda one: one.chi2))
    return 0.5 * ((rival.chi2 - fitted.chi2) / inflation - (len(fitted.point) - len(rival.point)) * math.log(effective))


def scales_of(fitted: Fitted) -> Scales:
    """angle [rad] and speed [m/s]: the largest of the readings fitted, and that of a swing of this size; frequency
    [Hz]: that of a swing, until a force in time has another."""
    largest = 0.0
    for run, rows in zip(fitted.experiment.runs, fitted.likelihood.rows, strict=True):
        if rows.any():
            unit = 1.0 if run.quantity == "theta" else fitted.cradle.length
            largest = max(largest, float(np.nanmax(np.abs(run.readings[rows]))) / unit)
    return {"angle": largest, "speed": largest * math.sqrt(fitted.cradle.gravity * fitted.cradle.length),
            "frequency": 1.0 / fitted.cradle.period}  # fmt: skip


def inner(experiment: Experiment) -> Experiment:
    """The training part alone, the last third of its time held out: this extrapolates as the whole does."""
    runs = []
    for run, rows in zip(experiment.runs, training_rows(experiment)[0], strict=True):
        if rows.any():
            times = run.times[rows]
            split = float(times[0] + _INNER * (times[-1] - times[0]))
            runs.append(dataclasses.replace(run, times=times, readings=run.readings[rows], fit_to=split))
    return dataclasses.replace(experiment, runs=tuple(runs), digest="inner")


def log_evidence(before: Fitted, after: Fitted) -> float:
    """Of a model over another that is nested in it: ½ (Δχ²/c − k ln n_eff), see `decide`."""
    inflation, effective = coloured(after)
    more = len(after.point) - len(before.point)
    return 0.5 * ((before.chi2 - after.chi2) / inflation - more * math.log(effective))


def _key(*what: object) -> str:
    return hashlib.sha256(json.dumps(["law", *what]).encode()).hexdigest()[:20]
