"""What jumps of the readings leave open: on residuals written down here, and on five bobs of the soft reference."""

import dataclasses
import functools
import math

import numpy as np
import pytest

from identification.experiment.experiment import Experiment
from identification.inference.impact_order_noise import (
    add_impact_order_noise,
    estimate_impact_order_noise,
    impact_order_chi2,
)
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.laplace import laplace_approximation
from identification.inference.least_squares import difference_jacobian
from identification.inference.likelihood import Likelihood
from identification.inference.unknowns import Unknown
from tests.reference.laboratory import record, write_experiment
from tests.reference.soft_contact import SoftCradle
from tests.synthetic import nothing_hidden

A = np.random.default_rng(4).standard_normal((200, 2))
D = np.random.default_rng(5).standard_normal(200)


@dataclasses.dataclass
class Residuals:
    """A stand-in for a likelihood: residuals A z, which jump by `jump` times D from one point to the next, for points
    with a first coordinate below `possible`."""

    low: float = -np.inf
    jump: float = 0.0
    possible: float = np.inf
    workers: int = 1

    def __post_init__(self):
        self.unknowns = [Unknown(name, "1", name, 0.0, low=self.low, search=1.0) for name in ("a", "b")]

    def residuals(self, point):
        if point[0] > self.possible:
            raise ImpossibleModelError("beyond")
        return A @ point + self.jump * (1.0 if np.sin(1e9 * point[0]) > 0.0 else -1.0) * D


COVARIANCE = np.linalg.inv(A.T @ A)


@pytest.mark.parametrize(
    ("told", "point"), [({}, [0.0, 0.0]), ({"low": 0.0}, [0.0, 0.0]), ({"possible": 0.05}, [0.0, 0.0])]
)
def test_nothing_is_added_where_nothing_jumps(told, point):
    """Nor in the corner of two bounds, nor near the end of what is possible."""
    found = add_impact_order_noise(Residuals(**told), np.array(point), A, COVARIANCE)
    np.testing.assert_allclose(found, COVARIANCE, rtol=1e-9)


def test_a_jump_widens_by_what_it_does_to_a_fit():
    """Between two points a jump of ±D changes by 2 D or 0 or −2 D: by 2 D Dᵀ in the mean of squares, of which a fit
    takes C Aᵀ."""
    size = 3.0
    moved = COVARIANCE @ A.T @ (size * D)
    found = add_impact_order_noise(Residuals(jump=size), np.array([0.3, 0.1]), A, COVARIANCE) - COVARIANCE
    # Of 16 pairs, 8 ± 2 differ: within 3 sd, a factor of 4.
    ratio = np.diag(found) / (2.0 * moved**2)
    assert np.all((ratio > 0.25) & (ratio < 1.75)), ratio


@pytest.mark.parametrize(
    ("told", "least", "most"),
    # Of 16 pairs, 8 ± 2 differ by two jumps, the others by none.
    [({}, 0.0, 1e-9), ({"jump": 3.0}, 0.25, 1.75), ({"possible": -1.0}, math.inf, math.inf)],
)
def test_how_far_readings_jump(told, least, most):
    """By nothing where they are smooth; by no end where no pair is possible."""
    found = impact_order_chi2(Residuals(**told), np.array([0.3, 0.1]), A, COVARIANCE)
    assert least <= found / float(9.0 * D @ D) <= most


def test_unknown_noise_of_several_runs_widens_nothing(tmp_path):
    """Readings say nothing of it by themselves: its columns are zero, wherever they stand."""
    recordings = [record(SoftCradle(3, stiffness_factor=1e6), {3: angle}, noise=1e-3, duration=4.0, seed=k)
                  for k, angle in enumerate((0.2, 0.15))]  # fmt: skip
    stated = {"k_f": 18000.0, "kappa": 187.0, "b": 0.002}
    path = write_experiment(tmp_path, recordings, stated=stated, run={"noise": None})
    likelihood = Likelihood(Experiment.load(path))
    assert [name for name in likelihood.names if name.startswith("noise")] == ["noise@1", "noise@2"]
    start = likelihood.start()
    before = laplace_approximation(
        likelihood, start, difference_jacobian(likelihood, start, likelihood.residuals(start))
    )
    known, mode = estimate_impact_order_noise(likelihood, before)
    assert len(known.noise_model.impact_order) == 2 and np.all(np.isfinite(mode.covariance))
    for k in (1, 2):
        place = likelihood.names.index(f"noise@{k}")
        assert np.exp(mode.point[place]) == pytest.approx(1e-3, rel=0.1)  # of some 700 readings: 3 %
        assert 0.01 < np.sqrt(mode.covariance[place, place]) < 0.1


