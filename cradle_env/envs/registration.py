"""The environments that `import cradle_env` registers, all in one table."""

from __future__ import annotations

from typing import Any

from gymnasium.envs.registration import register, registry

_CONTROL = {
    "entry_point": "cradle_env.envs.newton_cradle:NewtonCradleEnv",
    "vector_entry_point": "cradle_env.envs.vector:NewtonCradleVectorEnv",
}
# Keep the bobs clicking for a minute by the spacer alone, on a cradle that is slightly another in each episode. No
# constant δ comes near the best: see studies/baselines.
_LEVEL: dict[str, Any] = {
    "reward": "sustain",
    "actions": ("delta",),
    "release_angle": (0.15, 0.3),
    "control_interval": 0.1,
    "length": (0.297, 0.303),
    "mass": (0.276, 0.287),
    "k_f": (16200.0, 19800.0),
    "kappa": (177.0, 216.0),
    "b": (0.0018, 0.0022),
}


def _level(threshold: float, **settings: Any) -> dict[str, Any]:
    """A task of 600 control intervals, 60 s."""
    return {
        **_CONTROL, "max_episode_steps": 600, "reward_threshold": threshold, "kwargs": {**_LEVEL, **settings},
    }  # fmt: skip


#: What `gymnasium.register` is given, by name.
ENVIRONMENTS: dict[str, dict[str, Any]] = {
    # A spacer at rest returns up to 2.58, at δ = −0.02 and 0.05 rad.
    "NewtonCradle-v0": {**_CONTROL, "max_episode_steps": 3600, "reward_threshold": 2.65},
    "NewtonCradleRelease-v0": {
        "entry_point": "cradle_env.envs.release:NewtonCradleReleaseEnv",
        "vector_entry_point": "cradle_env.envs.release_vector:NewtonCradleReleaseVectorEnv",
        "reward_threshold": 0.2,
    },
    # The fewer bobs and the slower the spacer, the less it can do.
    "NewtonCradleEasy-v0": _level(0.9, bobs=10),
    "NewtonCradleMedium-v0": _level(0.8, bobs=5, spacer_speed=0.015),
    "NewtonCradleHard-v0": _level(0.5, bobs=2, spacer_speed=0.0075),
    # Medium; each number within a factor of 2 of its default, lengths and masses within a third.
    "NewtonCradleRandomized-v0": _level(
        0.7,
        bobs=5,
        spacer_speed=0.015,
        length=(0.2, 0.4),
        mass=(0.19, 0.37),
        k_f=(9000.0, 36000.0),
        kappa=(98.0, 393.0),
        b=(0.001, 0.004),
    ),
    # Medium, seen by a camera.
    "NewtonCradleCamera-v0": _level(0.8, bobs=5, spacer_speed=0.015, camera_noise=0.002),
}


def register_all() -> None:
    """Register what is not there yet: a second import, or a user's own registration, changes nothing."""
    for name, told in ENVIRONMENTS.items():
        if name not in registry:
            register(name, **told)
