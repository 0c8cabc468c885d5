"""Places of a diagnosis: the energy that data hold beyond a model, window by window, and lines, single frequencies;
against the soft-contact reference."""

import numpy as np
import pytest
from scipy.signal import lombscargle

from identification.diagnosis.residuals.periodogram import count_independent, frequency_grid, line_power
from identification.diagnosis.residuals.residual_tests import describe_phase, scan_residuals
from identification.diagnosis.residuals.windows import start_state_windows
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.searcher import Searcher, refine_to_mode
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import FitResult, with_known_noise
from identification.inference.likelihood import Likelihood
from identification.inference.start_points import point_at
from studies.diagnosis.study import fit_near
from tests.reference.laboratory import record, write_experiment
from tests.reference.soft_contact import SoftCradle

TRUTH = {"k_f": 18000.0, "kappa": 190.0, "b": 0.002}
ANGLE, NOISE = 0.2, 1e-3


def recorded(b, seed=1, noise=NOISE, effects=None):
    cradle = SoftCradle(2, stiffness_factor=1e6, effects=effects or {}, **{**TRUTH, "b": b})
    return record(cradle, {2: ANGLE}, duration=30.0, noise=noise, seed=seed)


def energy(run, times):
    """Energy of the swing of both bobs at these times [J]."""
    mass, length, gravity = run.cradle.mass, run.cradle.length, run.cradle.gravity
    at = np.searchsorted(run.times, times)
    swing = 0.5 * mass * (length * run.theta_dot[at]) ** 2 + mass * gravity * length * (1.0 - np.cos(run.theta[at]))
    return swing.sum(axis=1)


@pytest.fixture(scope="module")
def damped(tmp_path_factory):
    """(model at b = 0.002 beside data at b = 0.0023, the recording of the data)."""
    recording = recorded(0.0023)
    path = write_experiment(tmp_path_factory.mktemp("damped"), [recording], stated=TRUTH, run={"fit_to": 30.0})
    likelihood = Searcher(FitCache(None, ""), 0, 1).likelihood(with_known_noise(Experiment.load(path)))
    return FitResult(likelihood, point_at(likelihood, TRUTH)), recording


def test_the_excess_is_the_difference_of_energies(damped):
    fitted, recording = damped
    found = start_state_windows(fitted)
    starts = np.array([window.interval[0] for window in found])
    # Starts that are no frame of the reference fall between two: energies change slowly there.
    expected = energy(recording.run, starts) - energy(recorded(TRUTH["b"], noise=0.0).run, starts)
    excess = np.array([window.energy @ fitted.residuals[window.rows] for window in found])
    sd = np.array([window.sd for window in found])
    assert expected.min() < -5.0 * sd.max(), "the test needs a difference that can be seen"
    # 14 normal numbers of unit variance: mean square 1 ± 0.38, largest below 4; the second-order part is 0.2 sd.
    pulls = (excess - expected) / sd
    assert np.mean(pulls**2) < 2.2 and np.abs(pulls).max() < 4.0
    assert np.mean((excess / sd) ** 2) > 10.0, "without the difference the test must fail"


def test_start_states_absorb_what_happened_before(damped):
    """A bob that was let go otherwise is seen in the whole run, but not within windows; a wrong damping is."""
    fitted, _ = damped
    residuals = fitted.residuals.copy()
    other = point_at(fitted.likelihood, {**TRUTH, "release_angle_error@1": 5e-3})
    residuals += fitted.likelihood.residuals(other) - fitted.likelihood.residuals(point_at(fitted.likelihood, TRUTH))
    for window in start_state_windows(fitted)[3:]:
        shift = residuals[window.rows] - fitted.residuals[window.rows]
        left = shift - window.absorbed @ (window.absorbed.T @ shift)
        # What is left of some ten noises is of second order.
        assert np.linalg.norm(left) < 0.1 * np.linalg.norm(shift)


