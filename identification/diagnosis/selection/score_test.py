"""How far each absent effect would go towards what is left, beside all that the fitted unknowns can absorb.

To first order in its strength an effect changes the residuals r by columns S; a refit keeps S⊥ = S − Q Qᵀ S of them.
Adding it lowers χ² by |P r|², P projecting on the span of S⊥; where a strength has one sign only, by what that sign
gives. The same numbers of the replicates say how much the best of all candidates gains by chance.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cradle_env.effects import Effect
from cradle_env.threads import in_threads
from identification.diagnosis.residuals.residual_tests import chi2_log_tail
from identification.diagnosis.selection.candidates import (
    Candidate,
    Values,
    list_candidates,
    shapes,
    with_effects,
)
from identification.inference.fit_result import FitResult, orthonormal_basis
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.likelihood import Likelihood
from identification.inference.start_points import flatten_values, point_at

#: First strength of the finite differences [scales of the parameter].
_STEP = 1e-2
#: RMS change of the residuals by which the strength is then chosen [noise].
_MOVED = 0.3
#: Tries to find that strength.
_TRIES = 8
#: What keeps less than this share of a sensitivity after projection cannot be seen at all.
MIN_VISIBLE_SHARE = 1e-4
#: Candidates whose sensitivities after projection are this parallel cannot be told apart to first order.
PARALLEL = 0.98


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """A shape of a candidate, and the change S of the residuals per strength [scales], (R + P, k); values(s): the
    candidate's with strengths s (k,), within bounds."""

    values: Callable[[np.ndarray], Values]
    S: np.ndarray


@dataclass(frozen=True, eq=False)
class CandidateScore:
    """One candidate's: the χ² that it would save, degrees of freedom, whether its strength has one sign, surprise
    (−log10 p of this candidate alone), p among all candidates, those it is parallel to, and directions: for each
    shape an orthonormal basis (R + P, k); likely: for each shape, its values where the χ² would be least; sensed: all
    shapes, seen or not."""

    candidate: Candidate
    gain: float
    degrees: int
    one_sided: bool
    neg_log10_p: float
    p: float
    parallel: tuple[Candidate, ...]
    directions: tuple[np.ndarray, ...]
    likely: tuple[Values, ...]
    sensitivities: tuple[Sensitivity, ...]


@dataclass(frozen=True, eq=False)
class ScoreTest:
    """Scores, the most surprising first; p: that of the best among all; replicas: the best one's in each replicate."""

    scores: tuple[CandidateScore, ...]
    p: float
    largest: float
    replicate_maxima: np.ndarray


def score(fitted: FitResult, replicates: np.ndarray) -> ScoreTest:
    """Scores every candidate; replicates: (R + P, M), see `FitResult.replicates`."""
    found = []
    several, workers = list_candidates(fitted.cradle), fitted.likelihood.workers
    all_sensed = in_threads(lambda candidate: compute_sensitivities(fitted, candidate), several, workers)
    replicate_maxima = np.zeros(replicates.shape[1])
    for candidate, shape_unknowns in zip(several, all_sensed, strict=True):
        directions, likely = [], []
        sided = all(p.one_sided for p in candidate.declaration.strengths)
        sided = sided and bool(candidate.declaration.parameters)
        best, chance, degrees = 0.0, np.zeros(replicates.shape[1]), 1
        for sensitivity in shape_unknowns:
            basis = _seen(fitted, sensitivity.S)
            if basis is None:
                continue
            directions.append(basis)
            likely.append(sensitivity.values(np.linalg.lstsq(fitted.project(sensitivity.S), -fitted.residuals)[0]))
            single = sided and sensitivity.S.shape[1] == 1
            gain = float(_gain(basis, fitted.residuals[:, None], single)[0])
            best, degrees = max(best, gain), max(degrees, basis.shape[1])
            chance = np.maximum(chance, _gain(basis, replicates, single))
        replicate_maxima = np.maximum(replicate_maxima, gain_neg_log10_p(chance, degrees, sided))
        own = float(gain_neg_log10_p(np.array(best), degrees, sided))
        found.append((candidate, best, degrees, sided, own, tuple(likely), tuple(shape_unknowns), tuple(directions)))
    scores = [
        CandidateScore(
            candidate,
            gain,
            degrees,
            sided,
            own,
            family_p(own, replicate_maxima),
            _parallel(candidate, found),
            directions,
            likely,
            sensitivity,
        )
        for candidate, gain, degrees, sided, own, likely, sensitivity, directions in found
    ]
    scores.sort(key=lambda s: -s.neg_log10_p)
    largest = scores[0].neg_log10_p if scores else 0.0
    return ScoreTest(tuple(scores), family_p(largest, replicate_maxima), largest, replicate_maxima)


def gain_neg_log10_p(gain: np.ndarray, degrees: int, sided: bool) -> np.ndarray:
    """−log10 p of a gain in χ²: half of it can be had by a strength of one sign only."""
    tail = chi2_log_tail(np.maximum(gain, 0.0), max(degrees, 1))
    if sided:
        tail = tail + np.log(np.where(gain > 0.0, 0.5, 1.0))
    return -tail / np.log(10.0)


