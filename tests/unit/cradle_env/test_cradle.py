"""What a user states and gets back: validation, dimensionless groups, releases, conventions, batches, symmetry."""

import copy
import dataclasses
import math
import pickle
import re
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cradle_env
from cradle_env import Cradle, InitialState, Release, Trajectory, simulate, simulate_batch
from cradle_env.mechanics import event_loop, restitution
from cradle_env.mechanics.layout import T0, T1
from cradle_env.simulation import SimulationError, prepare

RELEASE = Release(angle=0.228)


def same(one: Trajectory, other: Trajectory) -> bool:
    """Bit for bit."""
    names = ("t", "theta", "r", "theta_dot", "r_dot", "impacts")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


# --- validation -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"bobs": 0}, "bobs is 0; it must be"),
        ({"bobs": 201}, "bobs is 201"),
        ({"bobs": 2.5}, "bobs is 2.5"),
        ({"bobs": True}, "bobs is True"),
        ({"bobs": "five"}, "bobs is 'five'"),
        ({"bobs": math.nan}, "bobs is nan"),
        ({"bobs": None}, "bobs is None"),
        ({"mass": 0}, "mass is 0 kg; it must be greater than 0"),
        ({"mass": "heavy"}, "mass is 'heavy', which is not a number; give it in kg"),
        ({"mass": [0.1, 0.2]}, r"mass is \[0.1, 0.2\], which is not a number"),
        ({"length": -0.3}, "length is -0.3 m"),
        ({"length": math.inf}, "length is inf m"),
        ({"radius": 0}, "radius is 0 m"),
        ({"gravity": 0}, "gravity is 0 m/s"),
        ({"youngs_modulus": 0}, "youngs_modulus is 0 Pa"),
        ({"youngs_modulus": 1e-100}, "youngs_modulus is 1e-100 Pa; it must be at least 1 Pa"),
        ({"youngs_modulus": 1e100}, "youngs_modulus is 1e.100 Pa; it must be at least 1 and at most 1e.18 Pa"),
        ({"model": None}, "unknown model None; known: ho, nsp, pendulum"),
        ({"power_law": np.array(0.3)}, "power_law is array.*; it must be the pair"),
        ({"poisson_ratio": 0.6}, "poisson_ratio is 0.6; it must be greater than -1 and at most 0.5"),
        ({"pivot_half_spacing": -0.1}, "pivot_half_spacing is -0.1 m; it must be at least 0"),
        ({"k_f": -1}, "k_f is -1 N s/m"),
        ({"k_f": math.nan}, "k_f is nan N s/m"),
        ({"b": -1e-3}, "b is -0.001 kg/s"),
        ({"kappa": 0}, "kappa is 0 N/m"),
        ({"restitution": 1.1}, "restitution is 1.1; it must be at least 0 and at most 1"),
        ({"power_law": (-0.1, 0.2)}, "alpha is -0.1"),
        ({"power_law": (0.1, -0.2)}, "n is -0.2"),
        ({"delta": -1.0}, "delta is -1; it must be greater than -1"),
        ({"delta": "wide"}, "delta is 'wide'"),
        ({"bobs": 3, "delta": [0.0]}, "delta has 1 values; 3 bobs have 2 gaps"),
        ({"bobs": 3, "delta": [0.0, -2.0]}, "delta is -2"),
        ({"delta": 1e300}, "delta is 1e\\+300; it must be greater than -1 and at most 100"),
        ({"length": 1e-200}, "length is 1e-200 m; it must be at least 1e-09 m"),
        ({"kappa": 1e300}, "kappa is 1e\\+300 N/m; it must be greater than 0 and at most 1e\\+12"),
        ({"effects": ["quadratic_drag"]}, r"effects is \['quadratic_drag'\]; give {name: {parameter: value}}"),
        ({"effects": {"quadratic_drag": 0.1}}, "give {name: {parameter: value}}"),
        ({"power_law": (0.1, 0.2), "effects": {"contact_duration": {"scale": 1.0}}}, "needs k_f"),
    ],
)
def test_impossible_cradles_are_refused(fields: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Cradle(**fields)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "either angle"),
        ({"angle": 0.1, "angles": {1: 0.1}}, "either angle"),
        ({"angles": {}}, "angles is {}; give"),
        ({"angle": 4.0}, "release angle is 4 rad; it must be at least -3.14159 and at most 3.14159 rad"),
        ({"angle": math.nan}, "release angle is nan rad"),
        ({"angles": {2: "high"}}, "release angle of bob 2 is 'high'"),
        ({"angle": 0.1, "bobs": 0}, "release bobs is 0"),
        ({"angles": {1.7: 0.2}}, "release bob is 1.7; it must be a whole number"),
        ({"angles": {"last": 0.2}}, "release bob is 'last', which is not a number"),
        ({"angles": {5: 0.2}, "bobs": 3}, "release bobs is 3; angles names the bobs, so leave it out"),
        ({"angles": [(1, 0.2)]}, r"angles is \[\(1, 0.2\)\]; give {bob: angle}"),
        ({"angle": 0.1, "bobs": 1.5}, "release bobs is 1.5"),
        ({"angle": 0.1, "start": "taut"}, "start is 'taut'; it must be 'unstretched' or 'hanging'"),
    ],
)
def test_impossible_releases_are_refused(fields: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Release(**fields)


def test_a_start_from_which_bobs_cannot_be_spread_is_refused() -> None:
    """Those that overlap a little are spread; on strings of 1 mm, 20 mm apart, they cannot be."""
    simulate(Cradle(bobs=3), InitialState(np.array([0.0, -0.01, 0.0]), np.zeros(3)), 0.1)
    with pytest.raises(ValueError, match=r"bobs overlap by 0.02. m at the release; give angles"):
        simulate(Cradle(bobs=2, delta=-0.5), InitialState(np.zeros(2), np.zeros(2), r=np.full(2, 1e-3)), 0.1)


@pytest.mark.parametrize(("bobs", "delta"), [(100, -0.02), (200, -0.05)])
def test_bobs_pressed_so_hard_that_no_rest_is_found(bobs: int, delta: float) -> None:
    """They were let go from places where they had passed through each other."""
    with pytest.raises(ValueError, match=f"bobs is {bobs} at delta {delta}: no common rest was found"):
        simulate(Cradle(bobs=bobs, delta=delta), Release(angle=1.2), 0.1)
    env = gymnasium.make("NewtonCradle-v0", bobs=bobs, delta_range=(-0.05, 0.1), actions=("delta",))
    env.reset()
    with pytest.raises(SimulationError, match="no common rest"):
        env.step(np.full(1, -1.0))
    with pytest.raises(ValueError, match="no common rest"):
        env.reset(options={"delta": delta})


def test_ninety_bobs_pressed_together() -> None:
    run = simulate(Cradle(bobs=90, delta=-0.02), Release(angle=1.2), times=np.array([0.0, 0.1]))
    assert run.theta[0, 0] == pytest.approx(-44 * 0.0008 / 0.3, rel=0.02)
    np.testing.assert_allclose(run.gaps()[:, :88], 0.0, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("release", "message"),
    [
        (Release(angle=0.1, bobs=4), "release lifts 4 bobs; the cradle has 3"),
        (Release(angles={4: 0.1}), "release names bob 4; the cradle has bobs 1 to 3"),
        (Release(angles={0: 0.1}), "release names bob 0"),
        (Release(angle=1.6), "release angle is 1.6 rad; on strings it must be at most 1.5 rad"),
        (Release(angles={2: 0.2}), "bobs overlap by .* at the release"),
        (Release(angle=-0.3), "bobs overlap by .* outwards"),  # beyond where they would only have passed the last
        (Release(angles={2: 0.3, 3: 0.1}), "bobs overlap by .* at the release"),
        (InitialState(np.array([0.3, -0.1, 0.0]), np.zeros(3)), "bobs overlap by .* side by side"),
        (InitialState(theta=np.zeros(2), theta_dot=np.zeros(3)), "initial theta must be 3 finite numbers"),
        (InitialState(theta=np.zeros(3), theta_dot=np.full(3, np.nan)), "initial theta_dot"),
        (InitialState(theta=np.zeros(3), theta_dot=np.zeros(3), r=np.ones(4)), "initial r must"),
        (InitialState(theta=None, theta_dot=np.zeros(3)), "initial theta must be 3 finite numbers"),
        (InitialState(np.zeros(3), np.zeros(3), r=np.array([0.3, 0.0, 0.3])), "initial r is 0 m; it must be at least"),
        (InitialState(np.zeros(3), np.zeros(3), r=np.full(3, -0.3)), "initial r is -0.3 m"),
        (InitialState(np.zeros(3), np.zeros(3), tension_ratio=np.full(3, -5.0)), "initial tension_ratio is -5"),
        (InitialState(np.zeros(3), np.zeros(3), tension_ratio=np.full(3, 2.0)), "at least 0 and at most 1"),
    ],
)
def test_impossible_starts_are_refused(release: Release | InitialState, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        simulate(Cradle(bobs=3), release, 1.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"duration": 0.0}, "duration is 0 s"),
        ({"sample_rate": -1.0}, "sample_rate is -1 1/s"),
        ({"times": np.array([0.0, 2.0, 1.0])}, "ascending"),
        ({"times": np.array([-1.0, 2.0])}, "from 0 s on"),
        ({"times": np.array([0.0, np.nan])}, "finite"),
        ({"times": np.array([])}, "not empty"),
        ({"tolerance": 0.0}, "tolerance is 0"),
        ({"tolerance": 0.1}, "tolerance is 0.1; it must be at least 1e-24 and at most 1e-06"),
        ({"duration": 1e300, "sample_rate": 1e3}, "a run is held in memory"),
    ],
)
@pytest.mark.parametrize("run", [simulate, simulate_batch])
def test_impossible_runs_are_refused(run, arguments: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        run(Cradle(bobs=2), RELEASE, **arguments)


@pytest.mark.parametrize("beta", [1e-200, 1e200])
def test_no_beta_beyond_arithmetic(beta: float) -> None:
    with pytest.raises(ValueError, match="beta is 1e"):
        Cradle.from_groups(beta=beta)


def test_one_sample_has_no_sigma() -> None:
    with pytest.raises(ValueError, match="there is but one"):
        simulate(Cradle(bobs=2), RELEASE, times=np.array([0.5])).sigma()


def test_numbers_of_numpy_are_numbers() -> None:
    """An effect that is absent at a value takes it as it is, and a file writes it as a number."""
    value = Cradle(effects={"quadratic_drag": {"c2": np.float64(0.0)}}).effects["quadratic_drag"]["c2"]
    assert type(value) is float


def test_a_cradle_is_a_value() -> None:
    cradle = Cradle(bobs=3, delta=[0.0, 0.01], effects={"quadratic_drag": {"c2": 2e-3}})
    assert cradle == Cradle(bobs=3, delta=(0.0, 0.01), effects={"quadratic_drag": {"c2": 2e-3}})
    assert len({cradle, cradle.replace(), cradle.replace(mass=0.3)}) == 2
    with pytest.raises(dataclasses.FrozenInstanceError):
        cradle.mass = 1.0
    with pytest.raises(TypeError):
        cradle.effects["quadratic_drag"]["c2"] = 1.0


@pytest.mark.parametrize("value", [Cradle(effects={"quadratic_drag": {"c2": 2e-3}}), Release(angles={1: 0.1}), RELEASE])
def test_travels_to_other_processes(value: Cradle | Release) -> None:
    """Vector environments and clusters pickle what they send."""
    assert pickle.loads(pickle.dumps(value)) == value
    assert copy.deepcopy(value) == value


# --- groups and conventions -------------------------------------------------------------------------------------


def test_standard_set() -> None:
    cradle = Cradle(bobs=2)
    assert cradle.kappa == pytest.approx(196.61, abs=5e-3)
    assert cradle.beta == pytest.approx(0.114, rel=1e-12)
    assert RELEASE.gamma(cradle) == pytest.approx(0.228**2 / 6, rel=1e-15)
    assert cradle.k_el == pytest.approx(1.4558e10, rel=1e-4)


@settings(derandomize=True, max_examples=50, deadline=None)
@given(st.floats(0.02, 0.5), st.floats(0.05, 2.0), st.floats(0.0, 0.5), st.floats(0.01, 5.0), st.floats(1.0, 30.0))
def test_beta_and_kappa_either_way_round(beta: float, length: float, a: float, mass: float, gravity: float) -> None:
    fields = {"length": length, "pivot_half_spacing": a, "mass": mass, "gravity": gravity}
    cradle = Cradle.from_groups(beta=beta, **fields)
    # PHYSICS.md: β = √(m g/(κ_r r0)), κ_r = 4 κ (r0/√(r0² + a²))².
    stiffness = 4 * cradle.kappa * length**2 / (length**2 + a**2)
    assert math.sqrt(mass * gravity / (stiffness * length)) == pytest.approx(beta, rel=1e-12)
    assert Cradle(kappa=cradle.kappa, **fields).beta == pytest.approx(beta, rel=1e-12)


def test_alpha_and_n() -> None:
    cradle = Cradle.from_groups(bobs=2, alpha=0.05, n=0.3, delta=0.01)
    assert (cradle.alpha, cradle.n, cradle.beta) == (0.05, 0.3, pytest.approx(0.114))
    assert cradle.power_law == (0.05, 0.3)
    assert Cradle.from_groups(bobs=2, k_f=18000.0) == Cradle(bobs=2)
    constant = Cradle(bobs=2, effects={"-velocity_dependent_restitution": {}}, restitution=0.9)
    assert (constant.alpha, constant.n) == (pytest.approx(0.1), 0.0)
    with pytest.raises(ValueError, match="alpha and n belong together"):
        Cradle.from_groups(alpha=0.05)
    with pytest.raises(ValueError, match="both beta and kappa"):
        Cradle.from_groups(beta=0.1, kappa=200.0)


def test_alpha_of_elastic_spheres() -> None:
    assert Cradle(bobs=2, k_f=0.0).alpha == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("bobs", [1, 2, 5])
def test_pivots(bobs: int) -> None:
    cradle = Cradle(bobs=bobs, delta=0.1, radius=0.03)
    np.testing.assert_allclose(cradle.pivots, (np.arange(1, bobs + 1) - (bobs + 1) / 2) * 0.066, atol=1e-16)
    np.testing.assert_allclose(cradle.replace(delta=0.0).pivots, cradle.pivots / 1.1, atol=1e-16)
    for known_once in (cradle.pivots, cradle.gaps):
        with pytest.raises(ValueError, match="read-only"):
            known_once[:] = 0.0


def test_signs_and_numbers() -> None:
    """θ > 0 towards higher numbers; pair i is bobs i and i + 1."""
    cradle = Cradle(bobs=4, delta=0.002)
    run = simulate(cradle, Release(angle=0.2), 1.0)
    assert run.theta.shape == run.r.shape == run.theta_dot.shape == run.r_dot.shape == (241, 4)
    assert run.gaps().shape == (241, 3)
    assert run.theta[0, 3] == pytest.approx(0.2)
    assert run.x()[0, 3] > cradle.pivots[3]
    assert run.impacts["pair"][0] == 3
    run = simulate(cradle, Release(angles={1: -0.2}), 1.0)
    assert run.x()[0, 0] < cradle.pivots[0]
    assert run.impacts["pair"][0] == 1
    assert np.all(np.diff(run.impacts["time"]) >= 0)
    assert np.all(run.impacts["loss"] >= 0)


def test_gaps_one_by_one() -> None:
    delta = [0.0, 0.003, 0.01]
    run = simulate(Cradle(bobs=4, delta=delta), Release(angles={1: -0.2}), 5.0)
    np.testing.assert_allclose(run.gaps()[0, 1:], 0.04 * np.array(delta[1:]), rtol=0, atol=1e-15)
    np.testing.assert_allclose(np.diff(run.cradle.pivots), 0.04 * (1 + np.array(delta)), rtol=1e-14)
    assert run.gaps().min() >= -1e-9
    assert same(
        simulate(Cradle(bobs=3, delta=0.01), RELEASE, 5.0), simulate(Cradle(bobs=3, delta=[0.01] * 2), RELEASE, 5.0)
    )


# --- releases ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["ho", "pendulum", "nsp"])
@pytest.mark.parametrize(
    ("release", "lifted"),
    [
        (Release(angle=0.2), {5}),
        (Release(angle=0.2, bobs=3), {3, 4, 5}),
        (Release(angle=0.2, bobs=5), {1, 2, 3, 4, 5}),
        (Release(angles={1: -0.2}), {1}),
        (Release(angles={1: -0.2, 2: -0.15, 5: 0.1}), {1, 2, 5}),
    ],
)
@pytest.mark.parametrize("start", ["unstretched", "hanging"])
def test_who_is_lifted(model: str, release: Release, lifted: set[int], start: str) -> None:
    run = simulate(Cradle(bobs=5, model=model), dataclasses.replace(release, start=start), times=np.array([0.0]))
    assert {int(i) + 1 for i in np.flatnonzero(run.theta[0])} == lifted
    np.testing.assert_array_equal(run.theta_dot, 0)
    # Four strings of length L carry the weight: 4 κ (L − L0) r0/L0 = m g.
    string = math.hypot(0.30, 0.10) * (1 + run.cradle.mass * 9.81 / (4 * run.cradle.kappa * 0.30))
    hanging = math.sqrt(string**2 - 0.10**2) if model == "nsp" else 0.30
    for i in range(5):
        free = i + 1 in lifted and start == "unstretched"
        assert run.r[0, i] == pytest.approx(0.30 if free else hanging, abs=1e-12)


@pytest.mark.parametrize("model", ["ho", "pendulum", "nsp"])
@pytest.mark.parametrize("delta", [-0.05, -0.01, -1e-3])
@pytest.mark.parametrize("count", [2, 3, 5])
def test_lifted_neighbours_do_not_overlap(model: str, delta: float, count: int) -> None:
    run = simulate(Cradle(bobs=5, delta=delta, model=model), Release(angle=0.5, bobs=count), 2.0)
    assert run.gaps().min() >= -1e-9
    # They are spread about the angle stated, by half the overlap each.
    assert run.theta[0, 5 - count :].mean() == pytest.approx(0.5, abs=0.02)
    assert np.all(np.diff(run.theta[0, 5 - count :]) > 0)


def test_a_string_just_straight_that_is_let_in_is_slack() -> None:
    """At r0, moving inwards: the bob falls freely until its strings are straight again."""
    still = np.zeros(1)
    cradle = Cradle(bobs=1, b=0.0)
    run = simulate(cradle, InitialState(still, still, np.array([0.3]), np.array([-0.1])), 0.015, 2000.0)
    np.testing.assert_allclose(run.r[:, 0], 0.3 - 0.1 * run.t + 0.5 * 9.81 * run.t**2, rtol=0, atol=1e-12)


def test_a_row_that_all_but_touches_is_no_stall() -> None:
    """N (N − 1)/2 impacts within some 10 ms, as every bob must meet every other's momentum: far more than 2000."""
    run = simulate(Cradle(bobs=80, delta=1e-5, model="pendulum"), Release(angle=0.228), 0.4, ledger=False)
    assert len(run.impacts) >= 80 * 79 // 2


def test_a_state_goes_on() -> None:
    """A run from the state of another, midway, is the rest of it; also with the memory of hysteretic strings."""
    elastic = Cradle(bobs=2, effects={"-string_hysteresis": {}})
    whole = simulate(elastic, RELEASE, 4.0)
    k = 240
    state = InitialState(whole.theta[k], whole.theta_dot[k], whole.r[k], whole.r_dot[k])
    rest = simulate(elastic, state, 3.0)
    # The state is interpolated, to 1e-8 m/s, and no better known.
    np.testing.assert_allclose(rest.theta, whole.theta[k:], rtol=0, atol=1e-6)

    one = Cradle(bobs=1)
    fall = simulate(one, Release(angle=0.2), 1.0, 10000.0)
    lowest = int(np.argmax(fall.r[:900, 0]))  # within the first radial swing
    k = lowest + 200
    s = np.hypot(fall.r[:, 0], 0.1) - math.hypot(0.3, 0.1)
    # On the parabola T = κ s_max (s/s_max)², which is s/s_max of the loading line's tension.
    memory = np.array([s[k] / s[lowest]])
    assert 0.5 < memory[0] < 0.99
    state = InitialState(fall.theta[k], fall.theta_dot[k], fall.r[k], fall.r_dot[k], memory)
    rest = simulate(one, state, times=fall.t[: len(fall.t) - k])
    # s_max is known to the 0.1 ms between samples: 1e-5 of it, and of the ripple of 3 mm.
    np.testing.assert_allclose(rest.r, fall.r[k:], rtol=0, atol=1e-7)
    forgotten = simulate(one, dataclasses.replace(state, tension_ratio=None), times=rest.t)
    assert np.abs(forgotten.r - fall.r[k:]).max() > 1e-4


def test_impacts_hours_after_the_release() -> None:
    """Once neighbouring numbers are 2 ps apart, the instant of an impact is as exact as it can be."""
    cradle = Cradle(bobs=2, model="ho")
    times = np.linspace(0.0, 2.0, 100)
    runs: list[np.ndarray] = []

    def run(t0: float) -> None:
        c, bobs, S, W = prepare(cradle, RELEASE)
        S[:, [T0, T1]] = t0
        motion, impacts = np.empty((len(times), 2, 4)), np.empty((256, 4))
        table = restitution.universal_curves()
        _, count = event_loop.run(
            c[0], bobs, table, S, W, t0 + 2.0, t0 + times, motion, np.empty((0, 2, 7)), impacts, 0
        )
        runs.extend((motion[:, :, 0], impacts[:count, 0] - t0))

    for t0 in (0.0, 9000.0, 1e7):
        worker = threading.Thread(target=run, args=(t0,), daemon=True)  # it went on for ever
        worker.start()
        worker.join(60.0)
        assert not worker.is_alive()
    theta, touched, *later = runs
    assert len(touched) == 4
    np.testing.assert_allclose(later[0], theta, rtol=0, atol=1e-9)
    np.testing.assert_allclose(later[1], touched, rtol=0, atol=1e-10)
    np.testing.assert_allclose(later[2], theta, rtol=0, atol=1e-6)


# --- symmetry, determinism, batches -----------------------------------------------------------------------------


@settings(derandomize=True, max_examples=25, deadline=None)
@given(
    bobs=st.integers(2, 5),
    angle=st.floats(0.05, 0.5),
    delta=st.sampled_from([-0.005, 0.0, 0.01]),
    model=st.sampled_from(["ho", "pendulum", "nsp"]),
    lifted=st.integers(1, 2),
    start=st.sampled_from(["unstretched", "hanging"]),
)
def test_mirror(bobs: int, angle: float, delta: float, model: str, lifted: int, start: str) -> None:
    """The mirrored release runs mirrored, over 3 s: later, N ≥ 3 makes more of the last digit. Two bobs that fall in
    touch make more of it at once: their gap is nothing but rounding."""
    cradle = Cradle(bobs=bobs, delta=delta, model=model)
    right = {bobs - i: angle for i in range(lifted)}
    left = {1 + i: -angle for i in range(lifted)}
    one, other = (simulate(cradle, Release(angles=angles, start=start), 3.0) for angles in (right, left))
    tolerance = 2e-9 if lifted == 1 else 1e-7
    np.testing.assert_allclose(other.theta, -one.theta[:, ::-1], rtol=0, atol=tolerance)
    np.testing.assert_allclose(other.r, one.r[:, ::-1], rtol=0, atol=tolerance)


@settings(derandomize=True, max_examples=15, deadline=None)
@given(scale=st.floats(0.2, 5.0), angle=st.floats(0.05, 0.4), model=st.sampled_from(["ho", "pendulum", "nsp"]))
def test_units_of_length_do_not_matter(scale: float, angle: float, model: str) -> None:
    """All lengths and gravity by one factor, string force per weight and e(v) the same: the same angles."""
    one = Cradle(bobs=3, model=model, delta=0.002, power_law=(0.05, 0.0))
    other = one.replace(
        length=one.length * scale, pivot_half_spacing=one.pivot_half_spacing * scale, radius=one.radius * scale,
        gravity=one.gravity * scale,
    )  # fmt: skip
    runs = [simulate(cradle, Release(angle=angle), 2.0) for cradle in (one, other)]
    np.testing.assert_allclose(runs[0].theta, runs[1].theta, rtol=0, atol=1e-8)


def test_runs_repeat_bit_for_bit() -> None:
    cradle = Cradle(bobs=5, delta=-0.001)
    runs = []
    for seed in (1, 2):
        np.random.seed(seed)
        runs.append(simulate(cradle, RELEASE, 20.0))
    assert same(*runs)


@pytest.mark.parametrize("bobs", [2, 5])
@pytest.mark.parametrize("delta", [-0.005, 0.0])
def test_samples_do_not_touch_the_motion(bobs: int, delta: float) -> None:
    cradle = Cradle(bobs=bobs, delta=delta)
    runs = [simulate(cradle, RELEASE, 20.0, rate, ledger=rate > 100) for rate in (10.0, 240.0, 1000.0)]
    runs.append(simulate(cradle, RELEASE, times=np.array([20.0])))
    for run in runs[1:]:
        assert np.array_equal(run.impacts, runs[0].impacts)
        assert np.array_equal(run.theta[-1], runs[0].theta[-1])
    assert np.array_equal(runs[1].theta[::24], runs[0].theta)


@pytest.mark.parametrize("workers", [1, 2, 7, None])
def test_a_batch_is_single_runs_bit_for_bit(workers: int | None) -> None:
    cradles = [
        Cradle(bobs=bobs, model=model, delta=delta, b=b)
        for bobs, model, delta, b in [
            (1, "nsp", 0.0, 0.002), (2, "ho", 0.0, 0.0), (5, "nsp", -0.005, 0.002), (3, "pendulum", 0.01, 0.1),
            (10, "nsp", 0.0, 0.002), (2, "nsp", 0.2, 0.002), (5, "nsp", 0.0, 0.002),
        ]
    ]  # fmt: skip
    cradles.append(cradles[2].replace(effects={"quadratic_drag": {"c2": 2e-3}, "contact_duration": {"scale": 1.0}}))
    releases = [Release(angle=0.1 + 0.02 * i) for i in range(len(cradles))]
    batch = simulate_batch(cradles, releases, 5.0, workers=workers)
    for run, cradle, release in zip(batch, cradles, releases, strict=True):
        assert (run.cradle, run.release) == (cradle, release)
        assert same(run, simulate(cradle, release, 5.0))


def test_threads_find_the_curves_complete() -> None:
    """The first impacts of a process, in several threads at a time, have the restitution of the later ones."""
    code = """
import threading
from cradle_env.mechanics.restitution import universal_curves
ready, tables = threading.Barrier(4), []
def look():
    ready.wait()
    tables.append(universal_curves().copy())
threads = [threading.Thread(target=look) for _ in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
assert all((table == universal_curves()).all() for table in tables)
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


@pytest.mark.slow
def test_the_process_that_compiles_computes_the_same_bits(tmp_path) -> None:
    """As one that finds the kernels compiled: which parts were inlined must not show (contracted multiply-adds did)."""
    package = Path(cradle_env.__file__).parent
    shutil.copytree(package, tmp_path / "cradle_env", ignore=shutil.ignore_patterns("__pycache__"))
    code = "from cradle_env import *; print(simulate(Cradle(), Release(angle=0.2), 10.0).theta.tobytes().hex())"

    def bits() -> str:
        done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout

    assert bits() == bits()


def test_one_cradle_or_one_release_serves_all() -> None:
    releases = [RELEASE, Release(angle=0.1)]
    for run, release in zip(simulate_batch(Cradle(bobs=2), releases, 1.0), releases, strict=True):
        assert same(run, simulate(Cradle(bobs=2), release, 1.0))
    cradles = [Cradle(bobs=2), Cradle(bobs=3)]
    assert [run.theta.shape[1] for run in simulate_batch(cradles, RELEASE, 1.0)] == [2, 3]
    assert simulate_batch(cradles, RELEASE, 1.0, ledger=True)[0].energy().total.shape == (241,)
    with pytest.raises(ValueError, match="kept no energy ledger"):
        simulate_batch(cradles, RELEASE, 1.0)[0].energy()
    with pytest.raises(ValueError, match="2 cradles and 3 releases"):
        simulate_batch(cradles, [RELEASE] * 3, 1.0)


def test_fifty_bobs() -> None:
    run = simulate(Cradle(bobs=50), RELEASE, 10.0)
    assert run.gaps().min() >= -1e-9
    # The blow runs through the row: the last bob leaves with most of the first one's speed.
    assert run.theta[:, 0].min() < -0.15
    np.testing.assert_allclose(run.energy().total, run.energy().total[0], rtol=0, atol=2e-7)


def test_one_bob_hits_nothing() -> None:
    run = simulate(Cradle(bobs=1), RELEASE, 10.0)
    assert len(run.impacts) == 0
    assert run.gaps().shape == (2401, 0)


@pytest.mark.parametrize(
    ("bobs", "beginning"),
    [
        (1, RELEASE),
        (1, InitialState(np.full(1, 0.2), np.zeros(1))),
        (2, Release(angle=0.2, bobs=2)),
        (2, Release(angle=0.0)),
    ],
    ids=["one bob", "one bob in motion", "all lifted", "none lifted"],
)
def test_nothing_to_synchronize_with(bobs: int, beginning: Release | InitialState) -> None:
    run = simulate(Cradle(bobs=bobs), beginning, 3.0)
    assert np.isnan(run.sigma()).all() and run.sigma().shape == run.t.shape
    assert np.isnan(run.newton_exponent())


@pytest.mark.parametrize("name", ["spacer_offset.offset[3]", "spacer_offset.offset[0]", "angle_offset.offset[1]"])
def test_a_value_by_number_that_is_not_there_is_refused_by_name(name):
    cradle = Cradle(bobs=3, effects={"spacer_offset": {"offset": [0.0, 0.0]}})
    with pytest.raises(ValueError, match=re.escape(name)):
        cradle.with_values({name: 1e-3})
