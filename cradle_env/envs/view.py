"""What an environment shows of an episode: a picture, a text or a window of its cradle, and σ so far."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from cradle_env.envs.episodes import Episodes
from cradle_env.envs.settings import Settings
from cradle_env.errors import one_line
from cradle_env.mechanics import control_interval
from cradle_env.rendering import FADE, Canvas, Scene, contact, extent, text
from cradle_env.simulation import impact_rows

_NONE = np.zeros((0, 4))


class View:
    """Draws episode k of `episodes` as `mode` says: "human", "rgb_array" or "ansi". Pivots are drawn where the spacer
    holds them, bobs where they are, also where the frame moves."""

    def __init__(self, mode: str, fps: float, settings: Settings) -> None:
        self.mode = mode
        self._fps = fps
        self._settings = settings
        widest = settings.widest()
        ends = settings.delta_range if "delta" in settings.actions else (np.max(settings.delta),)
        self._extent = extent(widest.replace(delta=max(ends)))
        self._canvas: Canvas | None = None
        self.begin()

    def begin(self) -> None:
        """A new episode."""
        self._times: list[float] = []
        self._sigma: list[float] = []
        self._impacts: deque[np.ndarray] = deque()

    def follow(self, time: float, sigma: float, impacts: np.ndarray = _NONE) -> None:
        """Takes note of a step that ended at `time` [s], and of its impacts as the kernel writes them, (M, 4). What a
        picture shows of them is made when it is drawn: most steps are never shown."""
        self._times.append(time)
        self._sigma.append(sigma)
        if len(impacts) > 0:
            self._impacts.append(impacts.copy())
            while self._impacts[0][-1, 0] <= time - FADE:
                self._impacts.popleft()

    def render(self, episodes: Episodes, k: int, info: dict[str, float]) -> Any:
        """The picture (H, W, 3) uint8, the text, or None where it went to the window."""
        scene = self._scene(episodes, k, info)
        if self.mode == "ansi":
            return text(scene)
        if self._canvas is None:
            self._canvas = Canvas(human=self.mode == "human", fps=self._fps)
        return self._canvas.show(scene) if self.mode == "human" else self._canvas.draw(scene)

    def _scene(self, episodes: Episodes, k: int, info: dict[str, float]) -> Scene:
        drawn = np.empty((episodes.bobs.shape[1], 3))
        control_interval.drawing(episodes.cradles, episodes.bobs, episodes.state, episodes.episodes, k, drawn)
        bobs = episodes.bobs[k]
        return Scene(
            time=info["time"],
            pivots=bobs["pivot"] + bobs["drive"] * info["time"],
            x=drawn[:, 0],
            z=drawn[:, 1],
            radius=float(episodes.cradles["radius"][k]),
            load=drawn[:, 2],
            contact=contact(impact_rows(np.concatenate([_NONE, *self._impacts])), len(bobs), info["time"]),
            sigma_times=np.array(self._times),
            sigma=np.array(self._sigma),
            newton_exponent=info["newton_exponent"] or np.nan,
            delta=info["delta"],
            duration=self._settings.duration,
            extent=self._extent,
            title="Newton's cradle",
        )

    def close(self) -> None:
        """Closes the window."""
        if self._canvas is not None:
            self._canvas.close()
            self._canvas = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_canvas": None}


def check_render_mode(mode: str | None, metadata: dict[str, Any]) -> str | None:
    """The mode, if there is such a one; ValueError otherwise."""
    if mode is not None and mode not in metadata["render_modes"]:
        raise ValueError(f"render_mode is {one_line(mode)}; choose one of {', '.join(metadata['render_modes'])}")
    return mode
