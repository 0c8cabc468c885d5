"""The energy ledger: what is held and what was taken add up; nothing comes from nowhere; bobs at rest stay so."""

import numpy as np
import pytest

from cradle_env import Cradle, InitialState, Release, Trajectory, simulate
from tests.reference.soft_contact import SoftCradle, simulate_soft

ELASTIC = {"-string_hysteresis": {}}
RELEASE = Release(angle=0.228)
CASES = pytest.mark.parametrize(("bobs", "delta"), [(2, 0.0), (3, -0.005), (5, 0.0), (5, 0.01), (10, -0.02)])

# Samples between steps are interpolated where bobs do not fly on series; velocities err with the 5th power of the step.
# By default that is up to 1.1e-7 J; at a quarter of the step, 1e-10 J.
FINE = 1e-19
# A chain of touching bobs is integrated to 1e-7 a step; 36 chains in 20 s, of 0.02 J, err by 1.2e-8 J at most.
TOLERANCE = 3e-9


def held(run: Trajectory) -> np.ndarray:
    energy = run.energy()
    return energy.kinetic + energy.gravity + energy.strings


@CASES
@pytest.mark.parametrize("effects", [ELASTIC, {}], ids=["elastic", "hysteretic"])
def test_ledger_closes(bobs: int, delta: float, effects: dict) -> None:
    cradle = Cradle(bobs=bobs, delta=delta, effects=effects)
    total = simulate(cradle, RELEASE, 20.0, tolerance=FINE).energy().total
    np.testing.assert_allclose(total, total[0], rtol=0, atol=TOLERANCE)
    total = simulate(cradle, RELEASE, 20.0).energy().total
    np.testing.assert_allclose(total, total[0], rtol=0, atol=2e-7)


@CASES
@pytest.mark.parametrize("model", ["ho", "pendulum"])
def test_ledger_closes_on_rigid_strings(bobs: int, delta: float, model: str) -> None:
    run = simulate(Cradle(bobs=bobs, delta=delta, model=model), RELEASE, 20.0, tolerance=FINE)
    np.testing.assert_allclose(run.energy().total, run.energy().total[0], rtol=0, atol=TOLERANCE)
    np.testing.assert_array_equal(run.energy().strings, 0.0)


@CASES
def test_energy_never_grows_on_elastic_strings(bobs: int, delta: float) -> None:
    cradle = Cradle(bobs=bobs, delta=delta, effects=ELASTIC)
    assert np.diff(held(simulate(cradle, RELEASE, 20.0, tolerance=FINE))).max() <= 1e-10
    free = held(simulate(cradle.replace(k_f=0.0, b=0.0), RELEASE, 20.0, tolerance=FINE))
    # Nothing takes energy. What chains make of it, which lose nothing that would hide their errors: 5e-8 J.
    np.testing.assert_allclose(free, free[0], rtol=0, atol=1e-8)


@pytest.mark.parametrize("effects", [{}, {"length_mismatch": {"relative": [0.05, -0.05]}}], ids=["equal", "uneven"])
def test_bobs_that_hang_have_no_energy_of_swinging(effects: dict) -> None:
    cradle = Cradle(bobs=2, delta=0.05, effects={"mass_mismatch": {"relative": [0.3, -0.3]}, **effects})
    hanging = simulate(cradle, Release(angles={1: 0.0}, start="hanging"), 0.5)
    # A joule of each, m g r, is known to some 1e-16 of it.
    np.testing.assert_allclose(hanging.swing_energy(), 0.0, atol=1e-12)


@CASES
@pytest.mark.parametrize("effects", [ELASTIC, {}], ids=["elastic", "hysteretic"])
def test_what_is_taken_never_comes_back(bobs: int, delta: float, effects: dict) -> None:
    # 1.4 rad: the strings go slack before every impact.
    run = simulate(Cradle(bobs=bobs, delta=delta, effects=effects), Release(angle=1.4), 10.0)
    energy = run.energy()
    # Interpolation of what drag took: its rate is positive, its cubic errs by some 1e-9 J.
    assert np.diff(energy.drag).min() >= -1e-9
    assert np.diff(energy.impacts).min() >= 0
    lost = run.ledger[:, :, 5]  # of each bob, up to its last slack
    if effects:
        np.testing.assert_allclose(lost, 0, atol=1e-9)  # the quadrature of the strings' work
    else:
        assert lost[-1, -1] > 0.01
        assert np.diff(lost, axis=0).min() >= -1e-12


