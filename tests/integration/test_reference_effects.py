"""The effects of the soft-contact reference, each against something that it was not derived from."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from identification.experiment.experiment import Experiment
from tests.reference import laboratory
from tests.reference.soft_contact import KEYS, SoftCradle, simulate_soft
from tests.synthetic import recorded_run

MASS, LENGTH, G = 0.2813, 0.30, 9.81

#: Everything that acts on three bobs at once, apart from measurement.
ALL = {
    "group_drag": {"slope": 5.0},
    "added_mass": {"mass": 0.03},
    "frame_compliance": {"frame_mass": 3.0, "frequency": 4.0, "damping_ratio": 0.02},
    "spacer_offset": {"offset": [2e-4, -1e-4]},
    "mass_mismatch": {"relative": [0.02, -0.03, 0.01]},
    "length_mismatch": {"relative": [0.01, -0.005, 0.0]},
    "string_creep": {"rate": 2e-5},
    "bob_attraction": {"force": 5e-3, "range": 5e-3},
    "frame_drag": {"c2": 3.0},
    "string_kink": {"stiffening": 0.2, "angle": 0.1},
    "sticky_pair": {"energy": 2e-5, "pair": 2},
    "pivot_friction": {"tau_c": 1e-4},
    "smooth_friction": {"tau_c": 2e-4},
    "stribeck_friction": {"tau_c": 1e-4, "tau_s": 2e-4},
    "quadratic_drag": {"c2": 2e-3},
    "power_drag": {"c": 3e-3},
    "side_wind": {"force": 0.01, "centre": 0.02, "width": 0.05},
    "vibration": {"acceleration": 0.02, "frequency": 3.0, "phase": 0.3},
    "magnet": {"energy": 1e-4, "bob": 3, "angle": 0.05},
    "power_attraction": {"force": 3e-3},
    "squeeze_film": {"coefficient": 1e-12},
}


def without(effects: dict, *names: str) -> dict:
    return {name: values for name, values in effects.items() if name not in names}


def test_all_effects_are_tested_together() -> None:
    measured = {"angle_offset", "angle_scale", "clock_scale", "exposure_blur"}
    assert set(ALL) == set(KEYS) - measured - {"contact_duration"}


@pytest.mark.parametrize("strings", ["rigid", "elastic", "hysteretic"])
def test_energy_ledger_closes(strings: str) -> None:
    """Motion, weight and frame, with all that was taken: 0.2 J, of which every step may err by some 1e-13."""
    effects = ALL
    if strings == "rigid":  # creep so fast that the bobs' radial inertia counts
        effects = without(ALL, "string_kink") | {"string_creep": {"rate": 5e-3}}
    run = simulate_soft(SoftCradle(3, strings=strings, effects=effects), {3: 0.228}, times=np.linspace(0, 3, 301))
    assert len(run.contacts) > 10
    assert np.ptp(run.mechanical_energy()) > 5e-3
    total = run.mechanical_energy() + run.taken.sum(axis=1)
    np.testing.assert_allclose(total, total[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("strings", ["rigid", "elastic"])
def test_a_free_frame_keeps_momentum(strings: str) -> None:
    """Contacts, attraction and friction in the pivots pass between bobs and frame, and nothing else acts along x."""
    internal = ("added_mass", "mass_mismatch", "bob_attraction", "sticky_pair", "squeeze_film", "pivot_friction")
    frame = {"frame_mass": 2.0, "frequency": 0.0, "damping_ratio": 0.0}
    effects = {name: ALL[name] for name in internal} | {"frame_compliance": frame}
    cradle = SoftCradle(3, strings=strings, b=0.0, effects=effects)
    run = simulate_soft(cradle, {3: 0.228}, times=np.linspace(0, 3, 301))
    bobs = run.velocity()[0] @ cradle.constants().inertia
    assert len(run.contacts) > 10
    assert np.ptp(bobs) > 0.1
    np.testing.assert_allclose(bobs + 2.0 * run.frame[:, 1], 0, atol=1e-10)


def test_halved_steps_change_nothing() -> None:
    """Kinks of forces included; 1e-11 per step, grown by some 15 impacts of three bobs."""
    cradle, times = SoftCradle(3, effects=ALL), np.linspace(0, 2, 121)
    coarse = simulate_soft(cradle, {3: 0.228}, times=times)
    fine = simulate_soft(cradle, {3: 0.228}, times=times, tolerance=1e-11 / 32, max_step=5e-4)
    np.testing.assert_allclose(coarse.theta, fine.theta, rtol=0, atol=1e-7)


@pytest.mark.parametrize("strings", ["rigid", "elastic", "hysteretic"])
@pytest.mark.parametrize("delta", [0.003, -0.005])
def test_what_hangs_at_rest_stays(strings: str, delta: float) -> None:
    """Blown at, attracted, leaning on each other, on a frame that they push aside by F/K; the root is good to 1e-12."""
    names = ("frame_compliance", "bob_attraction", "side_wind", "magnet", "mass_mismatch", "length_mismatch")
    effects = {name: ALL[name] for name in (*names, "string_kink")[: None if strings != "rigid" else -1]}
    cradle = SoftCradle(3, delta=delta, strings=strings, effects=effects)
    run = simulate_soft(cradle, {}, times=np.array([0.0, 1.0]))
    np.testing.assert_allclose(run.theta[1], run.theta[0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.r[1], run.r[0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.frame[1], run.frame[0], rtol=0, atol=1e-10)
    wind = {"side_wind": {"force": 0.02}, "frame_compliance": ALL["frame_compliance"]}
    blown = simulate_soft(SoftCradle(3, strings="rigid", delta=0.5, effects=wind), {}, times=np.array([0.0, 1.0]))
    np.testing.assert_allclose(np.tan(blown.theta), 0.02 / (MASS * G), rtol=1e-9)
    np.testing.assert_allclose(blown.frame[:, 0], 0.06 / (3.0 * (2 * np.pi * 4.0) ** 2), rtol=1e-9)


def cartesian(cradle: SoftCradle, start: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Bobs on elastic strings that never meet, under ALL but contact and dry friction: (T, N, 2) in the room.

    Newton's law in Cartesian coordinates, state x, y, vx, vy (4, N) and X, X'; start (2, N): x and y.
    """
    e, n, a = cradle.effects, cradle.bobs, cradle.pivot_half_spacing
    weight = MASS * (1 + np.array(e["mass_mismatch"]["relative"]))
    inertia = weight + e["added_mass"]["mass"]
    r0 = LENGTH * (1 + np.array(e["length_mismatch"]["relative"]))
    diameter = 2 * cradle.radius
    gaps = diameter * (1 + cradle.delta + np.array(e["spacer_offset"]["offset"]))
    pivots = np.append(0.0, np.cumsum(gaps))
    pivots -= pivots.mean()
    frame = e["frame_compliance"]
    omega = 2 * np.pi * frame["frequency"]

    def rate(t: float, state: np.ndarray) -> np.ndarray:
        x, y, vx, vy = state[:-2].reshape(4, n)
        big_x, big_v = state[-2:]
        dx = x - pivots - big_x
        r, theta = np.hypot(dx, y), np.arctan2(dx, -y)
        natural = np.hypot(r0, a)
        tension = cradle.kappa * (np.hypot(r, a) - natural - e["string_creep"]["rate"] * np.log(1 + t))
        assert np.all(tension > 0)
        kink = e["string_kink"]
        tension *= 1 + kink["stiffening"] * np.exp(-(((theta - kink["angle"]) / 0.05) ** 2))
        pull_x, pull_y = (-4 * tension * r0 / natural * part / r for part in (dx, y))
        speed = np.hypot(vx, vy)
        drag = cradle.b + e["quadratic_drag"]["c2"] * speed + e["power_drag"]["c"] * np.sqrt(speed)
        wind = e["side_wind"]
        shaking = 0.02 * np.sin(2 * np.pi * 3.0 * t + 0.3) * weight
        fx = pull_x + shaking + wind["force"] * np.exp(-(((x - wind["centre"]) / wind["width"]) ** 2))
        fy = pull_y - weight * G
        for i in range(n - 1):
            apart = np.array([x[i + 1] - x[i], y[i + 1] - y[i]])
            gap = np.linalg.norm(apart) - diameter
            assert gap > 0
            normal = apart / (gap + diameter)
            opening = normal @ [vx[i + 1] - vx[i], vy[i + 1] - vy[i]]
            push = -e["bob_attraction"]["force"] * np.exp(-gap / e["bob_attraction"]["range"])
            push -= e["power_attraction"]["force"] / (1 + gap / 5e-3) ** 4
            push -= e["squeeze_film"]["coefficient"] * opening / (gap + 1e-4) ** 3
            fx[[i, i + 1]] += np.array([-1, 1]) * push * normal[0]
            fy[[i, i + 1]] += np.array([-1, 1]) * push * normal[1]
            drag[[i, i + 1]] += cradle.b * e["group_drag"]["slope"] * np.exp(-gap / 5e-3)
        fx -= drag * vx
        fy -= drag * vy
        away = (theta[2] - 0.05) / 0.05  # the magnet: a potential -energy exp(-away^2) of the angle alone
        slope = 2 * e["magnet"]["energy"] * away / 0.05 * np.exp(-(away**2))
        fx[2] -= slope * -y[2] / r[2] ** 2
        fy[2] -= slope * dx[2] / r[2] ** 2
        mass = frame["frame_mass"]
        on_frame = -pull_x.sum() - mass * omega**2 * big_x - 2 * frame["damping_ratio"] * mass * omega * big_v
        on_frame -= e["frame_drag"]["c2"] * abs(big_v) * big_v
        return np.concatenate([vx, vy, fx / inertia, fy / inertia, [big_v, on_frame / mass]])

    begin = np.concatenate([start[0], start[1], np.zeros(2 * n + 2)])
    begin[-2] = start[2, 0]
    found = solve_ivp(rate, (0, times[-1]), begin, "DOP853", times, rtol=1e-11, atol=1e-13, max_step=2e-3)
    return np.stack([found.y[:n].T, found.y[n : 2 * n].T], axis=2)


