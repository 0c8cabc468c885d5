"""What a joint posterior says of one case."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from cradle_env import simulate, simulate_batch
from identification import Experiment, diagnose
from identification.inference.contributions import measure_contributions
from identification.inference.likelihood import Likelihood, shift_release_angle
from identification.inference.normal_approximation import normal_approximation
from identification.inference.statistics import statistics

#: Draws of the normal approximation of the joint posterior.
_DRAWS = 200
_NAMES = ("k_f", "kappa", "b")


def judge(experiment: Experiment, truth: dict[str, float], with_diagnosis: bool) -> dict[str, Any]:
    """Truth of λ, statistics from all, from each source alone and from all without each, disagreements.

    with_diagnosis: whether to diagnose the experiment, too.
    """
    release = experiment.runs[0].release
    assert release is not None
    true = simulate(experiment.cradle.replace(**truth), release.release, 60.0, 240.0, ledger=False)
    likelihood, mode = normal_approximation(Likelihood(experiment))
    points = np.random.default_rng(0).multivariate_normal(mode.point, mode.covariance, _DRAWS, method="cholesky")
    values = [likelihood.values(point) for point in points]
    runs = simulate_batch(
        [likelihood.cradle(one) for one in values],
        [shift_release_angle(release.release, one.get("release_angle_error@1", 0.0)) for one in values],
        60.0,
    )
    joint = {name: statistics(np.array([one[name] for one in values])) for name in _NAMES}
    joint["lambda"] = statistics(np.array([run.newton_exponent() for run in runs]))
    found = measure_contributions(likelihood, mode.point)
    assert found is not None
    row: dict[str, Any] = {
        "truth": truth | {"lambda": true.newton_exponent()},
        "joint": joint,
        "alone": found.alone,
        "without": found.without,
        "disagreements": [dataclasses.asdict(one) for one in found.disagreements],
    }
    if with_diagnosis:
        diagnosis = diagnose(experiment)
        row |= {"verdict": diagnosis.verdict, "named": [step.effect for step in diagnosis.steps]}
        row |= {"equivalent": [list(names) for names in diagnosis.equivalent]}
    return row
