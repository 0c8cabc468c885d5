"""The study of baselines: its controllers do what they say, and its page is of the environments of now."""

import re

import gymnasium as gym
import numpy as np
import pytest

from cradle_env.envs.registration import ENVIRONMENTS
from studies.baselines.__main__ import HERE, NAMES
from studies.baselines.page import by_method, page
from studies.baselines.planner import plan
from studies.baselines.policies import at_random, by_hand, constant, play
from studies.kept_rows import read_rows

PAGE = (HERE / "results.md").read_text(encoding="utf-8")
KEPT = read_rows(HERE / "results.jsonl")


def test_the_page_is_of_what_is_kept() -> None:
    assert PAGE == page(KEPT, NAMES)
    assert {row["environment"] for row in KEPT} == {*NAMES} == {*ENVIRONMENTS} - {"NewtonCradleRelease-v0"}
    assert re.search(r"!\[.*\]\(baselines.png\)", PAGE) and (HERE / "baselines.png").is_file()


@pytest.mark.parametrize("name", [name for name in NAMES if name != "NewtonCradle-v0"])
def test_no_constant_comes_near_the_threshold(name: str) -> None:
    """What is learned or planned exceeds it, or a law does."""
    found = {method: returns.mean() for method, returns in by_method(KEPT, name).items()}
    threshold = ENVIRONMENTS[name]["reward_threshold"]
    assert found["constant δ"] < 0.67 * threshold < threshold < max(found.values())


@pytest.mark.slow
def test_a_plan_beats_a_constant() -> None:
    fixed = play("NewtonCradleHard-v0", constant(np.zeros(1)), 1, seed=5)
    assert plan("NewtonCradleHard-v0", seed=5) > fixed[0]


@pytest.mark.parametrize("name", ["NewtonCradleMedium-v0", "NewtonCradleCamera-v0"])
def test_a_feedback_law_beats_a_constant_and_chance(name: str) -> None:
    hand, chance, fixed = (
        play(name, policy, 3, seed=5) for policy in (by_hand(name), at_random(name, 0), constant(np.zeros(1)))
    )
    assert hand.shape == (3,)
    assert hand.min() > 2.0 * max(chance.max(), fixed.max())


def test_returns_are_those_of_single_environments() -> None:
    env = gym.make("NewtonCradleHard-v0")
    expected = []
    for seed in (5, 6):
        env.reset(seed=seed)
        total, over = 0.0, False
        while not over:
            _, reward, terminated, truncated, _ = env.step(np.array([0.5], np.float32))
            total, over = total + reward, terminated or truncated
        expected.append(total)
    np.testing.assert_allclose(play("NewtonCradleHard-v0", constant(np.array([0.5])), 2, seed=5), expected, rtol=1e-12)