def test_all_forces_at_once_in_cartesian_coordinates() -> None:
    """Both integrators keep 1e-11 per step of a smooth motion: some 1e-9 m in two seconds."""
    friction = ("sticky_pair", "pivot_friction", "smooth_friction", "stribeck_friction")
    effects = without(ALL, *friction) | {
        "squeeze_film": {"coefficient": 1e-8},
        "frame_compliance": {"frame_mass": 1.0, "frequency": 1.5, "damping_ratio": 0.02},
    }
    cradle = SoftCradle(3, strings="elastic", kappa=196.0, delta=0.5, effects=effects)
    times = np.linspace(0, 2, 81)
    run = simulate_soft(cradle, {1: -0.10, 3: 0.12}, "hanging", times=times)
    x, y = run.position(), -run.r * np.cos(run.theta)
    start = np.array([x[0], y[0], np.full(3, run.frame[0, 0])])
    other = cartesian(cradle, start, times)
    assert len(run.contacts) == 0
    np.testing.assert_allclose(x, other[:, :, 0], rtol=0, atol=2e-9)
    np.testing.assert_allclose(y, other[:, :, 1], rtol=0, atol=2e-9)
    # Without a frame there is no frame_drag; every other effect is seen a hundredfold.
    for name in without(effects, "frame_compliance"):
        lacking = replace(cradle, effects=without(effects, name))
        less = simulate_soft(lacking, {1: -0.10, 3: 0.12}, "hanging", times=times)
        assert np.abs(less.position() - x).max() > 2e-7, name


