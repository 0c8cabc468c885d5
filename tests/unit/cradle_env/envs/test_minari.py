"""Minari records episodes of both environments, and replays them bit for bit."""

import gymnasium as gym
import numpy as np
import pytest

import cradle_env  # noqa: F401  registers the names

minari = pytest.importorskip("minari")
pytest.importorskip("jax", reason="Minari records with it")

pytestmark = pytest.mark.filterwarnings("default::UserWarning:minari", "default::ResourceWarning")


@pytest.mark.parametrize("name", ["NewtonCradle-v0", "NewtonCradleRelease-v0"])
def test_episodes_are_recorded_and_replayed(name: str, tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    recorder = minari.DataCollector(gym.make(name, bobs=2, duration=2.0, delta=(0.0, 0.01)), record_infos=True)
    shown = []
    for seed in range(2):
        infos, over = [recorder.reset(seed=seed)[1]], False
        recorder.action_space.seed(seed)
        while not over:
            _, _, terminated, truncated, info = recorder.step(recorder.action_space.sample())
            infos.append(info)
            over = terminated or truncated
        shown.append(infos)
    recorder.create_dataset("cradle/test-v0")
    recorder.close()

    kept = minari.load_dataset("cradle/test-v0")
    env = kept.recover_environment()
    assert (env.spec.id, env.unwrapped.settings.bobs) == (name, 2)
    assert kept.total_episodes == 2
    for seed, (episode, infos) in enumerate(zip(kept.iterate_episodes(), shown, strict=True)):
        np.testing.assert_array_equal(env.reset(seed=seed)[0], episode.observations[0])
        assert len(episode.actions) == len(infos) - 1
        for k, action in enumerate(episode.actions):
            observation, *rest, _ = env.step(action)
            np.testing.assert_array_equal(observation, episode.observations[k + 1])
            assert rest == [episode.rewards[k], episode.terminations[k], episode.truncations[k]]
        assert sorted(episode.infos) == sorted(infos[0])
        assert sum(value.nbytes for value in episode.infos.values()) < 20_000
        for key in infos[0]:
            np.testing.assert_array_equal(episode.infos[key], [info[key] for info in infos])