def test_entries_are_what_they_say() -> None:
    """Strings by the closed form of their work, drag by quadrature, impacts by their rows, gravity by heights."""
    cradle = Cradle(bobs=3, effects=ELASTIC)
    run = simulate(cradle, RELEASE, 5.0, sample_rate=4000.0)
    energy = run.energy()
    a, r0, L0 = cradle.pivot_half_spacing, cradle.length, np.hypot(cradle.length, cradle.pivot_half_spacing)

    def antiderivative(r: np.ndarray) -> np.ndarray:
        """Of s dr, s = √(r² + a²) − L0."""
        return (r * np.hypot(r, a) + a**2 * np.arcsinh(r / a)) / 2 - L0 * r

    stretched = np.maximum(run.r, r0)
    stored = 4 * cradle.kappa * r0 / L0 * (antiderivative(stretched) - antiderivative(np.full_like(stretched, r0)))
    np.testing.assert_allclose(energy.strings, stored.sum(axis=1), rtol=0, atol=1e-10)
    speed2 = run.r_dot**2 + (run.r * run.theta_dot) ** 2
    np.testing.assert_allclose(energy.kinetic, cradle.mass / 2 * speed2.sum(axis=1), rtol=1e-12)
    weight = cradle.mass * cradle.gravity
    np.testing.assert_allclose(energy.gravity, -weight * (run.r * np.cos(run.theta)).sum(axis=1), rtol=1e-12)
    power = cradle.b * speed2.sum(axis=1)
    taken = np.concatenate([[0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(run.t))])
    # Impacts swap velocities between bobs, so the power is smooth but for what they take: the trapezoid does.
    np.testing.assert_allclose(energy.drag, taken, rtol=0, atol=1e-8)
    losses = [run.impacts["loss"][run.impacts["time"] <= t].sum() for t in run.t[::500]]
    np.testing.assert_allclose(energy.impacts[::500], losses, rtol=0, atol=1e-15)


def test_hysteresis_loop_of_one_bob() -> None:
    """A bob let go at r0 overshoots along the loading line and comes back along the parabola (eq. 4): at the next
    turn the strings have lost the area between, by a closed form."""
    cradle = Cradle(bobs=1, b=0.0)
    run = simulate(cradle, Release(angles={1: 0.0}), 0.2, sample_rate=20000.0)
    a, r0 = cradle.pivot_half_spacing, cradle.length
    L0 = np.hypot(r0, a)
    lowest = int(np.argmax(run.r[:, 0] * (run.t < 0.1)))
    highest = lowest + int(np.argmax(run.r_dot[lowest + 5 :, 0] > 0)) + 5
    s = np.linspace(0, 1, 20001)

    def work(tension, r1: float, r2: float) -> float:
        r = r1 + (r2 - r1) * s
        values = 4 * tension(np.hypot(r, a) - L0) * r0 / L0
        return float((values.sum() - (values[0] + values[-1]) / 2) * (r2 - r1) / (len(s) - 1))

    top = np.hypot(run.r[lowest, 0], a) - L0
    down = work(lambda stretch: cradle.kappa * stretch, r0, run.r[lowest, 0])
    up = work(lambda stretch: cradle.kappa * top * (stretch / top) ** 2, run.r[lowest, 0], run.r[highest, 0])
    strings = run.energy().strings
    # The turns are found between samples 50 µs apart.
    assert strings[lowest] - strings[0] == pytest.approx(down, rel=1e-6)
    assert strings[highest] - strings[lowest] == pytest.approx(up, rel=1e-5)