def one_bob(effects: dict, rate, angle: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """One rigid pendulum without drag b: the reference, and theta'' = -g/r sin th + torque(t, th, th')/(m r^2)."""
    times = np.linspace(0, 5, 101)

    def slope(t: float, state: np.ndarray) -> list[float]:
        theta, omega = state
        return [omega, -G / LENGTH * np.sin(theta) + rate(t, theta, omega) / (MASS * LENGTH**2)]

    found = solve_ivp(slope, (0, 5), [angle, 0.0], "DOP853", times, rtol=1e-11, atol=1e-13, max_step=2e-3)
    run = simulate_soft(SoftCradle(1, strings="rigid", b=0.0, effects=effects), {1: angle}, times=times)
    return run.theta[:, 0], found.y[0]


@pytest.mark.parametrize(
    ("name", "values", "torque"),
    [
        ("pivot_friction", {"tau_c": 1e-3}, lambda t, th, om: -1e-3 * np.tanh(om / 0.02)),
        ("smooth_friction", {"tau_c": 1e-3, "rate": 0.3}, lambda t, th, om: -1e-3 * om / (abs(om) + 0.3)),
        (
            "stribeck_friction",
            {"tau_c": 1e-3, "tau_s": 2e-3, "rate": 0.4},
            lambda t, th, om: -(1e-3 + 1e-3 * np.exp(-((om / 0.4) ** 2))) * np.tanh(om / 0.02),
        ),
        ("quadratic_drag", {"c2": 0.02}, lambda t, th, om: -0.02 * LENGTH**3 * abs(om) * om),
        ("power_drag", {"c": 0.02, "power": 1.3}, lambda t, th, om: -0.02 * LENGTH**2.3 * abs(om) ** 0.3 * om),
        ("side_wind", {"force": 0.1}, lambda t, th, om: 0.1 * LENGTH * np.cos(th)),
        (
            "side_wind",
            {"force": 0.1, "centre": 0.02, "width": 0.03},
            lambda t, th, om: 0.1 * LENGTH * np.cos(th) * np.exp(-(((LENGTH * np.sin(th) - 0.02) / 0.03) ** 2)),
        ),
        (
            "vibration",
            {"acceleration": 0.1, "frequency": 0.8, "phase": 0.0},
            lambda t, th, om: MASS * 0.1 * np.sin(2 * np.pi * 0.8 * t) * LENGTH * np.cos(th),
        ),
        (
            "magnet",
            {"energy": 1e-3, "bob": 1, "angle": 0.1, "width": 0.05},
            lambda t, th, om: -2e-3 * (th - 0.1) / 0.05**2 * np.exp(-(((th - 0.1) / 0.05) ** 2)),
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_forces_on_one_bob(name: str, values: dict, torque) -> None:
    """The kinks of |v|^p and |v| where the bob turns cost 1e-9; each force moves the bob by 1e-2."""
    found, expected = one_bob({name: values}, torque)
    np.testing.assert_allclose(found, expected, rtol=0, atol=5e-9)
    bare, _ = one_bob({}, lambda t, th, om: 0.0)
    assert np.abs(found - bare).max() > 2e-3


def test_added_mass_is_a_heavier_bob_of_less_weight() -> None:
    """m + m' at the gravity g m/(m + m'): contacts and strings included. Rounding alone, grown by 8 impacts."""
    more, kappa = 0.05, 196.0
    times = np.linspace(0, 3, 181)
    added = SoftCradle(2, kappa=kappa, effects={"added_mass": {"mass": more}})
    heavy = SoftCradle(2, kappa=kappa, mass=MASS + more, gravity=G * MASS / (MASS + more))
    runs = [simulate_soft(cradle, {2: 0.228}, times=times) for cradle in (added, heavy)]
    np.testing.assert_allclose(runs[0].theta, runs[1].theta, rtol=0, atol=1e-10)
    np.testing.assert_allclose(runs[0].contacts["energy_lost"], runs[1].contacts["energy_lost"], rtol=1e-6)
    # And its period is sqrt(1 + m'/m) times as long: one bob at stretched times.
    slow = SoftCradle(1, strings="rigid", b=0.0, effects={"added_mass": {"mass": more}})
    stretched = simulate_soft(slow, {1: 0.3}, times=times * np.sqrt(1 + more / MASS)).theta
    plain = simulate_soft(SoftCradle(1, strings="rigid", b=0.0), {1: 0.3}, times=times).theta
    np.testing.assert_allclose(stretched, plain, rtol=0, atol=1e-10)


@pytest.mark.parametrize("strings", ["rigid", "elastic"])
def test_frame_and_pendulum_are_two_linear_oscillators(strings: str) -> None:
    """Small swings: the matrix exponential. Beyond it sin th, and r under th'^2, of order th^3 = 1e-12."""
    frame_mass, frequency, ratio, b = 1.5, 1.1, 0.01, 0.004
    effects = {"frame_compliance": {"frame_mass": frame_mass, "frequency": frequency, "damping_ratio": ratio}}
    cradle = SoftCradle(1, strings=strings, b=b, effects=effects)
    times = np.linspace(0, 20, 201)
    run = simulate_soft(cradle, {1: 1e-4}, "hanging", times=times)
    r = run.r[0, 0]
    omega = 2 * np.pi * frequency
    mass = np.array([[frame_mass + MASS, MASS * r], [MASS * r, MASS * r**2]])
    spring = np.diag([frame_mass * omega**2, MASS * G * r])
    damping = np.diag([2 * ratio * frame_mass * omega, 0]) + b * np.array([[1, r], [r, r**2]])
    inverse = np.linalg.inv(mass)
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ spring, -inverse @ damping]])
    advance, expected = expm(system * times[1]), np.zeros((201, 4))
    expected[0, 1] = 1e-4
    for i in range(200):
        expected[i + 1] = advance @ expected[i]
    np.testing.assert_allclose(run.theta[:, 0], expected[:, 1], rtol=0, atol=3e-11)
    np.testing.assert_allclose(run.frame, expected[:, [0, 2]], rtol=0, atol=3e-11)
    assert np.abs(run.frame[:, 0]).max() > 1e-6


def test_a_heavy_or_stiff_frame_is_none() -> None:
    """X is the pull of some 1 N over M w^2, and shifts all bobs alike."""
    times = np.linspace(0, 2, 121)
    still = simulate_soft(SoftCradle(2), {2: 0.228}, times=times).theta
    for mass, frequency in ((np.inf, 5.0), (1.0, np.inf), (1e9, 5.0)):
        effects = {"frame_compliance": {"frame_mass": mass, "frequency": frequency, "damping_ratio": 0.01}}
        moved = simulate_soft(SoftCradle(2, effects=effects), {2: 0.228}, times=times).theta
        np.testing.assert_allclose(moved, still, rtol=0, atol=1e-7)


def test_creep() -> None:
    """A bob that only hangs keeps its tension, so its strings grow as they creep, once the first jolt is forgotten."""
    times = np.linspace(10, 30, 41)
    for strings, tolerance in (("elastic", 3e-8), ("hysteretic", 3e-8), ("rigid", 1e-13)):  # m: b r' takes 1e-8
        cradle = SoftCradle(1, strings=strings, b=1.0, effects={"string_creep": {"rate": 1e-4}})
        run = simulate_soft(cradle, {}, times=times)
        total = np.hypot(run.r[0], cradle.pivot_half_spacing) + 1e-4 * np.log((1 + times) / 11)
        expected = np.sqrt(total**2 - cradle.pivot_half_spacing**2)
        np.testing.assert_allclose(run.r[:, 0], expected, rtol=0, atol=tolerance)
    # A swing on rigid strings that are paid out slowly keeps E/w: its amplitude goes like r^-3/4, to order theta^2.
    cradle = SoftCradle(1, strings="rigid", b=0.0, effects={"string_creep": {"rate": 5e-3}})
    run = simulate_soft(cradle, {1: 1e-3}, times=np.linspace(5, 60, 20001))
    r, theta, speed = run.r[:, 0], run.theta[:, 0], run.theta_dot[:, 0]
    amplitude = np.sqrt(theta**2 + speed**2 * r / G) * r**0.75
    assert np.ptp(r) / r[0] > 0.03
    assert np.ptp(amplitude) / amplitude[0] < 2e-3  # r'/(r w) = 5e-4 at 5 s is how slow "slowly" is


def test_strings_that_creep_turn_where_their_stretch_does() -> None:
    """A bob dropped on hysteretic strings that creep fast: r alone, each reversal of s' an event; 1e-11 per step."""
    rate, natural, b, kappa = 2e-3, np.hypot(LENGTH, 0.1), 0.3, 196.0
    times = np.linspace(0, 0.5, 51)
    cradle = SoftCradle(1, kappa=kappa, b=b, effects={"string_creep": {"rate": rate}})
    run = simulate_soft(cradle, {1: 0.0}, times=times)

    def stretched(t: float, r: float) -> float:
        return np.hypot(r, 0.1) - natural - rate * np.log1p(t)

    def tension(s: float, loading: bool, s_turn: float, t_turn: float) -> float:
        return max(t_turn + kappa * (s - s_turn), 0) if loading else t_turn * (s / s_turn) ** 2

    def slope(t: float, state: np.ndarray, *law: float) -> list[float]:
        pull = 4 * tension(stretched(t, state[0]), *law) * LENGTH / natural
        return [state[1], G - (pull + b * state[1]) / MASS]

    def turns(t: float, state: np.ndarray, *_: float) -> float:
        return state[0] * state[1] / np.hypot(state[0], 0.1) - rate / (1 + t)

    turns.terminal = True
    t, state, law, parts = 0.0, [LENGTH, 0.0], (True, 0.0, 0.0), []
    while t < times[-1]:
        turns.direction = -1 if law[0] else 1
        options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14, "events": turns, "dense_output": True}
        part = solve_ivp(slope, (t, times[-1]), state, args=law, **options)
        t, state = part.t[-1], part.y[:, -1]
        s = stretched(t, state[0])
        law = (not law[0], s, tension(s, *law))
        parts.append((t, part.sol))
    assert len(parts) > 5
    expected = [next(sol for end, sol in parts if time <= end)(time)[0] for time in times]
    np.testing.assert_allclose(run.r[:, 0], expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("delta", [0.0, 0.05])
def test_bobs_in_phase_are_slowed_by_their_neighbours(delta: float) -> None:
    """Both swing as one bob would at b (1 + slope exp(-gap/range)); contacts that do not press add rounding."""
    gap, times = 2 * 0.020 * delta, np.linspace(0, 10, 101)
    cradle = SoftCradle(2, strings="rigid", delta=delta, effects={"group_drag": {"slope": 15.0, "range": 4e-3}})
    pair = simulate_soft(cradle, {1: 0.2, 2: 0.2}, times=times).theta
    b = 0.002 * (1 + 15.0 * np.exp(-gap / 4e-3))
    alone = simulate_soft(SoftCradle(1, strings="rigid", b=b), {1: 0.2}, times=times).theta
    np.testing.assert_allclose(pair, alone.repeat(2, axis=1), rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("effects", "force"),
    [
        ({"bob_attraction": {"force": 0.02, "range": 5e-3}}, lambda gap: 0.02 * np.exp(-gap / 5e-3)),
        ({"power_attraction": {"force": 0.02, "power": 3.0}}, lambda gap: 0.02 * (1 + gap / 5e-3) ** -3),
    ],
    ids=["bob_attraction", "power_attraction"],
)
def test_attraction_at_rest(effects: dict, force) -> None:
    """Two bobs lean together by tan th = F(gap)/(m g), the line of centres being level; they stay there."""
    cradle = SoftCradle(2, strings="rigid", delta=0.2, effects=effects)
    run = simulate_soft(cradle, {}, times=np.array([0.0, 2.0]))
    lean = brentq(lambda th: np.tan(th) - force(8e-3 - 2 * LENGTH * np.sin(th)) / (MASS * G), 0, 0.01, xtol=1e-15)
    np.testing.assert_allclose(run.theta, [[lean, -lean]] * 2, rtol=0, atol=1e-12)
    # In touch they press on each other as hard as they attract: F = k_el eps^1.5.
    touching = SoftCradle(2, strings="rigid", effects=effects)
    theta = simulate_soft(touching, {}, times=np.array([0.0, 0.5])).theta
    overlap = (0.02 / touching.constants().k_el) ** (2 / 3)
    np.testing.assert_allclose(LENGTH * (theta[:, 0] - theta[:, 1]), overlap, rtol=0.005)  # weight resists a little


def test_mismatches_and_spacers() -> None:
    """Far apart, each bob is a damped oscillator of its own: beyond it sin th, 1e-9 of 1e-3 rad in 57 rad of phase."""
    lengths, masses = [0.03, -0.02, 0.0], [0.05, 0.0, -0.05]
    effects = {"length_mismatch": {"relative": lengths}, "mass_mismatch": {"relative": masses}}
    times = np.linspace(0, 10, 101)
    cradle = SoftCradle(3, strings="rigid", b=0.02, delta=1.0, effects=effects)
    theta = simulate_soft(cradle, {1: 1e-3, 2: 1e-3, 3: 1e-3}, times=times).theta
    decay = 0.02 / (2 * MASS * (1 + np.array(masses)))
    omega = np.sqrt(G / (LENGTH * (1 + np.array(lengths))) - decay**2)
    t = times[:, None]
    expected = 1e-3 * np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t))
    np.testing.assert_allclose(theta, expected, rtol=0, atol=5e-9)

    offset = SoftCradle(3, delta=1e-3, effects={"spacer_offset": {"offset": [5e-4, -2e-3]}})
    stated = SoftCradle(3, delta=[1.5e-3, -1e-3])
    runs = [simulate_soft(cradle, {3: 0.2}, times=times[:11]).theta for cradle in (offset, stated)]
    np.testing.assert_allclose(*runs, rtol=0, atol=1e-9)  # 1e-3 + 5e-4 is rounded


