"""Sets of sources combined by least squares, without a simulation: posteriors, and how far two sources agree."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtrc, ndtri

from cradle_env.effects import effect
from cradle_env.parameter_name import ParameterName
from cradle_env.simulation import simulate_batch
from cradle_env.synchronization import WINDOW
from identification.experiment.constraint import Constraint
from identification.inference.least_squares import bounds, difference_steps
from identification.inference.likelihood import LAMBDA_RATE, TOLERANCE, Likelihood
from identification.inference.statistics import statistics
from identification.inference.unknowns import Unknown

#: Standard deviation of an unknown, in the half width of its search box, beyond which a source does not tell it.
_TOLD = 2.0
#: Half width of the search box of an unknown that is not searched [its unit].
_PLAIN_WIDTH = 1.0
#: Standard deviation of the weak prior that keeps unknowns in place that no source tells, in the same unit.
_OPEN = 10.0
#: Degrees of freedom below which two sources have nothing in common.
_LEAST_FREEDOM = 0.5
#: Draws for which λ is simulated: the ends of its 95 % interval are then known to a fifth of its sd.
_DRAWS = 100


@dataclass(frozen=True)
class SourceMode:
    """A mode of the runs of a source: mean (C,) and information (C, C) of the cradle's unknowns, χ² above the best."""

    mean: np.ndarray
    information: np.ndarray
    excess: float


@dataclass(frozen=True)
class Source:
    """What tells of the cradle: modes of runs, or a constraint.

    Parameters
    ----------
    name : str
        "trajectories", "sound" or the name of an instrument.
    modes : tuple of SourceMode
        Modes of the runs, the best first; empty for an instrument.
    constraint : Constraint, optional
        That of an instrument.
    """

    name: str
    modes: tuple[SourceMode, ...] = ()
    constraint: Constraint | None = None


