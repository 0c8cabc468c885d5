"""Steps per second of our environments and of Gymnasium's own, measured in the same run: `cradle bench`."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym

import cradle_env  # noqa: F401  registers the environments
from cradle_env.threads import cores

#: Classic environments of Gymnasium, and ours, each with its default wrappers.
_SINGLE: dict[str, tuple[str, dict[str, Any]]] = {
    "Pendulum-v1": ("Pendulum-v1", {}),
    "Acrobot-v1": ("Acrobot-v1", {}),
    "NewtonCradle-v0, 2 bobs": ("NewtonCradle-v0", {"bobs": 2}),
    "NewtonCradle-v0, 5 bobs": ("NewtonCradle-v0", {"bobs": 5}),
}
_MANY = 1024
_ROUNDS = 7


def single_environments(steps: int = 4000) -> dict[str, float]:
    """Measure steps per second of each environment with random actions: the best of several alternating rounds."""
    players = {name: _player(gym.make(kind, **settings), steps) for name, (kind, settings) in _SINGLE.items()}
    best = dict.fromkeys(players, 0.0)
    for _ in range(_ROUNDS):
        for name, play in players.items():
            best[name] = max(best[name], steps / _seconds(play))
    return best


def _player(env: gym.Env, steps: int) -> Callable[[], None]:
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(1000)]
    env.reset(seed=0)

    def play() -> None:
        for k in range(steps):
            _, _, terminated, truncated, _ = env.step(actions[k % 1000])
            if terminated or truncated:
                env.reset()

    return play


def vector_environments(steps: int = 40) -> dict[str, float]:
    """Measure steps per second (environments times calls) of 1024 cradles of five bobs on one and two threads."""
    best: dict[str, float] = {}
    for workers in (1, 2)[: cores()]:
        env = gym.make_vec("NewtonCradle-v0", num_envs=_MANY, bobs=5, workers=workers)
        env.action_space.seed(0)
        actions = [env.action_space.sample() for _ in range(10)]
        env.reset(seed=0)

        def play(env=env, actions=actions) -> None:
            for k in range(steps):
                env.step(actions[k % 10])

        play()
        fastest = min(_seconds(play) for _ in range(_ROUNDS))
        best[f"NewtonCradle-v0, 5 bobs, {_MANY} at once, {workers} thread{'s' * (workers > 1)}"] = (
            _MANY * steps / fastest
        )
        env.close()
    return best


def _seconds(play: Callable[[], None]) -> float:
    start = time.perf_counter()
    play()
    return time.perf_counter() - start
