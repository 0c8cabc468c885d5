"""Pictures of a cradle: frames and a window by pygame, films, and drawings for terminals."""

from cradle_env.rendering.canvas import Canvas
from cradle_env.rendering.film import save_animation
from cradle_env.rendering.scene import FADE, Scene, contact, extent, loads, scenes
from cradle_env.rendering.terminal import text

__all__ = ["FADE", "Canvas", "Scene", "contact", "extent", "loads", "save_animation", "scenes", "text"]
