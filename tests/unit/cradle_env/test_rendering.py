"""Pictures show what the scenes say; films and drawings for terminals are whole."""

import dataclasses
import gc
import os
import subprocess
import sys

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled
from PIL import Image

from cradle_env import Cradle, InitialState, Release, simulate
from cradle_env.rendering import Canvas, Scene, contact, extent, loads, save_animation, scenes, text
from cradle_env.trajectory import IMPACT
from tests.paths import ROOT


def scene(cradle: Cradle, theta=0.0, **changes) -> Scene:
    """Bobs at the angles theta [rad], strings slack, and nothing known of σ."""
    theta = np.broadcast_to(theta, cradle.bobs)
    made = Scene(
        time=1.25,
        pivots=cradle.pivots,
        x=cradle.pivots + cradle.length * np.sin(theta),
        z=-cradle.length * np.cos(theta),
        radius=cradle.radius,
        load=np.zeros(cradle.bobs),
        contact=np.zeros(cradle.bobs - 1),
        sigma_times=np.empty(0),
        sigma=np.empty(0),
        newton_exponent=np.nan,
        delta=cradle.delta,
        duration=10.0,
        extent=extent(cradle),
    )
    return dataclasses.replace(made, **changes)


def steel(picture: np.ndarray) -> np.ndarray:
    """Where a picture has the colour of bobs, below the rail and above the legend: (row, column) of each pixel."""
    red, blue = picture[..., 0].astype(int), picture[..., 2].astype(int)
    mask = (blue - red > 8) & (blue - red < 30) & (red < 215)
    rows, columns = np.nonzero(mask)
    rail = np.flatnonzero(mask.sum(axis=1) > 40)[0] + 20
    stage = (rows > rail) & (rows < 390)
    return np.column_stack([rows[stage], columns[stage]])


@pytest.fixture(scope="module")
def run():
    return simulate(Cradle(bobs=3), Release(angle=0.4), duration=3.0)


def test_the_same_scene_gives_the_same_picture(run):
    shown = list(scenes(run, fps=4))
    assert len(shown) == 13
    canvas = Canvas()
    pictures = [canvas.draw(s) for s in shown]
    assert pictures[0].shape == (600, 800, 3)
    assert pictures[0].dtype == np.uint8
    assert not np.array_equal(pictures[3], pictures[4])
    np.testing.assert_array_equal(canvas.draw(shown[3]), pictures[3])
    np.testing.assert_array_equal(Canvas().draw(shown[3]), pictures[3])
    assert Canvas(size=(400, 240)).draw(shown[3]).shape == (240, 400, 3)


def test_a_bob_is_drawn_where_the_scene_says():
    cradle, canvas = Cradle(bobs=1), Canvas()
    at_rest = steel(canvas.draw(scene(cradle)))
    scale = (np.ptp(at_rest, axis=0).max() + 1) / (2.0 * cradle.radius)
    middle = at_rest.mean(axis=0)
    assert middle[1] == pytest.approx(400, abs=1.0)
    for theta in (-0.7, 0.2, 0.7):
        moved = steel(canvas.draw(scene(cradle, theta))).mean(axis=0) - middle
        expected = cradle.length * scale * np.array([np.cos(theta) - 1.0, np.sin(theta)])
        assert moved == pytest.approx(expected, rel=0.02, abs=1.0)


@pytest.mark.parametrize("bobs", [1, 2, 5, 50])
@pytest.mark.parametrize("length", [0.1, 0.3, 5.0])
def test_lifted_bobs_stay_inside(bobs, length):
    cradle, canvas = Cradle(bobs=bobs, length=length), Canvas()
    paper = canvas.draw(scene(cradle))[0, 0]
    for lift in (-1.5, 1.5):
        theta = np.zeros(bobs)
        theta[0 if lift < 0.0 else -1] = lift
        picture = canvas.draw(scene(cradle, theta))
        rim = np.concatenate([picture[:4].reshape(-1, 3), *(picture[:390, side] for side in (0, 1, -1, -2))])
        np.testing.assert_array_equal(rim, np.broadcast_to(paper, rim.shape))


