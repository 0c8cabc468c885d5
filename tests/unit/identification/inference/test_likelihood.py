"""The likelihood: what it predicts, what it counts, and where it says impossible."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import multivariate_normal, norm

from cradle_env import Cradle, Release, simulate
from identification.experiment.experiment import Experiment
from identification.experiment.run import Prior, ReleaseInfo, Run
from identification.experiment.train_test import training_rows
from identification.inference import least_squares as least_squares_module
from identification.inference.calibration import calibrate
from identification.inference.least_squares import bounds
from identification.inference.likelihood import Likelihood, shift_release_angle
from identification.inference.low_rank_noise import LowRankNoise
from identification.inference.mode_search import find_mode
from identification.inference.posterior import Posterior
from identification.inference.search_options import SearchOptions
from tests.reference.laboratory import correlated_noise, record, write_experiment
from tests.reference.soft_contact import SoftCradle, simulate_soft
from tests.synthetic import simulated_run

TRUE = {"k_f": 21000.0, "kappa": 180.0, "b": 0.003}


def experiment(angle_error=0.0, noise=1e-3, seconds=12.0, lost=()):
    """Two bobs by the independent simulator, contacts 250 times shorter; stated values are 10 % off."""
    rng = np.random.default_rng(5)
    times = np.arange(int(seconds * 60) + 1) / 60
    soft = SoftCradle(bobs=2, stiffness_factor=1e6, **TRUE)
    theta = simulate_soft(soft, {2: 0.228 + angle_error}, times=times).theta
    readings = theta + noise * rng.standard_normal(theta.shape)
    for rows, bob in lost:
        readings[rows, bob] = np.nan
    cradle = Cradle(bobs=2, k_f=19000.0, kappa=190.0, b=0.0027)
    release = ReleaseInfo(Release(angle=0.228), angle_sd=1e-3)
    return Experiment(cradle, (Run(times, readings, release=release, noise=noise),))


@pytest.mark.parametrize("error", [-0.002, 0.0, 0.002])
@pytest.mark.parametrize("angle", [-0.2, 0.2])
def test_an_angle_error_lifts_further_or_less_far(error, angle):
    assert shift_release_angle(Release(angle=angle), error).angle == pytest.approx(angle * (1 + error / 0.2), abs=1e-15)
    two = shift_release_angle(Release(angles={1: -0.2, 3: 0.2}), error).angles
    assert two[1] == pytest.approx(-0.2 - error) and two[3] == pytest.approx(0.2 + error)


@pytest.mark.parametrize("angle_error", [-0.0012, 0.0012])
def test_the_mode_finds_the_truth_of_an_independent_simulator(angle_error):
    likelihood = Likelihood(experiment(angle_error))
    likelihood, mode = find_mode(likelihood, seed=1)
    found, sd = likelihood.values(mode.point), np.sqrt(np.diag(mode.covariance))
    # Four standard deviations each: a chance of 1e-4 for an honest fit, none for one in a wrong mode of κ.
    for k, (name, value) in enumerate(TRUE.items()):
        assert abs(mode.point[k] - math.log(value)) < 4 * sd[k], name
    assert abs(found["release_angle_error@1"] - angle_error) < 4 * sd[3]
    assert mode.cost / 1442 == pytest.approx(1.0, abs=0.15)  # χ² of 1442 readings scatters by 0.04


def test_a_descent_ends_where_minpack_does_with_fewer_simulations(monkeypatch):
    """Held against SciPy's MINPACK at its tightest, with derivatives by central differences."""
    likelihood, simulations = Likelihood(experiment()), []
    start = likelihood.start() + np.array([-0.3, 0.049, 0.5, 2e-3])  # κ 0.5 % off, its mode 1 % wide
    scale = least_squares_module.difference_steps(likelihood)
    least = 2.0 * least_squares(
        likelihood.residuals, start, "3-point", method="lm", x_scale=scale, xtol=1e-12, ftol=1e-12
    ).cost  # fmt: skip
    residuals = likelihood.residuals
    monkeypatch.setattr(likelihood, "residuals", lambda z: simulations.append(z) or residuals(z), raising=False)
    counts = []
    for options in (SearchOptions(), SearchOptions(broyden_error=0.0)):  # 0: no Broyden updates
        simulations.clear()
        assert least_squares_module.refine(likelihood, start, 40, options)[1] == pytest.approx(
            least, abs=2e-3
        )  # ends at gains of 1e-3
        counts.append(len(simulations))
    assert counts[0] < 0.8 * counts[1], counts