def family_p(neg_log10_p: float, replicate_maxima: np.ndarray) -> float:
    """p of the best of all candidates: 1 − (1 − p)^n, n the number of independent ones that the replicates show."""
    if len(replicate_maxima) == 0 or np.median(replicate_maxima) <= 0.0:
        return 1.0
    number = np.log(2.0) / -np.log1p(-min(10.0 ** -float(np.median(replicate_maxima)), 1.0 - 1e-12))
    return float(-np.expm1(max(number, 1.0) * np.log1p(-min(10.0**-neg_log10_p, 1.0 - 1e-12))))


def _gain(basis: np.ndarray, residuals: np.ndarray, single: bool) -> np.ndarray:
    """χ² that a candidate saves, (M,): the model must move by −r. A single column's sign is that of the strength."""
    parts = basis.T @ residuals
    if single:
        parts = np.minimum(parts, 0.0)
    return np.sum(parts**2, axis=0)


def _seen(fitted: FitResult, S: np.ndarray) -> np.ndarray | None:
    """Orthonormal basis of what a refit leaves of the columns S; None if nothing can be seen of them."""
    lengths = np.linalg.norm(S, axis=0)
    S = S[:, lengths > 0.0] / lengths[lengths > 0.0]
    left = fitted.project(S)
    kept = np.linalg.norm(left, axis=0) > MIN_VISIBLE_SHARE
    if not kept.any():
        return None
    if kept.sum() == 1:
        return left[:, kept] / np.linalg.norm(left[:, kept])
    return orthonormal_basis(left[:, kept])


def _parallel(candidate: Candidate, found: list[tuple]) -> tuple[Candidate, ...]:
    """Other candidates that hold nearly the same direction, of whatever sign."""
    own = next(entry[-1] for entry in found if entry[0] is candidate)
    several = []
    for other, *_, directions in found:
        if other is not candidate:
            cosines = [np.linalg.norm(A.T @ B, 2) for A, B in itertools.product(own, directions)]
            if cosines and max(cosines) >= PARALLEL:
                several.append(other)
    return tuple(several)


def compute_sensitivities(fitted: FitResult, candidate: Candidate) -> list[Sensitivity]:
    """Each shape of a candidate with what its strengths change; none where impossible.

    An effect without parameters, or one that brings others along, is not small: it is judged by its refit alone.
    """
    declared, bobs = candidate.declaration, fitted.cradle.bobs
    strengths = declared.strengths
    if not strengths or len(candidate.effects) > 1:
        return []
    elements = [
        (p, element if p.each and not candidate.shared else None)
        for p in strengths for element in range(1 if candidate.shared else p.count(bobs) - p.balanced)
    ]  # fmt: skip
    found = []
    for shape in shapes(declared, bobs):
        columns = [_column(fitted, candidate, shape, *element) for element in elements]
        seen = [(element, column) for element, column in zip(elements, columns, strict=True) if column is not None]
        if seen:
            values = functools.partial(_strong, declared, bobs, shape, [element for element, _ in seen])
            found.append(Sensitivity(values, np.column_stack([column for _, column in seen])))
    return found


def _strong(declared: Effect, bobs: int, shape: Values, elements: Sequence, factors: np.ndarray) -> Values:
    """The values of a shape with its strengths at these factors of their scales, within bounds."""
    values = {p.key: p.repeat(p.absent, bobs) for p in declared.strengths} | dict(shape)
    for (parameter, element), factor in zip(elements, factors, strict=True):
        if math.isinf(parameter.absent) and factor <= 0.0:
            continue  # as weak as can be
        value = min(max(parameter.at_strength(float(factor)), parameter.low), parameter.high)
        if element is None:
            values[parameter.key] = parameter.repeat(value, bobs)
        else:
            values[parameter.key] = [value if i == element else v for i, v in enumerate(values[parameter.key])]
    return declared.balance(values)


def residual_change(fitted: FitResult, candidate: Candidate, values: Values) -> np.ndarray:
    """Change of the residuals by a candidate with these values, (R + P,), all else as fitted."""
    name = candidate.declaration.name
    model = with_effects(fitted.experiment, {name: values}, candidate.unknown)
    likelihood = Likelihood(model, fitted.likelihood.rows, fitted.likelihood.workers)
    stated = likelihood.values(likelihood.start())
    point = point_at(likelihood, {**stated, **fitted.values, **flatten_values(name, values)})
    moved = likelihood.residuals(point)[: fitted.count] - fitted.residuals[: fitted.count]
    return np.concatenate([moved, np.zeros(len(fitted.residuals) - fitted.count)])


def _column(fitted: FitResult, candidate: Candidate, shape: dict, parameter, element: int | None):
    """d residuals / d strength of one value of a parameter, (R + P,), by a step that the noise would just show."""
    declared, bobs = candidate.declaration, fitted.cradle.bobs
    step, found = _STEP, None
    for _ in range(_TRIES):
        values = _strong(declared, bobs, shape, [(parameter, element)], np.array([step]))
        try:
            moved = residual_change(fitted, candidate, values)
        except ImpossibleModelError:
            break
        size = float(np.sqrt(np.mean(moved[: fitted.count] ** 2)))
        if size == 0.0 or not np.isfinite(size):
            break
        found = moved / step
        if _MOVED / 3.0 < size < 3.0 * _MOVED:
            break
        step *= math.sqrt(_MOVED / size) if size < _MOVED else _MOVED / size  # a blur grows as its square
    return found