def test_the_view_holds_the_hardest_swing():
    cradle = Cradle(bobs=2)
    run = simulate(cradle, Release(angle=1.5), duration=3.0)
    half, depth = extent(cradle)
    assert np.abs(run.x()).max() + cradle.radius < half
    assert (run.r * np.cos(run.theta)).max() + cradle.radius < depth


def test_impacts_and_tensions_show():
    cradle, canvas = Cradle(bobs=2), Canvas()
    plain = canvas.draw(scene(cradle)).astype(int)

    def changed(**changes):
        return int(np.any(canvas.draw(scene(cradle, **changes)) != plain, axis=-1).sum())

    assert 0 < changed(contact=np.array([0.1])) < changed(contact=np.array([1.0]))
    assert 0 < changed(load=np.array([1.0, 0.0])) < changed(load=np.array([3.0, 3.0]))


def test_pressed_and_spread_pivots_look_different():
    canvas, held = Canvas(), extent(Cradle(bobs=3))
    pictures = [canvas.draw(scene(Cradle(bobs=3, delta=d), delta=0.0, extent=held)) for d in (-1e-4, 0.0, 1e-4)]
    pressed, touching, spread = (picture.astype(int) for picture in pictures)
    assert (pressed - touching)[..., 0].max() > 40  # redder
    assert (spread - touching)[..., 2].max() > 20  # bluer


def test_tension_at_rest_is_one_on_first_loading_and_after_many(run):
    cradle, hanging = run.cradle, Release(angles={1: 0.0}, start="hanging")
    np.testing.assert_allclose(loads(simulate(cradle, hanging, 0.1))[0], 1.0, rtol=1e-6)
    assert loads(run)[0, -1] == 0.0  # lifted unstretched
    np.testing.assert_array_equal(loads(simulate(Cradle(model="pendulum"), hanging, 0.1)), 1.0)
    uneven = {"length_mismatch": {"relative": [0.01, 0.0, -0.02]}, "mass_mismatch": {"relative": [0.3, 0.0, -0.3]},
              "string_creep": {"rate": 1e-3}}  # fmt: skip
    resting = simulate(Cradle(bobs=3, delta=0.05, effects=uneven), hanging, 1.0)
    np.testing.assert_allclose(loads(resting), 1.0, rtol=0.05)  # strings that creep let their bobs fall a little
    spent = simulate(Cradle(bobs=1), InitialState(np.zeros(1), np.zeros(1), tension_ratio=np.full(1, 0.5)), 0.1)
    assert loads(spent)[0] == pytest.approx(0.5)
    # The strings stay stretched by what they were loaded with, but in the mean they carry the weight.
    late = np.array([s.load for s in scenes(simulate(cradle, Release(angle=0.2), duration=10.0))])[-60:]
    np.testing.assert_allclose(late.mean(axis=0), 1.0, atol=0.03)


def test_an_impact_fades():
    impacts = np.array([(1.0, 1, 0.5, 0.0), (1.02, 1, 0.1, 0.0), (1.06, 2, 0.2, 0.0)], IMPACT)
    assert contact(impacts, 3, 0.99).tolist() == [0.0, 0.0]
    np.testing.assert_allclose(contact(impacts, 3, 1.05), [0.25, 0.0])
    np.testing.assert_allclose(contact(impacts, 3, 1.06), [0.2, 0.2])
    assert contact(impacts, 3, 2.0).tolist() == [0.0, 0.0]


