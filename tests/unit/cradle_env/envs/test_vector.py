"""`gym.make_vec("NewtonCradle-v0")` is Gymnasium's vector of single environments, bit for bit."""

import copy
import functools
import itertools
import math
import os
import pickle
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.error import ClosedEnvironmentError, InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv

import cradle_env  # noqa: F401  registers the names
from cradle_env.envs.vector import NewtonCradleVectorEnv

same = functools.partial(data_equivalence, exact=True)

# Episodes of two bobs are soon over: within 2 s, a window of 1.15 s after the asynchrony has come to 0.97.
SHORT = {"control_interval": 0.1, "duration": 4.0, "bobs": 2, "synchronized_at": 0.97}
RANGES = {"delta": (-0.01, 0.02), "mass": (0.1, 0.3), "length": (0.2, 0.4), "release_angle": (0.1, 0.4)}


def slower(before: dict[str, float], after: dict[str, float]) -> float:
    return before["kinetic"] - after["kinetic"] - after["sigma"]


def native(num_envs: int, mode: str = "NextStep", **told) -> NewtonCradleVectorEnv:
    told = {"max_episode_steps": 3600, **told}
    return NewtonCradleVectorEnv(num_envs=num_envs, autoreset_mode=mode, **told)


def single_of(told: dict) -> gym.Env:
    return gym.make("cradle_env:NewtonCradle-v0", **told)


def of_singles(num_envs: int, mode: str = "NextStep", each=None, workers=None, **told) -> SyncVectorEnv:
    each = [{}] * num_envs if each is None else each
    makers = [functools.partial(single_of, {**told, **own}) for own in each]
    return SyncVectorEnv(makers, autoreset_mode=mode)


def random_actions(env, seed: int = 0):
    rng = np.random.default_rng(seed)
    while True:
        yield rng.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32)


def compare(one, other, steps: int, *, seed: int | list | None = 5, mode: str = "NextStep", options=None) -> np.ndarray:
    """Both return the same all along; how many episodes were (terminated, truncated)."""
    first = one.reset(seed=seed, options=copy.deepcopy(options)), other.reset(seed=seed, options=copy.deepcopy(options))
    assert same(*first)
    assert first[0][0] in one.observation_space
    ends = np.zeros(2, int)
    for k, actions in enumerate(itertools.islice(random_actions(one), steps)):
        ours, theirs = one.step(actions), other.step(actions)
        for name, a, b in zip(
            ("observations", "rewards", "terminated", "truncated", "infos"), ours, theirs, strict=True
        ):
            assert same(a, b), (k, name, a, b)
        assert ours[0] in one.observation_space
        ends += [ours[2].sum(), ours[3].sum()]
        over = ours[2] | ours[3]
        if mode == "Disabled" and over.any():
            options = {"reset_mask": over}
            assert same(one.reset(options=dict(options)), other.reset(options=dict(options)))
    assert [g.bit_generator.state for g in one.np_random] == [g.bit_generator.state for g in other.np_random]
    assert one.np_random_seed == other.np_random_seed
    return ends


# --- bit for bit ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
@pytest.mark.parametrize("reward", ["synchronize", "sustain", slower])
def test_single_environments_bit_for_bit(mode: str, reward) -> None:
    """Infos with masks, final observations and infos; each with settings of its own, some over those of all."""
    never = {"synchronized_at": 1e-9}
    each = [
        {"synchronized_at": 0.999},
        {},
        {"delta": 0.02, "reward": "sustain", **never},
        {"reward": slower, "mass": 0.1},
        {"model": "pendulum", "release_angle": 0.4, **never},
        {"effects": {"quadratic_drag": {"c2": 1e-3}}, **never},
        {"start": "hanging", "released_bobs": 2},
    ]
    told = {**SHORT, "reward": reward, "delta": (-0.01, 0.01), "each": each, "workers": 2}
    terminated, truncated = compare(native(7, mode, **told), of_singles(7, mode, **told), 130, mode=mode)
    assert terminated > 5
    assert truncated > 5


@pytest.mark.parametrize("workers", [None, 1, 2, 3, 50])
@pytest.mark.parametrize("num_envs", [1, 2, 5])
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_whatever_the_number_of_threads(num_envs: int, workers: int | None, mode: str) -> None:
    told = {**SHORT, **RANGES, "synchronized_at": 0.99, "duration": 2.6, "workers": workers}
    assert compare(native(num_envs, mode, **told), of_singles(num_envs, mode, **told), 60, mode=mode).any()


