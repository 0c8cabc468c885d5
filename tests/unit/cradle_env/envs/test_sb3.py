"""`CradleVecEnv` is a `DummyVecEnv` of single environments, bit for bit; Stable-Baselines3 learns on it."""

import functools

import gymnasium as gym
import numpy as np
import pytest

import cradle_env  # noqa: F401  registers the names

pytest.importorskip("stable_baselines3")

from gymnasium.utils.env_checker import data_equivalence
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize, VecVideoRecorder

from cradle_env.envs.sb3 import CradleVecEnv

# Episodes that end within 40 steps, as synchronized or by their duration.
SHORT = {"control_interval": 0.1, "duration": 4.0, "bobs": 2, "synchronized_at": 0.97, "delta": (-0.01, 0.02)}
ALGORITHMS = {
    PPO: {"n_steps": 16, "batch_size": 16, "n_epochs": 1},
    SAC: {"learning_starts": 16, "train_freq": 4, "buffer_size": 200, "batch_size": 16},
}


def singles(count: int, **settings) -> DummyVecEnv:
    return DummyVecEnv([functools.partial(gym.make, "NewtonCradle-v0", **settings)] * count)


@pytest.mark.parametrize("settings", [SHORT, {**SHORT, "max_episode_steps": 7}], ids=["their own end", "a time limit"])
def test_it_is_single_environments_bit_for_bit(settings: dict) -> None:
    one, other = CradleVecEnv("NewtonCradle-v0", 3, **settings), singles(3, **settings)
    rng, ends = np.random.default_rng(0), []
    for seed, options in ((4, None), (4, {"delta": 0.01}), (None, None)):
        for cradles in (one, other):
            if seed is not None:
                cradles.seed(seed)
            cradles.set_options(options)
        np.testing.assert_array_equal(one.reset(), other.reset())
        assert data_equivalence(one.reset_infos, other.reset_infos, exact=True)
        for _ in range(50):
            actions = rng.uniform(-1.0, 1.0, (3, 2)).astype(np.float32)
            ours, theirs = one.step(actions), other.step(actions)
            for a, b in zip(ours[:3], theirs[:3], strict=True):
                assert a.dtype == b.dtype
                np.testing.assert_array_equal(a, b)
            for a, b in zip(ours[3], theirs[3], strict=True):
                assert data_equivalence(dict(sorted(a.items())), dict(sorted(b.items())), exact=True)
            ends += [info["TimeLimit.truncated"] for info in ours[3] if "terminal_observation" in info]
            assert data_equivalence(one.reset_infos, other.reset_infos, exact=True)
    assert ("max_episode_steps" in settings) in ends


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_agents_learn_and_are_saved_and_loaded(algorithm, tmp_path) -> None:
    cradles = VecNormalize(VecMonitor(CradleVecEnv("NewtonCradle-v0", 4, **SHORT)))
    model = algorithm("MlpPolicy", cradles, seed=0, device="cpu", **ALGORITHMS[algorithm])
    before = [parameter.detach().clone() for parameter in model.policy.parameters()]
    model.learn(256)
    assert any((old != new).any() for old, new in zip(before, model.policy.parameters(), strict=True))
    assert len(model.ep_info_buffer) > 0 and np.isfinite([episode["r"] for episode in model.ep_info_buffer]).all()
    model.save(tmp_path / "agent")
    cradles.save(str(tmp_path / "scales.pkl"))

    fresh = CradleVecEnv("NewtonCradle-v0", 4, **SHORT)
    scaled = VecNormalize.load(str(tmp_path / "scales.pkl"), fresh)
    loaded = algorithm.load(tmp_path / "agent", env=scaled, device="cpu")
    seen = np.stack([fresh.observation_space.sample() for _ in range(4)])
    np.testing.assert_array_equal(scaled.normalize_obs(seen), cradles.normalize_obs(seen))
    expected = model.predict(cradles.normalize_obs(seen), deterministic=True)[0]
    np.testing.assert_array_equal(loaded.predict(scaled.normalize_obs(seen), deterministic=True)[0], expected)
    loaded.learn(64, reset_num_timesteps=False)
    scaled.training = False
    assert np.isfinite(evaluate_policy(loaded, scaled, n_eval_episodes=4, warn=False)[0])


def test_pictures() -> None:
    cradles = CradleVecEnv("NewtonCradle-v0", 2, render_mode="rgb_array", bobs=2)
    pytest.importorskip("pygame")
    cradles.reset()
    assert cradles.render().shape == (1200, 800, 3) or cradles.render().shape == (600, 1600, 3)
    assert cradles.env_method("render", indices=[1])[0].shape == (600, 800, 3)
    cradles.close()


def test_a_film(tmp_path) -> None:
    pytest.importorskip("pygame")
    moviepy = pytest.importorskip("moviepy")
    cradles = CradleVecEnv("NewtonCradle-v0", 2, render_mode="rgb_array", **SHORT)
    films = VecVideoRecorder(cradles, str(tmp_path), record_video_trigger=lambda step: step == 0, video_length=5)
    films.reset()
    for _ in range(6):
        films.step(np.zeros((2, 2)))
    films.close()
    (film,) = tmp_path.glob("*.mp4")
    with moviepy.VideoFileClip(str(film)) as clip:
        assert (clip.size, clip.fps) == ([800, 1200], 10)  # one cradle above the other, ten steps a second


def test_a_vector_environment_that_is_made() -> None:
    native = gym.make_vec("NewtonCradle-v0", 3, autoreset_mode="SameStep", **SHORT)
    np.testing.assert_array_equal(CradleVecEnv(native).reset().shape, (3, 11))
    for mode in ("NextStep", "Disabled"):
        for make in (
            lambda mode=mode: CradleVecEnv(gym.make_vec("NewtonCradle-v0", 2, autoreset_mode=mode)),
            lambda mode=mode: CradleVecEnv("NewtonCradle-v0", 2, autoreset_mode=mode),
        ):
            with pytest.raises(ValueError, match=f'autoreset_mode is "{mode}"; Stable-Baselines3 takes "SameStep"'):
                make()
    with pytest.raises(TypeError, match="num_envs and settings belong to a name"):
        CradleVecEnv(native, bobs=2)


@pytest.mark.parametrize("name", ["NewtonCradle-v0", "NewtonCradleRelease-v0"])
def test_names_are_enough(name: str) -> None:
    """As Stable-Baselines3 makes environments by itself, with pictures."""
    vector = make_vec_env(name, n_envs=2, env_kwargs={"bobs": 2, "duration": 2.0})
    assert vector.render_mode == "rgb_array"
    for env in (vector, name):
        assert PPO("MlpPolicy", env, n_steps=8, batch_size=8, n_epochs=1, device="cpu").learn(16).num_timesteps >= 16
    assert vector.render().shape[-1] == 3
    vector.close()


def test_single_cradles_are_asked() -> None:
    cradles = CradleVecEnv("NewtonCradle-v0", 2, bobs=2)
    assert [settings.bobs for settings in cradles.get_attr("settings", 0)] == [2]
    assert cradles.has_attr("settings") and not cradles.has_attr("nothing")
    assert cradles.env_is_wrapped(gym.wrappers.TimeLimit) == [False, False]
    with pytest.raises(AttributeError, match="bobs is a setting, fixed"):
        cradles.set_attr("bobs", 3)
    with pytest.raises(AttributeError, match="get_state is none of settings"):
        cradles.env_method("get_state")
    cradles.set_options([{"delta": 0.0}, {"delta": 0.01}])
    with pytest.raises(ValueError, match="different options"):
        cradles.reset()
