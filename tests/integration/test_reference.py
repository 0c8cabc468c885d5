"""The two independent integrators against the numbers of the physics notes, and against each other."""

import numpy as np
import pytest

from identification.bench import scipy_contact, scipy_peer
from tests.reference.soft_contact import SoftCradle, simulate_soft

# The restitutions and chains of the notes are those of k_el = 1.46e10 N/m^1.5 of Table 1. The formula gives 1.4558e10,
# which lowers e by 5e-5: far more than the integrators err.
TABLE_MODULUS = 200e9 * 1.46e10 / scipy_contact.Peer(2).k_el
KAPPA = SoftCradle(2).constants().kappa


def angle_for_speed(speed: float, length: float = 0.30, gravity: float = 9.81) -> float:
    """Release angle (rad) of a rigid pendulum without drag that reaches `speed` at the bottom."""
    return 2 * np.arcsin(speed / (2 * np.sqrt(gravity * length)))


@pytest.mark.parametrize(("speed", "e", "duration"), [(0.1, 0.97745, 199), (0.5, 0.96905, 144), (1.0, 0.96456, 125)])
def test_pair_restitution_and_duration(speed: float, e: float, duration: float) -> None:
    peer = scipy_contact.Peer(2, youngs_modulus=TABLE_MODULUS)
    assert scipy_contact.restitution_curve(peer)(speed) == pytest.approx(e, abs=5e-6)
    a = peer.k_f * peer.k_el**-0.6 * (peer.mass / 2) ** -0.4 * speed**0.2
    seconds = scipy_contact.kk_pair(a)[1] * ((peer.mass / 2) ** 2 / (peer.k_el**2 * speed)) ** 0.2
    assert seconds * 1e6 == pytest.approx(duration, abs=0.5)

    cradle = SoftCradle(2, youngs_modulus=TABLE_MODULUS, strings="rigid", b=0.0)
    run = simulate_soft(cradle, {2: angle_for_speed(speed)}, times=np.array([0.4]))
    contact = run.contacts[0]
    assert contact["speed"] == pytest.approx(speed, rel=1e-6)
    energy = peer.mass / 4 * contact["speed"] ** 2  # of the relative motion
    assert np.sqrt(1 - contact["energy_lost"] / energy) == pytest.approx(e, abs=6e-6)
    assert contact["duration"] * 1e6 == pytest.approx(duration, abs=0.5)


def test_restitution_curve_is_the_integration() -> None:
    peer = scipy_contact.Peer(2)
    scale = peer.k_f * peer.k_el**-0.6 * (peer.mass / 2) ** -0.4
    curve = scipy_contact.restitution_curve(peer)
    for speed in np.geomspace(1e-9, 5, 12):
        assert curve(speed) == pytest.approx(scipy_contact.kk_pair(scale * speed**0.2)[0], abs=1e-12)


def test_the_chain_is_as_good_as_its_tolerance_says_to_two_digits() -> None:
    exact, *found = (
        scipy_contact.kk_chain(scipy_contact.Peer(5), 0.391, np.ones(3), rtol, 0.01 * rtol)
        for rtol in (3e-14, 1e-12, 1e-10)
    )
    tight, loose = (np.abs(impulses - exact).max() for impulses in found)
    assert tight < 1e-10 < loose < 1e-8


@pytest.mark.parametrize(
    "velocities", [[-0.0612, 0.0906, 0.9706], [-0.0614, -0.0227, -0.0069, 0.1412, 0.9499]], ids=["3", "5"]
)
def test_chain_at_rest(velocities: list[float]) -> None:
    """Velocities over that of the bob that hits, which comes first."""
    bobs = len(velocities)
    impulses = scipy_contact.kk_chain(scipy_contact.Peer(bobs, youngs_modulus=TABLE_MODULUS), 0.391, np.ones(bobs - 2))
    after = np.diff(-impulses, prepend=-1, append=0)
    np.testing.assert_allclose(after, velocities, atol=6e-5)

    # Contacts so short that gravity has no part: the velocities at 10 us after the first touch.
    cradle = SoftCradle(bobs, youngs_modulus=TABLE_MODULUS, strings="rigid", b=0.0, stiffness_factor=1e6)
    angles = {bobs: angle_for_speed(0.391)}
    touch = simulate_soft(cradle, angles, times=np.array([0.4])).contacts["time"][0]
    run = simulate_soft(cradle, angles, times=np.array([touch + 1e-5]))
    np.testing.assert_allclose(-run.theta_dot[0, ::-1] * cradle.length / 0.391, velocities, atol=6e-5)


