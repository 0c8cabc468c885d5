"""Learned laws as effects: known by name, never candidates, absent at 0 to the bit, present as what they say."""

import math
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cradle_env import CATALOGUE, Cradle, InitialState, Release, restitution_curve, simulate
from cradle_env.effects import LEARNED, effect, known_effects
from cradle_env.simulation import equilibrium
from identification import Experiment
from identification.diagnosis.selection.candidates import list_candidates
from tests.unit.cradle_env.test_effects import TIMES, angles, one_bob

RELEASE = Release(angle=0.3)
SCALES = {"angle": 0.3, "speed": 0.5, "frequency": 1.3}
EACH = pytest.mark.parametrize("declared", LEARNED, ids=lambda declared: declared.name)


def law(name: str, **coefficients: float) -> dict:
    """The effect with these coefficients, the others 0."""
    values = effect(name).absent_values()
    return {name: {**values, **{k: v for k, v in SCALES.items() if k in values}, **coefficients}}


@EACH
def test_known_by_name_but_no_candidate(declared) -> None:
    assert effect(declared.name) is declared
    assert declared not in CATALOGUE and declared not in known_effects()
    assert declared.name not in {candidate.name for candidate in list_candidates(Cradle(bobs=3))}
    assert all(getattr(declared, text).strip() for text in ("summary", "equation", "reference", "energy", "looks_like"))


@EACH
def test_absent_is_the_base_bit_for_bit(declared) -> None:
    for model in ("ho", "pendulum", "nsp"):
        runs = [simulate(Cradle(bobs=3, model=model, effects=e), RELEASE, 5.0) for e in ({}, law(declared.name))]
        np.testing.assert_array_equal(runs[0].theta, runs[1].theta)
        np.testing.assert_array_equal(runs[0].ledger, runs[1].ledger)


COEFFICIENTS = {
    "push": 4e-3, "even": -3e-3, "surge": 2e-3, "cubic": 5e-3, "quintic": -4e-3, "well": 6e-3, "dry": 1e-3,
    "slow": 2e-3, "stick": 2e-3, "square": 3e-3, "cube": 4e-3, "wide": 5e-3, "loaded": 1e-3, "radial": 2e-2,
    "hump_1": 3e-3, "hump_2": -2e-3, "hump_3": 1e-3, "hump_4": 2e-3, "hump_5": -1e-3, "hump_6": 2e-3, "hump_7": -3e-3,
    "tug_1": 2e-2, "tug_2": -3e-2, "tug_3": 4e-2, "tug_4": 3e-2, "tug_5": -2e-2, "tug_6": 3e-2, "tug_7": -4e-2,
    "cosine": 3e-3, "sine": -4e-3,
}  # fmt: skip


def formula(t: float, _r: float, theta: float, v_r: float, v_t: float) -> tuple[float, float]:
    """The library as its declaration states it, term by term."""
    x, u, c = theta / 0.3, v_t / 0.5, COEFFICIENTS
    along = c["push"] + c["even"] * x**2 + c["surge"] * u**2 + c["cubic"] * x**3 + c["quintic"] * x**5
    along -= c["well"] * x * math.exp(-((5 * x) ** 2)) + (c["dry"] + c["loaded"] * x**2) * math.tanh(100 * u)
    along -= c["stick"] * math.sqrt(2 * math.e) * u / 0.07 * math.exp(-((u / 0.07) ** 2))
    along -= c["slow"] * u / (abs(u) + 0.1) + c["square"] * abs(u) * u + c["cube"] * u**3 + c["wide"] * x**2 * u
    along += sum(c[f"hump_{i + 4}"] * math.exp(-((4 * x - i) ** 2)) for i in range(-3, 4))
    pull = sum(c[f"tug_{i + 4}"] * math.exp(-((4 * x - i) ** 2)) for i in range(-3, 4))
    aside = c["cosine"] * math.cos(2 * math.pi * 1.3 * t) + c["sine"] * math.sin(2 * math.pi * 1.3 * t)
    return aside * math.sin(theta) - pull - c["radial"] * v_r / 0.5, aside * math.cos(theta) + along