def test_a_gif_has_all_frames_and_its_time(run, tmp_path):
    canvas, path = Canvas(size=(320, 240)), tmp_path / "run.gif"
    save_animation((canvas.draw(s) for s in scenes(run)), path, 30)
    with Image.open(path) as film:
        durations = [film.seek(k) or film.info["duration"] for k in range(film.n_frames)]
    assert len(durations) == 91
    assert sum(durations) == pytest.approx(91000 / 30, abs=6.0)
    assert os.listdir(tmp_path) == ["run.gif"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # moviepy's reader leaves a pipe open
def test_an_mp4_has_all_frames_and_its_time(run, tmp_path):
    from moviepy import VideoFileClip

    canvas, path = Canvas(size=(320, 240)), tmp_path / "run.mp4"
    frames = [canvas.draw(s) for s in scenes(run, fps=10)]
    save_animation(frames, path, 10)
    with VideoFileClip(str(path)) as film:
        assert film.duration == pytest.approx(3.1)
        read = list(film.iter_frames())
    assert len(read) == len(frames) == 31
    assert np.abs(read[7].astype(int) - frames[7]).mean() < 3.0
    assert os.listdir(tmp_path) == ["run.mp4"]
    del film
    gc.collect()  # the warning comes here, not in a later test


@pytest.mark.parametrize("ending", ["gif", "mp4"])
def test_a_film_that_fails_leaves_nothing_behind(tmp_path, ending):
    def frames():
        yield np.zeros((16, 16, 3), np.uint8)
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        save_animation(frames(), tmp_path / f"film.{ending}", 1)
    with pytest.raises(ValueError, match="no frames"):
        save_animation([], tmp_path / f"film.{ending}", 1)
    assert os.listdir(tmp_path) == []


def test_other_films_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"film\.avi .* must end in \.gif or \.mp4"):
        save_animation([], tmp_path / "film.avi", 10)
    with pytest.raises(ValueError, match=r"fps is 60 1/s; it must be .* at most 50"):
        save_animation([], tmp_path / "film.gif", 60)


@pytest.mark.parametrize("bobs", [1, 2, 5, 50])
def test_a_drawing_has_all_bobs(bobs):
    drawing = text(scene(Cradle(bobs=bobs)))
    assert drawing.count("●") == bobs
    assert max(map(len, drawing.splitlines())) <= 72
    assert "t = 1.25 s" in drawing


def test_a_drawing_tells_what_is_known(run):
    *_, last = scenes(run)
    *_, readings = text(last).splitlines()
    assert f"σ = {run.sigma()[-1]:.3f}" in readings
    assert f"λ = {run.newton_exponent():.3f} s⁻¹" in readings
    assert "δ = −0.0100 … +0.0200" in text(scene(Cradle(bobs=3, delta=(-0.01, 0.02))))
    assert "λ = –" in text(scene(Cradle()))


@pytest.mark.parametrize("missing, action", [("pygame", Canvas), ("moviepy.video.io.ffmpeg_writer", None)])
def test_a_missing_package_is_named_with_its_extra(missing, action, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(DependencyNotInstalled, match=r"pip install 'newtons-cradle\[render\]'"):
        (action or (lambda: save_animation([], tmp_path / "film.mp4", 10)))()


def test_a_picture_needs_no_display_and_leaves_no_trace():
    code = """
import os
from tests.unit.cradle_env.test_rendering import Canvas, Cradle, scene
before = dict(os.environ)
Canvas().draw(scene(Cradle()))
import pygame
assert not pygame.display.get_init()
assert dict(os.environ) == before, set(os.environ) ^ set(before)
"""
    variables = {k: v for k, v in os.environ.items() if not k.startswith(("SDL_", "PYGAME_", "WAYLAND_"))}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        capture_output=True,
        text=True,
        env={**variables, "DISPLAY": ":none"},
        cwd=ROOT,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_window_shows_the_picture_and_closes(monkeypatch):
    import pygame

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    canvas, shown = Canvas(human=True, fps=200), scene(Cradle(), 0.2)
    canvas.show(shown)
    seen = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    np.testing.assert_array_equal(seen, canvas.draw(shown))
    canvas.close()
    canvas.close()
    assert not pygame.display.get_init()
    with pytest.raises(ValueError, match="no window"):
        canvas.show(shown)
