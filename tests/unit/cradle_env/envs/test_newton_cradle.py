"""`gym.make("NewtonCradle-v0")` and `"NewtonCradleRelease-v0"` keep Gymnasium's contract and their own."""

import copy
import functools
import importlib
import json
import math
import os
import pickle
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import h5py
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ClosedEnvironmentError, InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import check_env, data_equivalence
from hypothesis import given, settings
from hypothesis import strategies as st

import cradle_env
from cradle_env.effects import Effect, Parameter, register
from cradle_env.envs import episodes
from cradle_env.envs.newton_cradle import NewtonCradleEnv
from cradle_env.envs.release import NewtonCradleReleaseEnv
from cradle_env.mechanics import layout as p
from tests.paths import ROOT

IDS = ("NewtonCradle-v0", "NewtonCradleRelease-v0")
NOTHING = np.zeros(2, np.float32)

same = functools.partial(data_equivalence, exact=True)


def energy_kept(before: dict[str, float], after: dict[str, float]) -> float:
    return after["kinetic"] + after["gravity"] - before["kinetic"] - before["gravity"]


def python(code: str, *arguments: str, **environment: str) -> str:
    """What `code` prints in a fresh interpreter, in the folder of the package; warnings are errors there, too."""
    others = (f"-Wdefault::{kind}" for kind in ("DeprecationWarning", "PendingDeprecationWarning", "FutureWarning"))
    run = subprocess.run(
        [sys.executable, "-Werror", *others, "-c", code, *arguments],
        capture_output=True, text=True, timeout=300, cwd=ROOT, env={**os.environ, **environment},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr[-2000:]
    return run.stdout


def rollout(env: gym.Env, actions: np.ndarray, seed: int | None = None) -> list:
    """All that an environment returns, from reset on; it is reset at the end of every episode."""
    returned = [env.reset(seed=seed)]
    for action in actions:
        returned.append(env.step(action))
        if returned[-1][2] or returned[-1][3]:
            returned.append(env.reset())
    return returned


def random_actions(env: gym.Env, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, *env.action_space.shape)).astype(np.float32)


# --- registration -----------------------------------------------------------------------------------------------


def test_a_second_import_registers_nothing_anew() -> None:
    before = {name: gym.spec(name) for name in IDS}
    importlib.reload(cradle_env)
    assert all(gym.spec(name) is spec for name, spec in before.items())


def test_specs() -> None:
    spec, release = map(gym.spec, IDS)
    assert spec.entry_point == "cradle_env.envs.newton_cradle:NewtonCradleEnv"
    assert spec.vector_entry_point == "cradle_env.envs.vector:NewtonCradleVectorEnv"
    assert release.entry_point == "cradle_env.envs.release:NewtonCradleReleaseEnv"
    assert (spec.max_episode_steps, spec.reward_threshold) == (3600, 2.65)
    assert (release.max_episode_steps, release.reward_threshold) == (None, 0.2)
    assert not spec.nondeterministic
    assert not release.nondeterministic


@pytest.mark.parametrize("name", IDS)
def test_a_spec_travels(name: str) -> None:
    told = {"bobs": 3, "delta": (-0.01, 0.01), "actions": ("release_angle",), "dtype": "float64", "duration": 5.0}
    told |= {"effects": {"quadratic_drag": {"c2": 1e-3}}, "delta_range": [-0.02, 0.05]}
    env = gym.make(name, **told)
    actions = random_actions(env, 5)
    expected = rollout(env, actions, seed=3)
    for spec in (EnvSpec.from_json(env.spec.to_json()), pickle.loads(pickle.dumps(env.spec))):
        assert same(rollout(gym.make(spec), actions, seed=3), expected)


def test_names_in_a_fresh_process() -> None:
    """Found by the module's name; by the bare one once the package is imported, and also where workers start anew."""
    code = """if True:
        import json, gymnasium as gym
        env = gym.make("cradle_env:NewtonCradle-v0")
        release = gym.make("cradle_env:NewtonCradleRelease-v0")
        vector = gym.make_vec("cradle_env:NewtonCradle-v0", num_envs=2)
        import cradle_env
        again = gym.make("NewtonCradle-v0")
        print(json.dumps([type(e.unwrapped).__name__ for e in (env, release, vector, again)]))
    """
    kinds = ["NewtonCradleEnv", "NewtonCradleReleaseEnv", "NewtonCradleVectorEnv", "NewtonCradleEnv"]
    assert json.loads(python(code)) == kinds


def test_unknown_settings_are_told_by_make() -> None:
    with pytest.raises(TypeError, match="unknown setting 'delt'; did you mean 'delta'"):
        gym.make("NewtonCradle-v0", delt=0.0)


@pytest.mark.parametrize("name", IDS)
@pytest.mark.parametrize("make", [gym.make, functools.partial(gym.make_vec, num_envs=2)], ids=["single", "vector"])
def test_a_framework_may_offer_settings_that_are_not_there(name: str, make) -> None:
    """TorchRL offers `frameskip` to every environment, and looks for Python's words in the error."""
    with pytest.raises(TypeError) as refused:
        make(name, frameskip=1)
    assert "unexpected keyword argument 'frameskip'" in str(refused.value)
    assert "known: actions, b, bobs" in str(refused.value)
    make(name).close()


# --- Gymnasium's checks -----------------------------------------------------------------------------------------

CONFIGURATIONS = {
    "default": {},
    **{f"{bobs} bobs": {"bobs": bobs} for bobs in (1, 2, 20)},
    **{model: {"model": model} for model in ("ho", "pendulum")},
    "rigid by an effect": {"model": "ho", "effects": {"large_angle": {}}},
    "float64": {"dtype": "float64"},
    "numpy's float64": {"dtype": np.float64},
    "delta only": {"actions": ("delta",)},
    "release only": {"actions": ["release_angle"]},
    "release first": {"actions": ("release_angle", "delta")},
    "ranges": {"delta": (-0.01, 0.02), "release_angle": (0.1, 0.3), "k_f": (0.0, 1e5), "length": (0.2, 0.4)},
    "sustain": {"reward": "sustain"},
    "a function": {"reward": energy_kept},
    "drag": {"effects": {"quadratic_drag": {"c2": 2e-3}}},
    "friction": {"effects": {"pivot_friction": {"tau_c": 1e-4}}},
    "contacts in time": {"effects": {"contact_duration": {"scale": 1.0}}, "bobs": 3},
    "without hysteresis": {"effects": {"-string_hysteresis": {}}},
    "constant restitution": {"effects": {"-velocity_dependent_restitution": {}}, "restitution": 0.9},
    "a power law": {"power_law": (0.05, 0.2)},
    **{f"every {interval:.4f} s": {"control_interval": interval} for interval in (1 / 240, 0.1, 0.5)},
    "two lifted": {"released_bobs": 2},
    "all lifted": {"released_bobs": 5},
    "hanging": {"start": "hanging"},
    "pressed": {"delta": -0.05, "delta_range": (-0.05, 0.2)},
    "fast spacer": {"spacer_speed": 1.0},
    "short": {"duration": 0.1},
    "a camera": {"camera_noise": 0.01},
    "normalized": {"normalize_observations": True},
    "a normalized camera": {"normalize_observations": True, "camera_noise": 0.01, **{"delta": (0.0, 0.05)}},
    "a camera that sees nothing": {"camera_noise": 1.0, "dtype": "float64"},
}


@pytest.mark.parametrize("told", CONFIGURATIONS.values(), ids=CONFIGURATIONS)
def test_gymnasium_finds_nothing_wrong(told: dict) -> None:
    """Warnings are errors here."""
    check_env(gym.make("NewtonCradle-v0", **told).unwrapped, skip_render_check=True)
    env = gym.make("NewtonCradle-v0", **told)  # within the checks of every step
    rollout(env, random_actions(env, 10), seed=1)
    env.close()