@pytest.mark.parametrize(
    "told",
    [
        {},
        {"bobs": 1},
        {"bobs": 20},
        {"model": "ho"},
        {"dtype": "float64"},
        {"actions": ("delta",)},
        {"actions": ("release_angle", "delta")},
        {"effects": {"contact_duration": {"scale": 1.0}}, "bobs": 3},
        {"delta": -0.02, "released_bobs": 2, "start": "hanging"},
        {"control_interval": 0.5, "spacer_speed": 1.0},
        {"max_episode_steps": 7},
        {"max_episode_steps": -1, "control_interval": 0.5, "duration": 5.0},
        {"camera_noise": 0.01, **RANGES},
        {"camera_noise": 0.01, "max_episode_steps": 7},
    ],
    ids=repr,
)
def test_whatever_the_settings(told: dict) -> None:
    compare(native(3, **told), of_singles(3, **told), 25)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_cameras_in_every_mode(mode: str) -> None:
    """Readings of environments that are not reset stay; each camera has its own noise."""
    each = [{"camera_noise": noise} for noise in (0.0, 0.01, 0.1)]
    told = {**SHORT, "camera_noise": 0.5}
    assert compare(native(3, mode, each=each, **told), of_singles(3, mode, each=each, **told), 60, mode=mode).any()


@pytest.mark.parametrize("seed", [0, [3, 1, 4], [3, None, 4], (9, 9, 9)])
def test_seeds_and_options(seed) -> None:
    options = {"delta": 0.03, "release_angle": (0.1, 0.2), "mass": 0.2}
    one, other = (make(3, **SHORT, **RANGES) for make in (native, of_singles))
    one.reset(seed=1)
    other.reset(seed=1)
    if seed != 0:
        seed = list(seed)
    compare(one, other, 10, seed=seed, options=options)
    assert same(one.reset(), other.reset())  # options last one episode, random numbers go on


def test_a_numpy_seed_is_a_seed() -> None:
    env = native(2, **RANGES)
    assert same(env.reset(seed=np.int64(3)), env.reset(seed=3))
    assert env.np_random_seed == (3, 4)


def test_random_numbers_before_reset() -> None:
    seeds = native(3).np_random_seed
    assert len(set(seeds)) == 3
    env = native(3, **RANGES)
    seeds = env.np_random_seed
    first = env.reset()
    assert same(native(3, **RANGES).reset(seed=list(seeds)), first)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_some_are_reset(mode: str) -> None:
    one, other = (make(4, mode, **SHORT, **RANGES) for make in (native, of_singles))
    assert same(one.reset(seed=2), other.reset(seed=2))
    rng = np.random.default_rng(0)
    for k, actions in enumerate(itertools.islice(random_actions(one), 60)):
        ours, theirs = one.step(actions), other.step(actions)
        assert same(ours, theirs)
        mask = rng.random(4) < 0.1
        if mode == "Disabled":
            mask |= ours[2] | ours[3]
        if mask.any():
            options = {"reset_mask": mask, "delta": 0.01}
            seed = [None, 7, None, 8] if k % 2 else None
            given = dict(options)
            assert same(one.reset(seed=seed, options=given), other.reset(seed=seed, options=dict(options)))
            assert "reset_mask" in given  # the caller's own


# --- how it is made ---------------------------------------------------------------------------------------------


def test_make_vec() -> None:
    told = {"num_envs": 3, "bobs": 2, "duration": 2.0, "control_interval": 0.1}
    envs = [gym.make_vec("NewtonCradle-v0", vectorization_mode=way, **told) for way in ("sync", "vector_entry_point")]
    envs.append(gym.make_vec("NewtonCradle-v0", **told))
    assert isinstance(envs[1].unwrapped, NewtonCradleVectorEnv)
    assert isinstance(envs[2].unwrapped, NewtonCradleVectorEnv)  # where none is asked for
    for env in envs[1:]:
        assert env.metadata == envs[0].metadata
        for space in ("observation_space", "action_space", "single_observation_space", "single_action_space"):
            assert getattr(env, space) == getattr(envs[0], space)
        compare(env, envs[0], 25)
    assert envs[2].unwrapped._limit == 3600
    with pytest.raises(TypeError, match="unknown setting 'bob'; did you mean 'bobs'"):
        gym.make_vec("NewtonCradle-v0", num_envs=2, bob=2)
    release = gym.make_vec("NewtonCradleRelease-v0", num_envs=2, duration=2.0)
    release.reset(seed=0)
    terminated, truncated = release.step(np.zeros((2, 2), np.float32))[2:4]
    assert terminated.all()
    assert not truncated.any()


