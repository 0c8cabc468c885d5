"""The study of baselines: its controllers do what it says, and its page is of the environments of now."""

import re

import gymnasium as gym
import numpy as np
import pytest

from cradle_env.envs.registration import ENVIRONMENTS
from studies.baselines.__main__ import _HERE, NAMES
from studies.baselines.policies import at_random, by_hand, constant, play

PAGE = (_HERE / "results.md").read_text(encoding="utf-8")


def rows() -> dict[str, list[float]]:
    """Of each environment the mean returns at random, of the best constant, and by hand."""
    found = {}
    for line in PAGE.splitlines():
        if line.startswith("| `"):
            name, random, constant_, _, hand, *_ = [cell.strip() for cell in line.strip("|").split("|")]
            found[name.strip("`")] = [float(cell.split()[0]) for cell in (random, constant_, hand)]
    return found


def test_the_page_has_all_environments() -> None:
    assert list(rows()) == [*NAMES] == [name for name in ENVIRONMENTS if name != "NewtonCradleRelease-v0"]
    assert re.search(r"!\[.*\]\(baselines.png\)", PAGE) and (_HERE / "baselines.png").is_file()


def test_no_constant_comes_near_a_feedback_law_in_the_benchmarks() -> None:
    for name, (_, fixed, hand) in rows().items():
        if name != "NewtonCradle-v0":
            assert fixed < 0.75 * hand, name


@pytest.mark.parametrize("name", ["NewtonCradle5-v0", "NewtonCradleCamera-v0"])
def test_a_feedback_law_beats_a_constant_and_chance(name: str) -> None:
    hand, chance, fixed = (
        play(name, policy, 3, seed=5) for policy in (by_hand(name), at_random(name, 0), constant(np.zeros(1)))
    )
    assert hand.shape == (3,)
    assert hand.min() > 2.0 * max(chance.max(), fixed.max())


def test_returns_are_those_of_single_environments() -> None:
    env = gym.make("NewtonCradle2-v0")
    expected = []
    for seed in (5, 6):
        env.reset(seed=seed)
        total, over = 0.0, False
        while not over:
            _, reward, terminated, truncated, _ = env.step(np.array([0.5], np.float32))
            total, over = total + reward, terminated or truncated
        expected.append(total)
    np.testing.assert_allclose(play("NewtonCradle2-v0", constant(np.array([0.5])), 2, seed=5), expected, rtol=1e-12)