@pytest.mark.parametrize(
    "told", [{"duration": 5.0}, {"duration": 5.0, "bobs": 2, "dtype": "float64"}, {"reward": "sustain", "duration": 5}]
)
def test_gymnasium_finds_nothing_wrong_with_the_release(told: dict) -> None:
    check_env(gym.make("NewtonCradleRelease-v0", **told).unwrapped)
    env = gym.make("NewtonCradleRelease-v0", **told)
    for _, reward, terminated, truncated, _ in rollout(env, random_actions(env, 3), seed=1)[1::2]:
        assert math.isfinite(reward)
        assert (terminated, truncated) == (True, False)


@pytest.mark.parametrize("duration", [2.0, 5.0])
def test_the_release_shows_the_same_before_and_after(duration: float) -> None:
    """Recorders such as Minari's stack infos: keys, shapes and types stay."""
    env = NewtonCradleReleaseEnv(duration=duration, release_angle=0.2)
    before, after = env.reset(seed=0)[1], env.step(NOTHING)[4]
    for info in (before, after):
        assert list(info) == ["newton_exponent", "delta", "release_angle", "times", "sigma"]
        assert info["sigma"].shape == info["times"].shape == (12,)
        assert all(np.asarray(value).dtype == np.float64 for value in info.values())
    np.testing.assert_array_equal(before["times"], after["times"])
    assert (before["sigma"] == 1.0).all() and before["newton_exponent"] == 0.0 and before["release_angle"] == 0.2
    assert after["sigma"].min() < 0.9
    before["times"][:] = 0.0  # the caller's own
    assert env.run.t[-1] == duration and len(env.run.sigma()) == 240 * duration + 1
    assert env.reset()[1]["times"][-1] == duration and env.run is None


def test_gymnasium_finds_nothing_wrong_with_the_pictures() -> None:
    """All render modes, a window too; in a process of its own, whose warnings are errors."""
    pytest.importorskip("pygame")
    code = """if True:
        import gymnasium as gym
        from gymnasium.utils.env_checker import check_env
        check_env(gym.make("cradle_env:NewtonCradle-v0", bobs=2, render_mode="rgb_array").unwrapped)
        env = gym.make("NewtonCradle-v0", render_mode="human", control_interval=0.01)
        env.reset(seed=1)
        for _ in range(5):
            env.step(env.action_space.sample())
        assert env.render() is None
        env.close()
        env.close()
        print("through")
    """
    assert "through" in python(code, SDL_VIDEODRIVER="dummy", PYGAME_HIDE_SUPPORT_PROMPT="1")


def test_what_the_class_says_of_its_spaces() -> None:
    env = NewtonCradleEnv(bobs=3, duration=20.0, dtype="float64")
    space = env.observation_space
    assert (space.shape, space.dtype) == ((15,), np.float64)
    fast, spin = 4 * math.sqrt(9.81 * 0.3), 4 * math.sqrt(9.81 / 0.3)
    rest = [1.0, 2.0, 20.0]
    np.testing.assert_allclose(space.high, [0.6] * 3 + [np.pi] * 3 + [fast] * 3 + [spin] * 3 + rest, rtol=1e-15)
    np.testing.assert_allclose(space.low, [0.0] * 3 + [-np.pi] * 3 + [-fast] * 3 + [-spin] * 3 + [-1, 0, 0], rtol=1e-15)
    assert (env.action_space.shape, env.action_space.dtype) == ((2,), np.float32)
    single = NewtonCradleEnv(bobs=3, duration=20.1).observation_space
    # Rounded outwards, where float32 has no such number.
    np.testing.assert_array_less(space.high[:12], single.high[:12].astype(float))
    assert float(single.high[-1]) > 20.1
    np.testing.assert_array_equal(single.low[[0, 1, 2, 12, 13, 14]], [0.0, 0.0, 0.0, -1.0, 0.0, 0.0])
    keys = ["time", "delta", "release_angle", "sigma", "asynchrony", "relative_swing", "newton_exponent", "impacts"]
    keys += ["fastest_impact", "kinetic", "gravity", "strings", "drag", "collisions", "spacer"]
    assert list(env.reset(seed=0)[1]) == list(env.step(NOTHING)[4]) == keys


def test_what_a_camera_shows() -> None:
    """θ with independent errors of the stated standard deviation, δ and the time; all else as without a camera."""
    told = {"bobs": 3, "delta": 0.01, "dtype": "float64"}
    plain, sharp, noisy = (NewtonCradleEnv(**told, **own) for own in ({}, {"camera_noise": 0}, {"camera_noise": 0.02}))
    returned = [rollout(env, random_actions(env, 400), seed=1)[:401] for env in (plain, sharp, noisy)]
    truth, exact, read = (np.array([step[0] for step in steps]) for steps in returned)
    np.testing.assert_array_equal(exact, truth[:, [3, 4, 5, 12, 14]])
    assert noisy.observation_space.shape == (5,) and noisy.observation_space.contains(read[0])
    np.testing.assert_array_equal(read[:, 3:], exact[:, 3:])
    errors = read[:, :3] - exact[:, :3]
    # Within four standard errors of the standard deviation, of the mean, and of correlations that are none.
    assert abs(errors.std() / 0.02 - 1.0) < 4.0 / math.sqrt(2 * errors.size)
    assert abs(errors.mean()) < 4.0 * 0.02 / math.sqrt(errors.size)
    for one, other in ((errors[1:, 0], errors[:-1, 0]), (errors[:, 0], errors[:, 1])):
        assert abs(np.corrcoef(one, other)[0, 1]) < 4.0 / math.sqrt(len(one))
    for a, b in zip(returned[0], returned[2], strict=True):
        assert same(a[1:], b[1:])


@pytest.mark.parametrize("camera", [None, 0.002])
def test_normalized_observations(camera: float | None) -> None:
    """The same numbers from other origins in other units, of the size of 1 in a swing."""
    told = {"bobs": 3, "dtype": "float64", "camera_noise": camera, "release_angle": 0.5}
    plain, scaled = (NewtonCradleEnv(**told, normalize_observations=each) for each in (False, True))
    actions = random_actions(plain, 400)
    actions[0, 1] = 1.0  # the largest release angle, of which angles are parts
    truth, shown = (np.array([step[0] for step in rollout(env, actions, seed=1)]) for env in (plain, scaled))
    speed, rate = math.sqrt(9.81 * 0.3), math.sqrt(9.81 / 0.3)
    middle = np.repeat([0.3, 0.0, 0.04, 0.0], [3, 9, 1, 2])
    unit = np.repeat([0.006, 0.5, 0.1 * speed, 0.5 * rate, 0.06, 1.0, 60.0], [3, 3, 3, 3, 1, 1, 1])
    seen = slice(None) if camera is None else [3, 4, 5, 12, 14]
    np.testing.assert_allclose(shown, (truth - middle[seen]) / unit[seen], rtol=1e-12)
    assert all(row in scaled.observation_space for row in shown)
    largest = np.abs(shown).max(axis=0)
    assert largest.max() < 3.0 and largest[:-1].min() > 0.1  # the bob between moves least


# --- seeds and repetition ---------------------------------------------------------------------------------------

RANGES = {"delta": (-0.01, 0.02), "mass": (0.1, 0.3), "length": (0.2, 0.4), "release_angle": (0.1, 0.4)}


@pytest.mark.parametrize("told", [{}, RANGES, {**RANGES, "bobs": 2, "duration": 0.2}], ids=["fixed", "drawn", "short"])
def test_rollouts_repeat_bit_for_bit(told: dict) -> None:
    envs = [gym.make("NewtonCradle-v0", **told) for _ in range(2)]
    actions = random_actions(envs[0], 60)
    one, other = (rollout(env, actions, seed=5) for env in envs)
    assert same(one, other)
    assert same(rollout(envs[0], actions, seed=5), one)


def test_seeds_choose_what_is_drawn() -> None:
    env = gym.make("NewtonCradle-v0", **RANGES)
    first, second = env.reset(seed=1)[0], env.reset()[0]
    assert not np.array_equal(first, second)
    assert not np.array_equal(first, env.reset(seed=2)[0])
    assert np.array_equal(env.reset(seed=1)[0], first)
    assert np.array_equal(env.reset()[0], second)
    release = NewtonCradleReleaseEnv(**RANGES)
    drawn = []
    for seed in (1, None, 1):
        release.reset(seed=seed)
        drawn.append(release.cradle)
    assert drawn[0] == drawn[2] != drawn[1]


