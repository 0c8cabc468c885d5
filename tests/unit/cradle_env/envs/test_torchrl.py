"""TorchRL makes the environments by their names, and finds that they keep to their specs."""

import pytest

import cradle_env  # noqa: F401  registers the names

pytest.importorskip("torchrl")

from torchrl.envs import GymEnv, SerialEnv, check_env_specs

# What TorchRL and PyTorch announce of themselves is not ours.
pytestmark = pytest.mark.filterwarnings("default::UserWarning", "default::DeprecationWarning", "default::FutureWarning")


@pytest.mark.parametrize("name", ["NewtonCradle-v0", "NewtonCradleRelease-v0"])
def test_an_environment_keeps_to_its_specs(name: str) -> None:
    env = GymEnv(name, bobs=2, duration=2.0)
    check_env_specs(env)
    rolled = env.rollout(5, break_when_any_done=False)
    assert rolled["observation"].shape == (5, *env.observation_spec["observation"].shape)
    env.close()


def test_several_at_once() -> None:
    env = SerialEnv(2, lambda: GymEnv("NewtonCradle-v0", bobs=2))
    assert env.rollout(3)["action"].shape == (2, 3, 2)
    env.close()