@pytest.mark.parametrize("elastic", [False, True])
def test_the_force_is_its_formula(elastic: bool) -> None:
    """Friction all but jumps at each turn, as in test_effects. The least of the terms moves θ by 2e-5 rad: that a term
    were missing, or another's, would show."""
    base = Cradle(bobs=1, effects={"-string_hysteresis": {}}) if elastic else Cradle(bobs=1, model="pendulum")
    cradle = base.replace(effects={**base.effects, **law("learned_force", **COEFFICIENTS)})
    expected = one_bob(cradle, formula, elastic=elastic)
    np.testing.assert_allclose(angles(cradle), expected, rtol=0, atol=1e-6)
    for key in COEFFICIENTS if elastic else [key for key in COEFFICIENTS if key != "radial" and "tug" not in key]:
        without = law("learned_force", **{**COEFFICIENTS, key: 0.0})
        assert np.abs(angles(base.replace(effects={**base.effects, **without})) - expected).max() > 1e-5, key


@pytest.mark.parametrize("model", ["ho", "pendulum", "nsp"])
@pytest.mark.parametrize("coefficients", [{"push": 0.02}, {"hump_4": 0.03, "even": 0.01}, {"tug_4": 0.3, "push": 0.01}])
def test_bobs_at_rest_hang_where_the_force_lets_them(model: str, coefficients: dict) -> None:
    """A bob that nothing hits stays where it starts, to rounding; under a push along the swing that is asin(F/m g)."""
    cradle = Cradle(bobs=2, delta=8.0, model=model, effects=law("learned_force", **coefficients))
    run = simulate(cradle, RELEASE, 5.0)
    assert np.ptp(run.theta[:, 0]) < 1e-12 and np.ptp(run.r[:, 0]) < 1e-12
    lean = coefficients.get("push", 0.0) / (cradle.mass * cradle.gravity)
    if coefficients.keys() == {"push"}:
        assert run.theta[0, 0] == pytest.approx(lean if model == "ho" else math.asin(lean), rel=1e-12)


@pytest.mark.parametrize("hump", [-0.7, -0.3, 0.3])
def test_a_steep_force_lets_bobs_hang_where_they_are_still(hump: float) -> None:
    """Springs up to three times as stiff as gravity, about 25 % of the swing on either side."""
    for key in ("hump_3", "hump_5"):
        cradle = Cradle(bobs=2, delta=8.0, effects=law("learned_force", **{key: hump, "push": 0.01}))
        assert np.ptp(simulate(cradle, RELEASE, 2.0).theta[:, 0]) < 1e-9


def test_bobs_hang_where_they_would_were_a_room_that_shakes_still() -> None:
    still, shaken = (Cradle(bobs=2, effects=law("learned_force", cosine=c, sine=c, push=1e-3)) for c in (0.0, 0.01))
    for at_rest, other in zip(equilibrium(still), equilibrium(shaken), strict=True):
        np.testing.assert_array_equal(at_rest, other)
    assert simulate(shaken, RELEASE, 1.0).theta[0, 0] == simulate(still, RELEASE, 1.0).theta[0, 0]


def test_bobs_whose_rest_is_not_found_are_refused() -> None:
    """A force that changes twelve times as steeply as gravity: the search for it overshoots."""
    with pytest.raises(ValueError, match=r"no common rest was found .* a force as steep"):
        simulate(Cradle(bobs=2, delta=8.0, effects=law("learned_force", hump_4=3.0)), RELEASE, 1.0)