def test_contact_duration_is_a_stiffness() -> None:
    runs = [
        simulate_soft(cradle, {2: 0.228}, times=np.array([0.5])).contacts[0]
        for cradle in (SoftCradle(2), SoftCradle(2, effects={"contact_duration": {"scale": 0.1}}))
    ]
    assert runs[1]["duration"] / runs[0]["duration"] == pytest.approx(0.1, rel=1e-3)  # it comes somewhat faster
    assert runs[1]["energy_lost"] == pytest.approx(runs[0]["energy_lost"], rel=1e-3)


def test_a_sticky_pair_loses_its_energy_at_each_separation() -> None:
    """The ledger's third column holds nothing else here. The gap at which it begins to tear is located to 1e-12 s."""
    energy = 3e-5
    cradle = SoftCradle(2, strings="rigid", b=0.0, effects={"sticky_pair": {"pair": 1, "energy": energy}})
    run = simulate_soft(cradle, {2: 0.228}, times=np.linspace(0, 3, 31))
    separations = np.searchsorted(run.contacts["time"], run.times)
    assert separations[-1] >= 5
    np.testing.assert_allclose(run.taken[:, 2], energy * separations, rtol=1e-6, atol=1e-12)


def test_instrument() -> None:
    """Scale, offset and clock are exact. Over an exposure, a small swing shrinks by sin(w D/2)/(w D/2)."""
    plain = SoftCradle(1, strings="rigid", b=0.0)
    exact = {"angle_scale": {"scale": 0.01}, "angle_offset": {"offset": 2e-3}, "clock_scale": {"scale": -0.02}}
    seen = laboratory.record(
        SoftCradle(1, strings="rigid", b=0.0, effects=exact), {1: 0.2}, duration=2.0, noise=0.0, rate=60.0
    )
    truth = simulate_soft(plain, {1: 0.2}, times=np.arange(121) / 60 / 0.98).theta
    np.testing.assert_allclose(seen.times, np.arange(121) / 60, rtol=0, atol=1e-15)
    np.testing.assert_allclose(seen.readings, 1.01 * truth + 2e-3, rtol=0, atol=1e-13)

    blurred = SoftCradle(1, strings="rigid", b=0.0, effects={"exposure_blur": {"duration": 0.1}})
    readings = laboratory.record(blurred, {1: 1e-3}, duration=2.0, noise=0.0).readings[4:, 0]
    omega = np.sqrt(G / LENGTH)
    swing = 1e-3 * np.cos(omega * np.arange(4, 121) / 60)
    shrunk = swing * np.sin(omega * 0.05) / (omega * 0.05)
    np.testing.assert_allclose(readings, shrunk, rtol=0, atol=1.5e-9)  # of sin th, 1e-3^3/16 w t
    assert np.abs(swing - shrunk).max() > 1e-5