@pytest.mark.parametrize("delta", [0.0, -0.005])
def test_energy_never_grows(delta: float) -> None:
    cradle = SoftCradle(3, strings="elastic", delta=delta)
    energy = simulate_soft(cradle, {3: 0.228}, times=np.linspace(0, 5, 1201)).energy()
    assert np.diff(energy).max() < 1e-12
    free = SoftCradle(3, strings="elastic", delta=delta, k_f=0.0, b=0.0)
    energy = simulate_soft(free, {3: 0.228}, times=np.linspace(0, 5, 1201)).energy()
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("factor", [1.0, 1e4])
@pytest.mark.parametrize("strings", ["hysteretic", "elastic", "rigid"])
def test_pressed_bobs_start_at_rest(strings: str, factor: float) -> None:
    cradle = SoftCradle(5, delta=[-0.005, 0.001, -0.005, -0.002], strings=strings, stiffness_factor=factor)
    run = simulate_soft(cradle, {}, times=np.array([0.0, 0.5]))
    assert run.theta[0, 0] < -1e-5 < 1e-5 < run.theta[0, -1]
    np.testing.assert_allclose(run.theta[1], run.theta[0], rtol=0, atol=1e-10)


@pytest.mark.parametrize("strings", ["hysteretic", "elastic"])
@pytest.mark.parametrize("bobs", [2, 5])
def test_halved_steps_change_nothing(bobs: int, strings: str) -> None:
    cradle = SoftCradle(bobs, strings=strings)
    times = np.linspace(0, 5, 601)
    coarse = simulate_soft(cradle, {bobs: 0.228}, times=times)
    fine = simulate_soft(cradle, {bobs: 0.228}, times=times, tolerance=1e-11 / 32, max_step=5e-4)
    np.testing.assert_allclose(coarse.theta, fine.theta, rtol=0, atol=1e-9 if bobs == 2 else 1e-6)


@pytest.mark.parametrize("strings", ["hysteretic", "elastic"])
@pytest.mark.parametrize("bobs", [2, 3])
def test_short_contacts_are_instantaneous_impacts(bobs: int, strings: str) -> None:
    """The difference is the duration of contact: f^-0.4, two powers of ten of f for 10^0.8 of angle."""
    times = np.linspace(0, 3, 721)
    hard, _, _ = scipy_peer.simulate(
        bobs, angle=0.228, times=times, strings=strings, kappa=KAPPA, rtol=1e-12, atol=1e-14
    )

    def difference(factor: float) -> float:
        cradle = SoftCradle(bobs, strings=strings, stiffness_factor=factor)
        return np.abs(simulate_soft(cradle, {bobs: 0.228}, times=times).theta - hard).max()

    assert difference(1e4) < 5e-5
    assert difference(1e4) / difference(1e6) == pytest.approx(10**0.8, rel=0.02)


def test_blows_too_short_part_bobs_that_hang_at_unequal_heights() -> None:
    """Bobs 1.4e-5 of their length apart in height are 2e-10 m apart: struck as one while a blow presses them by far
    more, so that the stiffer the contacts the further they are from the blow on equal bobs, by f^0.4."""
    times = np.linspace(0, 0.5, 121)
    uneven = {"length_mismatch": {"relative": [4.9e-5, 3.5e-5, -5e-6]}}

    def moved(factor: float) -> float:
        runs = (
            simulate_soft(SoftCradle(3, stiffness_factor=factor, effects=effects), {3: 0.228}, times=times).theta[:, 1]
            for effects in (uneven, {})
        )
        return float(np.abs(np.subtract(*runs)).max())

    assert moved(3e4) < 1e-4
    assert moved(1e10) / moved(1e8) == pytest.approx(10**0.8, rel=0.3)


def test_peer_impact_times_converge() -> None:
    times = np.linspace(0, 5, 601)
    runs = [
        scipy_peer.simulate(2, angle=0.228, times=times, strings="elastic", rtol=1e-13, atol=1e-15, max_step=max_step)
        for max_step in (2e-3, 5e-3)
    ]
    np.testing.assert_allclose(runs[0][2], runs[1][2], rtol=0, atol=1e-12)


def test_peer_refuses_pressed_bobs() -> None:
    with pytest.raises(ValueError, match="delta >= 0"):
        scipy_peer.simulate(2, angle=0.2, times=np.array([0.0, 1.0]), delta=-0.001)