def test_draws_keep_to_their_ranges() -> None:
    env = NewtonCradleEnv(**RANGES, bobs=2)
    env.reset(seed=1)
    drawn = []
    for _ in range(200):
        _, info = env.reset()
        cradle = env._episodes.of[0]
        drawn.append([info["delta"], cradle.mass, cradle.length])
    low, high = np.array([RANGES[name] for name in ("delta", "mass", "length")]).T
    assert (np.array(drawn) >= low).all()
    assert (np.array(drawn) <= high).all()
    # Half of 200 uniform draws, give or take 5 standard deviations of 7.
    assert (np.abs((np.array(drawn) > (low + high) / 2).sum(axis=0) - 100) < 35).all()


def test_options_last_one_episode() -> None:
    env = gym.make("NewtonCradle-v0", actions=("delta",))
    usual, _ = env.reset(seed=0)
    changed, info = env.reset(options={"delta": 0.05, "release_angle": 0.4, "mass": 0.1})
    assert (info["delta"], info["release_angle"]) == (0.05, 0.4)
    assert not np.array_equal(changed, usual)
    assert np.array_equal(env.reset()[0], usual)
    assert np.array_equal(env.reset(options={})[0], usual)


@settings(derandomize=True, max_examples=60, deadline=None)
@given(data=st.data())
def test_observations_stay_within_their_space(data: st.DataObject) -> None:
    """Whatever is allowed, and whatever the agent does."""
    draw = data.draw
    bobs = draw(st.integers(1, 6))
    model = draw(st.sampled_from(["ho", "pendulum", "nsp"]))
    steepest = 1.5 if model == "nsp" else math.pi
    widest = sorted(draw(st.lists(st.floats(1e-3, steepest), min_size=2, max_size=2, unique=True)))
    deltas = sorted(draw(st.lists(st.floats(-0.05, 0.2), min_size=2, max_size=2, unique=True)))
    told = {
        "bobs": bobs,
        "model": model,
        "released_bobs": draw(st.integers(1, bobs)),
        "start": draw(st.sampled_from(["unstretched", "hanging"])),
        "actions": draw(st.sampled_from([("delta",), ("release_angle",), ("delta", "release_angle")])),
        "delta_range": deltas,
        "delta": draw(st.one_of(st.just(tuple(deltas)), st.floats(*deltas))),
        "release_angle_range": widest,
        "release_angle": draw(st.one_of(st.just(tuple(widest)), st.floats(*widest))),
        "spacer_speed": draw(st.sampled_from([1e-3, 0.01, 0.1, 1.0])),
        "control_interval": draw(st.sampled_from([1 / 240, 1 / 60, 0.1, 0.5])),
        "duration": draw(st.sampled_from([0.5, 3.0])),
        "reward": draw(st.sampled_from(["synchronize", "sustain"])),
        "dtype": draw(st.sampled_from(["float32", "float64"])),
        "length": draw(st.sampled_from([0.05, 0.3, 2.0, (0.1, 1.0)])),
        "effects": draw(st.sampled_from([{}, {"quadratic_drag": {"c2": 0.01}}, {"pivot_friction": {"tau_c": 1e-3}}])),
    }
    env = NewtonCradleEnv(**told)
    ends = st.sampled_from([-1.0, 0.0, 1.0]) | st.floats(-1.0, 1.0, width=32)
    count = len(told["actions"])
    actions = draw(st.lists(st.lists(ends, min_size=count, max_size=count), min_size=3, max_size=12))
    observation, info = env.reset(seed=draw(st.integers(0, 2**32)))
    assert observation in env.observation_space
    for action in actions * 3:  # past the end of a short episode, too
        observation, reward, _, _, info = env.step(np.array(action, np.float32))
        assert observation in env.observation_space, (told, observation)
        assert math.isfinite(reward), told
        assert all(map(math.isfinite, info.values())), (told, info)


def test_what_is_returned_is_the_callers() -> None:
    """Whoever keeps or changes it changes nothing for others."""
    seen = []

    def reward(before: dict[str, float], after: dict[str, float]) -> float:
        seen.append((dict(before), dict(after)))
        return 1.5

    env = NewtonCradleEnv(reward=reward)
    observation, info = env.reset(seed=0)
    start = dict(info)
    info.clear()
    observation[:] = 7.0
    kept, value, _, _, info = env.step(NOTHING)
    first, before = dict(info), kept.copy()
    info.clear()
    other = env.step(NOTHING)[0]
    assert np.array_equal(kept, before)
    assert not np.array_equal(other, kept)
    assert value == 1.5
    assert seen[0] == (start, first)
    assert seen[1][0] == first
    assert env.impacts.dtype.names == ("time", "pair", "speed", "loss")


# --- how an episode ends ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("interval", "duration", "steps"),
    [(1 / 60, 0.25, 15), (0.1, 0.25, 3), (0.1, 0.3, 3), (0.5, 1.0, 2), (1 / 240, 0.05, 12), (1 / 60, 30.0, 1800)],
)
def test_truncated_after_the_duration_and_not_before(interval: float, duration: float, steps: int) -> None:
    env = gym.make("NewtonCradle-v0", bobs=2, control_interval=interval, duration=duration, synchronized_at=1e-9)
    env.reset(seed=0)
    for k in range(1, steps + 1):
        observation, _, terminated, truncated, info = env.step(NOTHING)
        assert (terminated, truncated) == (False, k == steps)
        assert info["time"] == pytest.approx(k * interval, rel=1e-13)  # rounding of k products
        assert observation[-1] == pytest.approx(min(k * interval, duration), rel=1e-7)  # float32


@pytest.mark.parametrize(("limit", "steps"), [({}, 3600), ({"max_episode_steps": 20}, 20), ({"duration": 90.0}, 3600),
                                              ({"duration": 61.0, "max_episode_steps": -1}, 3660)])  # fmt: skip
def test_the_registered_time_limit(limit: dict, steps: int) -> None:
    env = gym.make("NewtonCradle-v0", bobs=2, synchronized_at=1e-9, **limit)
    env.reset(seed=0)
    ends = [env.step(NOTHING)[3] for _ in range(steps)]
    assert not any(ends[:-1])
    assert ends[-1]


# --- states -----------------------------------------------------------------------------------------------------


def stepped(env: NewtonCradleEnv, until, action: np.ndarray = NOTHING, most: int = 60000) -> NewtonCradleEnv:
    """The environment, reset, released with the settings, and stepped until `until(env, terminated)`."""
    env.reset(seed=11)
    env.step(NOTHING)
    for _ in range(most):
        terminated = env.step(action)[2]
        if until(env, terminated):
            return env
    raise AssertionError("this never happened")


def links(env: NewtonCradleEnv) -> np.ndarray:
    return env._episodes.state[0, :-1, p.LINK]


MOMENTS = {
    "before release": ({}, None, NOTHING),
    "in mid-episode": ({}, lambda env, _: env._episodes.info(0)["time"] > 1.0, NOTHING),
    "pressed": ({"delta": -0.01}, lambda env, _: (links(env) == p.PRESSED).any(), NOTHING),
    "in a contact": (
        {"effects": {"contact_duration": {"scale": 1.0}}, "bobs": 3, "control_interval": 1e-4, "duration": 2.0},
        lambda env, _: (links(env) == p.RESOLVED).any(), NOTHING,
    ),
    "while the spacer moves": ({}, lambda env, _: env._episodes.episodes["rate"][0] > 0, np.array([1.0, 0.5])),
    "spacer, rigid": ({"model": "pendulum"}, lambda env, _: env._episodes.episodes["rate"][0] > 0, np.array([1, 0.5])),
    "after the end": ({"synchronized_at": 0.9, "bobs": 2}, lambda env, terminated: terminated, NOTHING),
    "through a camera": ({"camera_noise": 0.01}, lambda env, _: env._episodes.info(0)["time"] > 1.0, NOTHING),
    "drawn": ({**RANGES}, lambda env, _: env._episodes.info(0)["impacts"] > 0, NOTHING),
}  # fmt: skip


