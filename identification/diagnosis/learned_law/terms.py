"""The library of terms of learned laws, and best subsets of them in a linear model of the residuals.

Coefficients c change the residuals r by S c. S⊥ is the part of S that a refit of the unknowns cannot compensate. With
G = S⊥ᵀS⊥ and h = −S⊥ᵀr a subset of the terms lowers χ² by hᵀG⁻¹h of its rows and columns. The drag b stays in G, at
place 0, since it must not become negative. Subsets grow by one term and exchange terms one at a time (Miller 2002,
Subset Selection in Regression, section 3).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.effects import LEARNED, effect
from cradle_env.effects.learned_force import ALONG_STRINGS, IN_TIME, learned_force
from cradle_env.effects.radial_elasticity import radial_elasticity
from cradle_env.parameter_name import ParameterName
from cradle_env.threads import in_threads
from identification.diagnosis.criteria import MISSPECIFIED_GAP
from identification.diagnosis.selection.candidates import with_effects
from identification.diagnosis.selection.evidence import schwarz_evidence
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import FitResult, orthonormal_basis
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.likelihood import Likelihood
from identification.inference.noise_model import rms
from identification.inference.nonsmooth import column_norms
from identification.inference.start_points import point_at

#: Most terms of a law.
MAX_TERMS = 10
#: A term is left out if the unknowns absorb all but this fraction of its effect on the residuals.
_MIN_VISIBLE_SHARE = 1e-3
#: Lowest relative change of b: drag stays positive.
_MIN_B_CHANGE = -0.9
#: First step of a coefficient in finite differences [its unit].
_STEP = 1e-6
#: RMS change of the residuals by which the step is chosen [noise].
TARGET_SHIFT = 0.3
#: Most attempts to find that step.
_TRIES = 6
#: The unknown that periodic terms share.
FREQUENCY = f"{learned_force.name}.frequency"

Scales = Mapping[str, float]


@dataclass(frozen=True)
class Term:
    """One term of the library.

    Parameters
    ----------
    effect, key : str
        The effect and the key of the coefficient.
    element : int
        Bob or pair on which the term acts, from 1; 0 if one coefficient applies to all.
    single : bool
        Whether the coefficient does not distinguish bobs or pairs.
    """

    effect: str
    key: str
    element: int
    single: bool = False

    @property
    def name(self) -> str:
        """Name of its unknown."""
        return f"{self.effect}.{self.key}" + ("" if self.single else f"[{self.element or '*'}]")

    @property
    def in_time(self) -> bool:
        """Whether it is a periodic force, whose frequency is another unknown of the law."""
        return self.effect == learned_force.name and self.key in IN_TIME

    def excludes(self, other: Term) -> bool:
        """Whether both set the same coefficient."""
        same = (self.effect, self.key) == (other.effect, other.key)
        return same and (self.element == other.element or not self.element or not other.element)


def library(cradle: Cradle) -> tuple[Term, ...]:
    """All terms that a cradle can have, those on all bobs first; forces along strings need elastic strings."""
    terms = []
    for declared in LEARNED:
        for p in declared.strengths:
            several = p.count(cradle.bobs)
            if (declared.acts_on == "contact" or p.each == "gap") and cradle.bobs == 1:
                continue
            if p.key in ALONG_STRINGS and not cradle.has(radial_elasticity.name):
                continue
            terms += [Term(declared.name, p.key, i, not p.each) for i in range(1 if several == 1 else several + 1)]
    return tuple(sorted(terms, key=lambda term: term.element > 0))


def selection_cost(cradle: Cradle, terms: int) -> float:
    """Log evidence that choosing this many terms from the library costs: the logarithm of the number of choices."""
    return math.log(math.comb(len(library(cradle)), terms))


def selection_cost_beside(fitted: FitResult, terms: int) -> float:
    """The same for a law added to a fitted model; 0 if that is misspecified.

    For a misspecified model the residuals set the scale of the evidence, and a few terms do not complete it.
    """
    far = rms(fitted.residuals[: fitted.count]) > MISSPECIFIED_GAP
    return 0.0 if far else selection_cost(fitted.cradle, terms)


def with_terms(experiment: Experiment, scales: Scales, terms: Sequence[Term]) -> Experiment:
    """The experiment with these terms in its model.

    Their coefficients start at zero and are to be inferred, as is the frequency of periodic terms. scales: see
    `law_scales`.
    """
    names = dict.fromkeys(term.effect for term in terms)
    values: dict[str, dict[str, Any]] = {}
    for name in names:
        parameters = effect(name).parameters
        values[name] = {
            p.key: p.repeat(p.absent, experiment.cradle.bobs) if p.is_strength else scales[p.key] for p in parameters
        }
    unknown = [term.name for term in terms]
    unknown += [FREQUENCY] if any(term.in_time for term in terms) else []
    return with_effects(experiment, values, tuple(unknown)) if terms else experiment


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A linear model of the residuals of a fit.

    terms, columns (R + P, K): change of the residuals per coefficient of each term. basis (R + P, rank): orthonormal;
    the part of the residuals that the unknowns absorb, b excepted. visible (K',): indices of the terms that the
    unknowns do not absorb. G (1 + K', 1 + K'), h (1 + K',): of b and of these terms, see the module.
    """

    fitted: FitResult
    terms: tuple[Term, ...]
    columns: np.ndarray
    basis: np.ndarray
    visible: np.ndarray
    G: np.ndarray
    h: np.ndarray

    @classmethod
    def of(cls, fitted: FitResult, scales: Scales, had: Sequence[Term] = ()) -> LinearModel:
        """The linear model of all terms but periodic ones and those that the terms `had` exclude."""
        terms = tuple(
            term for term in library(fitted.cradle)
            if not term.in_time and not any(term.excludes(own) for own in had)
        )  # fmt: skip
        columns = in_threads(lambda term: residual_derivative(fitted, scales, term), terms, fitted.likelihood.workers)
        b = fitted.likelihood.names.index("b")
        basis = orthonormal_basis(np.delete(fitted.jacobian, b, axis=1))
        return cls._with(fitted, terms, np.column_stack(columns), basis)

    def with_common_terms(self) -> LinearModel:
        """The linear model of the terms that are common to all bobs, pairs or impacts."""
        common = [i for i, term in enumerate(self.terms) if not term.element]
        return self._with(self.fitted, tuple(self.terms[i] for i in common), self.columns[:, common], self.basis)

    def with_columns(self, terms: Sequence[Term], columns: np.ndarray) -> LinearModel:
        """The linear model with more terms and their columns (R + P, K)."""
        return self._with(self.fitted, (*self.terms, *terms), np.column_stack([self.columns, columns]), self.basis)

    @classmethod
    def _with(cls, fitted: FitResult, terms: tuple[Term, ...], columns: np.ndarray, basis: np.ndarray) -> LinearModel:
        own = np.column_stack([fitted.jacobian[:, fitted.likelihood.names.index("b")], columns])
        lengths = np.linalg.norm(own, axis=0)
        left = own / np.where(lengths > 0.0, lengths, 1.0)
        left -= basis @ (basis.T @ left)
        seen = np.flatnonzero(np.linalg.norm(left[:, 1:], axis=0) > _MIN_VISIBLE_SHARE)
        left = left[:, [0, *(1 + seen)]] * lengths[[0, *(1 + seen)]]
        return cls(fitted, terms, columns, basis, seen, left.T @ left, -left.T @ fitted.residuals)

    def term(self, place: int) -> Term:
        """The term at a place of G, from 1."""
        return self.terms[self.visible[place - 1]]

    @functools.cached_property
    def _gains(self) -> dict[tuple[int, ...], float]:
        return {}

    def chi2_gain(self, subset: tuple[int, ...]) -> float:
        """χ² that b and a subset save together."""
        if subset not in self._gains:
            own, c = [0, *subset], self.coefficients(subset)
            self._gains[subset] = float(2.0 * c @ self.h[own] - c @ self.G[np.ix_(own, own)] @ c)
        return self._gains[subset]

    def coefficients(self, subset: tuple[int, ...]) -> np.ndarray:
        """(1 + k,): best change of b's coordinate, then best coefficients of a subset."""
        own, least = [0, *subset], _MIN_B_CHANGE * self.fitted.scale_of("b")
        size = np.sqrt(np.diag(self.G)[own])
        size[size == 0.0] = 1.0
        G, h = self.G[np.ix_(own, own)] / np.outer(size, size) + 1e-9 * np.eye(len(own)), self.h[own] / size
        c = np.linalg.solve(G, h) / size
        if c[0] < least:
            rest = np.linalg.solve(G[1:, 1:], h[1:] - least * size[0] * G[1:, 0]) / size[1:]
            c = np.concatenate([[least], rest])
        return c

    def subset_path(self, most: int) -> list[tuple[int, ...]]:
        """The best subset of each size: one term is added to the last one, then terms are exchanged one at a time."""
        best: tuple[int, ...] = ()
        path = []
        for _ in range(min(most, len(self.visible))):
            wider = self.supersets(best)
            if not wider:
                break
            best = max(wider, key=self.chi2_gain)
            while True:
                exchanged = [new for i in best for new in self.supersets(tuple(j for j in best if j != i))]
                better = max(exchanged, key=self.chi2_gain)
                if self.chi2_gain(better) <= self.chi2_gain(best) * (1.0 + 1e-9):
                    break
                best = better
            path.append(best)
        return path

    def supersets(self, subset: tuple[int, ...]) -> list[tuple[int, ...]]:
        """All subsets with one more term."""
        return [
            tuple(sorted((*subset, j))) for j in range(1, len(self.h))
            if not any(self.term(j).excludes(self.term(i)) for i in subset)
        ]  # fmt: skip

    def solve(self, subset: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
        """(residuals with a subset (R + P,), changes of the unknowns and coefficients of the subset (D + k,))."""
        c, J = self.coefficients(subset), self.fitted.jacobian
        b = self.fitted.likelihood.names.index("b")
        others = np.delete(J, b, axis=1)
        left = self.fitted.residuals + c[0] * J[:, b] + self.columns[:, [self.visible[j - 1] for j in subset]] @ c[1:]
        size = column_norms(others)
        rest = -np.linalg.lstsq(others / size, left, rcond=1e-10)[0] / size
        return left + others @ rest, np.concatenate([np.insert(rest, b, c[0]), c[1:]])

    def log_evidence(self, subset: tuple[int, ...], inflation: float, effective: float) -> float:
        """Log evidence over the model alone: ½ (Δχ²/c − k ln n_eff) less the cost of choosing the terms.

        The frequency of periodic terms counts as an unknown.
        """
        unknowns = len(subset) + any(self.term(i).in_time for i in subset)
        gained = schwarz_evidence(self.chi2_gain(subset) - self.chi2_gain(()), unknowns, inflation, effective)
        return gained - selection_cost_beside(self.fitted, len(subset))

    def values(self, subset: tuple[int, ...]) -> dict[str, float]:
        """Unknowns of the cradle and coefficients of a subset at the minimum of χ² in the linear model."""
        step = self.solve(subset)[1]
        values = {}
        for u, z, d in zip(self.fitted.likelihood.unknowns, self.fitted.point, step, strict=False):
            if ParameterName.parse(u.name).run is None:
                values[u.name] = float(u.value(z)) * max(1.0 + d, 0.1) if u.log else float(z + d)
        coefficients = step[len(self.fitted.point) :]
        return values | {self.term(j).name: float(c) for j, c in zip(subset, coefficients, strict=True)}


def residual_derivative(fitted: FitResult, scales: Scales, term: Term, step: float = _STEP) -> np.ndarray:
    """d residuals / d coefficient, (R + P,), by a finite difference; 0 if the term cannot be simulated.

    step: first try [unit of the coefficient]; it is then adapted to change the residuals by TARGET_SHIFT, as far as it
    can be simulated.
    """
    new, own = with_terms(fitted.experiment, scales, (term,)), fitted.likelihood
    likelihood = Likelihood(new, own.rows, own.workers)
    derivative = np.zeros(len(fitted.residuals))
    for _ in range(_TRIES):
        try:
            moved = likelihood.residuals(point_at(likelihood, {**fitted.values, term.name: step})) - fitted.residuals
        except ImpossibleModelError:
            break
        derivative, size = moved / step, rms(moved)
        if size == 0.0 or TARGET_SHIFT / 3.0 < size < 3.0 * TARGET_SHIFT:
            break
        step *= TARGET_SHIFT / size
    return derivative
