"""RLlib's runner samples both environments, one by one and through their native vector environments."""

import pytest

pytest.importorskip("ray.rllib")

from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner

# What Ray and its packages announce is not ours.
pytestmark = [
    pytest.mark.filterwarnings(f"default::{kind}")
    for kind in ("UserWarning", "DeprecationWarning", "FutureWarning", "ResourceWarning")
]


@pytest.mark.parametrize("mode", ["sync", "vector_entry_point"])
@pytest.mark.parametrize(("name", "steps"), [("NewtonCradle", 120), ("NewtonCradleRelease", 1)])
def test_a_runner_samples_whole_episodes(name: str, steps: int, mode: str) -> None:
    config = PPOConfig().environment(f"cradle_env:{name}-v0", env_config={"bobs": 2, "duration": 2.0})
    runner = SingleAgentEnvRunner(config=config.env_runners(num_envs_per_env_runner=2, gym_env_vectorize_mode=mode))
    episodes = runner.sample(num_episodes=3, random_actions=True)
    assert type(runner.env.unwrapped).__name__ == ("SyncVectorEnv" if mode == "sync" else f"{name}VectorEnv")
    assert [len(episode) for episode in episodes] == [steps] * 3
    assert all(list(episode.get_infos(0)) == list(episode.get_infos(-1)) for episode in episodes)
    runner.stop()