def test_a_spec_makes_it_again() -> None:
    env = gym.make_vec("NewtonCradle-v0", num_envs=3, bobs=2, delta=(0.0, 0.01))
    again = gym.make_vec(pickle.loads(pickle.dumps(env.spec)))
    assert again.num_envs == 3
    assert same(again.reset(seed=1), env.reset(seed=1))


@pytest.mark.slow
@pytest.mark.parametrize("context", ["spawn", "forkserver"])
def test_workers_that_start_anew(context: str) -> None:
    told = {**SHORT, **RANGES}
    env = AsyncVectorEnv([functools.partial(single_of, told)] * 2, context=context)
    expected = of_singles(2, **told)
    try:
        assert same(env.reset(seed=3), expected.reset(seed=3))
        for actions in itertools.islice(random_actions(env), 45):
            # The workers load compiled kernels, this process may have compiled its own: the same bits.
            assert same(env.step(actions), expected.step(actions))
    finally:
        env.close()


def test_async_by_make_vec() -> None:
    told = {"num_envs": 2, "bobs": 2, "reward": slower}
    env = gym.make_vec("NewtonCradle-v0", vectorization_mode="async", vector_kwargs={"context": "forkserver"}, **told)
    try:
        expected = gym.make_vec("NewtonCradle-v0", **told)
        assert same(env.reset(seed=3), expected.reset(seed=3))
        for actions in itertools.islice(random_actions(env), 5):
            assert same(env.step(actions), expected.step(actions))
    finally:
        env.close()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_experiments_at_once_are_those_one_by_one(mode: str) -> None:
    """The release has a vector environment of its own, in threads."""
    told = {"duration": 2.0, "bobs": 2, **RANGES}
    one = gym.make_vec("NewtonCradleRelease-v0", num_envs=3, autoreset_mode=mode, workers=2, **told)
    single = functools.partial(gym.make, "NewtonCradleRelease-v0", **told)
    other = SyncVectorEnv([single] * 3, autoreset_mode=mode)
    assert type(one.unwrapped).__name__ == "NewtonCradleReleaseVectorEnv"
    assert compare(one, other, 6, mode=mode)[0] >= 9
    one.reset(seed=0)
    with pytest.raises(InvalidAction, match="must be 2 finite numbers"):
        one.step(np.array([[0.0, 0.0], [0.0, np.nan], [0.0, 0.0]]))
    other.reset(seed=0)
    assert same(one.step(np.zeros((3, 2), np.float32)), other.step(np.zeros((3, 2), np.float32)))


# --- states -----------------------------------------------------------------------------------------------------


def what_follows(env: NewtonCradleVectorEnv) -> list:
    followed = [env.step(actions) for actions in itertools.islice(random_actions(env, 3), 60)]
    return [*followed, env.reset(), [random.random() for random in env.np_random], env.np_random_seed]


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("steps", [0, 7, 40])  # the last where some wait to be reset
def test_a_state_goes_on_bit_for_bit(mode: str, steps: int) -> None:
    make = functools.partial(native, 3, mode, **SHORT, **RANGES, workers=2, max_episode_steps=40)
    env = make()
    env.reset(seed=11)
    for actions in itertools.islice(random_actions(env), steps):
        env.step(actions)
    state = env.get_state()
    stored, twin, pickled = pickle.dumps(state), copy.deepcopy(env), pickle.dumps(env)
    expected = what_follows(env)
    env.set_state(state)
    assert same(what_follows(env), expected)
    other, busy = make(), make()
    other.set_state(pickle.loads(stored))
    busy.reset(seed=1)
    what_follows(busy)
    busy.set_state(state)
    for again in (twin, pickle.loads(pickled), other, busy):
        assert same(what_follows(again), expected)


def test_states_of_others_are_refused() -> None:
    env = native(2)
    env.reset(seed=0)
    for other, message in (
        (native(3), "of 3 environments; this is 2"),
        (native(2, bobs=2), "bobs 2; here it is 5"),
        (native(2, each=[{}, {"reward": "sustain"}]), "reward 'sustain'; here it is 'synchronize'"),
    ):
        other.reset(seed=0)
        with pytest.raises(ValueError, match=message):
            env.set_state(other.get_state())
    with pytest.raises(TypeError, match="what get_state returns"):
        env.set_state(None)
    alone = gym.make("NewtonCradle-v0").unwrapped
    alone.reset(seed=0)
    with pytest.raises(ValueError, match="vector environment"):
        native(1).set_state(alone.get_state())
    env.set_state(native(2).get_state())  # of no episodes
    with pytest.raises(ResetNeeded):
        env.step(np.zeros((2, 2)))