@pytest.mark.parametrize("delta", [-0.05, -0.005, -1e-4])
@pytest.mark.parametrize("bobs", [2, 5, 10])
def test_leaning_bobs_stay_at_rest(bobs: int, delta: float) -> None:
    """The equilibrium of N bobs, from a run that lifts one more out of their way; then on their own."""
    run = simulate(Cradle(bobs=bobs + 1, delta=delta), Release(angle=0.9), 0.05)
    theta, r = run.theta[0, :bobs], run.r[0, :bobs]
    assert theta[0] < 0 < theta[-1]
    # Rounding only: there is no force left that could move them.
    np.testing.assert_allclose(run.theta[:, :bobs], theta[None].repeat(len(run.t), 0), rtol=0, atol=1e-14)
    cradle = Cradle(bobs=bobs, delta=delta)
    np.testing.assert_allclose(theta, -theta[::-1], rtol=0, atol=1e-15)
    run = simulate(cradle, InitialState(theta=theta, theta_dot=np.zeros(bobs), r=r), 10.0)
    np.testing.assert_allclose(run.theta, theta[None].repeat(len(run.t), 0), rtol=0, atol=1e-14)
    np.testing.assert_allclose(run.gaps(), 0, rtol=0, atol=1e-11)
    assert len(run.impacts) == 0


@pytest.mark.parametrize("strings", ["rigid", "elastic"])
def test_leaning_equilibrium(strings: str) -> None:
    """Against a root finder on the balance of all forces; spheres 10^10 times as stiff are all but rigid."""
    delta = (-0.005, 0.001, -0.01, -0.002, 0.0)
    model = "pendulum" if strings == "rigid" else "nsp"
    run = simulate(Cradle(bobs=6, delta=delta, model=model), Release(angle=0.3), times=np.array([0.0]))
    soft = SoftCradle(6, delta=list(delta), strings=strings, stiffness_factor=1e10)
    state = simulate_soft(soft, {6: 0.3}, times=np.array([0.0]))
    np.testing.assert_allclose(run.theta, state.theta, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.r, state.r, rtol=0, atol=1e-12)


def test_slack_strings_hold_nothing() -> None:
    """A bob let go 5 mm above the length of its strings."""
    run = simulate(Cradle(bobs=1), InitialState(np.zeros(1), np.zeros(1), r=np.full(1, 0.295)), 1.0)
    energy = run.energy()
    assert energy.strings[0] == 0.0
    np.testing.assert_allclose(energy.total, energy.total[0], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("fields", "tolerance"),
    [
        ({"b": 100.0}, 1e-8),
        ({"b": 1000.0}, 1e-8),
        ({"effects": {"pivot_friction": {"tau_c": 1.0}}}, 1e-8),
        ({"b": 1.0, "effects": {"group_drag": {"slope": 20.0, "range": 0.1}}}, 1e-6),
        ({"effects": {"bob_attraction": {"force": 10.0, "range": 0.05}}}, 3e-3),  # single instants, interpolated
    ],
    ids=["drag", "more drag", "friction", "drag of a group", "attraction"],
)
@pytest.mark.parametrize("model", ["ho", "pendulum", "nsp"])
def test_the_strongest_of_what_may_be_declared(fields: dict, tolerance: float, model: str) -> None:
    """Steps follow what is stiffer than the swing: the ledger closes, the motion is that of steps a quarter as long."""
    cradle = Cradle(bobs=2, model=model, **fields)
    run, fine = (simulate(cradle, RELEASE, 3.0, tolerance=t) for t in (1e-14, 1e-19))
    np.testing.assert_allclose(run.energy().total, run.energy().total[0], rtol=0, atol=tolerance)
    np.testing.assert_allclose(run.theta, fine.theta, rtol=0, atol=1e-4)  # it was 3 mrad and more


def test_what_is_stiffer_than_any_cradle_is_refused() -> None:
    with pytest.raises(ValueError, match=r"b acts on a bob within 2.8e-06 s; it must take 1.7e-05 s or more"):
        simulate(Cradle(bobs=1, b=1e5), RELEASE, 1.0)
    friction = {"pivot_friction": {"tau_c": 1.0}}
    with pytest.raises(ValueError, match="pivot_friction: tau_c acts on a bob within"):
        simulate(Cradle(bobs=1, mass=1e-3, effects=friction), RELEASE, 1.0)
