"""The environments that `import cradle_env` registers, all in one table."""

from __future__ import annotations

from typing import Any

from gymnasium.envs.registration import register, registry

_CONTROL = {
    "entry_point": "cradle_env.envs.newton_cradle:NewtonCradleEnv",
    "vector_entry_point": "cradle_env.envs.vector:NewtonCradleVectorEnv",
}
# Keep the bobs apart for a minute by the spacer alone. No constant δ comes near the best: see studies/baselines.
_SUSTAIN: dict[str, Any] = {
    "reward": "sustain",
    "actions": ("delta",),
    "release_angle": (0.15, 0.3),
    "control_interval": 0.1,
}


def _benchmark(**settings: Any) -> dict[str, Any]:
    """A task of 600 control intervals, 60 s."""
    return {**_CONTROL, "max_episode_steps": 600, "kwargs": {**_SUSTAIN, **settings}}


#: What `gymnasium.register` is given, by name.
ENVIRONMENTS: dict[str, dict[str, Any]] = {
    # A spacer at rest returns up to 2.58, at δ = −0.02 and 0.05 rad.
    "NewtonCradle-v0": {**_CONTROL, "max_episode_steps": 3600, "reward_threshold": 2.7},
    "NewtonCradleRelease-v0": {
        "entry_point": "cradle_env.envs.release:NewtonCradleReleaseEnv",
        "vector_entry_point": "cradle_env.envs.release_vector:NewtonCradleReleaseVectorEnv",
        "reward_threshold": 0.2,
    },
    "NewtonCradle2-v0": _benchmark(bobs=2),
    "NewtonCradle5-v0": _benchmark(bobs=5),
    "NewtonCradle10-v0": _benchmark(bobs=10),
    # Each number within a factor of 2 of its default, lengths and masses within a third.
    "NewtonCradleRandomized-v0": _benchmark(
        bobs=5,
        length=(0.2, 0.4),
        mass=(0.19, 0.37),
        k_f=(9000.0, 36000.0),
        kappa=(98.0, 393.0),
        b=(0.001, 0.004),
    ),
    "NewtonCradleCamera-v0": _benchmark(bobs=5, camera_noise=0.002),
}


def register_all() -> None:
    """Register what is not there yet: a second import, or a user's own registration, changes nothing."""
    for name, told in ENVIRONMENTS.items():
        if name not in registry:
            register(name, **told)
