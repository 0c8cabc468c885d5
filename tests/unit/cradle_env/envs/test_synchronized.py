"""What counts as synchronized: all bobs in unison after contact, by formulas that the environment does not use."""

import math

import gymnasium as gym
import numpy as np
import pytest

import cradle_env  # noqa: F401  registers the environments
from cradle_env import Cradle
from cradle_env.simulation import equilibrium

#: The spacer as wide as it goes, the release as small.
WIDE = np.array([1.0, -1.0])


def played(action, steps: int | None = None, **settings) -> list[tuple]:
    """All that an episode's steps return; `steps`: past its end, too."""
    env = gym.make("NewtonCradle-v0", dtype="float64", max_episode_steps=-1, **settings)
    env.reset(seed=0)
    taken = [env.step(action)]
    while len(taken) < steps if steps else not (taken[-1][2] or taken[-1][3]):
        taken.append(env.step(action))
    return taken


def total(steps: list[tuple]) -> float:
    return sum(step[1] for step in steps)


def test_a_lone_swing_is_no_synchronization() -> None:
    """The lifted bob reaches no other. σ falls all the same: it swings evenly to both sides."""
    steps = played(WIDE, release_angle_range=(0.005, 0.5))
    assert steps[-1][4]["time"] == pytest.approx(60.0) and not any(step[2] for step in steps)
    assert sum(step[4]["impacts"] for step in steps) == 0.0 and steps[-1][4]["sigma"] < 0.01
    assert {step[4]["asynchrony"] for step in steps} == {1.0}
    assert total(steps) == pytest.approx(-1.0)  # the time it took


def test_a_lifted_bob_that_swings_evenly_is_no_synchronization() -> None:
    """The others swing out of step with it and with each other, while σ says 0."""
    steps = played(WIDE)
    assert steps[-1][4]["time"] == pytest.approx(60.0) and not any(step[2] for step in steps)
    assert min(step[4]["sigma"] for step in steps) < 0.01
    theta = np.array([step[0][5:10] for step in steps])[-600:]  # 10 s
    assert np.corrcoef(theta.T)[-1, :-1].max() < 0.99
    assert total(steps) < 0.0


def test_bobs_that_swing_in_unison_go_on_so() -> None:
    steps = played(np.zeros(2), steps=3600)
    ends = [k for k, step in enumerate(steps) if step[2]]
    assert 2000 < ends[0] < 3000 and ends == [*range(ends[0], 3600)]
    theta = np.array([step[0][5:10] for step in steps])
    for last in (ends[0], 3599):
        swing = theta[last - 70 : last]  # a period and a bit
        assert np.corrcoef(swing.T).min() > 0.99
        assert np.ptp(np.ptp(swing, axis=0)) < 0.1 * np.ptp(swing)


@pytest.mark.parametrize("restitution", [0.5, 0.9])
def test_two_linear_pendulums(restitution: float) -> None:
    """Both meet at the lowest point every half period, and keep e of their relative speed each time; the mean swing
    stays. Between impacts, nothing changes."""
    effects = {"-velocity_dependent_restitution": {}}
    steps = played(
        np.zeros(2), 300, bobs=2, model="ho", effects=effects, restitution=restitution, b=0.0, start="hanging"
    )
    impacts = np.cumsum([step[4]["impacts"] for step in steps])
    left = restitution**impacts
    met = impacts > 0
    assert impacts[-1] >= 8
    found = {name: np.array([step[4][name] for step in steps]) for name in ("asynchrony", "relative_swing")}
    # Impacts come at equal times only while the swings are exactly harmonic, which the integration keeps to 1e-8.
    np.testing.assert_allclose(found["relative_swing"], left, rtol=1e-6)
    np.testing.assert_allclose(found["asynchrony"][met], (left * np.sqrt(2 / (1 + left**2)))[met], rtol=1e-6)
    assert (found["asynchrony"][~met] == 1.0).all()


def test_swings_are_counted_from_where_the_bobs_rest() -> None:
    """At δ < 0 the bobs lean on each other; the true rest is found by the search for the equilibrium."""
    settings = {"delta": -0.04, "delta_range": (-0.05, 0.1), "actions": ("delta",)}
    steps = played(np.zeros(1), 2400, **settings)
    rest, _ = equilibrium(Cradle(bobs=5, delta=-0.04))
    assert np.ptp(rest) > 0.01
    seen = np.array([step[0] for step in steps])
    swing = (seen[:, 5:10] - rest) + 1j * seen[:, 15:20] * math.sqrt(0.3 / 9.81)
    part = 1.0 - 5.0 * np.abs(swing.mean(axis=1)) ** 2 / (np.abs(swing) ** 2).sum(axis=1)
    expected = np.sqrt(part / 0.8)
    found = np.array([step[4]["asynchrony"] for step in steps])
    met = found < 1.0
    # The environment's rest is of first order in the lean: 2 % of 0.01 rad beside swings of some 0.04.
    np.testing.assert_allclose(found[met], expected[met], atol=0.01)
    assert found[-1] < 0.05 < np.abs(seen[-1, 5:10]).max() / 0.228


def test_a_lean_without_motion_sustains_nothing() -> None:
    settings = {"delta": -0.05, "delta_range": (-0.05, 0.1), "release_angle": 0.0016, "actions": ("delta",)}
    steps = played(np.zeros(1), 3600, reward="sustain", **settings)
    assert steps[-1][4]["sigma"] > 1.0 and steps[-1][4]["kinetic"] < 1e-6
    assert total(steps) < 0.1


def test_a_swing_without_contact_sustains_nothing() -> None:
    """The lifted bob swings on alone with 80 % of its amplitude; the reward ends after 1.05 periods without an
    impact."""
    steps = played(WIDE, reward="sustain", release_angle_range=(0.005, 0.5))
    assert steps[-1][4]["relative_swing"] > 0.75
    assert total(steps) <= 1.05 * 2 * math.pi * math.sqrt(0.3 / 9.81) / 60.0


def test_what_is_sustained_is_the_amplitude_of_the_clicking() -> None:
    steps = played(np.zeros(2), 600, reward="sustain")
    counted = [min(step[4]["relative_swing"], 1.0) / 3600 for step in steps]
    np.testing.assert_allclose([step[1] for step in steps], counted, rtol=1e-12)


@pytest.mark.parametrize("threshold", [0.9, 0.5, 0.2])
def test_terminated_when_the_asynchrony_has_been_low_for_a_window(threshold: float) -> None:
    steps = played(np.zeros(2), bobs=2, control_interval=1 / 240, synchronized_at=threshold)
    times, found = (np.array([step[4][name] for step in steps]) for name in ("time", "asynchrony"))
    since = times[np.flatnonzero(found > threshold)[-1] + 1]
    window = 1.05 * 2 * math.pi * math.sqrt(0.3 / 9.81)
    assert steps[-1][2] and window <= times[-1] - since < window + 1 / 240
    assert total(steps) == pytest.approx(-math.log(threshold) - times[-1] / 60.0)
