"""A set of candidates over the base model, and the modes of its likelihood that are known."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from identification.diagnosis.criteria import EVALUATIONS, FINAL_EVALUATIONS, MAX_DISTANCE, MODES_KEPT
from identification.diagnosis.selection.continuation import (
    Basin,
    Minimum,
    distinct_basins,
    refine_all,
    unit_of_chi2,
)
from identification.diagnosis.selection.evidence import LaplaceTerms
from identification.diagnosis.selection.fit_cache import FitCache, fit_key
from identification.inference.fit_result import FitResult
from identification.inference.least_squares import cost
from identification.inference.likelihood import Likelihood
from identification.inference.nonsmooth import descend
from identification.inference.start_points import flatten_values, point_at

#: Labels of candidates.
Names = frozenset[str]


@dataclass(eq=False)
class Model:
    """A set of candidates, the effects that they bring, and the modes, the best first.

    is_finished: whether what was near the best was followed to its modes, and not only approached. store: keeps what
    was found, so that an interrupted search goes on.
    """

    names: Names
    effects: frozenset[str]
    likelihood: Likelihood
    store: FitCache
    modes: list[Minimum] = field(default_factory=list)
    is_finished: bool = False
    _approached: list[Minimum] = field(default_factory=list)
    _fitted: FitResult | None = None
    _terms: LaplaceTerms | None = None

    @property
    def label(self) -> str:
        """Its candidates, as tables have them."""
        return " + ".join(sorted(self.names)) or "base"

    @property
    def chi2(self) -> float:
        """That of the best mode; infinite if there is none."""
        return self.modes[0].chi2 if self.modes else math.inf

    @property
    def unit(self) -> float:
        """What one unit of χ² is worth beside what this model leaves."""
        return unit_of_chi2(self.likelihood, self.chi2)

    @property
    def fitted(self) -> FitResult:
        """The best mode as a fit."""
        if self._fitted is None:
            self._fitted = FitResult(self.likelihood, self.modes[0].point)
        return self._fitted

    @property
    def other_modes(self) -> tuple[FitResult, ...]:
        """The other modes as fits."""
        return tuple(FitResult(self.likelihood, mode.point) for mode in self.modes[1:])

    @property
    def terms(self) -> LaplaceTerms:
        """What its evidence needs."""
        if self._terms is None:
            self._terms = LaplaceTerms.of(self.fitted)
        return self._terms

    @property
    def inflation(self) -> float:
        """c of its residuals."""
        return self.fitted.effective_sample.inflation

    def approach(self, what: str, starts: Callable[[], Sequence[np.ndarray]]) -> None:
        """Adds what is near the modes about several points (D,), by a few evaluations over all data.

        What lies in the basin of a mode that is finished leads nowhere else. what: under which it is stored.
        """

        def find() -> list[Minimum]:
            found = refine_all(self.likelihood, starts(), EVALUATIONS)
            unit = unit_of_chi2(self.likelihood, found[0].chi2) if found else 1.0
            return [basin.minimum for basin in distinct_basins(self.likelihood, found, unit)]

        near = self._stored(what, find)
        if self.modes and not self._approached:
            near = [one for one in near if not self._best_basin.holds(one)]
        self._approached += near
        self._add(near)

    def finish(self) -> None:
        """Follows what was approached to its modes, and the best of them on across jumps of the readings.

        A row of bobs and its mirror image swing nearly alike: the best is tried with the row reversed, too.
        """
        self.is_finished = True
        limit = self.chi2 + MAX_DISTANCE * self.unit
        near, self._approached = [one for one in self._approached if one.chi2 < limit], []

        def find() -> list[Minimum]:
            found = refine_all(self.likelihood, [one.point for one in near], FINAL_EVALUATIONS)
            found += refine_all(self.likelihood, _reversed_row(self.likelihood, found[0].point), FINAL_EVALUATIONS)
            found.sort(key=lambda one: one.chi2)
            if (reached := descend(self.likelihood, found[0].point)) is not found[0].point:
                found[0] = Minimum(reached, cost(self.likelihood, reached))
            basins = distinct_basins(self.likelihood, found, unit_of_chi2(self.likelihood, found[0].chi2))
            return [basin.minimum for basin in basins]

        if near:
            found = self._stored(f"finished {[one.point.tolist() for one in near]}", find)
            self.modes = [mode for mode in self.modes if mode not in near]
            self._add(found)

    def finish_from(self, start: np.ndarray) -> None:
        """Finishes it from a point (D,) too, unless that lies in the basin of the best mode."""
        if not self.modes or not self._best_basin.holds(Minimum(start, cost(self.likelihood, start))):
            self.approach(f"at {start.tolist()}", lambda: [start])
            self.finish()

    @property
    def _best_basin(self) -> Basin:
        return Basin(self.modes[0], self.terms.all_information, self.unit)

    def _add(self, modes: Iterable[Minimum]) -> None:
        before = self.chi2
        self.modes = sorted([*self.modes, *modes], key=lambda mode: mode.chi2)[:MODES_KEPT]
        if self.chi2 < before:
            self._fitted = self._terms = None

    def _stored(self, what: str, find: Callable[[], list[Minimum]]) -> list[Minimum]:
        """Minima found once, kept as one vector."""
        key = fit_key(what, self.likelihood.experiment)
        rows = self.store.point(key, lambda: np.array([[*one.point, one.chi2] for one in find()]).ravel())
        return [Minimum(row[:-1], float(row[-1])) for row in rows.reshape(-1, len(self.likelihood.names) + 1)]


def _reversed_row(likelihood: Likelihood, point: np.ndarray) -> list[np.ndarray]:
    """The point (D,) with the values of each bob or gap in reverse order; none if that changes nothing."""
    values = likelihood.values(point)
    for name, own in likelihood.cradle(values).effects.items():
        several = {key: value[::-1] for key, value in own.items() if isinstance(value, tuple)}
        values = values | flatten_values(name, several)
    there = point_at(likelihood, values)
    return [] if np.array_equal(there, point) else [there]
