"""Whether several runs are of one cradle.

Where a joint fit leaves far more than noise, the check fits each run alone, with its length free. Runs of different
cradles then leave only noise, and their lengths or k_f differ far beyond their uncertainty.

A missing effect behaves otherwise. It leaves residuals in each run, or it biases b as well, differently at each
amplitude. So a difference in k_f counts only if all other unknowns agree.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np

from cradle_env.cradle import FIELDS
from identification.diagnosis.criteria import DEFAULT_CRITERIA, Criteria, may_hold_faults
from identification.experiment.run import Prior
from identification.inference.fit_result import FitResult
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import find_mode
from identification.progress import Progress

#: Share of the joint fit's excess χ² that fits of each run alone may leave: different cradles leave only noise.
_MAX_LEFT_SHARE = 0.1
#: Difference [standard deviations] up to which unknowns other than length and k_f agree.
_AGREE_SD = 5.0
#: Relative standard deviation of the length's prior, where the experiment states none.
_LENGTH_SD = 0.03


def check_run_consistency(
    fitted: FitResult, seed: int, progress: Progress, criteria: Criteria = DEFAULT_CRITERIA
) -> None:
    """Raises ValueError, naming two runs and the unknown that differs, if they are of different cradles."""
    runs = fitted.experiment.runs
    if len(runs) < 2 or not may_hold_faults(fitted, criteria):
        return
    excess_alone, estimates = 0.0, []
    for k, run in enumerate(runs):
        progress("check", k / len(runs), f"{run.file} alone")
        excess, own = _fit_alone(fitted, k, seed)
        excess_alone += excess
        estimates.append(own)
    if excess_alone > _MAX_LEFT_SHARE * (fitted.chi2 - fitted.count):
        return
    for i, j in itertools.combinations(range(len(runs)), 2):
        name = _differing_unknown(estimates[i], estimates[j], criteria)
        if name is not None:
            (one, sd), (other, other_sd) = estimates[i][name], estimates[j][name]
            raise ValueError(
                f"{runs[j].file} and {runs[i].file} are not of one cradle: fitted alone, their {name} is"
                f" {other:.5g} ± {other_sd:.1g} and {one:.5g} ± {sd:.1g} {FIELDS[name][0]}; diagnose them apart, or"
                " check what is stated of each"
            )


#: Value and standard deviation of each unknown of the cradle, by name.
Estimates = dict[str, tuple[float, float]]


def _differing_unknown(one: Estimates, other: Estimates, criteria: Criteria) -> str | None:
    """The name of the unknown that two cradles differ in; None if they may be one cradle."""
    apart = {name: abs(other[name][0] - value) / math.hypot(sd, other[name][1]) for name, (value, sd) in one.items()}
    least_of = {"length": criteria.min_length_difference, "k_f": criteria.min_k_f_difference}
    for name, least in least_of.items():
        if (
            name in apart
            and apart[name] > criteria.run_difference_sd
            and abs(other[name][0] / one[name][0] - 1.0) > least
        ):
            if name == "length" or all(z < _AGREE_SD for key, z in apart.items() if key not in least_of):
                return name
    return None


def _fit_alone(fitted: FitResult, k: int, seed: int) -> tuple[float, Estimates]:
    """(excess of χ² over the number of readings, estimates) of a fit to run k alone."""
    together = fitted.experiment
    length = together.cradle.length
    infer = {"length": Prior(mean=length, sd=_LENGTH_SD * length), **together.infer}
    likelihood = Likelihood(
        dataclasses.replace(together, runs=(together.runs[k],), infer=infer),
        [fitted.likelihood.rows[k]],
        fitted.likelihood.workers,
    )
    _, mode = find_mode(likelihood, seed)
    values, deviations = likelihood.values(mode.point), np.sqrt(np.diag(mode.covariance))
    estimates = {}
    for u, sd in zip(likelihood.unknowns, deviations, strict=True):
        if not u.nuisance:
            estimates[u.name] = values[u.name], float(sd * (values[u.name] if u.log else 1.0))
    return mode.cost - FitResult(likelihood, mode.point).count, estimates