def what_follows(env: NewtonCradleEnv) -> list:
    """Steps, an episode drawn anew, steps of it, and what the random numbers are then."""
    followed = []
    for _ in range(2):
        for action in random_actions(env, 20):
            followed.append((env.step(action), env.impacts.tolist()))
        followed.append(env.reset())
    return [*followed, env.np_random.random(), env.np_random_seed]


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_state_goes_on_bit_for_bit(moment: str) -> None:
    told, until, action = MOMENTS[moment]
    env = NewtonCradleEnv(**told)
    if until is None:
        env.reset(seed=11)
    else:
        stepped(env, until, action)
    state = env.get_state()
    stored, twin, pickled, impacts = pickle.dumps(state), copy.deepcopy(env), pickle.dumps(env), env.impacts
    expected = what_follows(env)
    env.set_state(state)
    assert np.array_equal(env.impacts, impacts)
    assert same(what_follows(env), expected)
    assert same(what_follows(twin), expected)
    assert same(what_follows(pickle.loads(pickled)), expected)
    other = NewtonCradleEnv(**told)  # never reset
    other.set_state(pickle.loads(stored))
    assert same(what_follows(other), expected)
    busy = NewtonCradleEnv(**told)
    rollout(busy, random_actions(busy, 30), seed=77)
    busy.set_state(state)
    assert same(what_follows(busy), expected)


def test_a_state_is_not_changed_by_going_on() -> None:
    env = stepped(NewtonCradleEnv(), lambda env, _: env._episodes.info(0)["time"] > 0.5)
    state = env.get_state()
    before = pickle.dumps(state)
    env.set_state(state)
    what_follows(env)
    assert pickle.dumps(state) == before


@pytest.mark.parametrize("name", IDS)
def test_a_pickled_environment_goes_on(name: str) -> None:
    """As Gymnasium tests its own, wrappers and all."""
    env = gym.make(name, duration=5.0, **RANGES)
    actions = random_actions(env, 5)
    expected = rollout(env, actions, seed=123)
    for twin in (pickle.loads(pickle.dumps(env)), copy.deepcopy(env)):
        assert same(rollout(twin, actions, seed=123), expected)


@pytest.mark.parametrize("mode", ["rgb_array", "ansi"])
def test_pictures_after_a_state(mode: str) -> None:
    """The state brings no history of σ along: what was drawn before is forgotten."""
    if mode == "rgb_array":
        pytest.importorskip("pygame")
    env = NewtonCradleEnv(render_mode=mode)
    stepped(env, lambda env, _: env._episodes.info(0)["time"] > 1.0)
    env.render()
    state, twin = env.get_state(), pickle.loads(pickle.dumps(env))
    assert np.array_equal(env.render(), twin.render())
    for _ in range(30):
        env.step(NOTHING)
    pictures = []
    for other in (env, NewtonCradleEnv(render_mode=mode)):
        other.set_state(state)
        other.step(NOTHING)
        pictures.append(other.render())
    assert np.array_equal(*pictures)


@pytest.mark.parametrize(
    ("others", "message"),
    [
        ({"bobs": 3}, "bobs 3; here it is 5"),
        ({"actions": ("delta",)}, r"actions \('delta',\); here"),
        ({"duration": 5.0}, "duration 5.0; here it is 60.0"),
        ({"reward": "sustain"}, "reward 'sustain'; here it is 'synchronize'"),
        ({"control_interval": 0.1}, "control_interval 0.1; here"),
        ({"length": 1.0}, "length is 1 m .* the observation space holds r to 0.6 m"),
    ],
)
def test_a_state_of_another_environment_is_refused(others: dict, message: str) -> None:
    other, env = NewtonCradleEnv(**others), NewtonCradleEnv()
    other.reset(seed=0)
    expected = env.reset(seed=0)[0]
    with pytest.raises(ValueError, match=message):
        env.set_state(other.get_state())
    assert np.array_equal(env.reset()[0], expected)


def test_what_is_no_state_is_refused() -> None:
    env = NewtonCradleEnv()
    with pytest.raises(TypeError, match="the state is 3; it must be what get_state returns"):
        env.set_state(3)
    vector = gym.make_vec("NewtonCradle-v0", num_envs=1)
    vector.reset(seed=0)
    with pytest.raises(ValueError, match="vector environment"):
        env.set_state(vector.unwrapped.get_state())
    before = env.get_state()  # of no episode
    env.reset(seed=0)
    env.set_state(before)
    with pytest.raises(ResetNeeded):
        env.step(NOTHING)


BREEZE = """if True:
    import pickle, sys
    import numpy as np
    from cradle_env.effects import Effect, Parameter, register
    from cradle_env.envs.newton_cradle import NewtonCradleEnv

    def push(t, r, theta, v_r, v_theta, parameters):
        return 0.0, parameters[0]

    text = dict.fromkeys(("symbol", "summary", "equation", "reference", "energy", "looks_like"), "a push")
    push_by = Parameter("f", "f", "N", "push", absent=0.0, low=-1.0, high=1.0, scale=0.01)
    register(Effect(name="breeze", acts_on="bob", parameters=(push_by,), force=push, **text))
    env, state = pickle.load(open(sys.argv[1], "rb"))
    other = NewtonCradleEnv(bobs=2, effects={"breeze": {"f": 0.05}})
    other.set_state(state)
    for e in (env, other):
        print(e.step(np.zeros(2))[0].tolist())
"""