def test_missing_readings_do_not_count():
    gap = slice(100, 400)
    likelihood = Likelihood(experiment(lost=[(gap, 0)]))
    whole = Likelihood(experiment())
    assert len(whole.residuals(whole.start())) - len(likelihood.residuals(likelihood.start())) == 300


def test_density_is_that_of_gaussian_noise():
    likelihood = Likelihood(experiment())
    point = likelihood.start()
    run = likelihood.experiment.runs[0]
    motion = simulate(likelihood.experiment.cradle, Release(angle=0.228), times=run.times)
    residual = (run.readings - motion.theta) / 1e-3
    expected = -0.5 * np.sum(residual**2) - residual.size * math.log(1e-3)
    # The inference's longer integration steps change θ by 1e-7 rad, 1e-4 of the noise.
    assert likelihood.log_density(point)[0] == pytest.approx(expected, rel=1e-5)


def test_density_with_jumps_is_that_of_their_covariance():
    likelihood = Likelihood(experiment(seconds=1.0))
    run, rng = likelihood.experiment.runs[0], np.random.default_rng(2)
    jumps = 5e-4 * rng.standard_normal((run.readings.size, 3))
    directions, sizes, _ = np.linalg.svd(jumps, full_matrices=False)
    jumping, point = (
        likelihood.with_noise(likelihood.noise_model.with_impact_order([LowRankNoise(directions, sizes)])),
        likelihood.start(),
    )
    residual = (likelihood.predict(point, 0, likelihood.rows[0])[0] - run.readings).ravel()
    covariance = 1e-6 * np.eye(len(residual)) + jumps @ jumps.T
    # Only a difference is defined; that to the density without jumps has no other terms.
    expected = multivariate_normal.logpdf(residual, cov=covariance) - np.sum(norm.logpdf(residual, scale=1e-3))
    gained = jumping.log_density(point)[0] - likelihood.log_density(point)[0]
    assert gained == pytest.approx(expected, rel=1e-9)
    # Least squares weighs by the same covariance; the last residual is the prior's of the release.
    squares = float(residual @ np.linalg.solve(covariance, residual))
    assert np.sum(jumping.residuals(point)[:-1] ** 2) == pytest.approx(squares, rel=1e-9)


def test_of_correlated_readings_fewer_count():
    """Noise that keeps half of itself from frame to frame hides as much of slow motion as white noise of three times
    its variance; ρ of 1440 differences scatters by some 0.04, which is 0.3 of 3."""
    quiet = experiment(noise=1e-7)
    run = quiet.runs[0]
    noise = 1e-3 * correlated_noise(run.readings.shape, -1.0 / math.log(0.5), np.random.default_rng(1))
    likelihood = Likelihood(dataclasses.replace(quiet, runs=(
        dataclasses.replace(run, readings=run.readings + noise, noise=1e-3),
    )))  # fmt: skip
    truth = likelihood.start()
    truth[:3] = np.log([TRUE[name] for name in likelihood.names[:3]])
    assert likelihood.noise_inflations(truth) == pytest.approx([3.0], abs=1.2)
    assert Likelihood(experiment()).noise_inflations(truth) == [1.0]
    counted = likelihood.with_noise(likelihood.noise_model.with_inflations([3.0]))
    gained, whole = (
        some.log_density(truth)[0] - some.log_density(counted.start())[0] for some in (counted, likelihood)
    )
    assert gained == pytest.approx(whole / 3.0, rel=1e-9)


@pytest.mark.slow
def test_intervals_hold_the_truth_beside_correlated_noise(tmp_path):
    """κ and b of one bob over their standard deviations, 24 in all: RMS 0.6 to 1.4 in 998 of 1000 such tests. Were the
    noise taken as white, it would be 1.7."""
    errors = []
    for seed in range(12):
        soft = SoftCradle(1, k_f=18000.0, kappa=190.0, b=0.002)
        made = record(soft, {1: 0.228}, duration=20.0, correlation_time=-1.0 / (60.0 * math.log(0.5)), seed=seed)
        told = {1: 0.228 + 1e-3 * float(np.random.default_rng(seed).standard_normal())}
        path = write_experiment(tmp_path / str(seed), [made], stated={"kappa": 187.0, "b": 0.0023},
                                release={"angles": told})  # fmt: skip
        posterior = calibrate(Experiment.load(path))
        for name, value in (("kappa", 190.0), ("b", 0.002)):
            logs = np.log(posterior.samples(name) / value)
            errors.append(logs.mean() / logs.std())
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) < 1.4