def test_positions_are_counted_from_rest_in_the_room() -> None:
    frame = {"frame_compliance": {"frame_mass": 1.0, "frequency": 2.0, "damping_ratio": 0.05}}
    cradle = SoftCradle(3, strings="elastic", delta=-0.01, b=1.0, effects=frame)
    film = laboratory.record(cradle, {3: 0.1}, duration=20.0, rate=10.0, quantity="x", noise=0.0)
    np.testing.assert_allclose(film.readings[-1], 0, atol=1e-5)  # at rest again
    np.testing.assert_allclose(film.readings, film.run.position() - film.run.position()[-1], rtol=0, atol=1e-5)
    assert abs(film.run.theta[-1, 0]) > 1e-4


def test_noise_has_the_memory_it_is_given() -> None:
    """To four standard errors: of some n/6 = 13,000 independent readings, and of n = 80,000."""
    noise = laboratory.correlated_noise((40000, 2), 3.0, np.random.default_rng(1))
    products = [np.mean(noise**2), *(np.mean(noise[:-lag] * noise[lag:]) for lag in (1, 2, 6))]
    np.testing.assert_allclose(products, np.exp(-np.array([0, 1, 2, 6]) / 3), rtol=0, atol=0.035)
    white = laboratory.correlated_noise((40000, 2), 0.0, np.random.default_rng(1))
    assert abs(np.mean(white[1:] * white[:-1])) < 0.015