# --- wrappers and pictures --------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_recorded_statistics(mode: str) -> None:
    envs = [wrappers.vector.RecordEpisodeStatistics(make(3, mode, **SHORT)) for make in (native, of_singles)]
    for env in envs:
        env.reset(seed=0)
    count = 0
    for actions in itertools.islice(random_actions(envs[0]), 90):
        ours, theirs = (env.step(actions) for env in envs)
        for infos in (ours[4], theirs[4]):
            infos.get("episode", {}).pop("t", None)  # by the clock
        assert same(ours, theirs)
        count += "episode" in ours[4]
    assert count >= 3


@pytest.mark.parametrize(
    "wrapper",
    [
        wrappers.vector.NormalizeObservation,
        wrappers.vector.NormalizeReward,
        wrappers.vector.FlattenObservation,
        functools.partial(wrappers.vector.RescaleAction, min_action=np.float32(0), max_action=np.float32(1)),
        wrappers.vector.ClipAction,
        wrappers.vector.DictInfoToList,
    ],
    ids=lambda wrapper: getattr(wrapper, "func", wrapper).__name__,
)
def test_vector_wrappers(wrapper) -> None:
    ours, theirs = (wrapper(make(3, **SHORT)) for make in (native, of_singles))
    assert same(ours.reset(seed=0), theirs.reset(seed=0))
    ours.action_space.seed(0)
    for _ in range(50):
        actions = ours.action_space.sample()
        one, other = ours.step(actions), theirs.step(actions)
        assert same(one, other)
        assert np.isfinite(one[0]).all()


def test_pictures() -> None:
    text, theirs = (make(2, render_mode="ansi", bobs=2) for make in (native, of_singles))
    with pytest.raises(ResetNeeded):
        text.render()
    text.reset(seed=0)
    theirs.reset(seed=0)
    for actions in itertools.islice(random_actions(text), 3):
        text.step(actions)
        theirs.step(actions)
    # Impacts are marked by single environments only; there is none yet.
    assert text.render() == theirs.render()
    assert pickle.loads(pickle.dumps(text)).render() == theirs.render()
    text.close()
    with pytest.raises(ClosedEnvironmentError):
        text.render()
    assert native(2, control_interval=0.1).metadata["render_fps"] == 10
    env = native(2)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="nothing to render"):
        env.render()


def test_frames() -> None:
    pytest.importorskip("pygame")
    env = native(2, render_mode="rgb_array", **SHORT)
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.array([[0.0, 0.0], [0.0, 1.0]]))
    one, other = env.render()
    assert (one.shape, one.dtype) == ((600, 800, 3), np.uint8)
    assert not np.array_equal(one, other)
    env.close()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_lists_of_frames(mode: str) -> None:
    """As many of the last episodes as Gymnasium collects of single environments; those of a bob alone are the same."""
    pytest.importorskip("pygame")
    told = {"bobs": 1, "control_interval": 0.1, "duration": 0.5, "render_mode": "rgb_array_list"}
    one, other = native(2, mode, **told), of_singles(2, mode, **told)
    for env in (one, other):
        env.reset(seed=0)
    for steps in (3, 4, 2):
        for actions in itertools.islice(random_actions(one), steps):
            one.step(actions)
            other.step(actions)
        ours, theirs = one.render(), other.render()
        assert [len(frames) for frames in ours] == [len(frames) for frames in theirs]
        assert same(ours, theirs)
    one.close()
    other.close()


def test_single_cradles_are_asked() -> None:
    told = {"bobs": 2, "render_mode": "ansi", "each": [{"delta": 0.01}, {}, {}]}
    one, other = native(3, **told), of_singles(3, **told)
    one.reset(seed=3)
    other.reset(seed=3)
    for name in ("render_mode", "np_random_seed", "observation_space", "action_space", "render", "metadata"):
        assert same(one.call(name), other.call(name)), name
        assert same(one.get_attr(name), other.get_attr(name)), name
    assert one.get_attr("settings") == other.get_attr("settings")
    assert [settings.delta for settings in one.get_attr("settings")] == [0.01, 0.0, 0.0]
    with pytest.raises(AttributeError, match="gravity is a setting: see the attribute settings"):
        one.get_attr("gravity")
    with pytest.raises(AttributeError, match="nothing is none of settings, np_random"):
        one.call("nothing")
    with pytest.raises(AttributeError, match="delta is a setting, fixed"):
        one.set_attr("delta", [0.0, 0.01, 0.02])
    with pytest.raises(AttributeError, match="label cannot be set to 3: single cradles are rows of arrays"):
        one.set_attr("label", 3)


