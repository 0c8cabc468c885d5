"""Least squares reaches the minimum, also beside unknowns that no residual depends on."""

import numpy as np
import pytest

from cradle_env import Cradle, Release, simulate
from identification import Experiment
from identification.inference.least_squares import cost, difference_jacobian, refine
from identification.inference.likelihood import Likelihood


@pytest.mark.parametrize("noise", [1e-3, None])
def test_the_minimum_is_not_above_the_truth(noise):
    """An unknown noise makes the Jacobian singular; χ² then ended 1 to 2 % above that of the truth."""
    cradle, release = Cradle(bobs=2, k_f=16000.0, kappa=202.0, b=0.0023), Release(angle=0.228)
    run = simulate(cradle, release, duration=20.0, sample_rate=60.0)
    rng = np.random.default_rng(0)
    readings = run.theta + 1e-3 * rng.standard_normal(run.theta.shape)
    likelihood = Likelihood(Experiment.from_arrays(cradle, run.t, readings, release, noise=noise), workers=1)
    truth = likelihood.start()
    start = truth + [0.05 * rng.standard_normal() if u.name in ("k_f", "b") else 0.0 for u in likelihood.unknowns]
    reached = refine(likelihood, start, 40)[1]
    # Three unknowns lower χ² by 3 of 2400 on average, hardly ever by 20: 0.8 %.
    assert 0.992 * cost(likelihood, truth) < reached < cost(likelihood, truth) < 0.99 * cost(likelihood, start)


class Counted:
    """A likelihood that counts the simulations of its residuals."""

    def __init__(self, likelihood):
        self.experiment, self.unknowns, self.workers = likelihood.experiment, likelihood.unknowns, 1
        self.of, self.simulations = likelihood, 0

    def residuals(self, point):
        self.simulations += 1
        return self.of.residuals(point)


@pytest.mark.parametrize("off", [0.003, 0.03])
def test_known_derivatives_save_simulations_and_lead_to_the_same_minimum(off):
    """Known at the truth, for starts where χ² is 7 and 580 above the least."""
    cradle, release = Cradle(bobs=2, k_f=16000.0, kappa=202.0, b=0.0023), Release(angle=0.228)
    run = simulate(cradle, release, duration=20.0, sample_rate=60.0)
    readings = run.theta + 1e-3 * np.random.default_rng(0).standard_normal(run.theta.shape)
    likelihood = Likelihood(Experiment.from_arrays(cradle, run.t, readings, release, noise=1e-3), workers=1)
    truth = likelihood.start()
    start = truth + [off if u.name in ("k_f", "b") else 0.0 for u in likelihood.unknowns]
    known = difference_jacobian(likelihood, truth, likelihood.residuals(truth))
    plain, helped = Counted(likelihood), Counted(likelihood)
    least, found = refine(plain, start, 40)[1], refine(helped, start, 40, jacobian=known)[1]
    assert helped.simulations < 0.7 * plain.simulations
    # A profile ends where χ² has risen by 4 to 9: a hundredth of a unit shifts no end.
    assert abs(found - least) < 0.01 < cost(likelihood, start) - least


def test_known_derivatives_that_lead_nowhere_are_given_up():
    """Of the wrong sign: every step along them raises χ²."""
    cradle, release = Cradle(bobs=2, k_f=16000.0, kappa=202.0, b=0.0023), Release(angle=0.228)
    run = simulate(cradle, release, duration=20.0, sample_rate=60.0)
    likelihood = Likelihood(Experiment.from_arrays(cradle, run.t, run.theta, release, noise=1e-3), workers=1)
    truth = likelihood.start()
    start = truth + [0.03 if u.name in ("k_f", "b") else 0.0 for u in likelihood.unknowns]
    wrong = -difference_jacobian(likelihood, truth, likelihood.residuals(truth))
    # Without noise the least χ² is 0; the start has some 500.
    assert refine(likelihood, start, 60, jacobian=wrong)[1] < 0.01 < 100.0 < cost(likelihood, start)
