"""θ as a function of parameters: the values are those of other cradles, the derivatives those of differences."""

import importlib.util
import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

from cradle_env import Cradle, InitialState, Release, jax_theta, simulate, theta_and_jacobian

TIMES = np.linspace(0.0, 3.0, 61)
VALUES = {"k_f": 16e3, "kappa": 170.0, "release_angle": 0.21}


def run(k_f, kappa, angle):
    return simulate(Cradle(bobs=2, k_f=k_f, kappa=kappa), Release(angle=angle), times=TIMES, ledger=False).theta


def differences():
    """Central differences (T, N, 3) of order 2 with a step of 1e-5: good to 1e-6 of the largest derivative."""
    values, columns = np.array(list(VALUES.values())), []
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-5 * values[k]
        columns.append((run(*values + step) - run(*values - step)) / (2.0 * step[k]))
    return np.stack(columns, axis=-1)


def test_theta_and_jacobian():
    theta, jacobian = theta_and_jacobian(Cradle(bobs=2), Release(angle=0.2), TIMES, VALUES)
    np.testing.assert_array_equal(theta, run(*VALUES.values()))
    wanted = differences()
    # At the default tolerance of runs their derivatives by κ err by 8e-6 of the largest, by others by less.
    assert (np.abs(jacobian - wanted).max(axis=(0, 1)) < 2e-5 * np.abs(wanted).max(axis=(0, 1))).all()


def test_values_of_gaps_and_of_initial_states_are_values_not_changes():
    start = InitialState(np.array([0.0, 0.1, 0.2]), np.zeros(3))
    cradle = Cradle(bobs=3, delta=(0.01, 0.02))
    theta, _ = theta_and_jacobian(cradle, start, TIMES[:21], {"delta[2]": 0.03, "theta[3]": 0.25})
    there = simulate(
        cradle.replace(delta=(0.01, 0.03)), InitialState(np.array([0.0, 0.1, 0.25]), np.zeros(3)), times=TIMES[:21]
    )
    np.testing.assert_allclose(theta, there.theta, rtol=0, atol=1e-12)  # 0.02 + (0.03 - 0.02) may round otherwise


def test_what_cannot_be_differentiated_is_refused():
    with pytest.raises(ValueError, match=r"unknown sensitivity 'kapa'.*kappa"):
        theta_and_jacobian(Cradle(bobs=2), Release(angle=0.2), TIMES, {"kapa": 1.0})
    with pytest.raises(ValueError, match="k_f"):
        theta_and_jacobian(Cradle(bobs=2), Release(angle=0.2), TIMES, {"k_f": -1.0})
    with pytest.raises(ValueError, match="elastic strings"):
        theta_and_jacobian(Cradle(bobs=2, model="pendulum"), Release(angle=0.2), TIMES, {"k_f": 1e4})


def elsewhere(function):
    """Runs a function in a process of its own: JAX starts threads, which do not go with the forks of other tests."""
    if importlib.util.find_spec("jax") is None:
        pytest.skip("needs JAX")
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        pool.submit(function).result()


def test_jax_differentiates_in_both_modes_and_maps():
    elsewhere(differentiate_in_both_modes_and_map)


def differentiate_in_both_modes_and_map():
    """The last lines: what is wrong with a value is passed on."""
    import jax

    jax.config.update("jax_enable_x64", True)
    theta = jax_theta(Cradle(bobs=2), Release(angle=0.2), TIMES, list(VALUES))
    p = jax.numpy.array(list(VALUES.values()))
    value, exact = theta_and_jacobian(Cradle(bobs=2), Release(angle=0.2), TIMES, VALUES)
    np.testing.assert_array_equal(theta(p), value)
    # The same numbers, summed in another order: rounding.
    for mode in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(jax.jit(mode(theta))(p), exact, rtol=1e-12, atol=1e-14 * np.abs(exact).max())
    both = jax.vmap(theta)(jax.numpy.stack([p, 1.01 * p]))
    np.testing.assert_array_equal(both[1], theta(1.01 * p))
    with pytest.raises(Exception, match="k_f"):
        theta(jax.numpy.array([-1.0, 170.0, 0.2])).block_until_ready()