class Combination:
    """Least squares over sets of sources, about a point of the joint posterior."""

    def __init__(self, likelihood: Likelihood, point: np.ndarray, seed: int):
        self.likelihood, self.seed = likelihood, seed
        self.unknowns = likelihood.cradle_unknowns
        self.point = point[: len(self.unknowns)]
        self.low, self.high = (ends[: len(self.unknowns)] for ends in bounds(likelihood))
        self.steps = difference_steps(likelihood)[: len(self.unknowns)]
        self.widths = np.array([_width(u) for u in self.unknowns])
        self.fixed = likelihood.values(point)

    def posterior(self, sources: Sequence[Source]) -> dict[str, Any]:
        """Statistics of each parameter and of λ."""
        _, at, covariance = self.fit(sources)
        sd = np.sqrt(np.diag(covariance))
        told = [s < _TOLD * width for s, width in zip(sd, self.widths, strict=True)]
        found: dict[str, Any] = {}
        for u, z, s, is_told in zip(self.unknowns, at, sd, told, strict=True):
            if not u.nuisance:
                found[u.name] = _statistics(u, float(z), float(s)) if is_told else None
        moving = [t for u, t in zip(self.unknowns, told, strict=True) if not _of_instrument(u)]
        found["lambda"] = self.newton_exponent(at, covariance) if all(moving) else None
        return found

    def fit(self, sources: Sequence[Source]) -> tuple[float, np.ndarray, np.ndarray]:
        """(least χ² of the sources, point (C,), covariance (C, C)) over all choices of modes."""
        choices = itertools.product(*(one.modes or (None,) for one in sources))
        return min((self._fit(sources, chosen) for chosen in choices), key=lambda fitted: fitted[0])

    def _fit(
        self, sources: Sequence[Source], chosen: Sequence[SourceMode | None]
    ) -> tuple[float, np.ndarray, np.ndarray]:  # fmt: skip
        roots = [None if mode is None else _root(mode.information) for mode in chosen]

        def told(z: np.ndarray) -> np.ndarray:
            return np.concatenate([
                root @ (z - mode.mean) if mode is not None and root is not None else self._constraint(source, z)
                for source, mode, root in zip(sources, chosen, roots, strict=True)
            ])  # fmt: skip

        def residuals(z: np.ndarray) -> np.ndarray:
            return np.concatenate([told(z), self._prior(z), (z - self.point) / (_OPEN * self.widths)])

        start = np.clip(next((mode.mean for mode in chosen if mode is not None), self.point), self.low, self.high)
        found = least_squares(
            residuals, start, "3-point", (self.low - 1e-12, self.high + 1e-12), x_scale=self.steps, xtol=1e-12
        )
        covariance = np.linalg.inv(found.jac.T @ found.jac)
        excess = sum(mode.excess for mode in chosen if mode is not None)
        return float(np.sum(told(found.x) ** 2)) + excess, found.x, covariance

    def _cradle(self, z: np.ndarray):
        values = {u.name: float(u.value(coordinate)) for u, coordinate in zip(self.unknowns, z, strict=True)}
        return self.likelihood.cradle(self.fixed | values)

    def _constraint(self, source: Source, z: np.ndarray) -> np.ndarray:
        assert source.constraint is not None
        return source.constraint.residuals(self._cradle(z))

    def _prior(self, z: np.ndarray) -> np.ndarray:
        pairs = zip(self.unknowns, z, strict=True)
        return np.array([(u.value(coordinate) - u.mean) / u.sd for u, coordinate in pairs if not math.isnan(u.sd)])

    def newton_exponent(self, at: np.ndarray, covariance: np.ndarray) -> dict[str, Any] | None:
        """Statistics of λ of the first run's δ and release, over draws; None where it is not defined."""
        run, bobs = self.likelihood.experiment.runs[0], self.likelihood.experiment.cradle.bobs
        if run.release is None or bobs == 1:
            return None
        release = run.release.release
        try:
            release.check_synchronizes(self.likelihood.experiment.cradle)
        except ValueError:
            return None
        rng = np.random.default_rng(self.seed)
        points = rng.multivariate_normal(at, covariance, _DRAWS, method="cholesky")
        cradles = [self._cradle(np.clip(point, self.low, self.high)) for point in points]
        runs = simulate_batch(
            cradles, [release] * _DRAWS, WINDOW[1], LAMBDA_RATE, tolerance=TOLERANCE, workers=self.likelihood.workers
        )
        return statistics(np.array([one.newton_exponent() for one in runs]))

    def agreement(self, pair: Sequence[Source]) -> float | None:
        """Probability by chance of a difference as large as that of two sources; of one source from the model.

        None if they have nothing in common.
        """
        squares, at, _ = self.fit(pair)
        freedom = self._freedom(pair, at)
        if len(pair) > 1:  # what a source does not explain by itself is no difference from another one
            squares -= sum(self.fit([one])[0] for one in pair)
            freedom -= sum(self._freedom([one], at) for one in pair)
        return float(chdtrc(freedom, max(squares, 0.0))) if freedom > _LEAST_FREEDOM else None

    def _freedom(self, sources: Iterable[Source], at: np.ndarray) -> float:
        """Residuals less the unknowns that they determine, beside the priors."""
        rows = []
        for source in sources:
            if source.modes:
                rows.append(_root(source.modes[0].information))
            else:
                columns = [
                    (self._constraint(source, at + step) - self._constraint(source, at - step)) / (2.0 * step.sum())
                    for step in np.diag(self.steps)
                ]
                rows.append(np.array(columns).T)
        J = np.concatenate(rows) * self.widths
        prior = np.array([0.0 if math.isnan(u.sd) else u.sd**-2.0 for u in self.unknowns]) * self.widths**2
        information = J.T @ J
        determined = np.trace(np.linalg.solve(information + np.diag(prior + _OPEN**-2.0), information))
        # A direction of a run's information that says nothing is no residual.
        strengths = np.concatenate([np.linalg.norm(one * self.widths, axis=1) ** 2 for one in rows])
        return float(np.sum(strengths / (strengths + _OPEN**-2.0)) - determined)


def _width(u: Unknown) -> float:
    if not math.isnan(u.sd):
        return u.sd
    return u.search if u.search > 0.0 else _PLAIN_WIDTH


def _root(information: np.ndarray) -> np.ndarray:
    """R with Rᵀ R the information (C, C), without directions that rounding makes negative."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    return (np.sqrt(np.maximum(values, 0.0)) * vectors).T * scale


def _of_instrument(u: Unknown) -> bool:
    owner = ParameterName.parse(u.name).effect
    return bool(owner) and effect(owner).acts_on == "measurement"


def _statistics(u: Unknown, z: float, sd: float) -> dict[str, Any]:
    """Statistics of an unknown whose sampled coordinate is normal."""
    low95, low68, median, high68, high95 = (float(u.value(z + sd * ndtri(q))) for q in (0.025, 0.16, 0.5, 0.84, 0.975))
    spread = median * math.exp(0.5 * sd**2) * math.sqrt(math.expm1(sd**2)) if u.log else sd
    return {"median": median, "sd": spread, "ci68": [low68, high68], "ci95": [low95, high95]}
