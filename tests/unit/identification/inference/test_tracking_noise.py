"""Tracking noise: errors of readings that repeat where a bob passes the same place as fast."""

import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from cradle_env import Cradle, Release
from identification.experiment.experiment import Experiment
from identification.experiment.run import ReleaseInfo, Run, Tracking
from identification.inference.likelihood import Likelihood
from identification.inference.normal_approximation import normal_approximation
from identification.inference.tracking_noise import TrackingNoise

PENDULUM = Cradle(bobs=1, model="pendulum", b=0.002)
TRACKING = Tracking(ratio=2.0, place=2e-3, speed=2e-2)


def swing(times, b=PENDULUM.b):
    """Angle and speed of a damped pendulum of small swings, in closed form: (2, T)."""
    rate, decay = math.sqrt(PENDULUM.gravity / PENDULUM.length), b / (2.0 * PENDULUM.mass)
    omega = math.sqrt(rate**2 - decay**2)
    envelope = 0.01 * np.exp(-decay * times)
    theta = envelope * (np.cos(omega * times) + decay / omega * np.sin(omega * times))
    return theta, -envelope * rate**2 / omega * np.sin(omega * times)


def covariance(theta, speed, tracking, sigma):
    """Of readings with both kinds of noise, (T, T)."""
    far = np.subtract.outer(theta, theta) ** 2 / tracking.place**2
    far += np.subtract.outer(speed, speed) ** 2 / tracking.speed**2
    return sigma**2 * (np.eye(len(theta)) + tracking.ratio**2 * np.exp(-0.5 * far))


def recorded(times, readings, tracking, **fields):
    release = ReleaseInfo(Release(angle=0.01, start="hanging"), angle_sd=1e-3)
    return Run(times, np.reshape(readings, (len(times), -1)), release=release, tracking=tracking, delta=0.0, **fields)


def test_density_is_that_of_the_covariance():
    """With a missing reading. The low-rank covariance leaves out 2 % of a variance at most. Here that changes the log
    density by 0.1; without tracking noise it changes by 290."""
    times = np.arange(0.0, 6.0, 1 / 30)
    theta, speed = swing(times)
    sigma = 1e-4
    rng = np.random.default_rng(0)
    residuals = np.linalg.cholesky(covariance(theta, speed, TRACKING, sigma)) @ rng.standard_normal(len(times))
    seen = np.arange(len(times)) != 40
    run = recorded(times, np.where(seen, theta, np.nan), TRACKING, noise=sigma)
    likelihood = Likelihood(Experiment(PENDULUM, (run,)))
    model = likelihood.with_tracking_noise(likelihood.start()).noise_model
    right = multivariate_normal(cov=covariance(theta, speed, TRACKING, sigma)[np.ix_(seen, seen)])
    found = model.log_density(0, residuals[seen], sigma) - 0.5 * seen.sum() * math.log(2.0 * math.pi)
    assert found == pytest.approx(right.logpdf(residuals[seen]), abs=1.0)
    white = multivariate_normal(cov=sigma**2 * np.eye(seen.sum()))
    assert abs(white.logpdf(residuals[seen]) - found) > 50.0


def test_bobs_have_errors_of_their_own():
    times = np.arange(0.0, 4.0, 1 / 30)
    theta, _ = swing(times)
    seen = np.ones((len(times), 2), bool)
    seen[7, 0] = False
    noise = TrackingNoise.of(TRACKING, times, np.column_stack([theta, theta]), seen)
    of_first = np.column_stack([np.ones_like(theta), np.zeros_like(theta)])[seen]
    whitened = noise.whiten(of_first)
    assert (whitened[of_first == 0.0] == 0.0).all()
    assert 0.0 < np.linalg.norm(whitened) < 0.5 * np.linalg.norm(of_first)


@pytest.mark.slow  # 20 calibrations
def test_intervals_hold_the_truth_where_errors_repeat():
    """b of 20 pendulums in closed form: errors over their standard deviations have an RMS of 1, to 4 of its standard
    deviations, 1/√40. With the places of the readings, which contain the noise, instead of the model's it is 2.6."""
    times = np.arange(0.0, 15.0, 1 / 30)
    theta, speed = swing(times)
    factor = np.linalg.cholesky(covariance(theta, speed, TRACKING, 1e-4))
    z = []
    for seed in range(20):
        readings = theta + factor @ np.random.default_rng(seed).standard_normal(len(times))
        run = recorded(times, readings, TRACKING)
        likelihood, mode = normal_approximation(Likelihood(Experiment(PENDULUM, (run,))))
        row = likelihood.names.index("b")
        z.append((mode.point[row] - math.log(PENDULUM.b)) / math.sqrt(mode.covariance[row, row]))
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=4.0 / math.sqrt(40.0))
