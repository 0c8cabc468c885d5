"""The table of registered environments: what each is, and that each can be played and made again."""

import json
import math

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env, data_equivalence

from cradle_env.envs.registration import ENVIRONMENTS
from tests.paths import ROOT

BASELINES = ROOT / "studies" / "baselines" / "results.jsonl"
BENCHMARKS = [name for name, told in ENVIRONMENTS.items() if "kwargs" in told]
BOBS = {"NewtonCradleEasy-v0": 10, "NewtonCradleHard-v0": 2}


def test_the_names() -> None:
    ours = {name for name in gym.registry if name.startswith("NewtonCradle")}
    assert ours == {*ENVIRONMENTS}
    assert ours == {
        f"NewtonCradle{kind}-v0" for kind in ("", "Release", "Easy", "Medium", "Hard", "Randomized", "Camera")
    }


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmark_is_one_task(name: str) -> None:
    env = gym.make(name)
    bobs, settings = BOBS.get(name, 5), env.unwrapped.settings
    assert settings.bobs == bobs
    assert (settings.reward, settings.actions, settings.control_interval) == ("sustain", ("delta",), 0.1)
    assert env.spec.max_episode_steps * settings.control_interval == settings.duration == 60.0
    assert env.action_space.shape == (1,)
    assert env.observation_space.shape == ((bobs + 2,) if "Camera" in name else (4 * bobs + 3,))
    check_env(gym.make(name).unwrapped, skip_render_check=True)
    angles = [env.reset(seed=seed)[1]["release_angle"] for seed in range(20)]
    assert 0.15 <= min(angles) < 0.18 and 0.27 < max(angles) <= 0.3


@pytest.mark.parametrize("name", BENCHMARKS)
def test_it_is_made_again_from_its_spec_and_many_at_once(name: str) -> None:
    single, again = gym.make(name), gym.make(EnvSpec.from_json(gym.spec(name).to_json()))
    many = gym.make_vec(name, num_envs=2, vectorization_mode="vector_entry_point")
    assert type(many).__name__ == "NewtonCradleVectorEnv"
    seen = single.reset(seed=3)[0]
    np.testing.assert_array_equal(again.reset(seed=3)[0], seen)
    np.testing.assert_array_equal(many.reset(seed=[3, 4])[0][0], seen)
    action = np.array([0.3], np.float32)
    for _ in range(10):
        step = single.step(action)
        assert data_equivalence(step, again.step(action), exact=True)
        np.testing.assert_array_equal(many.step(np.tile(action, (2, 1)))[0][0], step[0])


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmark_asks_for_more_than_a_constant(name: str) -> None:
    """Its threshold is at least 1.5 times what the best fixed spacer returns, as the study of baselines has it."""
    kept = [json.loads(line) for line in BASELINES.read_text(encoding="utf-8").splitlines()]
    (best,) = [row for row in kept if (row["environment"], row["method"]) == (name, "constant δ")]
    assert gym.spec(name).reward_threshold > 1.5 * np.mean(best["returns"])


def test_an_episode_ends_after_a_minute() -> None:
    env = gym.make("NewtonCradleHard-v0", synchronized_at=1e-9)
    env.reset(seed=0)
    ends = [env.step(np.zeros(1, np.float32))[3] for _ in range(600)]
    assert ends[-1] and not any(ends[:-1])


@pytest.mark.parametrize("name", BENCHMARKS)
def test_cradles_differ_and_keep_to_their_ranges(name: str) -> None:
    env = gym.make(name).unwrapped
    told = ENVIRONMENTS[name]["kwargs"]
    for number in ("length", "mass", "k_f", "kappa", "b"):
        low, high = told[number]
        drawn = []
        for seed in range(30):
            env.reset(seed=seed)
            drawn.append(getattr(env._episodes.of[0], number))
        assert low <= min(drawn) and max(drawn) <= high and max(drawn) - min(drawn) > 0.7 * (high - low)


def test_the_camera_errs_by_two_milliradians() -> None:
    env = gym.make("NewtonCradleCamera-v0", dtype="float64")
    true = gym.make("NewtonCradleMedium-v0", dtype="float64")
    errors = [env.reset(seed=seed)[0][:4] - true.reset(seed=seed)[0][5:9] for seed in range(100)]
    assert np.std(errors) == pytest.approx(0.002, rel=4.0 / math.sqrt(2 * 400))
