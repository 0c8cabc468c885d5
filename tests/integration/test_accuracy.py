"""How exactly the equations are solved: against tight SciPy integrations, closed forms, and the order claimed."""

import functools

import numpy as np
import pytest
from scipy.integrate import DOP853, solve_ivp
from scipy.special import ellipk

from cradle_env import Cradle, Release, simulate
from cradle_env.mechanics import tableau
from identification.bench import scipy_peer
from identification.inference.likelihood import TOLERANCE

ELASTIC = {"-string_hysteresis": {}}
CONSTANT = {"-velocity_dependent_restitution": {}}
RELEASE = Release(angle=0.228)
STRINGS = pytest.mark.parametrize("strings", ["elastic", "hysteretic"])


def two_bobs(strings: str) -> Cradle:
    return Cradle(bobs=2, effects=ELASTIC if strings == "elastic" else {})


@functools.cache
def peer(strings: str) -> tuple[np.ndarray, ...]:
    """Times, theta, r and impacts of SciPy's DOP853. Steps of 2 ms instead of 10 ms move its impacts by 1e-13 s."""
    times = np.linspace(0, 10, 2401)
    kappa = two_bobs(strings).kappa
    return times, *scipy_peer.simulate(
        2, angle=0.228, times=times, strings=strings, kappa=kappa, rtol=1e-13, atol=1e-15
    )


def test_the_coefficients_are_those_of_scipy() -> None:
    stages = DOP853.n_stages
    np.testing.assert_array_equal(tableau.A, DOP853.A[:stages, :stages])
    np.testing.assert_array_equal(tableau.B, DOP853.B)
    np.testing.assert_array_equal(tableau.C, DOP853.C[:stages])


@STRINGS
def test_first_18_impacts(strings: str) -> None:
    impacts = peer(strings)[3][:18]
    run = simulate(two_bobs(strings), RELEASE, 10.0)
    np.testing.assert_array_equal(run.impacts["pair"][:18], 1)
    # 1e-9 s is asked for; 2e-11 to 6e-11 were measured.
    np.testing.assert_allclose(run.impacts["time"][:18], impacts[:, 0], rtol=0, atol=2e-10)
    # That times the some m/s^2 by which the speed of approach changes.
    np.testing.assert_allclose(run.impacts["speed"][:18], impacts[:, 2], rtol=0, atol=1e-9)


@STRINGS
def test_motion_over_10_s(strings: str) -> None:
    times, theta, r, _ = peer(strings)
    run = simulate(two_bobs(strings), RELEASE, times=times)
    # 1e-8 rad is asked for at 10 s; it holds throughout. r: a tenth of it, times the length, and interpolated on
    # steps of half a radian of the radial motion of 3 mm, which costs some 4e-9 m.
    np.testing.assert_allclose(run.theta, theta, rtol=0, atol=1e-8)
    np.testing.assert_allclose(run.r, r, rtol=0, atol=1e-8)


@STRINGS
def test_longer_steps_of_fits(strings: str) -> None:
    """Fits take longer steps, which may cost 2e-4 of the least noise known of, 1 mrad. 6e-8 and
    1.3e-7 were measured, 3e-7 and 7e-7 with steps a quarter longer."""
    times, theta, *_ = peer(strings)
    run = simulate(two_bobs(strings), RELEASE, times=times, ledger=False, tolerance=TOLERANCE)
    np.testing.assert_allclose(run.theta, theta, rtol=0, atol=2e-7)


@pytest.mark.parametrize("reach", [3e-4, 3e-3])
@pytest.mark.parametrize("effect", ["bob_attraction", "group_drag"], ids=["attraction", "drag"])
def test_forces_at_short_range_are_resolved(effect: str, reach: float) -> None:
    """Steps shorten where bobs come near: 5e-8 rad. Steps of 20 ms pass over a range of 0.3 mm: 1e-3 rad."""
    values = {"force": 1e-3} if effect == "bob_attraction" else {"slope": 0.5}
    cradle = Cradle(bobs=3, delta=0.005, effects={effect: {**values, "range": reach}})
    fits, fine = (simulate(cradle, RELEASE, 8.0, 60.0, ledger=False, tolerance=t).theta for t in (TOLERANCE, 1e-19))
    np.testing.assert_allclose(fits, fine, rtol=0, atol=3e-7)