@pytest.mark.parametrize(("quantity", "unit"), [("theta", "rad"), ("theta", "deg"), ("x", "mm")])
def test_files_are_read_by_the_project(quantity: str, unit: str, tmp_path: Path) -> None:
    """What was written comes back, to the twelve digits of the file."""
    scale = laboratory.UNITS[unit]
    films = [
        laboratory.record(
            SoftCradle(3, delta=delta, effects={"quadratic_drag": {"c2": 2e-3}}),
            angles,
            start,
            duration=1.0,
            quantity=quantity,
            noise=1e-3,
            seed=seed,
        )
        for seed, (delta, angles, start) in enumerate(
            [(0.0, {3: 0.228}, "unstretched"), ([1e-3, -2e-3], {1: -0.1, 3: 0.2}, "hanging")]
        )
    ]
    films[1] = laboratory.lose_track(laboratory.drop_frames(films[1], 0.2, seed=4), 2, 0.3, 0.5)
    path = laboratory.write_experiment(tmp_path, films, unit=unit, stated={"b": 0.003}, run={"fit_to": 0.8})
    experiment = Experiment.load(path)
    assert experiment.cradle.b == 0.003
    assert experiment.cradle.kappa == films[0].cradle.string_stiffness
    for run, film in zip(experiment.runs, films, strict=True):
        np.testing.assert_allclose(run.times, film.times, rtol=0, atol=1e-11)
        np.testing.assert_allclose(run.readings, film.readings, rtol=0, atol=1e-11 / scale * np.pi)
        assert run.noise == pytest.approx(1e-3)
        assert run.fit_to == 0.8
        in_memory = recorded_run(film, fit_to=0.8)
        assert in_memory.release == run.release
        np.testing.assert_array_equal(np.broadcast_to(in_memory.delta, 2), np.broadcast_to(run.delta, 2))
    assert len(experiment.runs[1].times) < 61
    assert np.isnan(experiment.runs[1].readings[:, 1]).any()


def test_a_tracker_slips() -> None:
    film = laboratory.record(SoftCradle(2), {2: 0.2}, duration=1.0, noise=0.0)
    slipped = laboratory.tracking_jump(film, 2, 0.05, 0.5, 0.7)
    moved = slipped.readings - film.readings
    inside = (film.times >= 0.5) & (film.times <= 0.7)
    np.testing.assert_allclose(moved[:, 1], 0.05 * inside, atol=1e-15)
    assert not moved[:, 0].any()


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"wind": {}}, "no effect 'wind'"),
        ({"side_wind": {}}, "keys are force, centre, width"),
        ({"side_wind": {"force": 1.0, "speed": 2.0}}, "keys are force"),
        ({"frame_drag": {"c2": 1.0}}, "add frame_compliance"),
    ],
)
def test_unknown_effects_are_refused(effects: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SoftCradle(2, effects=effects)


def test_nothing_of_the_package_is_used() -> None:
    for source in Path(laboratory.__file__).parent.glob("*.py"):
        imports = [line for line in source.read_text().splitlines() if "import " in line]
        assert not any("cradle_env" in line or "identification" in line for line in imports)