def test_a_motion_that_diverges_ends() -> None:
    """A drag along the strings too stiff for the steps. Left to itself, the motion was searched for meetings in strides
    that are short against its speed of some 1e20 m/s."""
    code = """
from cradle_env import Cradle, Release, simulate
from tests.unit.cradle_env.test_learned_effects import law
for size in (70.0, 80.0):
    drag = law("learned_force", angle=0.125, speed=0.214, radial=[size, 0.0, 0.0])
    cradle = Cradle(bobs=3, k_f=14935.0, kappa=243.6, b=0.0172, effects=drag)
    try:
        simulate(cradle, Release(angle=0.1212), 4.0, tolerance=5e-12)
    except RuntimeError as problem:
        print(problem)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert run.stdout.count("the motion left the range of numbers: a force is too steep for the steps") == 2, run.stdout


def test_an_environment_begins_where_bobs_hang() -> None:
    env = gym.make("NewtonCradle-v0", bobs=3, delta=0.1, effects=law("learned_force", push=0.02), release_angle=0.2)
    observation, _ = env.reset(seed=0)
    lean = math.asin(0.02 / (0.2813 * 9.81))
    np.testing.assert_allclose(observation[3:6], lean, rtol=1e-6)  # before the release, in single precision
    env.close()


def test_bobs_in_touch_rest_under_forces_that_press_them() -> None:
    """Until the third comes down, 0.25 s later."""
    cradle = Cradle(bobs=3, effects=law("learned_force", push=[4e-3, -6e-3, 0.0]))
    run = simulate(cradle, RELEASE, 0.25)
    assert np.ptp(run.theta[:, :2], axis=0).max() < 1e-9
    free = cradle.replace(effects=law("learned_force", push=[4e-3, 0.0, 0.0]))
    assert np.ptp(simulate(free, RELEASE, 0.25).theta[:, 1]) < 1e-9


def test_each_bob_has_its_own() -> None:
    """Far apart, bobs with their own coefficients swing as each would alone."""
    values = law("learned_force", square=[1e-3, 8e-3])
    pair = Cradle(bobs=2, model="pendulum", delta=8.0, effects=values)
    run = simulate(pair, Release(angles={1: 0.3, 2: 0.3}), 5.0)
    for bob, c in enumerate((1e-3, 8e-3)):
        alone = simulate(Cradle(bobs=1, model="pendulum", effects=law("learned_force", square=c)), RELEASE, 5.0)
        np.testing.assert_allclose(run.theta[:, bob], alone.theta[:, 0], rtol=0, atol=1e-12)
    assert np.ptp(run.theta[-1]) > 1e-3


def test_the_nearest_pull_is_the_attraction_of_that_range() -> None:
    """exp(−20 gap/R) is the catalogue's exp(−gap/range) at a range of R/20 = 1 mm."""
    learned = simulate(Cradle(bobs=3, effects=law("learned_pair", pull_near=0.05)), RELEASE, 3.0)
    attraction = {"bob_attraction": {"force": 0.05, "range": 1e-3}}
    known = simulate(Cradle(bobs=3, effects=attraction), RELEASE, 3.0)
    np.testing.assert_allclose(learned.theta, known.theta, rtol=0, atol=1e-10)
    assert np.abs(known.theta - simulate(Cradle(bobs=3), RELEASE, 3.0).theta).max() > 1e-5


def test_the_film_resists_opening_and_closing() -> None:
    """Two rigid pendulums that never touch, by SciPy; the longest range of each kind."""
    cradle = Cradle(bobs=2, model="ho", delta=0.5, effects=law("learned_pair", pull_far=0.02, film_far=0.05))
    d, m = 0.06, cradle.mass

    def motion(_t: float, y: np.ndarray) -> list[float]:
        gap = d + 0.3 * (y[1] - y[0]) - 0.04
        apart = -(0.02 + 0.05 * 0.3 * (y[3] - y[2]) / 0.5) * math.exp(-gap / 0.02)
        force = [-apart, apart]
        return [y[2], y[3], *(-9.81 / 0.3 * y[i] - cradle.b / m * y[2 + i] + force[i] / m / 0.3 for i in (0, 1))]

    start = [-0.02, 0.02, 0.0, 0.0]
    expected = solve_ivp(motion, (0, 5), start, "DOP853", t_eval=TIMES, rtol=1e-12, atol=1e-14, max_step=2e-3).y[:2]
    found = simulate(cradle, InitialState(np.array(start[:2]), np.array(start[2:])), times=TIMES)
    np.testing.assert_allclose(found.theta.T, expected, rtol=0, atol=5e-9)


def test_impacts_depart_by_the_formula() -> None:
    """From the speed and loss of every impact of two bobs, and from the curve. Rigid strings lean by up to 5e-3 rad at
    impact, which raises the mass that an impact moves by the square of that."""
    base = Cradle(bobs=2, model="pendulum")
    cradle = base.replace(effects=law("learned_impact", level=-0.01, slope=0.02, bend=-0.015, gentle=0.005, wet=-0.001))
    impacts = simulate(cradle, RELEASE, 20.0).impacts
    impacts = impacts[impacts["speed"] > 1e-3]
    u = impacts["speed"] / 0.5
    wanted = (
        restitution_curve(base, impacts["speed"]) - 0.01 + 0.02 * u - 0.015 * u**2 + 0.005 * np.exp(-u / 0.1) - 1e-3 / u
    )
    taken = 1.0 - impacts["loss"] / (0.25 * base.mass * impacts["speed"] ** 2)
    np.testing.assert_allclose(np.sqrt(taken), wanted, rtol=0, atol=3e-5)
    np.testing.assert_allclose(restitution_curve(cradle, impacts["speed"]), wanted, rtol=0, atol=1e-12)


