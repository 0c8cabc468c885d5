"""Controllers that neither learn nor plan, and episodes of them."""

from __future__ import annotations

from collections.abc import Callable

import gymnasium as gym
import numpy as np

import cradle_env  # noqa: F401  registers the environments

#: Actions (K, A) in [−1, 1] from observations (K, D); one that remembers is made anew for every episode.
Policy = Callable[[np.ndarray], np.ndarray]

#: Weights of `by_hand`: 1, θ_N − θ_1 [rad], ω_N − ω_1 [rad/s]. Found by trial at N = 5.
WEIGHTS = {"sustain": (1.3, -8.0, -0.25), "synchronize": (-1.0, 11.6, -1.3)}


def play(name: str, policy: Policy, episodes: int, seed: int) -> np.ndarray:
    """Returns of one episode of each of `episodes` cradles of a registered environment, with seeds from `seed` on."""
    cradles = gym.make_vec(name, episodes, vectorization_mode="vector_entry_point", autoreset_mode="SameStep")
    observations, _ = cradles.reset(seed=seed)
    returns, going = np.zeros(episodes), np.ones(episodes, bool)
    while going.any():
        observations, rewards, terminated, truncated, _ = cradles.step(policy(observations))
        returns += going * rewards
        going &= ~(terminated | truncated)
    cradles.close()
    return returns


def at_random(name: str, seed: int) -> Policy:
    """Uniform actions, drawn anew in every control interval."""
    width = gym.make(name).action_space.shape[0]
    rng = np.random.default_rng(seed)
    return lambda observations: rng.uniform(-1.0, 1.0, (len(observations), width))


def constant(actions: np.ndarray) -> Policy:
    """The same actions in every control interval: (A,) for all cradles, or (K, A)."""
    return lambda observations: np.broadcast_to(actions, (len(observations), np.shape(actions)[-1]))


def by_hand(name: str) -> Policy:
    """A linear law: the spacer follows how far apart the end bobs are, and how fast they part.

    Through a camera, speeds are differences of successive angles. Where the release angle is an action it is least.
    """
    settings = gym.make(name).unwrapped.settings  # type: ignore[attr-defined]
    n, camera, interval = settings.bobs, settings.camera_noise is not None, settings.control_interval
    level, angle, speed = WEIGHTS[settings.reward]
    earlier: list[np.ndarray] = []

    def policy(observations: np.ndarray) -> np.ndarray:
        theta = observations[:, :n] if camera else observations[:, n : 2 * n]
        apart = theta[:, -1] - theta[:, 0]
        if camera:
            parting = (apart - earlier[-1]) / interval if earlier else np.zeros(len(apart))
            earlier[:] = [apart]
        else:
            parting = observations[:, 4 * n - 1] - observations[:, 3 * n]
        asked = np.clip(level + angle * apart + speed * parting, -1.0, 1.0)
        return np.stack([{"delta": asked}.get(action, np.full_like(asked, -1.0)) for action in settings.actions], 1)

    return policy