@STRINGS
@pytest.mark.parametrize("impact", [1, 5])
def test_errors_keep_in_step_with_the_tolerance(strings: str, impact: int) -> None:
    """Where bobs fly on series: 1e-14 lengths allowed on each of some hundred segments make up to 1e-12 s at 0.4 m/s;
    1e-13 s was measured."""
    cradle = two_bobs(strings)

    def instant(tolerance: float) -> float:
        run = simulate(cradle, RELEASE, 3.0, ledger=False, tolerance=tolerance)
        return run.impacts["time"][impact - 1]

    for tolerance in (1e-15, 1e-14, 1e-12, 1e-10):
        assert abs(instant(tolerance) - instant(1e-22)) < 200.0 * tolerance


@STRINGS
def test_a_minute_of_two_bobs(strings: str) -> None:
    """Over 100 impacts and 2000 string reversals: 4e-11 rad was measured. A tolerance 100 times as large makes 2e-9."""
    run, fine = (simulate(two_bobs(strings), RELEASE, 60.0, ledger=False, tolerance=t) for t in (1e-14, 1e-16))
    np.testing.assert_allclose(run.theta, fine.theta, rtol=0, atol=3e-10)


@STRINGS
@pytest.mark.parametrize("impact", [1, 5])
def test_convergence_order_is_8(strings: str, impact: int) -> None:
    """Of the time of the first impact, before which a hysteretic string reverses eight times, and of the fifth, where
    bobs do not fly on series."""
    cradle = two_bobs(strings)
    cradle = cradle.replace(effects={**cradle.effects, "quadratic_drag": {"c2": 1e-12}})  # as good as none

    def instant(step_factor: float) -> float:
        run = simulate(cradle, RELEASE, 3.0, ledger=False, tolerance=1e-14 * step_factor**8)
        return run.impacts["time"][impact - 1]

    factors = 1.6 / 0.45 * 2.0 ** (-0.5 * np.arange(8))  # steps of 1.6 to 0.14 rad of the radial motion
    errors = np.array([abs(instant(factor) - instant(0.1)) for factor in factors])
    used = (errors < 1e-6) & (errors > 1e-13)  # rounding is some 1e-15 s
    assert used.sum() >= 5
    order = np.polyfit(np.log(factors[used]), np.log(errors[used]), 1)[0]
    # 7.6 to 8.3 were measured: where in a step an event falls is a matter of luck.
    assert 7.3 <= order <= 8.7


def test_one_harmonic_bob_is_exact() -> None:
    cradle = Cradle(bobs=1, model="ho", b=0.05)
    run = simulate(cradle, RELEASE, 30.0)
    decay = cradle.b / (2 * cradle.mass)
    omega = np.sqrt(cradle.gravity / cradle.length - decay**2)
    swing = np.cos(omega * run.t) + decay / omega * np.sin(omega * run.t)
    # Interpolated samples: (0.2)^6/46080 of 0.228 rad.
    np.testing.assert_allclose(run.theta[:, 0], 0.228 * np.exp(-decay * run.t) * swing, rtol=0, atol=1e-9)
    amplitude = np.hypot(run.theta[:, 0], (run.theta_dot[:, 0] + decay * run.theta[:, 0]) / omega)
    # The angular velocity is interpolated one order lower.
    np.testing.assert_allclose(amplitude / amplitude[0], np.exp(-decay * run.t), rtol=5e-8)


@pytest.mark.parametrize("angle", [0.1, 0.228, 1.0, 2.5])
def test_period_of_one_pendulum(angle: float) -> None:
    cradle = Cradle(bobs=1, model="pendulum", b=0.0)
    period = 4 * np.sqrt(cradle.length / cradle.gravity) * ellipk(np.sin(angle / 2) ** 2)
    run = simulate(cradle, Release(angle=angle), times=period * np.array([0.25, 0.5, 10.25, 10.75]))
    # At the bottom, where lateness shows first. As in the harmonic case, but 2.5 rad is far from harmonic.
    np.testing.assert_allclose(run.theta[[0, 2, 3], 0], 0, atol=1e-9 if angle < 2 else 1e-7)
    assert run.theta[1, 0] == pytest.approx(-angle, abs=1e-9)


