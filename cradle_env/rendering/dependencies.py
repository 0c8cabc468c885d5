"""Packages that only pictures need; they come with the extra `render`."""

from __future__ import annotations

import os

from gymnasium.error import DependencyNotInstalled


def missing(package: str) -> DependencyNotInstalled:
    """The error that says how to install a package that pictures need."""
    return DependencyNotInstalled(f"{package} is not installed; run `pip install 'newtons-cradle[render]'`")


def import_pygame():
    """pygame with its fonts ready, and without the environment variables that it sets.

    It prints no greeting: Gymnasium has seen to that.
    """
    before = set(os.environ)
    try:
        import pygame
    except ImportError as error:
        raise missing("pygame-ce") from error
    finally:
        for name in set(os.environ) - before:
            del os.environ[name]
    pygame.font.init()
    return pygame