# --- order of calls, and what is refused ------------------------------------------------------------------------


def test_order_of_calls() -> None:
    env = native(3, workers=2)
    actions = np.zeros((3, 2))
    with pytest.raises(ResetNeeded, match="call reset first"):
        env.step(actions)
    with pytest.raises(ResetNeeded, match=r"no episodes \[1, 2\] yet"):
        env.reset(options={"reset_mask": np.array([True, False, False])})
    env.reset(seed=0)
    env.step(actions)
    state = env.get_state()
    env.close()
    env.close()
    for call in (env.reset, lambda: env.step(actions), lambda: env.set_state(state)):
        with pytest.raises(ClosedEnvironmentError, match="closed; make another"):
            call()


def test_what_is_over_waits_for_its_reset() -> None:
    env = native(2, "Disabled", max_episode_steps=3)
    env.reset(seed=0)
    for _ in range(3):
        truncated = env.step(np.zeros((2, 2)))[3]
    assert truncated.all()
    with pytest.raises(ResetNeeded, match=r"episodes \[0, 1\] are over; reset them"):
        env.step(np.zeros((2, 2)))
    env.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(ResetNeeded, match=r"episodes \[1\] are over"):
        env.step(np.zeros((2, 2)))


def test_what_is_returned_is_the_callers() -> None:
    for mode in AutoresetMode:
        told = {**SHORT, "synchronized_at": 0.1, "reward": slower}
        one, other = native(2, mode, **told), native(2, mode, **told)
        for returned in (one.reset(seed=0), other.reset(seed=0)):
            if returned[1] is not None:
                returned[0][:] = 3.0
        one.reset(seed=0)
        for actions in itertools.islice(random_actions(one), 20):
            ours, theirs = one.step(actions), other.step(actions)
            assert same(ours, theirs)
            for array in (*ours[:4], *ours[4].values()):
                array[:] = 1  # of one environment only


BAD_ACTIONS = [
    [[0.0, 0.0], [math.nan, 0.0]], [[0.0, 0.0], [0.0, math.inf]], [[-math.inf, 0.0], [0.0, 0.0]], [0.0, 0.0], 0.0, None,
    "ab", [["0.1", "0.2"]] * 2, [[1j, 0.0]] * 2, [[0.0, 0.0]] * 3, [[0.0]] * 2, [[0.0], [0.0, 1.0]], [[10**400, 0]] * 2,
    np.zeros((2, 2, 1)), np.zeros((2, 2), complex), np.full((2, 2), np.nan), np.array([["a", "b"]] * 2), {"a": 1},
]  # fmt: skip


@pytest.mark.parametrize("actions", BAD_ACTIONS, ids=lambda actions: repr(actions)[:40])
def test_bad_actions_are_refused_and_change_nothing(actions) -> None:
    env, other = native(2), native(2)
    env.reset(seed=0)
    other.reset(seed=0)
    wanted = r"they must be finite numbers of shape \(2, 2\)|environment [01] is .*; it must be finite"
    with pytest.raises(InvalidAction, match=wanted):
        env.step(actions)
    assert same(env.step(np.zeros((2, 2))), other.step([[0, 0], [0, 0]]))


