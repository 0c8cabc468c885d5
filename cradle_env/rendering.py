"""Pictures of a cradle: frames and a window by pygame, films, and drawings for terminals."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from gymnasium.error import DependencyNotInstalled

from cradle_env.cradle import Cradle
from cradle_env.errors import check_range
from cradle_env.kernel_records import records
from cradle_env.release import InitialState
from cradle_env.synchronization import FLOOR, newton_exponent
from cradle_env.trajectory import Trajectory

#: An impact shows for this long, fading [s].
FADE = 0.1
#: Steepest lift [rad] that a picture holds.
LIFT = 1.5

# The page is drawn this many times finer than the picture, and HEIGHT units high whatever the picture's size.
_FINER = 2
_HEIGHT = 600
_STAGE_TOP, _STAGE_BOTTOM, _MARGIN = 98, 382, 40
_LEGEND = 424
_STRIP_LEFT, _STRIP_TOP, _STRIP_BOTTOM = 76, 458, 560
_DECADES = -np.log10(FLOOR)

# Colours of Okabe & Ito, which every kind of colour vision tells apart, on paper and greys.
_BLUE, _SKY, _VERMILLION, _ORANGE, _YELLOW = (0, 114, 178), (86, 180, 233), (213, 94, 0), (230, 159, 0), (240, 228, 66)
_PAPER, _PALE, _RAIL, _GREY, _INK = (252, 252, 250), (226, 229, 233), (176, 183, 192), (104, 112, 122), (36, 41, 48)


@dataclass(frozen=True)
class Scene:
    """All that a picture of a cradle shows, SI; z points upwards from the pivots' height.

    time [s]; pivots, x, z (N,): x of the pivots, centres of the bobs [m]; radius [m] of a bob; load (N,): tension of
    the strings over that at rest, 0 where slack; contact (N − 1,): impact speed of each pair that has just met [m/s],
    0 for the others; sigma_times [s], sigma (M,): σ so far; newton_exponent: λ [1/s], nan while unknown; delta: δ,
    one number or one per gap; duration [s] of the whole, the axis of σ; extent: half width and depth below the pivots
    [m] that the picture holds. The last two stay the same from frame to frame, and so does the view.
    """

    time: float
    pivots: np.ndarray
    x: np.ndarray
    z: np.ndarray
    radius: float
    load: np.ndarray
    contact: np.ndarray
    sigma_times: np.ndarray
    sigma: np.ndarray
    newton_exponent: float
    delta: float | np.ndarray
    duration: float
    extent: tuple[float, float]
    title: str = ""

    def readings(self) -> dict[str, str]:
        """What is written beside the picture: values by symbol, a dash where there is none."""
        gaps = np.ravel(self.delta)
        ends = [f"{gap:+.4f}" if gap else "0" for gap in sorted({gaps.min(), gaps.max()})] if gaps.size else []
        sigma = self.sigma[-1] if len(self.sigma) else np.nan
        readings = {
            "δ": " … ".join(ends),
            "t": f"{self.time:.2f} s",
            "σ": f"{sigma:.3f}" if np.isfinite(sigma) else "",
            "λ": f"{self.newton_exponent:.3f} s⁻¹" if np.isfinite(self.newton_exponent) else "",
        }
        return {symbol: value.replace("-", "−") or "–" for symbol, value in readings.items()}


def extent(cradle: Cradle) -> tuple[float, float]:
    """Half width and depth below the pivots [m] that hold every bob, lifted by ±1.5 rad, its strings stretched."""
    # At the bottom of a swing from the horizontal strings carry three times the weight; for a moment, twice that.
    length = cradle.length * (1.0 + 6.0 * cradle.beta**2 * cradle.has("radial_elasticity"))
    reach = length * (1.0 if cradle.has("large_angle") else LIFT)
    return float(np.abs(cradle.pivots).max() + reach + cradle.radius), length + cradle.radius


def loads(run: Trajectory) -> np.ndarray:
    """Tension of the strings over that at rest, (T, N), with the memory they have of their loading; 1 if they are
    rigid."""
    if not run.cradle.has("radial_elasticity"):
        return np.ones_like(run.r)
    bobs = records(run.cradle)[1]
    unstretched = bobs["string"] + bobs["creep"] * np.log1p(run.t)[:, None]
    stretch = np.maximum(np.hypot(run.r, bobs["half_spacing"]) - unstretched, 0.0)
    line = bobs["kappa"] * stretch * bobs["grip"] / (bobs["mass"] * run.cradle.gravity)  # as at the first loading
    loads = line.copy()
    ratio = run.release.tension_ratio if isinstance(run.release, InitialState) else None
    if run.cradle.has("string_hysteresis"):
        loads[0] *= 1.0 if ratio is None else ratio
        for k in range(1, len(line)):
            # Loading adds what the line adds; unloading goes as the square of the stretch, and so of the line.
            share = np.divide(line[k], line[k - 1], out=np.zeros_like(line[k]), where=line[k - 1] > 0.0)
            rise = line[k] - line[k - 1]
            loads[k] = np.where(rise > 0.0, loads[k - 1] + rise, loads[k - 1] * share**2)
    return loads


def contact(impacts: np.ndarray, bobs: int, time: float, fade: float = FADE) -> np.ndarray:
    """Speed [m/s] of the impacts (see `IMPACT`) of each pair up to `time`, fading over `fade` [s]; shape (N − 1,)."""
    left = 1.0 - (time - impacts["time"]) / fade
    recent = (left > 0.0) & (left <= 1.0)
    speed = np.zeros(bobs - 1)
    np.maximum.at(speed, impacts["pair"][recent] - 1, impacts["speed"][recent] * left[recent])
    return speed


def scenes(run: Trajectory, fps: float = 30.0, speed: float = 1.0) -> Iterator[Scene]:
    """The scenes of a run for a film of `fps` frames a second, `speed` times as fast as life."""
    check_range("fps", fps, "1/s", 0.0, above=True)
    check_range("speed", speed, "", 0.0, above=True)
    cradle, t, sigma = run.cradle, run.t, run.sigma()
    times = np.arange(t[0], t[-1] + 1e-9, speed / fps)
    of_run = (run.x(), run.theta, run.r, loads(run))
    x, theta, r, tensions = (np.array([np.interp(times, t, bob) for bob in column.T]).T for column in of_run)
    z = -r * np.cos(theta) if cradle.has("large_angle") else -r
    held = extent(cradle)
    for k, time in enumerate(times):
        past = np.searchsorted(t, time, side="right")
        yield Scene(
            time=float(time),
            pivots=cradle.pivots,
            x=x[k],
            z=z[k],
            radius=cradle.radius,
            load=tensions[k],
            contact=contact(run.impacts, cradle.bobs, time, FADE * speed),
            sigma_times=t[:past],
            sigma=sigma[:past],
            newton_exponent=float(newton_exponent(t[:past], sigma[:past])),
            delta=cradle.gaps,
            duration=float(t[-1]),
            extent=held,
            title="Newton's cradle",
        )


class Canvas:
    """Draws scenes into pictures of `size` (width, height) [pixels] and, with `human`, into a window at `fps` [1/s].

    Raises DependencyNotInstalled where pygame is missing.
    """

    def __init__(self, size: tuple[int, int] = (800, 600), *, human: bool = False, fps: float = 30.0):
        self._pygame = pygame = _import_pygame()
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
        self._page.fill(_PAPER)
        self._write(scene.title, 24, 38, 20)
        scale, x, y = self._view(scene)
        half, depth = (scale * side for side in scene.extent)
        for side in (x - half - 12, x + half + 6):
            self._box(_PALE, side, y - 8, 6, depth + 24, 3)
        self._box(_PALE, x - half - 24, y + depth + 12, 2 * half + 48, 10, 5)
        self._box(_RAIL, x - half - 12, y - 8, 2 * half + 24, 8, 4)

        for i, (value, name) in enumerate(((0.0, "slack"), (1.0, "at rest"), (2.0, "twice"), (3.0, "3 ×"))):
            left = 88 + 76 * i
            colour, width = _string(value)
            self._line(colour, width, (left, _LEGEND), (left + 22, _LEGEND))
            self._write(name, left + 28, _LEGEND, 11, _GREY)
        self._write("strings", 24, _LEGEND, 11)
        right = self._width - 24
        self._write("impact", right - 340, _LEGEND, 11)
        for i, speed in enumerate((0.1, 1.0)):
            self._flash(speed, 8, right - 284 + 76 * i, _LEGEND)
            self._write(f"{speed:g} m/s", right - 272 + 83 * i, _LEGEND, 11, _GREY)
        self._write("pivots", right - 138, _LEGEND, 11)
        for colour, name, left in ((_BLUE, "spread", right - 94), (_VERMILLION, "pressed", right - 46)):
            self._write(name, left + 1, _LEGEND, 11, colour)

        top, bottom, left = _STRIP_TOP, _STRIP_BOTTOM, _STRIP_LEFT
        for decade in range(round(_DECADES) + 1):
            height = top + (bottom - top) * decade / _DECADES
            self._line(_PALE, 1, (left, height), (right, height))
            self._write(f"{10.0**-decade:g}", left - 8, height, 11, _GREY, align=1.0)
        for time in _ticks(scene.duration):
            along = left + (right - left) * time / scene.duration
            self._line(_PALE, 1, (along, top), (along, bottom + 4))
            self._write(f"{time:g}", along, bottom + 14, 11, _GREY, align=0.5)
        self._write("σ", 24, 0.5 * (top + bottom), 14)
        self._write("time [s]", 0.5 * (left + right), bottom + 29, 11, _GREY, align=0.5)
        self._write("σ(t)", right - 70, top + 11, 11, _BLUE, align=1.0)
        self._write("exp(−λt)", right - 6, top + 11, 11, _VERMILLION, align=1.0)

    def _paint_readings(self, scene: Scene) -> None:
        for i, (symbol, value) in enumerate(scene.readings().items()):
            right = self._width - 24 - 92 * (3 - i)
            self._write(symbol, right, 28, 12, _GREY, align=1.0)
            self._write(value, right, 48, 16, align=1.0)

    def _paint_cradle(self, scene: Scene) -> None:
        scale, x0, y0 = self._view(scene)
        pivots, x, y = x0 + scale * scene.pivots, x0 + scale * scene.x, y0 - scale * scene.z
        radius = scale * scene.radius
        for pivot in pivots:
            self._box(_GREY, pivot - radius, y0 - 10, 2 * radius, 12, min(3.0, radius))
        for left, right in itertools.pairwise(pivots):
            gap = right - left - 2 * radius
            if abs(gap) > 1e-6 * radius:
                mark = max(abs(gap), 1.5)
                self._box(_BLUE if gap > 0 else _VERMILLION, 0.5 * (left + right - mark), y0 - 14, mark, 20, 0)
        for i, tension in enumerate(scene.load):
            colour, width = _string(tension)
            self._line(colour, width, (pivots[i], y0), (x[i], y[i]))
            self._dot(_PAPER, pivots[i], y0 - 4, 1.6)
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
                self._line(_VERMILLION, 1.5, start, stop)
        known = np.isfinite(scene.sigma)
        if np.count_nonzero(known) > 1:
            times, sigma = scene.sigma_times[known], scene.sigma[known]
            columns = np.linspace(times[0], times[-1], 2 + int(wide * (times[-1] - times[0])))
            curve = points(columns, -np.log10(np.maximum(np.interp(columns, times, sigma), FLOOR)))
            width = round(1.75 * self._unit)
            self._pygame.draw.lines(self._page, _BLUE, False, (self._unit * curve).tolist(), width)
            x, y = curve[-1]
            self._dot(_BLUE, x, y, 3.5)

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

    def _write(self, words, x, y, size, colour=_INK, align=0.0) -> None:
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
            pixels = (_ball if kind == "ball" else _burst)(radius)
            self._sprites[key] = self._pygame.image.frombuffer(pixels.tobytes(), pixels.shape[1::-1], "RGBA")
        image = self._sprites[key]
        half = 0.5 * image.get_width()
        self._page.blit(image, (round(x * self._unit - half), round(y * self._unit - half)))


def text(scene: Scene, width: int = 72) -> str:
    """A drawing for terminals, `width` columns wide: rail, strings, bobs, and a line of readings."""
    half, depth = scene.extent
    across = min(0.5 * (width - 1) / half, 22.0 / depth)  # columns per metre; a row is two columns high
    rows = [[" "] * width for _ in range(round(0.5 * across * depth) + 1)]

    def column(x):
        return min(max(round(0.5 * (width - 1) + across * x), 0), width - 1)

    bobs = []
    for pivot, x, z, tension in zip(scene.pivots, scene.x, scene.z, scene.load, strict=True):
        bottom = min(max(round(-0.5 * across * z), 1), len(rows) - 1)
        lean = across * (x - pivot) / bottom
        stroke = ":" if tension == 0.0 else "|" if abs(lean) < 0.5 else "\\" if lean > 0.0 else "/"
        for row in range(1, bottom):
            rows[row][column(pivot + (x - pivot) * row / bottom)] = stroke
        bobs.append((bottom, column(x)))
    for row, at in bobs:
        rows[row][at] = "●"
    left, right = (column(end) for end in (scene.pivots[0] - 0.2 * depth, scene.pivots[-1] + 0.2 * depth))
    rows[0][left : right + 1] = "─" * (right + 1 - left)
    for pivot in scene.pivots:
        rows[0][column(pivot)] = "┬"
    drawing = ["".join(row).rstrip() for row in rows]
    return "\n".join([*drawing, "   ".join(f"{symbol} = {value}" for symbol, value in scene.readings().items())])


def save_animation(frames: Iterable[np.ndarray], path: str | Path, fps: float = 30.0) -> None:
    """Writes frames (H, W, 3) uint8 as a film, .gif or .mp4, of `fps` frames a second; whole or not at all.

    Raises ValueError for other endings, DependencyNotInstalled for .mp4 where moviepy is missing.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in _WRITERS:
        raise ValueError(f"{path.name} is no film that can be written; it must end in {' or '.join(_WRITERS)}")
    # Theirs count hundredths of a second in two bytes, and are shown for 2 at least.
    check_range("fps", fps, "1/s", *((1.0 / 655.0, 50.0) if ending == ".gif" else (1e-3, np.inf)))
    part = path.with_name(f"{path.stem}.part{ending}")
    try:
        _WRITERS[ending](iter(frames), part, fps)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _write_gif(frames: Iterator[np.ndarray], path: Path, fps: float) -> None:
    from PIL import Image

    # One palette for all frames, from those of the first second: with palettes of their own, what rests would flicker.
    first = list(itertools.islice(frames, max(round(fps), 1)))
    if not first:
        raise ValueError("there are no frames to make a film of")
    palette = Image.fromarray(np.concatenate(first[::5])).quantize(255, dither=Image.Dither.NONE)

    def images():
        for k, frame in enumerate(itertools.chain(first, frames)):
            image = Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
            # GIF counts hundredths of a second: the frames' ends are rounded, so that the film as a whole is not.
            image.info["duration"] = 10 * (round(100 * (k + 1) / fps) - round(100 * k / fps))
            yield image

    film = images()
    next(film).save(path, save_all=True, append_images=film, loop=0)


