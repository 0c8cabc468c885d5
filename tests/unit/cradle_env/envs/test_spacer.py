"""The spacer in motion, and σ as an episode sees it: against equations in other coordinates, and against whole runs."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import cradle_env  # noqa: F401  registers the environments
from cradle_env import Cradle, Release, simulate
from cradle_env.synchronization import WINDOW

MODELS = pytest.mark.parametrize("model", ["nsp", "pendulum", "ho"])


def environment(**settings_):
    return gym.make("NewtonCradle-v0", dtype=np.float64, **settings_).unwrapped


def ledger(info: dict) -> float:
    held = info["kinetic"] + info["gravity"] + info["strings"]
    return held + info["drag"] + info["collisions"] - info["spacer"]


def driven(env, actions) -> list[tuple[np.ndarray, dict]]:
    env.reset(seed=0)
    return [(step[0], step[4]) for step in map(env.step, actions)]


@MODELS
@given(data=st.data(), bobs=st.integers(1, 6), speed=st.floats(0.001, 0.1), seed=st.integers(0, 1000))
@settings(deadline=None, max_examples=12)
def test_no_energy_from_nowhere(model: str, data, bobs: int, speed: float, seed: int) -> None:
    effects = data.draw(st.sampled_from([{}, {"quadratic_drag": {"c2": 0.01}}, {"pivot_friction": {"tau_c": 1e-3}}]))
    env = environment(bobs=bobs, model=model, effects=effects, spacer_speed=speed, delta_range=(-0.05, 0.2))
    actions = np.random.default_rng(seed).uniform(-1, 1, (300, 2))
    totals = [ledger(info) for _, info in driven(env, actions)]
    # Energies between steps are interpolated by cubics, as the strings jerk after a jump of the pivots' speeds: 5e-7 J
    # at single instants with one bob, of some 0.1 J. The speeds grow along the row, so that their sum is as N².
    np.testing.assert_allclose(totals, totals[0], rtol=0, atol=1e-6 * bobs**2)
    assert abs(np.median(totals) - totals[0]) < (2e-6 if "pivot_friction" in effects else 5e-7)


def bob_on_moving_pivot(cradle: Cradle, angle: float, speeds: np.ndarray, interval: float):
    """theta, r and the work of the pivot [J] at the end of every interval, during which the pivot moves at speeds[k].

    Polar coordinates about the pivot, which is an inertial frame as long as its speed is constant; when it jumps by
    du, the velocity relative to it jumps by -du along x. Elastic strings are released unstretched, but hang stretched.
    """
    m, g, r0, a, b = cradle.mass, cradle.gravity, cradle.length, cradle.pivot_half_spacing, cradle.b
    elastic, hysteretic = cradle.has("radial_elasticity"), cradle.has("string_hysteresis")
    memory = {"loading": True, "s": 0.0, "T": 0.0}  # the branch of eq. 4 and the point at which it began

    def tension(s):
        if memory["loading"]:
            return memory["T"] + cradle.kappa * (s - memory["s"])
        return memory["T"] * (s / memory["s"]) ** 2

    def stretch(r):
        return np.hypot(r, a) - np.hypot(r0, a)

    def reverse(r):
        s = stretch(r)
        memory.update(loading=not memory["loading"], s=s, T=tension(s))

    def rates(_t, y, u):
        theta, r, w, v, _ = y
        drag_r, drag_t = -b * (v + u * np.sin(theta)), -b * (r * w + u * np.cos(theta))
        if elastic:
            pull = 4 * tension(stretch(r)) * r0 / np.hypot(r0, a)
            dv = r * w**2 + g * np.cos(theta) + (drag_r - pull) / m
        else:
            pull, dv = m * r * w**2 + m * g * np.cos(theta) + drag_r, 0.0
        dw = (-g * np.sin(theta) - 2 * v * w + drag_t / m) / r
        return [w, v, dw, dv, -pull * np.sin(theta) * u]

    def reversal(_t, y, _u):
        return y[3] if hysteretic else 1.0

    reversal.terminal = True
    stretched = np.hypot(r0, a) * (1 + m * g / (4 * cradle.kappa * r0)) if elastic and angle == 0 else np.hypot(r0, a)
    y, u, out = np.array([angle, np.sqrt(stretched**2 - a**2), 0.0, 0.0, 0.0]), 0.0, []
    for speed in speeds:
        sin, cos = np.sin(y[0]), np.cos(y[0])
        if not elastic:  # the rod pulls at the mean of both speeds
            y[4] += m * (speed - u) * sin**2 * 0.5 * (speed + u)
        y[2] -= (speed - u) * cos / y[1]
        y[3] -= (speed - u) * sin if elastic else 0.0
        u, t = speed, 0.0
        if hysteretic and y[3] != 0 and (y[3] > 0) != memory["loading"]:
            reverse(y[1])
        while t < interval:
            reversal.direction = -1.0 if memory["loading"] else 1.0
            part = solve_ivp(
                rates, (t, interval), y, args=(u,), method="DOP853", rtol=1e-12, atol=1e-14, events=reversal
            )
            t, y = part.t[-1], part.y[:, -1].copy()
            if part.status == 1:
                reverse(y[1])
        out.append(y[[0, 1, 4]])
    return np.array(out)


@pytest.mark.parametrize(("model", "effects"), [("nsp", {}), ("nsp", {"-string_hysteresis": {}}), ("pendulum", {})])
def test_motion_and_work_of_a_moving_pivot(model: str, effects: dict) -> None:
    """Two bobs that never touch, their pivots moved at random."""
    env = environment(
        bobs=2, model=model, effects=effects, b=0.05, delta=0.17, release_angle=0.01, delta_range=(0.14, 0.2),
        release_angle_range=(0.005, 0.02), spacer_speed=0.003,
    )  # fmt: skip
    actions = np.random.default_rng(1).uniform(-1, 1, (200, 2))
    actions[0] = 0.0
    steps = driven(env, actions)
    assert steps[-1][1]["impacts"] == 0 and np.ptp([info["delta"] for _, info in steps]) > 0.01
    interval = env.settings.control_interval
    rates = np.diff([0.17, *(info["delta"] for _, info in steps)]) / interval
    cradle = Cradle(bobs=2, model=model, effects=effects, b=0.05)
    work = 0.0
    for bob, angle in ((0, 0.0), (1, 0.01)):
        theta, r, done = bob_on_moving_pivot(cradle, angle, rates * 2 * cradle.radius * (bob - 0.5), interval).T
        seen = np.array([observation for observation, _ in steps])
        # Of motions of 0.01 rad and 3 mm: interpolated on steps twice as long as those of `simulate`.
        np.testing.assert_allclose(seen[:, 2 + bob], theta, rtol=0, atol=2e-9)
        np.testing.assert_allclose(seen[:, bob], r, rtol=0, atol=2e-7 if model == "nsp" else 1e-15)
        work = work + done
    # Of some 1e-6 J that go in and out, interpolated by cubics.
    np.testing.assert_allclose([info["spacer"] for _, info in steps], work, rtol=0, atol=5e-9)


def test_spacer_is_no_faster_than_stated_and_ends_where_it_is_sent() -> None:
    env = environment(bobs=3, spacer_speed=0.002)
    infos = [info for _, info in driven(env, [np.zeros(2), *[np.ones(2)] * 200])]
    delta = np.array([info["delta"] for info in infos])
    per_step = 0.002 / 0.04 / 60  # speed over the diameter of a bob, per interval
    assert np.diff(delta).max() <= per_step * (1 + 1e-9) and np.all(np.diff(delta) >= 0)
    assert delta[-1] == 0.1 and delta[119] == pytest.approx(0.1 * 119 / 120, rel=1e-9)


@pytest.mark.parametrize(("bobs", "model"), [(2, "nsp"), (2, "pendulum"), (3, "nsp")])
def test_a_spacer_at_rest_is_a_whole_run(bobs: int, model: str) -> None:
    env = environment(bobs=bobs, model=model, delta=0.003, synchronized_at=1e-6)
    steps = driven(env, [np.zeros(2)] * 3600)
    seen, infos = np.array([s[0] for s in steps]), [s[1] for s in steps]
    cradle = Cradle(bobs=bobs, model=model, delta=0.003)
    run = simulate(cradle, Release(angle=0.228), 60.0, sample_rate=120.0)
    early = 600 if bobs == 2 else 120  # 10 s; with more bobs rounding grows
    # A step twice as long is 2^8 times less exact: 3e-8 rad.
    np.testing.assert_allclose(seen[:early, bobs : 2 * bobs], run.theta[2 : 2 * early + 2 : 2], rtol=0, atol=5e-8)
    np.testing.assert_allclose(seen[:early, :bobs], run.r[2 : 2 * early + 2 : 2], rtol=0, atol=1e-7)
    energy = run.energy()
    for name, column in (("kinetic", "kinetic"), ("drag", "drag"), ("collisions", "impacts"), ("strings", "strings")):
        ours = [info[name] for info in infos[:early]]
        np.testing.assert_allclose(ours, getattr(energy, column)[2 : 2 * early + 2 : 2], rtol=0, atol=1e-6)

    # σ is that of the middle of the window behind; λ is over what has been seen.
    half = round(0.5 * 1.05 * cradle.period * 120)
    whole = run.sigma()
    now = 2 * np.arange(1, 3601)
    known = now >= 2 * half
    sigma = np.array([info["sigma"] for info in infos])
    np.testing.assert_array_equal(sigma[~known], 1.0)
    atol = 1e-6 if bobs == 2 else 2e-3  # the order of touching bobs, once rounding has grown
    np.testing.assert_allclose(sigma[known], whole[now[known] - half], rtol=0, atol=atol)
    exponent = run.newton_exponent((WINDOW[0], 60.0 - half / 120 + 1e-9))
    assert infos[-1]["newton_exponent"] == pytest.approx(exponent, rel=1e-4 if bobs == 2 else 2e-2)


def test_release_never_presses_on_neighbours() -> None:
    env = environment(bobs=5, delta=-0.05, delta_range=(-0.05, 0.1), release_angle_range=(1e-6, 0.5), start="hanging")
    env.reset()
    _, _, _, _, info = env.step(np.array([0.0, -1.0]))
    # Four bobs lean out by one and a half gaps of 2 mm over 0.3 m, to the square of the lean; the fifth by one more.
    assert info["release_angle"] == pytest.approx(2.5 * 0.002 / 0.3, rel=0.02)
    assert info["kinetic"] < 1e-4


@pytest.mark.parametrize(
    "told",
    [
        {"bobs": 40},  # the lowest that actions reach by default
        {"bobs": 40, "model": "ho", "start": "hanging"},
        {"bobs": 5, "delta_range": (-0.05, 0.1), "release_angle_range": (0.01, 0.5)},
        {"bobs": 9, "delta_range": (-0.05, 0.1), "release_angle_range": (0.01, 0.5), "released_bobs": 4},
    ],
)
def test_lifted_bobs_clear_those_that_hang(told: dict) -> None:
    """In both environments alike, and no more than needed."""
    env, lowest = environment(**told), np.full(2, -1.0)
    env.reset(seed=0)
    info = env.step(lowest)[4]
    whole = gym.make("NewtonCradleRelease-v0", duration=2.0, **told)
    whole.reset(seed=0)
    after = whole.step(lowest)[4]
    assert after["release_angle"] == pytest.approx(info["release_angle"], rel=1e-9) and info["release_angle"] < 0.06
    bobs, start = told.get("released_bobs", 1), told.get("start", "unstretched")
    release = Release(angle=info["release_angle"], bobs=bobs, start=start)
    gaps = simulate(whole.unwrapped.cradle, release, times=np.zeros(1)).gaps()[0]
    np.testing.assert_allclose(gaps, 0.0, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("kappa", "mass", "speed", "seed"), [(2e5, 0.2813, 0.01, 28), (2e5, 0.03, 0.1, 11)])
def test_stiff_strings_that_turn_at_almost_no_stretch(kappa: float, mass: float, speed: float, seed: int) -> None:
    """Where a string unloads from next to nothing, its parabola must not be followed below zero stretch."""
    env = environment(bobs=3, delta=0.1, delta_range=(0.03, 0.15), spacer_speed=speed, kappa=kappa, mass=mass)
    actions = np.random.default_rng(seed).uniform(-1, 1, (300, 2))
    totals = [ledger(info) for _, info in driven(env, [np.zeros(2), *actions])]
    np.testing.assert_allclose(totals, totals[0], rtol=0, atol=1e-6)  # 4e-9 J were measured; it was 200 J


@pytest.mark.parametrize("model", ["pendulum", "ho"])
def test_a_spacer_that_starts_amid_a_contact(model: str) -> None:
    """Rigid strings jerk by next to nothing 120 µs after the first touch, which lasts 150 µs: that changes nothing."""
    followed = {"contact_duration": {"scale": 1.0}}
    touch = simulate(Cradle(bobs=2, model=model, effects=followed), Release(angle=0.228), 0.5).impacts["time"][0]
    env = environment(bobs=2, model=model, effects=followed, actions=("delta",), control_interval=touch + 120e-6)
    (_, before), (at_rest, _) = driven(env, [np.zeros(1), np.zeros(1)])
    _, (moved, after) = driven(env, [np.zeros(1), np.full(1, 1e-9)])
    assert after["delta"] > 0.0
    np.testing.assert_allclose(moved[2:4], at_rest[2:4], rtol=0, atol=1e-4)  # they turned over; 20 J
    assert ledger(after) == pytest.approx(ledger(before), abs=1e-7)
