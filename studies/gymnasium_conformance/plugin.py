"""A plugin for pytest that puts cradles where Gymnasium's tests make its own environments."""

from __future__ import annotations

import functools
import json
import os
import sys
import types
from pathlib import Path

import gymnasium as gym
import pytest
from gymnasium.envs.registration import EnvSpec

from cradle_env.envs import newton_cradle, release, vector
from cradle_env.envs.registration import ENVIRONMENTS

#: Environments that Gymnasium's tests of vectors and wrappers make by name: each stands for a cradle here.
STAND_INS = ("CartPole-v1", "Pendulum-v1", "MountainCarContinuous-v0")
#: The file that takes one line of JSON for every test.
OUTCOMES = "CRADLE_CONFORMANCE_OUTCOMES"

_touched = [False]


def pytest_configure() -> None:
    """Register the stand-ins, and hand the tests our specs where they look for those of Gymnasium."""
    cradle = gym.spec("NewtonCradle-v0")
    for name in STAND_INS:
        gym.registry[name] = EnvSpec(
            name, cradle.entry_point, vector_entry_point=cradle.vector_entry_point, max_episode_steps=500
        )
    ours = types.ModuleType("tests.envs.utils")
    vars(ours)["__getattr__"] = _looked_for
    sys.modules["tests.envs.utils"] = ours
    for kind in (newton_cradle.NewtonCradleEnv, release.NewtonCradleReleaseEnv, vector.NewtonCradleVectorEnv):
        _watch(kind)


def _looked_for(name: str) -> list:
    """What `tests.envs.utils` has by this name, made anew for every module: some tests close what they are given."""
    if name not in ("all_testing_initialised_envs", "all_testing_env_specs", "gym_testing_env_specs"):
        if name == "mujoco_testing_env_specs":
            return []
        raise AttributeError(name)
    environments = [gym.make(environment, disable_env_checker=True).unwrapped for environment in ENVIRONMENTS]
    return environments if name == "all_testing_initialised_envs" else [one.spec for one in environments]


def _watch(kind: type) -> None:
    """Take note whenever a cradle is made, reset or asked for a picture."""
    for name in ("__init__", "reset", "render"):
        plain = getattr(kind, name)

        @functools.wraps(plain)
        def watched(self, *arguments, _plain=plain, **keywords):
            _touched[0] = True
            return _plain(self, *arguments, **keywords)

        setattr(kind, name, watched)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item):
    """Begin a test with no cradle made."""
    _touched[0] = False
    yield


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo):
    """Write down how a test ended, and whether a cradle took part in it."""
    report = (yield).get_result()
    if report.when == "call" or report.outcome != "passed":
        why = "" if call.excinfo is None else call.excinfo.exconly().splitlines()[0]
        line = {"test": item.nodeid, "outcome": report.outcome, "cradle": _touched[0], "why": why}
        with Path(os.environ[OUTCOMES]).open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
