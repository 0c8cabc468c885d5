"""docs/reference/environment.md says what the code does: names, shapes, bounds, limits and defaults."""

import dataclasses
import math
import re

import gymnasium as gym
import numpy as np
import pytest

from cradle_env.envs.registration import ENVIRONMENTS
from cradle_env.envs.settings import Settings
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "reference" / "environment.md").read_text(encoding="utf-8")


def table(heading: str, which: int = 0) -> list[list[str]]:
    """The cells of a table below a heading, without its header."""
    section = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    found = re.findall(r"(?:^\|.*\|\n)+", section, re.MULTILINE)[which]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in found.splitlines()[2:]]


def number(cell: str) -> float:
    return float(cell.replace("−", "-"))


def test_the_names_shapes_and_limits() -> None:
    rows = {row[0].strip("`"): row[1:6] for row in table("Environments")}
    assert list(rows) == list(ENVIRONMENTS)
    for name, row in rows.items():
        env = gym.make(name)
        settings = env.unwrapped.settings
        limit = env.spec.max_episode_steps or 1
        assert row == [str(settings.bobs), str(env.action_space.shape), str(env.observation_space.shape), str(limit),
                       settings.reward]  # fmt: skip
    env = gym.make("NewtonCradle-v0")
    assert f"`{env.action_space}`" in PAGE and f"Box({env.observation_space.shape}, float32)" in PAGE
    assert env.observation_space.dtype == np.float32


def test_what_is_drawn() -> None:
    shared, randomized = (ENVIRONMENTS[f"NewtonCradle{level}-v0"]["kwargs"] for level in ("Medium", "Randomized"))
    for told, column in ((shared, 1), (randomized, 3)):
        drawn = {row[0].strip("`"): (number(row[column]), number(row[column + 1])) for row in table("Environments", 1)}
        assert drawn == {key: told[key] for key in ("length", "mass", "k_f", "kappa", "b")}
    low, high = shared["release_angle"]
    assert f"from {low:g} to {high:g} rad" in PAGE and f"intervals of {shared['control_interval']:g} s" in PAGE
    noise = ENVIRONMENTS["NewtonCradleCamera-v0"]["kwargs"]["camera_noise"]
    assert f"errors of {noise:g} rad" in PAGE
    rows = {row[0].strip("`"): row for row in table("Environments")}
    for name, told in ENVIRONMENTS.items():
        assert float(rows[name][6]) == told["reward_threshold"]
        if "kwargs" in told:
            assert number(rows[name][7]) == told["kwargs"].get("spacer_speed", 0.03)


def test_the_bounds_of_actions() -> None:
    settings = Settings()
    assert [row[1].split(":")[0].strip("`") for row in table("Action space")] == list(settings.actions)
    for row in table("Action space"):
        name = row[1].split(":")[0].strip("`")
        assert (number(row[2]), number(row[4])) == getattr(settings, f"{name}_range")
    assert f"{settings.spacer_speed:g} m/s" in PAGE


@pytest.mark.parametrize(
    ("name", "which", "widths"),
    [("NewtonCradle-v0", 0, [5, 5, 5, 5, 1, 1, 1]), ("NewtonCradleRelease-v0", 1, [12, 1, 1, 1])],
)
def test_the_bounds_of_observations(name: str, which: int, widths: list[int]) -> None:
    space = gym.make(name).observation_space
    least, largest = np.array([[number(row[2]), number(row[3])] for row in table("Observation space", which)]).T
    assert sum(widths) == space.shape[0]
    np.testing.assert_allclose(np.repeat(least, widths), space.low, rtol=2e-4)
    np.testing.assert_allclose(np.repeat(largest, widths), space.high, rtol=2e-4)
    env = gym.make(name)
    keys = ", ".join(f"`{key}`" for key in env.reset(seed=0)[1])
    assert keys.split(", `kinetic`")[0] in " ".join(PAGE.split())


def test_the_arguments() -> None:
    rows = {row[0].strip("`"): row[1] for row in table("Arguments")}
    fields = {f.name: f for f in dataclasses.fields(Settings) if f.name != "cradle"}
    assert list(rows) == list(fields)
    for name, cell in rows.items():
        default = getattr(Settings(), name)
        shown = f'"{default}"' if isinstance(default, str) else str(default).replace("'", '"')
        assert cell == ("{}" if name == "effects" else shown), name
    settings = Settings()
    assert f"asynchrony is ≤ {settings.synchronized_at:g}" in PAGE and f"after {settings.duration:g} s" in PAGE
    assert f"returns at most {-math.log(0.05):.1f}" in PAGE
