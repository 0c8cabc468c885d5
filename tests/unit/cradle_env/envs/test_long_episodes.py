"""What shows only after millions of steps; `make slow`."""

import resource

import gymnasium as gym
import pytest

import cradle_env  # noqa: F401  registers the environments

STEPS = 10_000_000


def peak_memory() -> int:
    """Largest resident memory of this process so far [kB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


@pytest.mark.slow
@pytest.mark.parametrize("many", [1, 1024])
def test_memory_is_flat_over_ten_million_steps(many: int) -> None:
    if many == 1:
        env = gym.make("NewtonCradle-v0", bobs=2)
    else:
        env = gym.make_vec("NewtonCradle-v0", num_envs=many, bobs=2)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(100)]
    env.reset(seed=0)

    def play(steps: int) -> None:
        for k in range(steps):
            _, _, terminated, truncated, _ = env.step(actions[k % 100])
            if many == 1 and (terminated or truncated):
                env.reset()

    play(20_000 if many == 1 else 100)
    before = peak_memory()
    play(STEPS // many)
    # A single number kept per step would be 80 MB.
    assert peak_memory() - before < 4_000
    env.close()
