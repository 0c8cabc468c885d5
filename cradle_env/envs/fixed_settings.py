"""Settings that an environment was made with are read once: setting them later would change nothing."""

from __future__ import annotations

from typing import Any

from cradle_env.envs.settings import PER_EPISODE, SETTINGS
from cradle_env.errors import one_line


def check_no_setting(name: str, value: Any) -> None:
    """AttributeError if the attribute to be set to `value` is named like a setting."""
    if name in SETTINGS:
        episode = f", or give reset(options={{{name!r}: ...}}) for one episode" if name in PER_EPISODE else ""
        raise AttributeError(
            f"{name} is a setting, fixed when the environment was made; to have it {one_line(value)}, make another with"
            f" {name}=...{episode}"
        )


class FixedSettings:
    """Refuses `env.gravity = 1.0` and the like, which would be without effect."""

    def __setattr__(self, name: str, value: Any) -> None:
        check_no_setting(name, value)
        super().__setattr__(name, value)