def test_impossible_points_have_no_density():
    likelihood = Likelihood(experiment())
    point = likelihood.start()
    point[3] = 3.0  # a release at 3.2 rad, on strings
    assert likelihood.log_density(point)[0] == -math.inf
    point = likelihood.start()
    point[0] = 50.0  # k_f of e^50, beyond its bounds
    assert likelihood.log_density(point)[0] == -math.inf


def test_what_cannot_matter_is_left_out():
    readings = np.zeros((50, 1)) + 0.1 * np.cos(np.arange(50))[:, None]
    run = Run(np.arange(50) / 10, readings, release=ReleaseInfo(Release(angle=0.1)), noise=1e-3)
    assert Likelihood(Experiment(Cradle(bobs=1, model="pendulum"), (run,))).names == ["b"]
    assert Likelihood(Experiment(Cradle(bobs=1), (run,))).names == ["kappa", "b"]
    priors = {"kappa": Prior(190.0, 19.0), "restitution": Prior(0.9, 0.1), "delta": Prior(0.0, 1e-3)}
    assert Likelihood(Experiment(Cradle(bobs=1, model="pendulum"), (run,), priors)).names == ["b"]
    two = dataclasses.replace(run, readings=np.hstack([readings, readings]))
    assert Likelihood(Experiment(Cradle(bobs=2), (two,), priors)).names == ["k_f", "kappa", "b", "delta"]
    with pytest.raises(ValueError, match="has no effect in this model"):
        Likelihood(Experiment(Cradle(bobs=1, model="pendulum"), (run,)), parameters=("kappa",))
    with pytest.raises(ValueError, match="did you mean 'kappa'"):
        Likelihood(experiment(), parameters=("kapa",))


def test_some_of_the_parameters_are_inferred_alone(tmp_path):
    one_bob = Experiment(Cradle(bobs=1), (simulated_run(Cradle(bobs=1), duration=3.0),))
    posterior = calibrate(one_bob, ["b"], steps=50.0, max_steps=60.0)  # whole numbers, if as floats
    assert posterior.likelihood.names == ["b", "release_angle_error@1"]
    posterior = dataclasses.replace(
        posterior, likelihood=posterior.likelihood.with_noise(posterior.likelihood.noise_model.with_inflations([2.5]))
    )
    loaded = Posterior.load(posterior.save(tmp_path / "posterior.nc"))
    assert loaded.likelihood.noise_model.inflations == (2.5,)
    assert loaded.likelihood.names == posterior.likelihood.names
    np.testing.assert_allclose(loaded.chain, posterior.chain, rtol=1e-12)


def test_a_run_of_which_more_is_unknown_is_not_held_out_whole():
    """Its start state, or where its bobs rest, would be fitted by nothing."""
    cradle = Cradle(bobs=2)
    last = simulated_run(cradle, angle=0.15, duration=6.0)
    for fields in ({}, {"state": "free", "release": None}, {"rest": "free"}):
        runs = (simulated_run(cradle, duration=6.0), dataclasses.replace(last, **fields))
        train, held = training_rows(Experiment(cradle, runs))
        expected = [0.0, 1.0] if not fields else [1.0 / 3.0, 1.0 / 3.0]
        for run, one, other, share in zip(runs, train, held, expected, strict=True):
            assert np.array_equal(one | other, run.fitted) and not (one & other).any()
            assert other.mean() == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize("name", ["k_f", "b", "kappa", "length", "restitution", "delta"])
def test_normal_priors_end_where_there_is_no_cradle(name):
    model = "ho" if name == "restitution" else "nsp"
    cradle = Cradle(bobs=2, model=model, effects={"-velocity_dependent_restitution": {}} if model == "ho" else {})
    run = simulated_run(cradle, duration=6.0)
    likelihood = Likelihood(Experiment(cradle, (run,), {name: Prior(mean=0.1, sd=1.0)}), parameters=())
    place = likelihood.names.index(name)
    low, high = bounds(likelihood)
    assert low[place] == pytest.approx(-1.0 if name == "delta" else 0.0, abs=1e-8)
    assert bool(high[place] <= 1.0) == (name == "restitution")