@pytest.mark.parametrize(
    ("told", "kind", "message"),
    [
        ({"num_envs": 0}, ValueError, "num_envs is 0; it must be a whole number, at least 1"),
        ({"num_envs": 2.0}, ValueError, "num_envs is 2.0"),
        ({"workers": 0}, ValueError, "workers is 0; it must be a whole number, at least 1"),
        ({"workers": -1}, ValueError, "workers is -1"),
        ({"workers": 1.5}, ValueError, "workers is 1.5"),
        ({"max_episode_steps": "long"}, TypeError, "max_episode_steps is 'long'"),
        (
            {"autoreset_mode": "Sometimes"},
            ValueError,
            "autoreset_mode is 'Sometimes'; choose one of NextStep, SameStep",
        ),
        ({"each": [{}]}, ValueError, "each has 1 settings; there are 2 environments"),
        ({"each": [{}, None]}, TypeError, "each has None; it must be one dictionary of settings"),
        ({"each": [{}, {"delt": 0.1}]}, TypeError, "unknown setting 'delt'; did you mean 'delta'"),
        ({"each": [{}, {"delta": 0.15}]}, ValueError, "delta is 0.15"),
        ({"each": [{}, {"bobs": 3}]}, ValueError, "each: bobs, actions, .* must be the same for all"),
        ({"each": [{}, {"length": 0.5}]}, ValueError, "each: .* length"),
        ({"each": [{}, {"actions": ["delta"]}]}, ValueError, "each: .* actions"),
        ({"bob": 3}, TypeError, "unknown setting 'bob'; did you mean 'bobs'"),
        ({"render_mode": "rgb"}, ValueError, "render_mode is 'rgb'; choose one of human"),
    ],
    ids=repr,
)
def test_settings_are_refused_by_name(told: dict, kind: type, message: str) -> None:
    with pytest.raises(kind, match=message):
        NewtonCradleVectorEnv(**{"num_envs": 2, **told})


@pytest.mark.parametrize(
    ("given", "kind", "message"),
    [
        ({"seed": [1]}, ValueError, "1 seeds for 2 environments"),
        ({"seed": -1}, gym.error.Error, "greater or equal to zero"),
        ({"seed": [1, "a"]}, gym.error.Error, "must be a python integer"),
        ({"options": [1]}, TypeError, "options has .*; it must be a dictionary"),
        ({"options": {"delt": 0.0}}, ValueError, "unknown option 'delt'; did you mean 'delta'"),
        ({"options": {"reset_mask": [True, False]}}, TypeError, r"options\['reset_mask'\] is \[True, False\]"),
        ({"options": {"reset_mask": np.array([1, 0])}}, TypeError, "numpy array of 2 booleans"),
        ({"options": {"reset_mask": np.ones(3, bool)}}, ValueError, r"has shape \(3,\); it must have shape \(2,\)"),
        ({"options": {"reset_mask": np.zeros(2, bool)}}, ValueError, "resets nothing"),
    ],
    ids=repr,
)
def test_resets_are_refused_by_name(given: dict, kind: type, message: str) -> None:
    env = native(2)
    env.reset(seed=0)
    with pytest.raises(kind, match=message):
        env.reset(**given)


# --- in the long run --------------------------------------------------------------------------------------------


def resident() -> int:
    """Memory in use [bytes]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the system does not tell how much memory is in use")
@pytest.mark.parametrize("kind", ["single", "vector"])
def test_memory_does_not_grow(kind: str) -> None:
    told = {"bobs": 2, "control_interval": 1 / 240, "duration": 5.0, **RANGES}
    env = native(2, "SameStep", workers=1, **told) if kind == "vector" else gym.make("NewtonCradle-v0", **told)
    env.reset(seed=0)
    actions = np.zeros(env.action_space.shape)

    def run(steps: int) -> None:
        for _ in range(steps):
            _, _, terminated, truncated, _ = env.step(actions)
            if kind == "single" and (terminated or truncated):
                env.reset()

    run(5_000)
    before = resident()
    run(50_000 // (2 if kind == "vector" else 1))
    # 100 bytes a step of each; an info kept of every step would be 10 times as much.
    assert resident() - before < 5e6


def test_a_state_repeated_goes_on_as_the_one_it_is_of() -> None:
    one, many = gym.make("NewtonCradle-v0", bobs=3).unwrapped, gym.make_vec("NewtonCradle-v0", num_envs=4, bobs=3)
    one.reset(seed=1)
    many.reset(seed=5)
    actions = np.random.default_rng(0).uniform(-1, 1, (60, 2)).astype(np.float32)
    for action in actions[:30]:
        one.step(action)
    many.set_state(one.get_state().repeated(4))
    for action in actions[30:]:
        observation, reward, *_ = one.step(action)
        observations, rewards, *_ = many.step(np.tile(action, (4, 1)))
        np.testing.assert_array_equal(observations, np.tile(observation, (4, 1)))
        np.testing.assert_array_equal(rewards, [reward] * 4)
    many.set_state(one.get_state().repeated(4))
    observations, _ = many.reset(options={"reset_mask": np.array([True, False, False, False])})
    np.testing.assert_array_equal(observations[1:], np.tile(observation, (3, 1)))