def test_a_wrong_damping_is_located_by_its_energy(damped):
    fitted, _ = damped
    located = scan_residuals(fitted, fitted.replicates(100, np.random.default_rng(0), (False,)))
    value = {test.phase: v for test, v in zip(located.tests, located.neg_log10_p, strict=True)}
    assert value["energy"] > np.quantile(located.replicate_maxima, 0.99)
    told = {phase: describe_phase(phase) for phase in (test.label(fitted.residuals) for test in located.tests)}
    assert {phase for phase, words in told.items() if words == f"a {phase}"} == {
        phase for phase in told if phase.startswith("line at ")
    }  # all else has words of its own
    assert told["unknowns"] == "other best-fit values than in the whole run" and told["0–45°"] == "0–45° of the swing"


def test_a_room_that_shakes_is_located_by_its_frequency(tmp_path):
    """0.5 mrad of a tone in noise of 1 mrad: lines hold it at its frequency, in common most of all; no other place
    holds half as much."""
    shaken = {"vibration": {"acceleration": 4e-3, "frequency": 1.3, "phase": 1.0}}
    path = write_experiment(tmp_path, [recorded(TRUTH["b"], effects=shaken)], stated=TRUTH, run={"fit_to": 30.0})
    fitted = fit_near(Searcher(FitCache(None, ""), 0, 1), with_known_noise(Experiment.load(path)), TRUTH)
    located = scan_residuals(fitted, fitted.replicates(100, np.random.default_rng(0), (False,)))
    assert located.where[0]["bob"] is None and located.where[0]["phase"] == "line at 1.3 Hz"
    others = [v for test, v in zip(located.tests, located.neg_log10_p, strict=True) if test.phase != "line"]
    assert located.largest > 2.0 * max(others) and located.largest > 2.0 * located.replicate_maxima.max()


def test_a_model_that_only_bends_is_located_by_its_unknowns(tmp_path):
    """Drag by the square of the speed, met by linear drag: the beginning alone asks for more of it than the whole."""
    hidden = {"quadratic_drag": {"c2": 2e-2}}
    path = write_experiment(tmp_path, [recorded(TRUTH["b"], effects=hidden)], stated=TRUTH, run={"fit_to": 30.0})
    fitted = fit_near(Searcher(FitCache(None, ""), 0, 1), with_known_noise(Experiment.load(path)), TRUTH)
    located = scan_residuals(fitted, fitted.replicates(100, np.random.default_rng(0), (False,)))
    beginnings = [i for i, test in enumerate(located.tests) if test.phase == "unknowns"]
    assert max(located.neg_log10_p[i] for i in beginnings) > 2.0 * located.replicate_maxima.max()
    # What the beginning would have is the refit itself: χ² there falls by the statistic, to first order.
    i = max(beginnings, key=lambda i: located.neg_log10_p[i])
    rows, until = located.tests[i].rows, located.tests[i].interval[1]
    likelihood = fitted.likelihood
    early = Likelihood(likelihood.experiment, [likelihood.rows[0] & (likelihood.experiment.runs[0].times <= until)], 1)
    refitted = FitResult(early, refine_to_mode(early, fitted.point))
    gained = np.sum(fitted.residuals[rows] ** 2) - np.sum(refitted.residuals[: len(rows)] ** 2)
    assert gained == pytest.approx(np.sum((located.tests[i].basis.T @ fitted.residuals[rows]) ** 2), rel=0.2)


def test_the_power_of_a_line_is_that_of_lomb_and_scargle():
    """Of readings at any times; SciPy's is half of the χ². Of white noise it is χ² with two degrees of freedom, and the
    best of all frequencies is what so many independent ones give, or up to some twice as many: the grid is finer."""
    rng = np.random.default_rng(2)
    times = np.sort(rng.uniform(0.0, 20.0, 500))
    found, noise = frequency_grid(20.0, 1.1), rng.standard_normal((500, 400))
    saved = line_power(times, noise, found)
    expected = 2.0 * lombscargle(times - times[0], noise[:, 0], 2.0 * np.pi * found)
    np.testing.assert_allclose(saved[:, 0], expected, rtol=1e-9)
    assert saved.mean() == pytest.approx(2.0, rel=0.02)
    by_chance = np.exp(-0.5 * np.median(saved.max(axis=0))) * count_independent(found) / np.log(2.0)
    assert 0.3 < by_chance < 1.0
    twice = line_power(np.repeat(times, 2), np.repeat(noise, 2, axis=0), found)
    np.testing.assert_allclose(twice, 2.0 * saved, rtol=1e-9)
