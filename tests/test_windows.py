"""Windows of a diagnosis: the energy that data hold beyond a model, against that of the soft-contact reference."""

import numpy as np
import pytest

from identification.diagnose.fitted import Fitted, with_known_noise
from identification.diagnose.locate import locate
from identification.diagnose.search import Searcher, Store, placed
from identification.diagnose.windows import windows
from identification.experiment import Experiment
from tests.independent.laboratory import record, write_experiment
from tests.independent.soft_contact import SoftCradle

TRUTH = {"k_f": 18000.0, "kappa": 190.0, "b": 0.002}
ANGLE, NOISE = 0.2, 1e-3


def recorded(b, seed=1, noise=NOISE):
    cradle = SoftCradle(2, stiffness_factor=1e6, **{**TRUTH, "b": b})
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
    likelihood = Searcher(Store(None, ""), 0, 1).likelihood(with_known_noise(Experiment.load(path)))
    return Fitted(likelihood, placed(likelihood, TRUTH)), recording


def test_the_excess_is_the_difference_of_energies(damped):
    fitted, recording = damped
    found = windows(fitted)
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
    other = placed(fitted.likelihood, {**TRUTH, "release_angle_error@1": 5e-3})
    residuals += fitted.likelihood.residuals(other) - fitted.likelihood.residuals(placed(fitted.likelihood, TRUTH))
    for window in windows(fitted)[3:]:
        shift = residuals[window.rows] - fitted.residuals[window.rows]
        left = shift - window.absorbed @ (window.absorbed.T @ shift)
        # What is left of some ten noises is of second order.
        assert np.linalg.norm(left) < 0.1 * np.linalg.norm(shift)


def test_a_wrong_damping_is_located_by_its_energy(damped):
    fitted, _ = damped
    located = locate(fitted, fitted.replicates(100, np.random.default_rng(0), (False,)))
    value = {place.phase: v for place, v in zip(located.places, located.statistic, strict=True)}
    assert value["energy"] > np.quantile(located.replicas, 0.99)
