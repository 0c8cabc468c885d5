"""Options of the inference: the defaults are those of a calibration that states none, and another value has effect."""

import doctest

import numpy as np
import pytest

from cradle_env import Cradle, Release, simulate
from identification import Experiment, calibrate
from identification.inference import calibration, search_options
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import find_mode
from identification.inference.search_options import SearchOptions


@pytest.fixture(scope="module")
def swing() -> Experiment:
    """One bob filmed for 10 s with 1 mrad of noise."""
    cradle, release = Cradle(bobs=1, model="pendulum", b=0.01), Release(angle=0.2)
    run = simulate(cradle, release, duration=10.0, sample_rate=30.0)
    readings = run.theta + 1e-3 * np.random.default_rng(0).standard_normal(run.theta.shape)
    return Experiment.from_arrays(cradle, run.t, readings, release, noise=1e-3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("plain")


@pytest.fixture(scope="module")
def plain(swing, folder):
    """Its posterior by a calibration without options."""
    return calibrate(swing, out=folder, steps=50)


@pytest.fixture(scope="module")
def other(swing):
    """Its posterior by a calibration with several."""
    options = SearchOptions(move_weights=(0.0, 0.8, 0.2), predictive_chance=0.2, min_ess=1e6)
    return calibrate(swing, steps=50, search=options)


def test_the_defaults_are_those_of_a_calibration_without_options(swing, plain):
    stated = calibrate(swing, steps=50, search=SearchOptions())
    assert np.array_equal(stated.chain, plain.chain)  # bit for bit: the same computation
    assert np.array_equal(stated.log_density, plain.log_density)
    assert (stated.gap.train, stated.gap.held_out) == (plain.gap.train, plain.gap.held_out)
    assert stated.gap.allowed == plain.gap.allowed


def test_other_moves_make_another_chain(plain, other):
    assert not np.array_equal(other.chain, plain.chain)


def test_a_larger_chance_lowers_the_bound_of_the_held_out_gap(plain, other):
    assert other.gap.allowed < plain.gap.allowed


def test_stricter_criteria_are_those_that_the_verdict_states(other):
    strict = other.convergence
    assert not strict.converged
    assert any("wanted at least 1000000" in reason for reason in strict.reasons)


@pytest.mark.parametrize("draws", [7, 240])
def test_the_search_draws_as_many_points_as_the_options_say(swing, draws):
    texts = []
    likelihood = Likelihood(swing, workers=1)
    found, mode = find_mode(
        likelihood, progress=lambda *all_: texts.append(all_[2]), options=SearchOptions(draws=draws)
    )
    assert f"{draws} points" in texts
    # The posterior has one mode, which is farther than 4 standard deviations from the truth once in 16,000 data sets.
    assert abs(np.log(found.values(mode.point)["b"] / 0.01)) < 4.0 * np.sqrt(mode.covariance[0, 0])


def test_chains_of_other_options_are_not_resumed(swing, plain, folder):
    with pytest.raises(ValueError, match="other search options"):
        calibrate(swing, out=folder, steps=80, search=SearchOptions(overdispersion=2.0))


@pytest.mark.parametrize(
    "options",
    [
        {"max_rhat": 1.0},
        {"draws": -1},
        {"adaptation_steps": ()},
        {"early_periods": 0.0},
        {"early_growth": 1.0},
        {"early_modes": 0},
        {"finished_modes": 0},
        {"move_weights": (0.5, 0.5, 0.5)},
    ],
)
def test_impossible_options_are_refused(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        SearchOptions(**options)


@pytest.mark.parametrize("module", [search_options, pytest.param(calibration, marks=pytest.mark.slow)])
def test_the_examples_run(module):
    assert doctest.testmod(module).failed == 0