def test_wet_impacts_take_the_same_speed_each() -> None:
    """Two rigid pendulums whose every impact takes 3 mm/s, by SciPy; the last ones take all there is."""
    taken, length, radius, times = 3e-3, 0.3, 0.02, np.arange(0.0, 5.0, 1 / 60)

    def motion(_t: float, y: np.ndarray) -> list[float]:
        return [y[2], y[3], *(-9.81 / length * np.sin(y[:2]) - 0.002 / 0.2813 * y[2:])]

    def apart(y: np.ndarray) -> np.ndarray:
        return np.array([2 * radius + length * (np.sin(y[1]) - np.sin(y[0])), length * (np.cos(y[0]) - np.cos(y[1]))])

    def gap(_t: float, y: np.ndarray) -> float:
        return float(np.hypot(*apart(y))) - 2 * radius

    gap.terminal, gap.direction = True, -1.0  # type: ignore[attr-defined]
    expected, y, t = np.empty((len(times), 2)), np.array([0.0, 0.25, 0.0, 0.0]), 0.0
    while t < times[-1]:
        run = solve_ivp(motion, (t, 5.0), y, "DOP853", events=gap, rtol=1e-11, atol=1e-13, dense_output=True)
        inside = (times >= t) & (times <= run.t[-1])
        expected[inside] = run.sol(times[inside])[:2].T
        t, y = run.t[-1], run.y[:, -1].copy()
        n = apart(y) / (2 * radius)
        along = length * (np.cos(y[:2]) * n[0] + np.sin(y[:2]) * n[1]) * [1, -1]
        speed = along @ y[2:]
        y[2:] -= (1.0 + max(0.0, 1.0 - taken / speed)) * speed / (along @ along) * along
    laws = law("learned_impact", wet=-taken / 0.5)
    cradle = Cradle(bobs=2, model="pendulum", restitution=1.0, effects={**laws, "-velocity_dependent_restitution": {}})
    found = simulate(cradle, Release(angle=0.25), times=times).theta
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7)


@pytest.mark.parametrize("departure", [{}, {"level": -0.3}, {"level": 0.01, "slope": -0.2}, {"wet": -0.01}])
def test_impacts_that_are_followed_in_time_depart_as_well(departure: dict) -> None:
    """The energy that the first contact takes, of two bobs and of a touching row, is that of instantaneous impacts."""
    for bobs, delta in ((2, 0.0), (3, 0.0)):
        cradle = Cradle(bobs=bobs, delta=delta, model="pendulum", b=0.0, effects=law("learned_impact", **departure))
        followed = cradle.replace(effects={**cradle.effects, "contact_duration": {"scale": 0.01}})
        taken = [simulate(c, RELEASE, times=np.array([0.0, 0.4])).energy().impacts[-1] for c in (cradle, followed)]
        assert taken[1] == pytest.approx(taken[0], rel=1e-3)


@pytest.mark.parametrize(
    "chosen",
    [
        law("learned_force", **COEFFICIENTS),
        law("learned_pair", pull=0.01, film_far=0.01),
        law("learned_impact", level=-0.02),
    ],
    ids=lambda chosen: next(iter(chosen)),
)
def test_ledger_closes(chosen: dict) -> None:
    """As in test_effects; a force between neighbours has a kink at touch, as bob_attraction there."""
    total = simulate(Cradle(bobs=3, effects=chosen), RELEASE, 5.0, tolerance=1e-19).energy().total
    np.testing.assert_allclose(total, total[0], rtol=0, atol=2e-7)


def test_a_model_file_with_a_law_runs_everywhere(tmp_path) -> None:
    values = ", ".join(f"{k} = {v}" for k, v in law("learned_force", square=2e-3)["learned_force"].items())
    model = f'[model]\nbase = "nsp"\neffects = ["learned_force"]\n[model.parameters]\nlearned_force = {{ {values} }}\n'
    (tmp_path / "model.toml").write_text(model, encoding="utf-8")
    env = gym.make("NewtonCradle-v0", bobs=2, model=str(tmp_path / "model.toml"))
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.close()
    (tmp_path / "run1.csv").write_text("t,theta_1,theta_2\n0,0,0.2\n0.1,0,0.19\n", encoding="utf-8")
    run = '[[run]]\nfile = "run1.csv"\nrelease = { bobs = 1, angle = 0.2 }\n'
    text = f'format = "cradle-experiment/1"\n[cradle]\nbobs = 2\n{model}{run}'
    cradle = Experiment.parse(text, tmp_path / "experiment.toml").cradle
    assert cradle.effects["learned_force"]["square"] == (2e-3, 2e-3)
