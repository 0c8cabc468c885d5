"""Frames and a window, drawn by pygame."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

from cradle_env.rendering.dependencies import import_pygame
from cradle_env.rendering.palette import BLUE, GREY, INK, PALE, PAPER, RAIL, VERMILLION, string_style
from cradle_env.rendering.scene import Scene
from cradle_env.rendering.sprites import ball, flash
from cradle_env.synchronization import FLOOR

# The page is drawn this many times finer than the picture, and HEIGHT units high whatever the picture's size.
_FINER = 2
_HEIGHT = 600
_STAGE_TOP, _STAGE_BOTTOM, _MARGIN = 98, 382, 40
_LEGEND = 424
_STRIP_LEFT, _STRIP_TOP, _STRIP_BOTTOM = 76, 458, 560
_DECADES = -np.log10(FLOOR)


class Canvas:
    """Draws scenes into pictures of `size` (width, height) [pixels] and, with `human`, into a window at `fps` [1/s].

    Raises DependencyNotInstalled where pygame is missing.
    """

    def __init__(self, size: tuple[int, int] = (800, 600), *, human: bool = False, fps: float = 30.0):
        self._pygame = pygame = import_pygame()
        self._fps = fps
        self._picture = pygame.Surface(size, 0, 32)
        self._page = pygame.Surface((_FINER * size[0], _FINER * size[1]), 0, 32)
        self._unit = _FINER * size[1] / _HEIGHT  # pixels of the page
        self._width = size[0] / size[1] * _HEIGHT
        self._view_of, self._backdrop = None, self._page.copy()
        self._fonts, self._sprites = {}, {}
        self._window = None
        if human:
            pygame.display.init()
            pygame.display.set_caption("Newton's cradle")
            self._window = pygame.display.set_mode(size)
            self._clock = pygame.time.Clock()

    def draw(self, scene: Scene) -> np.ndarray:
        """The picture of a scene, (H, W, 3) uint8; the same for the same scene."""
        self._paint(scene)
        width, height = self._picture.get_size()
        pixels = self._pygame.image.tobytes(self._picture, "RGB")
        return np.frombuffer(pixels, np.uint8).reshape(height, width, 3).copy()

    def show(self, scene: Scene) -> None:
        """Puts a scene into the window, and waits until the time of a frame is over."""
        if self._window is None:
            raise ValueError("this canvas has no window; make it with human=True")
        self._paint(scene)
        self._window.blit(self._picture, (0, 0))
        self._pygame.event.pump()
        self._pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._window is not None:
            self._window = None
            self._pygame.display.quit()

    def _paint(self, scene: Scene) -> None:
        view_of = (scene.extent, scene.radius, scene.duration, scene.title)
        if view_of != self._view_of:
            self._sprites.clear()
            self._paint_backdrop(scene)
            self._view_of, self._backdrop = view_of, self._page.copy()
        self._page.blit(self._backdrop, (0, 0))
        self._paint_readings(scene)
        self._paint_cradle(scene)
        self._paint_sigma(scene)
        self._pygame.transform.smoothscale(self._page, self._picture.get_size(), self._picture)

    def _paint_backdrop(self, scene: Scene) -> None:
        """What stays from frame to frame: title, frame of the cradle, legend, axes."""
        self._page.fill(PAPER)
        self._write(scene.title, 24, 38, 20)
        scale, x, y = self._view(scene)
        half, depth = (scale * side for side in scene.extent)
        for side in (x - half - 12, x + half + 6):
            self._box(PALE, side, y - 8, 6, depth + 24, 3)
        self._box(PALE, x - half - 24, y + depth + 12, 2 * half + 48, 10, 5)
        self._box(RAIL, x - half - 12, y - 8, 2 * half + 24, 8, 4)

        for i, (value, name) in enumerate(((0.0, "slack"), (1.0, "at rest"), (2.0, "twice"), (3.0, "3 ×"))):
            left = 88 + 76 * i
            colour, width = string_style(value)
            self._line(colour, width, (left, _LEGEND), (left + 22, _LEGEND))
            self._write(name, left + 28, _LEGEND, 11, GREY)
        self._write("strings", 24, _LEGEND, 11)
        right = self._width - 24
        self._write("impact", right - 340, _LEGEND, 11)
        for i, speed in enumerate((0.1, 1.0)):
            self._flash(speed, 8, right - 284 + 76 * i, _LEGEND)
            self._write(f"{speed:g} m/s", right - 272 + 83 * i, _LEGEND, 11, GREY)
        self._write("pivots", right - 138, _LEGEND, 11)
        for colour, name, left in ((BLUE, "spread", right - 94), (VERMILLION, "pressed", right - 46)):
            self._write(name, left + 1, _LEGEND, 11, colour)

        top, bottom, left = _STRIP_TOP, _STRIP_BOTTOM, _STRIP_LEFT
        for decade in range(round(_DECADES) + 1):
            height = top + (bottom - top) * decade / _DECADES
            self._line(PALE, 1, (left, height), (right, height))
            self._write(f"{10.0**-decade:g}", left - 8, height, 11, GREY, align=1.0)
        for time in _ticks(scene.duration):
            along = left + (right - left) * time / scene.duration
            self._line(PALE, 1, (along, top), (along, bottom + 4))
            self._write(f"{time:g}", along, bottom + 14, 11, GREY, align=0.5)
        self._write("σ", 24, 0.5 * (top + bottom), 14)
        self._write("time [s]", 0.5 * (left + right), bottom + 29, 11, GREY, align=0.5)
        self._write("σ(t)", right - 70, top + 11, 11, BLUE, align=1.0)
        self._write("exp(−λt)", right - 6, top + 11, 11, VERMILLION, align=1.0)

    def _paint_readings(self, scene: Scene) -> None:
        for i, (symbol, value) in enumerate(scene.readings().items()):
            right = self._width - 24 - 92 * (3 - i)
            self._write(symbol, right, 28, 12, GREY, align=1.0)
            self._write(value, right, 48, 16, align=1.0)

    def _paint_cradle(self, scene: Scene) -> None:
        scale, x0, y0 = self._view(scene)
        pivots, x, y = x0 + scale * scene.pivots, x0 + scale * scene.x, y0 - scale * scene.z
        radius = scale * scene.radius
        for pivot in pivots:
            self._box(GREY, pivot - radius, y0 - 10, 2 * radius, 12, min(3.0, radius))
        for left, right in itertools.pairwise(pivots):
            gap = right - left - 2 * radius
            if abs(gap) > 1e-6 * radius:
                mark = max(abs(gap), 1.5)
                self._box(BLUE if gap > 0 else VERMILLION, 0.5 * (left + right - mark), y0 - 14, mark, 20, 0)
        for i, tension in enumerate(scene.load):
            colour, width = string_style(tension)
            self._line(colour, width, (pivots[i], y0), (x[i], y[i]))
            self._dot(PAPER, pivots[i], y0 - 4, 1.6)
        for centre in zip(x, y, strict=True):
            self._stamp(("ball", round(radius * self._unit, 2)), *centre)
        for i in np.flatnonzero(scene.contact):
            self._flash(scene.contact[i], radius, 0.5 * (x[i] + x[i + 1]), 0.5 * (y[i] + y[i + 1]))

    def _paint_sigma(self, scene: Scene) -> None:
        wide = (self._width - 24 - _STRIP_LEFT) / scene.duration
        high = (_STRIP_BOTTOM - _STRIP_TOP) / _DECADES

        def points(times, decades):
            return np.column_stack([_STRIP_LEFT + wide * times, _STRIP_TOP + high * np.clip(decades, 0.0, _DECADES)])

        rate = scene.newton_exponent / np.log(10.0)
        if rate > 0.0:
            end = min(scene.duration, _DECADES / rate)
            times = np.linspace(0.0, end, 2 * round(1 + np.hypot(wide, high * rate) * end / 16))
            dashes = points(times, rate * times)
            for start, stop in zip(dashes[0::2], dashes[1::2], strict=True):
                self._line(VERMILLION, 1.5, start, stop)
        known = np.isfinite(scene.sigma)
        if np.count_nonzero(known) > 1:
            times, sigma = scene.sigma_times[known], scene.sigma[known]
            columns = np.linspace(times[0], times[-1], 2 + int(wide * (times[-1] - times[0])))
            curve = points(columns, -np.log10(np.maximum(np.interp(columns, times, sigma), FLOOR)))
            width = round(1.75 * self._unit)
            self._pygame.draw.lines(self._page, BLUE, False, (self._unit * curve).tolist(), width)
            x, y = curve[-1]
            self._dot(BLUE, x, y, 3.5)

    def _view(self, scene: Scene) -> tuple[float, float, float]:
        """Units per metre, and the point (x, y) of the page that the middle of the pivots has."""
        half, depth = scene.extent
        scale = min((0.5 * self._width - _MARGIN) / half, (_STAGE_BOTTOM - _STAGE_TOP) / depth)
        return scale, 0.5 * self._width, 0.5 * (_STAGE_TOP + _STAGE_BOTTOM - scale * depth)

    # What follows takes units of the page.

    def _line(self, colour, width, start, end) -> None:
        start, end = ([self._unit * c for c in point] for point in (start, end))
        self._pygame.draw.aaline(self._page, colour, start, end, max(round(width * self._unit), 1))

    def _box(self, colour, left, top, width, height, corner) -> None:
        left, top, right, bottom = (round(c * self._unit) for c in (left, top, left + width, top + height))
        rectangle = (left, top, right - left, bottom - top)
        self._pygame.draw.rect(self._page, colour, rectangle, border_radius=round(corner * self._unit))

    def _dot(self, colour, x, y, radius) -> None:
        self._pygame.draw.circle(self._page, colour, (x * self._unit, y * self._unit), radius * self._unit)

    def _write(self, words, x, y, size, colour=INK, align=0.0) -> None:
        """Words centred on y; `align` is the share of their width that lies left of x."""
        if size not in self._fonts:
            self._fonts[size] = self._pygame.font.Font(_font(), round(size * self._unit))
        image = self._fonts[size].render(words, True, colour)
        width, height = image.get_size()
        self._page.blit(image, (round(x * self._unit - align * width), round(y * self._unit - 0.5 * height)))

    def _flash(self, speed, radius, x, y) -> None:
        size = radius * (0.5 + 1.5 * np.sqrt(min(speed, 2.0)))
        self._stamp(("flash", round(size * self._unit)), x, y)

    def _stamp(self, key: tuple[str, float], x, y) -> None:
        """Puts a ball or a flash of a radius [pixels of the page] there; each is made once."""
        if key not in self._sprites:
            kind, radius = key
            pixels = (ball if kind == "ball" else flash)(radius)
            self._sprites[key] = self._pygame.image.frombuffer(pixels.tobytes(), pixels.shape[1::-1], "RGBA")
        image = self._sprites[key]
        half = 0.5 * image.get_width()
        self._page.blit(image, (round(x * self._unit - half), round(y * self._unit - half)))


def _font() -> str:
    """The file of a typeface that has Greek letters, wherever the picture is drawn."""
    import matplotlib

    return str(Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"))


def _ticks(duration: float) -> np.ndarray:
    """Round times from 0 to the duration, at most ten steps."""
    magnitude = 10.0 ** np.floor(np.log10(duration / 10.0))
    step = next(step for step in magnitude * np.array([1.0, 2.0, 5.0, 10.0]) if duration <= 10.0 * step)
    return step * np.arange(int(duration / step + 1e-9) + 1)