def _write_mp4(frames: Iterator[np.ndarray], path: Path, fps: float) -> None:
    try:
        from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter
    except ImportError as error:
        raise _missing("moviepy") from error
    first = next(frames, None)
    if first is None:
        raise ValueError("there are no frames to make a film of")
    with FFMPEG_VideoWriter(str(path), first.shape[1::-1], fps) as film:
        for frame in itertools.chain([first], frames):
            film.write_frame(frame)


_WRITERS = {".gif": _write_gif, ".mp4": _write_mp4}


def _missing(package: str) -> DependencyNotInstalled:
    return DependencyNotInstalled(f"{package} is not installed; run `pip install 'newtons-cradle[render]'`")


def _import_pygame():
    """pygame with its fonts ready, and without the environment variables that it sets.

    It prints no greeting: Gymnasium has seen to that.
    """
    before = set(os.environ)
    try:
        import pygame
    except ImportError as error:
        raise _missing("pygame-ce") from error
    finally:
        for name in set(os.environ) - before:
            del os.environ[name]
    pygame.font.init()
    return pygame


def _font() -> str:
    """The file of a typeface that has Greek letters, wherever the picture is drawn."""
    import matplotlib

    return str(Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"))


def _string(tension: float) -> tuple[tuple[int, ...], float]:
    """Colour and width of strings that carry `tension`, over that at rest."""
    shades = np.array([_SKY, _GREY, _ORANGE, _VERMILLION]).T
    return tuple(int(np.interp(tension, [0.0, 1.0, 2.0, 3.0], shade)) for shade in shades), min(1.0 + tension, 4.0)


def _ticks(duration: float) -> np.ndarray:
    """Round times from 0 to the duration, at most ten steps."""
    magnitude = 10.0 ** np.floor(np.log10(duration / 10.0))
    step = next(step for step in magnitude * np.array([1.0, 2.0, 5.0, 10.0]) if duration <= 10.0 * step)
    return step * np.arange(int(duration / step + 1e-9) + 1)


def _grid(radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, y over the radius, and the distance [pixels] from the middle, of a square that holds a disc."""
    half = int(np.ceil(radius)) + 1
    y, x = np.mgrid[-half:half, -half:half] + 0.5
    return x / radius, y / radius, np.hypot(x, y)


def _rgba(colour: np.ndarray, opacity: np.ndarray) -> np.ndarray:
    return np.dstack([np.clip(colour, 0, 255), 255 * np.clip(opacity, 0, 1)]).round().astype(np.uint8)


def _ball(radius: float) -> np.ndarray:
    """A steel ball lit from the upper left, (H, W, 4) uint8."""
    x, y, distance = _grid(radius)
    depth = np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))
    lit = np.maximum(-0.45 * x - 0.60 * y + 0.66 * depth, 0.0)
    bounced = 0.22 * np.maximum(y, 0.0) ** 3
    tone = 0.16 + 0.72 * lit**1.2 + bounced
    glint = np.maximum(-0.25 * x - 0.36 * y + 0.90 * depth, 0.0) ** 60
    steel = np.array([48, 56, 68]) + tone[..., None] * np.array([184, 182, 178]) + 90 * glint[..., None]
    return _rgba(steel, radius - distance + 0.5)


def _burst(radius: float) -> np.ndarray:
    """A flash, white in the middle and orange outside, with eight rays, (H, W, 4) uint8."""
    x, y, distance = _grid(radius)
    far = np.clip(distance / radius, 0.0, 1.0)
    rays = np.cos(4.0 * np.arctan2(y, x)) ** 8
    opacity = np.maximum(np.exp(-((far / 0.4) ** 2)), (0.3 + 0.7 * rays) * (1.0 - far) ** 0.6)
    shades = zip((255, 255, 255), _YELLOW, _ORANGE, _VERMILLION, strict=True)
    return _rgba(np.dstack([np.interp(far, [0.0, 0.2, 0.4, 1.0], shade) for shade in shades]), opacity)