@pytest.mark.parametrize("e", [1.0, 0.9, 0.7])
def test_two_harmonic_bobs_are_exact(e: float) -> None:
    """The sum of the angles swings freely; the difference too, but for a factor −e at each of its zeros."""
    cradle = Cradle(bobs=2, model="ho", b=0.01, effects=CONSTANT, restitution=e)
    run = simulate(cradle, RELEASE, 6.0)
    decay = cradle.b / (2 * cradle.mass)
    omega = np.sqrt(cradle.gravity / cradle.length - decay**2)
    free = 0.228 * np.exp(-decay * run.t) * (np.cos(omega * run.t) + decay / omega * np.sin(omega * run.t))
    zeros = (np.arange(len(run.impacts)) * np.pi + np.pi - np.arctan2(omega, decay)) / omega
    zeros = np.where(zeros < 0, zeros + np.pi / omega, zeros)
    np.testing.assert_allclose(run.impacts["time"], zeros, rtol=0, atol=1e-9)
    apart = e ** np.searchsorted(zeros, run.t) * np.abs(free)
    # Interpolation, as for one bob, and impacts 1e-9 s off at 1.3 rad/s.
    np.testing.assert_allclose(run.theta, np.stack([free - apart, free + apart], 1) / 2, rtol=0, atol=3e-9)


def pendulums(angle: float, cradle: Cradle, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two rigid pendulums with constant restitution by SciPy: theta (T, 2), times of the impacts."""
    pivots = np.array([0.0, 2 * cradle.radius * (1 + cradle.delta)])

    def contact(y: np.ndarray) -> tuple[float, np.ndarray]:
        """Gap, and its gradient by the two angles."""
        theta = y[:2]
        x, z = pivots + cradle.length * np.sin(theta), -cradle.length * np.cos(theta)
        across, up = x[1] - x[0], z[1] - z[0]
        distance = np.hypot(across, up)
        slope = cradle.length * (across * np.cos(theta) + up * np.sin(theta)) / distance
        return distance - 2 * cradle.radius, slope * [-1, 1]

    def motion(_: float, y: np.ndarray) -> np.ndarray:
        swing = -cradle.gravity / cradle.length * np.sin(y[:2]) - cradle.b / cradle.mass * y[2:]
        return np.concatenate([y[2:], swing])

    def meets(_: float, y: np.ndarray) -> float:
        gap, slope = contact(y)
        return gap if slope @ y[2:] < 0 else max(gap, 1e-9)

    meets.terminal, meets.direction = True, -1
    t, y, theta, impacts = 0.0, np.array([0.0, angle, 0.0, 0.0]), [], []
    while t < times[-1]:
        due = times[times >= t]
        run = solve_ivp(
            motion, (t, times[-1]), y, "DOP853", t_eval=due, events=meets, rtol=1e-13, atol=1e-15, max_step=0.02
        )
        theta.append(run.y[:2].T)
        if run.status == 0:
            break
        t, y = run.t_events[0][0], run.y_events[0][0].copy()
        impacts.append(t)
        # Lagrange: an impulse J along the line of centres changes m r0^2 theta' by J times the gap's gradient.
        slope = contact(y)[1]
        y[2:] -= (1 + cradle.restitution) * (slope @ y[2:]) / (slope @ slope) * slope
    return np.concatenate(theta), np.array(impacts)


@pytest.mark.parametrize(("angle", "delta"), [(0.228, 0.0), (0.8, 0.01), (2.0, 0.2)])
def test_two_pendulums_with_constant_restitution(angle: float, delta: float) -> None:
    cradle = Cradle(bobs=2, model="pendulum", delta=delta, effects=CONSTANT, restitution=0.95)
    times = np.linspace(0, 5, 501)
    theta, impacts = pendulums(angle, cradle, times)
    run = simulate(cradle, Release(angle=angle), times=times)
    assert len(impacts) >= 7
    np.testing.assert_allclose(run.impacts["time"], impacts, rtol=0, atol=1e-9)
    # Interpolation: 1e-9 of the swing at small angles; beyond 1 rad the motion has higher harmonics.
    np.testing.assert_allclose(run.theta, theta, rtol=0, atol=1e-8 if angle < 1 else 1e-7)


def test_strings_stiffen_a_light_frame() -> None:
    """10 g that five bobs pull, by their weight and by their strings, swing far faster than at the 0.2 Hz of their own
    spring."""
    light = {"frame_compliance": {"frame_mass": 1e-2, "frequency": 0.2, "damping_ratio": 0.0}}
    cradle, all_lifted = Cradle(bobs=5, delta=0.05, effects=light), Release(angle=0.2, bobs=5)
    run, exact = (simulate(cradle, all_lifted, 0.25, tolerance=t) for t in (1e-14, 1e-24))
    # By the spring alone the step was as long as to miss this by 3.5e-4 rad.
    np.testing.assert_allclose(run.theta, exact.theta, rtol=0, atol=1e-7)