def test_a_force_from_outside_goes_on_in_another_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled anew, it has another address there."""
    monkeypatch.setattr("cradle_env.effects._EFFECTS", dict(cradle_env.effects._EFFECTS))
    text = dict.fromkeys(("symbol", "summary", "equation", "reference", "energy", "looks_like"), "a push")
    push_by = Parameter("f", "f", "N", "push", absent=0.0, low=-1.0, high=1.0, scale=0.01)

    def push(t, r, theta, v_r, v_theta, parameters):
        return 0.0, parameters[0]

    register(Effect(name="breeze", acts_on="bob", parameters=(push_by,), force=push, **text))
    env = NewtonCradleEnv(bobs=2, effects={"breeze": {"f": 0.05}})
    env.reset(seed=0)
    env.step(NOTHING)
    (tmp_path / "state.pkl").write_bytes(pickle.dumps((env, env.get_state())))
    expected = env.step(NOTHING)[0].tolist()
    assert [json.loads(line) for line in python(BREEZE, str(tmp_path / "state.pkl")).splitlines()] == [expected] * 2


# --- wrappers ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "wrapper",
    [
        wrappers.NormalizeObservation,
        wrappers.NormalizeReward,
        functools.partial(wrappers.FrameStackObservation, stack_size=4),
        wrappers.FlattenObservation,
        wrappers.TimeAwareObservation,
        functools.partial(wrappers.RescaleAction, min_action=np.float32(0), max_action=np.float32(1)),
        functools.partial(wrappers.DelayObservation, delay=2),
        functools.partial(wrappers.MaxAndSkipObservation, skip=3),
        wrappers.ClipAction,
        functools.partial(wrappers.StickyAction, repeat_action_probability=0.5),
        wrappers.Autoreset,
    ],
    ids=lambda wrapper: getattr(wrapper, "func", wrapper).__name__,
)
def test_wrappers(wrapper) -> None:
    env = wrapper(gym.make("NewtonCradle-v0", bobs=2, duration=0.2))
    env.action_space.seed(0)
    observation, _ = env.reset(seed=0)
    assert observation in env.observation_space
    for _ in range(30):
        observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        assert observation in env.observation_space
        assert np.isfinite(observation).all()
        assert math.isfinite(reward)
        if (terminated or truncated) and not isinstance(env, wrappers.Autoreset):
            env.reset()
    env.close()


def test_recorded_statistics_and_time_limit() -> None:
    env = wrappers.RecordEpisodeStatistics(wrappers.TimeLimit(gym.make("NewtonCradle-v0"), 7))
    env.reset(seed=0)
    rewards = []
    for k in range(1, 8):
        _, reward, terminated, truncated, info = env.step(NOTHING)
        rewards.append(reward)
        assert (terminated, truncated) == (False, k == 7)
    assert info["episode"]["l"] == 7
    assert info["episode"]["r"] == pytest.approx(sum(rewards), abs=1e-6)  # the wrapper rounds to 6 digits
    # What a wrapper puts into an info stays out of the environment.
    assert "episode" not in env.unwrapped._episodes.info(0)


def test_a_rescaled_action_is_the_action() -> None:
    plain = gym.make("NewtonCradle-v0")
    rescaled = wrappers.RescaleAction(gym.make("NewtonCradle-v0"), np.float32(0), np.float32(1))
    plain.reset(seed=0)
    rescaled.reset(seed=0)
    one, other = plain.step(np.array([-0.5, 1.0], np.float32)), rescaled.step(np.array([0.25, 1.0], np.float32))
    assert same(one, other)


def test_a_video_is_recorded(tmp_path: Path) -> None:
    moviepy = pytest.importorskip("moviepy")
    pytest.importorskip("pygame")
    env = gym.make("NewtonCradle-v0", bobs=3, render_mode="rgb_array", control_interval=0.05)
    env = wrappers.RecordVideo(env, str(tmp_path / "films"), episode_trigger=lambda episode: True, disable_logger=True)
    env.reset(seed=0)
    for _ in range(10):
        env.step(NOTHING)
    env.close()
    (film,) = (tmp_path / "films").glob("*.mp4")
    with moviepy.VideoFileClip(str(film)) as clip:
        assert (clip.size, clip.fps) == ([800, 600], 20)
        assert clip.duration == pytest.approx(11 / 20, abs=0.051)  # one frame
        assert np.ptp(clip.get_frame(0.2)) > 100


# --- pictures ---------------------------------------------------------------------------------------------------


def test_render_modes() -> None:
    pytest.importorskip("pygame")
    env = gym.make("NewtonCradle-v0", render_mode="rgb_array").unwrapped
    with pytest.raises(ResetNeeded):
        env.render()
    env.reset(seed=0)
    first = env.render()
    assert (first.shape, first.dtype) == ((600, 800, 3), np.uint8)
    assert np.array_equal(env.render(), first)
    env.step(NOTHING)
    assert not np.array_equal(env.render(), first)
    env.close()
    with pytest.raises(ClosedEnvironmentError):
        env.render()
    text = NewtonCradleEnv(render_mode="ansi")
    text.reset(seed=0)
    assert isinstance(text.render(), str)
    assert "●" in text.render()
    assert text.metadata["render_fps"] == 60
    assert NewtonCradleEnv(control_interval=0.1).metadata["render_fps"] == 10
    with pytest.raises(ValueError, match="render_mode is 'rgb'; choose one of human, rgb_array, ansi"):
        NewtonCradleEnv(render_mode="rgb")
    with pytest.raises(ValueError, match="render_mode is 'human'; choose one of rgb_array"):
        NewtonCradleReleaseEnv(render_mode="human")


def test_pictures_of_an_experiment() -> None:
    """Axes before, σ(t) afterwards; the same for an equal experiment."""
    env, twin = (gym.make("NewtonCradleRelease-v0", duration=5.0, render_mode="rgb_array") for _ in range(2))
    pictures = []
    for each in (env, twin):
        with pytest.raises(ResetNeeded):
            each.unwrapped.render()
        each.reset(seed=0)
        before = each.render()
        each.step(NOTHING)
        pictures.append(each.render())
        assert each.unwrapped.run.t[-1] == 5.0
        each.close()
    assert (before.shape, before.dtype) == (pictures[0].shape, pictures[0].dtype) == ((600, 800, 3), np.uint8)
    assert np.array_equal(*pictures) and not np.array_equal(before, pictures[0])


@pytest.mark.parametrize("mode", ["rgb_array", "ansi"])
def test_pictures_are_made_only_when_asked_for(mode: str) -> None:
    """Whoever looks only once sees what others see who have looked all the time."""
    if mode == "rgb_array":
        pytest.importorskip("pygame")
    often, once = (NewtonCradleEnv(render_mode=mode) for _ in range(2))
    for env in (often, once):
        env.reset(seed=0)
        for action in random_actions(env, 40):
            env.step(action)
            if env is often:
                env.render()
    assert np.array_equal(often.render(), once.render())


def test_pictures_do_not_touch_the_motion() -> None:
    plain, drawn = NewtonCradleEnv(**RANGES), NewtonCradleEnv(**RANGES, render_mode="ansi")
    plain.reset(seed=0)
    drawn.reset(seed=0)
    for action in random_actions(plain, 30):
        drawn.render()
        assert same(plain.step(action), drawn.step(action))


def test_without_a_mode_there_is_nothing_to_render() -> None:
    env = NewtonCradleEnv()
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="nothing to render"):
        assert env.render() is None


# --- what is refused --------------------------------------------------------------------------------------------

BAD_ACTIONS = [
    [math.nan, 0.0], [math.inf, 0.0], [0.0, -math.inf], [0.0], [0.0] * 3, [[0.0, 0.0]], 0.0,
    None, "ab", ["0.1", "0.2"], [None, 0.0], [1j, 0.0], {"delta": 0.0}, [[0.0], [0.0, 1.0]], [10**400, 0], {0.0, 1.0},
    np.array(["a", "b"]), np.array(["0.1", "0.2"]), np.zeros(2, complex), np.array([{}, 0.0], object), np.zeros(0),
    np.array(["2020", "2021"], "M8[Y]"), np.full(2, np.nan, np.float32),
]  # fmt: skip


@pytest.mark.parametrize("action", BAD_ACTIONS, ids=lambda action: repr(action)[:40])
@pytest.mark.parametrize("kind", [NewtonCradleEnv, NewtonCradleReleaseEnv])
def test_bad_actions_are_refused_and_change_nothing(kind: type, action) -> None:
    env, other = kind(duration=2.0), kind(duration=2.0)
    for each in (env, other):
        each.reset(seed=0)
    with pytest.raises(InvalidAction, match=r"action is .*; it must be 2 finite numbers: delta, release_angle"):
        env.step(action)
    assert same(env.step(NOTHING), other.step(NOTHING))


@pytest.mark.parametrize(
    "action", [[0, 1], (0.0, 1.0), [False, True], np.array([0, 1]), np.array([0, 1], np.float16), np.array([0.0, 1.0])]
)
def test_numbers_of_any_kind_are_an_action(action) -> None:
    env, other = NewtonCradleEnv(), NewtonCradleEnv()
    env.reset(seed=0)
    other.reset(seed=0)
    assert same(env.step(action), other.step(np.array([0.0, 1.0], np.float32)))


@pytest.mark.parametrize("action", [[1.0000001, -3.0], np.array([1.5, -1.5], np.float32), np.array([2**40, -(2**40)])])
@pytest.mark.parametrize("kind", [NewtonCradleEnv, NewtonCradleReleaseEnv])
def test_finite_actions_are_clipped(kind: type, action) -> None:
    env, other = kind(duration=2.0), kind(duration=2.0)
    for each in (env, other):
        each.reset(seed=0)
    assert same(env.step(action), other.step(np.array([1.0, -1.0])))


@pytest.mark.parametrize("make", [functools.partial(gym.make_vec, num_envs=2), gym.make], ids=["vector", "single"])
@pytest.mark.parametrize("name", IDS)
def test_settings_are_fixed(name: str, make) -> None:
    """`gravity = 1.0` would be without effect."""
    env = make(name).unwrapped
    with pytest.raises(AttributeError, match=r"gravity is a setting, .* another with gravity=.* or give reset\(opt"):
        env.gravity = 1.0
    with pytest.raises(AttributeError, match=r"bobs is a setting, .*; to have it 3, make another with bobs=...$"):
        env.bobs = 3
    env.a_label_of_mine = "run 1"
    assert env.a_label_of_mine == "run 1"
    with pytest.raises(AttributeError, match="gravity is a setting"):
        getattr(env, "set_attr" if hasattr(env, "num_envs") else "set_wrapper_attr")("gravity", 1.0)


@pytest.mark.parametrize("kind", [NewtonCradleEnv, NewtonCradleReleaseEnv])
def test_order_of_calls(kind: type) -> None:
    env = kind(duration=2.0)
    with pytest.raises(ResetNeeded, match="call reset"):
        env.step(NOTHING)
    env.reset(seed=0)
    env.step(NOTHING)
    env.close()
    env.close()
    for call in (lambda: env.step(NOTHING), env.reset):
        with pytest.raises(ClosedEnvironmentError, match="closed; make another"):
            call()


def test_order_of_calls_of_the_rest() -> None:
    with pytest.raises(ResetNeeded):
        NewtonCradleEnv().impacts  # noqa: B018
    env = NewtonCradleEnv()
    env.reset(seed=0)
    state = env.get_state()
    env.close()
    with pytest.raises(ClosedEnvironmentError):
        env.set_state(state)
    with pytest.raises(ResetNeeded):
        gym.make("NewtonCradle-v0").step(NOTHING)


REFUSED = [
    ({"delt": 0.0}, TypeError, "unknown setting 'delt'; did you mean 'delta'"),
    ({"bob": 5}, TypeError, "unknown setting 'bob'; did you mean 'bobs'"),
    ({"cradle": {}}, TypeError, "unknown setting 'cradle'"),
    ({"bobs": 0}, ValueError, "bobs is 0; it must be at least 1 and at most 200"),
    ({"bobs": 201}, ValueError, "bobs is 201"),
    ({"bobs": 2.5}, ValueError, "bobs is 2.5; it must be a whole number"),
    ({"bobs": "many"}, ValueError, "bobs is 'many', which is not a number"),
    ({"delta": 0.15}, ValueError, "delta is 0.15; it must be at least -0.02 and at most 0.1; or widen delta_range"),
    ({"delta": 0.3, "actions": ["release_angle"]}, ValueError, "delta is 0.3; .* at most 0.2; at δ = −1 the pivots"),
    ({"delta": -1.0, "actions": ["release_angle"]}, ValueError, "delta is -1; it must be at least -0.05"),
    ({"delta": math.nan}, ValueError, "delta is nan"),
    ({"delta": "wide"}, ValueError, "delta is 'wide', which is not a number"),
    ({"delta": None}, ValueError, "delta is None"),
    ({"delta": (0.02, 0.01)}, ValueError, r"delta is \(0.02, 0.01\); a range is \(low, high\), low below high"),
    ({"delta": (0.0, 0.3)}, ValueError, "delta is 0.3"),
    ({"delta": (0.0, 0.01, 0.02)}, ValueError, r"delta is \(0.0, 0.01, 0.02\), which is not a number"),
    ({"delta_range": (-1.0, 0.1)}, ValueError, "delta_range is -1; it must be at least -0.05 and at most 0.2"),
    ({"delta_range": (0.05, -0.01)}, ValueError, r"delta_range is \(0.05, -0.01\); .* low below high"),
    ({"delta_range": (0.05, 0.05)}, ValueError, "low below high"),
    ({"delta_range": (0.05, "b")}, ValueError, "delta_range is 'b', which is not a number"),
    ({"delta_range": None}, ValueError, r"delta_range is None; it must be two numbers \(low, high\)"),
    ({"delta_range": (math.nan, 0.1)}, ValueError, "delta_range is nan"),
    ({"release_angle": None}, ValueError, "release_angle is None"),
    ({"release_angle": 0.6}, ValueError, "release_angle is 0.6 rad; .* at most 0.5 rad; or widen release_angle_range"),
    ({"release_angle": 0.0, "actions": ["delta"]}, ValueError, "release_angle is 0 rad; it must be greater than 0"),
    ({"release_angle_range": (0.0, 0.5)}, ValueError, "release_angle_range is 0 rad; it must be greater than 0"),
    ({"release_angle": 1.6, "actions": ["delta"]}, ValueError, "release angle is 1.6 rad; on strings .* 1.5 rad"),
    ({"release_angle_range": (0.1, 1.6)}, ValueError, "release angle is 1.6 rad; on strings .* 1.5 rad"),
    ({"released_bobs": 6}, ValueError, "release lifts 6 bobs; the cradle has 5"),
    ({"released_bobs": 0}, ValueError, "release bobs is 0"),
    ({"start": "hung"}, ValueError, "start is 'hung'; it must be 'unstretched' or 'hanging'"),
    ({"model": "nps"}, ValueError, "unknown model 'nps'; did you mean 'nsp'"),
    ({"model": None}, TypeError, "model is None; it must be one of ho, pendulum, nsp"),
    ({"effects": {"quadratic_drg": {}}}, ValueError, "unknown effect 'quadratic_drg'; did you mean 'quadratic_drag'"),
    ({"effects": {"quadratic_drag": {}}}, ValueError, "quadratic_drag: c2 .* is missing"),
    ({"effects": {"quadratic_drag": {"c3": 1}}}, ValueError, "unknown parameter of quadratic_drag 'c3'.* 'c2'"),
    ({"effects": {"quadratic_drag": {"c2": math.nan}}}, ValueError, "c2 is nan"),
    ({"effects": {"quadratic_drag": 0.1}}, TypeError, "effects is {'quadratic_drag': 0.1}; give"),
    ({"effects": ["quadratic_drag"]}, TypeError, r"effects is \['quadratic_drag'\]; give"),
    ({"effects": None}, TypeError, "effects is None; give"),
    ({"mass": -1.0}, ValueError, "mass is -1 kg; it must be greater than 0"),
    ({"mass": (0.1, math.inf)}, ValueError, "mass is inf"),
    ({"mass": (0.3, 0.1)}, ValueError, r"mass is \(0.3, 0.1\); a range"),
    ({"k_f": "soft"}, ValueError, "k_f is 'soft', which is not a number"),
    ({"power_law": 0.2}, ValueError, "power_law is 0.2; it must be the pair"),
    ({"actions": "delta"}, ValueError, "actions is 'delta'; give one or both of delta, release_angle, as a sequence"),
    ({"actions": {"delta"}}, ValueError, "as a sequence"),
    ({"actions": None}, ValueError, "actions is None"),
    ({"actions": ()}, ValueError, r"actions is \(\)"),
    ({"actions": ("delta", "delta")}, ValueError, "name each only once"),
    ({"actions": ("gap",)}, ValueError, "unknown action 'gap'; known: delta, release_angle"),
    ({"spacer_speed": 0.0}, ValueError, "spacer_speed is 0 m/s; it must be greater than 0"),
    ({"control_interval": 0.0}, ValueError, "control_interval is 0 s; it must be at least 0.0001 s"),
    ({"control_interval": 2.0, "duration": 1.0}, ValueError, "control_interval is 2 s; an episode lasts 1 s"),
    ({"duration": math.inf}, ValueError, "duration is inf s"),
    ({"reward": "synchronise"}, ValueError, "unknown reward 'synchronise'; did you mean 'synchronize'"),
    ({"reward": 1.0}, TypeError, "reward is 1.0; it must be one of synchronize, sustain or a function"),
    ({"camera_noise": -0.01}, ValueError, "camera_noise is -0.01 rad; it must be at least 0 and at most 1 rad"),
    ({"camera_noise": "much"}, ValueError, "camera_noise is 'much', which is not a number; give it in rad"),
    ({"normalize_observations": 1}, TypeError, "normalize_observations is 1; it is True or False"),
    ({"synchronized_at": 0.0}, ValueError, "synchronized_at is 0; it must be greater than 0 and at most 1"),
    ({"dtype": "float16"}, ValueError, "dtype is float16; observations are float32 or float64"),
    ({"dtype": "floaty"}, TypeError, "dtype is 'floaty'; observations are float32 or float64"),
]


@pytest.mark.parametrize(("told", "kind", "message"), REFUSED, ids=[repr(told)[1:50] for told, _, _ in REFUSED])
def test_settings_are_refused_by_name(told: dict, kind: type, message: str) -> None:
    with pytest.raises(kind, match=message):
        NewtonCradleEnv(**told)
    if not {"spacer_speed", "control_interval", "synchronized_at", "camera_noise", "normalize_observations"} & {*told}:
        with pytest.raises(kind, match=message):
            NewtonCradleReleaseEnv(**told)


@pytest.mark.parametrize(
    ("told", "kind", "message"),
    [
        ({"control_interval": 5.0}, TypeError, "control_interval is a setting of NewtonCradle-v0; .* leave it out"),
        ({"spacer_speed": 1e-9}, TypeError, "spacer_speed is a setting of NewtonCradle-v0"),
        ({"synchronized_at": 0.9}, TypeError, "synchronized_at is a setting of NewtonCradle-v0"),
        ({"camera_noise": 0.01}, TypeError, "camera_noise is a setting of NewtonCradle-v0"),
        ({"normalize_observations": True}, TypeError, "normalize_observations is a setting of NewtonCradle-v0"),
        ({"duration": 1e6}, ValueError, r"duration times sample_rate is 2.4e\+08; it must be at most 1e\+07"),
        (
            {"length": 5e-4},
            ValueError,
            "samples every 0.00416667 s are too sparse for .* a 0.04.* s swing",
        ),
        ({"length": (5e-4, 0.3)}, ValueError, "too sparse"),
    ],
)
def test_the_release_refuses_what_it_cannot_do(told: dict, kind: type, message: str) -> None:
    with pytest.raises(kind, match=message):
        NewtonCradleReleaseEnv(**told)


def test_numbers_as_arrays_without_a_dimension() -> None:
    settings = NewtonCradleEnv(k_f=np.array(17000.0), delta=np.array(0.01), release_angle=np.array(0.2)).settings
    cradle, angle = settings.drawn(np.random.default_rng(0))
    assert (cradle.k_f, cradle.delta, angle) == (17000.0, 0.01, 0.2)


@pytest.mark.parametrize(
    ("told", "message"),
    [({"bobs": 1}, "one bob has nothing to synchronize"), ({"bobs": 3, "released_bobs": 3}, "all 3 bobs are lifted")],
)
def test_the_release_leaves_something_to_synchronize_with(told: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        NewtonCradleReleaseEnv(**told)


def test_the_release_takes_longer_than_a_second() -> None:
    """Only from the first sample beyond it on is there a λ; without any the reward was the largest there is."""
    for duration in (0.5, 1.0, 1.004):
        with pytest.raises(ValueError, match=rf"duration is {duration:g} s; λ takes more than 1 s"):
            NewtonCradleReleaseEnv(duration=duration)
    env = NewtonCradleReleaseEnv(bobs=2, duration=1.0042)
    env.reset(seed=0)
    assert env.step(np.zeros(2))[1] < 1.0


def test_a_reset_that_is_refused_leaves_no_episode() -> None:
    """A hundred bobs pressed together have no common rest, which shows only as they are to be put there."""
    env = NewtonCradleEnv(bobs=100)
    many = gym.make_vec("NewtonCradle-v0", num_envs=2, bobs=100)
    for one, action in ((env, np.zeros(2)), (many, np.zeros((2, 2)))):
        one.reset(seed=0)
        one.step(action)
        with pytest.raises(ValueError, match="no common rest"):
            one.reset(options={"delta": -0.02})
        with pytest.raises(ResetNeeded):
            one.step(action)
        one.reset()
        one.step(action)


def test_observations_stay_in_the_space_of_the_environment_that_shows_them() -> None:
    """Strings so soft that bobs hang at twice their length, which only an environment of longer ones shows."""
    wide, narrow = NewtonCradleEnv(bobs=1, length=(0.3, 1.0), kappa=2.0), NewtonCradleEnv(bobs=1, kappa=2.0)
    wide.reset(seed=0, options={"length": 0.3})
    narrow.reset(seed=0)
    narrow.set_state(wide.get_state())
    for _ in range(30):
        assert narrow.observation_space.contains(narrow.step(np.zeros(2))[0])


@pytest.mark.parametrize("value", [5, 5.0, "5", np.int64(5)])
def test_five_is_five(value) -> None:
    env = NewtonCradleEnv(bobs=value, released_bobs=2.0)
    assert env.reset(seed=0)[0].shape == (23,)
    assert type(env.settings.bobs) is int


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"delt": 0.0}, ValueError, "unknown option 'delt'; did you mean 'delta'"),
        ({1: 2}, ValueError, "unknown option '1'"),
        ({"bobs": 3}, ValueError, "option 'bobs' is the same for all episodes"),
        ({"duration": 3.0}, ValueError, "option 'duration' is the same for all episodes"),
        ({"delta": 0.15}, ValueError, "delta is 0.15; .* at most 0.1; or widen delta_range"),
        ({"delta": "wide"}, ValueError, "delta is 'wide', which is not a number"),
        ({"delta": (0.02, 0.01)}, ValueError, "low below high"),
        ({"release_angle": math.nan}, ValueError, "release_angle is nan"),
        ({"mass": -1.0}, ValueError, "mass is -1"),
        ({"posterior": "nowhere.nc"}, ValueError, "no file 'nowhere.nc'; name the posterior.nc"),
        ({"posterior": None}, ValueError, "no file 'None'"),
        ([("delta", 0.0)], TypeError, "options is list; it must be a dictionary"),
        ("delta", TypeError, "options is str; it must be a dictionary"),
        (np.zeros(2), TypeError, "options is ndarray"),
    ],
)
@pytest.mark.parametrize("kind_of", [NewtonCradleEnv, NewtonCradleReleaseEnv])
def test_options_are_refused_by_name(kind_of: type, options, kind: type, message: str) -> None:
    env = kind_of(**RANGES)
    env.reset(seed=4)
    before = env.np_random.bit_generator.state
    with pytest.raises(kind, match=message):
        env.reset(seed=5, options=options)
    assert env.np_random.bit_generator.state == before


def test_options_beyond_the_observation_space_are_refused() -> None:
    env = NewtonCradleEnv()
    for options in ({"length": 1.0}, {"length": 0.01}, {"gravity": 50.0}):
        with pytest.raises(ValueError, match=r"length is .* and gravity .* but the observation space holds r to 0.6 m"):
            env.reset(options=options)
    assert env.reset(options={"length": 0.35})[0] in env.observation_space


# --- files ------------------------------------------------------------------------------------------------------


def test_a_model_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "cradle.toml"
    path.write_text('[model]\nbase = "pendulum"\neffects = ["quadratic_drag"]\n[model.parameters]\n'
                    "quadratic_drag = {c2 = 2e-3}\n")  # fmt: skip
    told = {"model": "pendulum", "effects": {"quadratic_drag": {"c2": 2e-3}}}
    actions = random_actions(NewtonCradleEnv(), 20)
    expected = rollout(NewtonCradleEnv(**told), actions, seed=0)
    for name in (path, str(path)):
        env = NewtonCradleEnv(model=name)
        assert same(rollout(env, actions, seed=0), expected)
    pickled = pickle.dumps(env)
    path.unlink()
    assert same(rollout(pickle.loads(pickled), actions, seed=0), expected)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "No such file or directory; name a TOML file"),
        ("x =", "is no TOML file"),
        (b"\xff\xfe", "is no TOML file"),
        ("", r"has no \[model\] table"),
        ("model = 3", r"has no \[model\] table"),
        ("[model]\nbas = 'nsp'", r"unknown key of \[model\] 'bas'; did you mean 'base'"),
        ("[model]\nbase = 'nps'", "unknown base 'nps'; did you mean 'nsp'"),
        ("[model]\nbase = ['nsp']", "unknown base"),
        ("[model]\neffects = 'quadratic_drag'", "effects is 'quadratic_drag'; it must be a list of names"),
        ("[model]\neffects = [1]", r"effects is \[1\]; it must be a list of names"),
        ("[model]\neffects = ['quadratic_drg']", "unknown effect 'quadratic_drg'; did you mean 'quadratic_drag'"),
        ("[model]\neffects = ['quadratic_drag']", "quadratic_drag has no value for c2"),
        ("[model]\nparameters = 3", "parameters is 3; write a table"),
        ("[model.parameters]\nquadratic_drag = 3", "write a table"),
    ],
)
def test_a_malformed_model_file_is_named(tmp_path: Path, content: str | bytes | None, message: str) -> None:
    path = tmp_path / "cradle.toml"
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ValueError, match=f"cradle.toml.*{message}"):
        NewtonCradleEnv(model=path)


def posterior(path: Path, **draws) -> str:
    with h5py.File(path, "w") as file:
        for name, values in draws.items():
            file[f"posterior/{name}"] = values
    return str(path)


def test_draws_of_a_posterior_are_joint(tmp_path: Path) -> None:
    masses = np.linspace(0.1, 0.3, 12).reshape(3, 4)  # chains and draws
    draws = {"mass": masses, "b": 0.01 * masses, "quadratic_drag.c2": 0.02 * masses, "newton_exponent": masses}
    options = {"posterior": posterior(tmp_path / "posterior.nc", **draws)}
    env = NewtonCradleEnv()
    env.reset(seed=0)
    seen = set()
    for _ in range(60):
        env.reset(options=options)
        bob = env._episodes.bobs[0, 0]
        seen.add(float(bob["mass"]))
        assert (bob["b"], bob["c2"]) == pytest.approx((0.01 * bob["mass"], 0.02 * bob["mass"]), rel=1e-15)
    assert seen == set(masses.ravel().tolist())
    actions = random_actions(env, 3)
    one, other = ([env.reset(seed=9, options=options), *(env.step(action) for action in actions)] for env in (env, env))
    assert same(one, other)
    env.reset()
    assert env._episodes.bobs["mass"][0, 0] == 0.2813


def test_draws_hold_the_spacer_and_values_of_each_bob_or_gap(tmp_path: Path) -> None:
    draws = {"delta": np.full(3, 0.004), "spacer_offset.offset[1]": np.full(3, 1e-3)}
    draws |= {"mass_mismatch.relative[1]": np.full(3, 0.02)}
    options = {"posterior": posterior(tmp_path / "posterior.nc", **draws)}
    known = {"spacer_offset": {"offset": [0.0]}, "mass_mismatch": {"relative": [0.0, 0.0]}}
    env = NewtonCradleEnv(bobs=2, effects=known)
    _, info = env.reset(seed=0, options=options)
    assert info["delta"] == pytest.approx(0.004)
    bobs = env._episodes.bobs[0]
    assert bobs["mass"] == pytest.approx([1.02 * 0.2813, 0.98 * 0.2813])
    assert np.diff(bobs["pivot"]) == pytest.approx(2.0 * 0.02 * 1.005)
    for wrong in ({"bobs": 2}, {"bobs": 3, "effects": {"spacer_offset": {"offset": 0.0}}}):
        with pytest.raises(ValueError, match="give the environment the bobs and the effects of the calibration"):
            NewtonCradleEnv(**wrong).reset(seed=0, options=options)


@pytest.mark.parametrize(
    ("draws", "message"),
    [
        ({}, "is no posterior of a calibration"),
        ({"newton_exponent": np.ones(3)}, "holds no parameter of a cradle"),
        ({"mass": np.ones(0)}, "equally many draws of all parameters, at least one; it has 0 of mass"),
        ({"mass": np.full(5, 0.2), "b": np.ones(2)}, "it has 2 of b, 5 of mass"),
        ({"mass": [b"heavy", b"light"]}, "is no posterior of a calibration"),
        ({"mass": np.full(3, np.nan)}, "mass is nan kg"),
        ({"mass": np.full(3, -1.0)}, "mass is -1 kg"),
        ({"gusts.strength": np.ones(3)}, "unknown effect 'gusts'"),
        ({"length": np.full(3, 2.0)}, "length is 2 m .* the observation space"),
    ],
)
def test_a_bad_posterior_is_refused(tmp_path: Path, draws: dict, message: str) -> None:
    path = posterior(tmp_path / "posterior.nc", **draws)
    with pytest.raises(ValueError, match=message):
        NewtonCradleEnv().reset(seed=0, options={"posterior": path})


def test_what_is_no_posterior_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "posterior.nc"
    text.write_text("mass = 3")
    for path in (text, tmp_path):
        with pytest.raises(ValueError, match=r"is no posterior of a calibration; name the posterior\.nc"):
            NewtonCradleEnv().reset(options={"posterior": path})


@pytest.mark.parametrize("most", [2000, 5])
def test_impacts_of_a_long_interval(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """All of them, in order; or the first, where there are more than are kept."""
    monkeypatch.setattr(episodes, "_MOST_IMPACTS", most)
    env = NewtonCradleEnv(bobs=5, control_interval=10.0, synchronized_at=1e-6)
    env.reset()
    taken = 0.0
    for _ in range(3):
        info = env.step(NOTHING)[4]
        impacts = env.impacts
        assert len(impacts) == min(info["impacts"], 5 * most) and info["impacts"] > 96
        assert np.all(np.diff(impacts["time"]) >= 0.0)
        assert info["time"] - 10.0 <= impacts["time"][0] and impacts["time"][-1] <= info["time"]
        if most == 2000:
            assert impacts["loss"].sum() == pytest.approx(info["collisions"] - taken, rel=1e-9)
        taken = info["collisions"]


@pytest.mark.parametrize("told", [{"bobs": 1}, {"bobs": 2, "released_bobs": 2, "delta": -0.01}])
def test_bobs_with_nothing_to_synchronize_with(told: dict) -> None:
    """σ is 1 and λ unknown to the end: the episode never ends as synchronized, nor is it rewarded for that."""
    env = NewtonCradleEnv(**told, actions=("delta",), duration=5.0)
    env.reset()
    gained, over, truncated = 0.0, False, False
    while not (over or truncated):
        _, reward, over, truncated, info = env.step(np.zeros(1))
        gained += reward
    assert truncated and not over
    assert (info["sigma"], info["newton_exponent"]) == (1.0, 0.0)
    assert gained == pytest.approx(-1.0)


def test_bobs_dragged_to_a_halt_against_each_other_do_not_hang() -> None:
    """Bobs seven times as large as their pendulums are long: touches without end once stopped this after 0.4 s."""
    env = NewtonCradleEnv(
        bobs=6, model="pendulum", start="hanging", delta=-0.006216, delta_range=(-0.008354, 0.005242), radius=0.1351,
        release_angle=2.8354, release_angle_range=(2.6889, 2.8824), spacer_speed=0.0036525, control_interval=0.1,
        duration=4.0, mass=0.58698, length=0.020286, k_f=1.0, b=20.0, gravity=14.4756,
        effects={"pivot_friction": {"tau_c": 0.071053}},
    )  # fmt: skip
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(40):
        observation = env.step(rng.uniform(-1, 1, 2))[0]
        assert np.all(np.isfinite(observation))


@pytest.mark.parametrize("action", [-0.5, 0.0, 0.5])
def test_a_displaced_pivot_is_no_part_of_the_delta_that_is_set(action: float) -> None:
    """With the pivots off by 0.003 the spacer still goes where it is sent, in both environments."""
    told = {"bobs": 2, "delta": 0.01, "actions": ("delta",), "effects": {"spacer_offset": {"offset": [0.003]}}}
    deltas = []
    for env in (NewtonCradleEnv(**told), NewtonCradleReleaseEnv(**told)):
        env.reset(seed=0)
        deltas.append(env.step(np.array([action]))[4]["delta"])
    np.testing.assert_allclose(deltas, np.interp(action, [-1, 0, 1], [-0.02, 0.01, 0.1]), rtol=1e-12)