@pytest.fixture(scope="module")
def jumpiest(tmp_path_factory):
    """Of the study's cases with nothing hidden, that whose readings jump most: its fit, and the truth. From one start
    a search may end in a worse mode."""
    return nothing_hidden(tmp_path_factory.mktemp("jumpiest"), "10-nothing-1", several_starts=True)


@pytest.mark.slow
def test_jumps_widen_what_is_known(jumpiest):
    """Five bobs whose order of impacts hangs on nothing: χ² changes by some 50 where κ does by 1e-9 of itself, and fits
    end among the luckiest of such points, 16 sd of the smooth covariance from the true κ."""
    found, truth = jumpiest
    J, off = found.jacobian, np.abs(found.point - truth)
    assert (off / np.sqrt(np.diag(np.linalg.inv(J.T @ J)))).max() > 8.0
    # 3.5 sd fail by chance once in 500, of four unknowns; and κ is still known to a part in a thousand.
    deviations = np.sqrt(np.diag(found.covariance))
    assert np.all(off < 3.5 * deviations) and deviations[found.likelihood.names.index("kappa")] < 1e-3


@pytest.mark.slow
def test_what_else_a_model_leaves_makes_no_jump_larger(jumpiest):
    """Points ten times further from the mode meet other jumps, which are larger, but not in proportion: they widen κ
    four times as much, where they would ten times if they counted as noise does."""
    found, _ = jumpiest
    likelihood, J = found.likelihood, found.jacobian
    smooth, place = laplace_approximation(likelihood, found.point, J).covariance, likelihood.names.index("kappa")
    near, far = (
        math.sqrt((add_impact_order_noise(likelihood, found.point, J, smooth, c) - c * smooth)[place, place])
        for c in (1.0, 100.0)
    )
    assert far < 6.0 * near


@pytest.mark.slow
def test_jumps_once_known_leave_a_density_that_can_be_sampled(jumpiest):
    """Over its own posterior the log density then departs from a normal one by a few (1.8 to 3.9 of five draws), where
    without it departs by a hundred (95 to 320), so that no walker leaves the luckiest point; and the truth lies within
    errors that still know κ to a part in a thousand."""
    found, truth = jumpiest
    plain = found.likelihood
    known, mode = estimate_impact_order_noise(plain, laplace_approximation(plain, found.point, found.jacobian))
    normal = np.random.default_rng(0).standard_normal((32, len(truth)))
    points = mode.point + normal @ np.linalg.cholesky(mode.covariance).T
    departures = [one.log_densities(points)[:, 0] + 0.5 * np.sum(normal**2, axis=1) for one in (plain, known)]
    # Of a few points the order of impacts is one that no pair has shown: the middle half counts.
    rugged, smooth = np.subtract(*np.quantile(departures, (0.75, 0.25), axis=1))
    assert smooth < 8.0 < 40.0 < rugged
    deviations = np.sqrt(np.diag(mode.covariance))
    # 3.5 sd fail by chance once in 500.
    assert np.all(np.abs(mode.point - truth) < 3.5 * deviations)
    assert deviations[plain.names.index("kappa")] < 1e-3


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """The fit to a case of the study, made once."""
    folder = tmp_path_factory.mktemp("cases")
    return functools.cache(lambda name: nothing_hidden(folder / name, name)[0])


def test_two_bobs_have_no_order_to_flip(fitted):
    found = fitted("00-nothing-2")
    mode = laplace_approximation(found.likelihood, found.point, found.jacobian)
    known, same = estimate_impact_order_noise(found.likelihood, mode)
    assert known is found.likelihood and same is mode


@pytest.mark.parametrize("name", ["00-nothing-2", pytest.param("00-nothing-7", marks=pytest.mark.slow)])
def test_where_readings_are_smooth_nothing_is_added(fitted, name):
    """Two bobs, and one of whom k_f says nothing."""
    found = fitted(name)
    J = found.jacobian
    smooth = np.sqrt(np.diag(np.linalg.pinv(J.T @ J)))
    # What bends in the third order adds least where the data are good; 1 % of an sd would change no figure.
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), smooth, rtol=1e-2)
