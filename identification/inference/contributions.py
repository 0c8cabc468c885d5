"""What each measurement contributes to a joint posterior, and whether two of them disagree.

A source is all runs of readings ("trajectories"), all runs of impacts ("sound"), or one instrument. Runs enter by the
normal approximation of their posterior about its modes, instruments by their constraints. Least squares over any set of
sources then takes no simulation. It gives the posterior of each source alone, and of all without each.

Two sources disagree if no cradle agrees with both: the least χ² of the two is larger than chance allows. The number of
degrees of freedom is that of the residuals less that of the unknowns that they determine. One probability counts for
the number of pairs that were compared (Bonferroni).
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from identification.experiment.run import Run
from identification.inference.laplace import laplace_approximation
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import refit
from identification.inference.nonsmooth import jacobian_at_mode
from identification.inference.normal_approximation import normal_approximation
from identification.inference.search_options import DEFAULT, SearchOptions
from identification.inference.source_combination import Combination, Source, SourceMode
from identification.progress import Progress

#: Two sources disagree if the probability of their difference by chance, over all pairs, is below this.
IMPROBABLE = 0.01


@dataclass(frozen=True)
class Disagreement:
    """Two sources that disagree; the same twice if a source disagrees with the model.

    p: probability of so large a difference by chance, over all pairs that were compared; parameter: that in which they
    differ most, or None.
    """

    between: tuple[str, str]
    p: float
    parameter: str | None


@dataclass(frozen=True)
class Contributions:
    """The posterior of each source alone, and of all without each.

    units: of parameters and of "lambda", by name. alone, without: by name of a source, statistics (median, sd, ci68,
    ci95) by name of a parameter; None where the sources do not tell it.
    """

    units: Mapping[str, str]
    alone: Mapping[str, Mapping[str, Any]]
    without: Mapping[str, Mapping[str, Any]]
    disagreements: tuple[Disagreement, ...]

    def content(self) -> dict[str, Any]:
        """As JSON files have it."""
        return {**vars(self), "disagreements": [dataclasses.asdict(one) for one in self.disagreements]}

    @classmethod
    def from_content(cls, content: Mapping[str, Any]) -> Contributions:
        """Of what `content` gives."""
        found = [Disagreement(tuple(one["between"]), one["p"], one["parameter"]) for one in content["disagreements"]]
        return cls(**{**content, "disagreements": tuple(found)})


def measure_contributions(
    likelihood: Likelihood,
    point: np.ndarray,
    seed: int = 0,
    progress: Progress | None = None,
    options: SearchOptions = DEFAULT,
) -> Contributions | None:
    """Compute the posterior of each source alone, and of all without each.

    Parameters
    ----------
    likelihood : Likelihood
        Of all sources.
    point : ndarray of shape (D,)
        The best point of the joint posterior.
    seed : int
        Of the search and of the draws for λ.
    progress : callable, optional
        Called with (stage, fraction done, text).
    options : SearchOptions
        Options of the search for the modes of the runs.

    Returns
    -------
    Contributions or None
        None if there is one source alone.
    """
    groups = _groups(likelihood.experiment.runs)
    constraints = likelihood.experiment.constraints
    if len(groups) + len(constraints) < 2:
        return None
    report = progress or (lambda *_: None)
    sources = []
    for k, (name, runs) in enumerate(groups.items()):
        report("contributions", k / (len(groups) + 1), f"the {name} alone")
        sources.append(Source(name, _modes(likelihood, runs, point, seed, options)))
    kinds = [constraint.kind for constraint in constraints]
    for constraint in constraints:
        several = kinds.count(constraint.kind) > 1
        sources.append(Source(constraint.file if several else constraint.kind, (), constraint))
    report("contributions", len(groups) / (len(groups) + 1), "without each")
    combination = Combination(likelihood, point, seed)
    alone = {one.name: combination.posterior([one]) for one in sources}
    without = {one.name: combination.posterior([other for other in sources if other is not one]) for one in sources}
    units = {u.name: u.unit for u in likelihood.cradle_unknowns} | {"lambda": "1/s"}
    return Contributions(units, alone, without, _disagreements(combination, sources, alone))


def _disagreements(
    combination: Combination, sources: Sequence[Source], alone: Mapping[str, Mapping[str, Any]]
) -> tuple[Disagreement, ...]:
    """Pairs of sources that no cradle agrees with, and sources that the model does not agree with."""
    compared = {}
    for a, b in itertools.combinations_with_replacement(sources, 2):
        p = combination.agreement([a] if a is b else [a, b])
        if p is not None:
            compared[a.name, b.name] = p
    found = []
    for (a, b), p in compared.items():
        if (over_all := min(1.0, p * len(compared))) < IMPROBABLE:
            found.append(Disagreement((a, b), over_all, _most_apart(alone[a], alone[b])))
    return tuple(sorted(found, key=lambda one: one.p))


def _most_apart(a: Mapping[str, Any], b: Mapping[str, Any]) -> str | None:
    """The parameter that both tell and in which they differ most."""
    apart = {
        name: abs(a[name]["median"] - b[name]["median"]) / math.hypot(a[name]["sd"], b[name]["sd"])
        for name in a
        if name != "lambda" and a[name] is not None and b[name] is not None
    }
    return max(apart, key=apart.__getitem__) if apart and max(apart.values()) > 0.0 else None


def _groups(runs: Sequence[Run]) -> dict[str, list[int]]:
    groups: dict[str, list[int]] = {}
    for k, run in enumerate(runs):
        groups.setdefault("sound" if run.of_impacts else "trajectories", []).append(k)
    return groups


def _modes(
    likelihood: Likelihood, runs: list[int], point: np.ndarray, seed: int, options: SearchOptions
) -> tuple[SourceMode, ...]:
    """The best mode of some runs alone, and that near the joint one."""
    experiment = dataclasses.replace(
        likelihood.experiment, runs=tuple(likelihood.experiment.runs[k] for k in runs), constraints=()
    )
    alone = Likelihood(experiment, [likelihood.rows[k] for k in runs], likelihood.workers, likelihood.parameters)
    count = len(alone.cradle_unknowns)
    weighted, best = normal_approximation(alone, seed, None, options)
    inflation = max(weighted.noise_model.inflations)
    prior = np.diag([0.0 if math.isnan(u.sd) else u.sd**-2.0 for u in alone.cradle_unknowns])

    def mode(at: np.ndarray, covariance: np.ndarray, squares: float) -> SourceMode:
        information = np.linalg.inv(covariance[:count, :count]) - prior
        return SourceMode(at[:count], information, squares)

    # The joint point, with the unknowns of these runs alone.
    own = [u.name for run in runs for u in likelihood.unknowns_by_run[run]]
    places = [*range(count), *(likelihood.names.index(name) for name in own)]
    _, near = refit(weighted, point[places], options)
    residuals = [weighted.residuals(at) for at in (best.point, near)]
    squares = [float(np.sum(one**2)) / inflation for one in residuals]
    J = jacobian_at_mode(weighted, near, residuals[1])
    wide = inflation * laplace_approximation(weighted, near, J).covariance
    modes = [mode(best.point, best.covariance, squares[0]), mode(near, wide, squares[1])]
    least = min(squares)
    modes = sorted((dataclasses.replace(one, excess=one.excess - least) for one in modes), key=lambda one: one.excess)
    return tuple(modes)
