"""The page to explore a sweep: what is in it, and what it does in a browser."""

import base64
import json
import re

import numpy as np
import pytest

from cradle_env import Cradle, Release, simulate
from identification.sweep import Grid
from identification.sweep.explore import AXES, LARGEST, check_size, explore_html
from tests.browser import CHROMIUM, Page

BETAS, DELTAS = (0.1, 0.114, 0.2), (-0.01, 0.0)
RELEASE = Release(angle=0.228)


@pytest.fixture(scope="module")
def page() -> str:
    """Two bobs at three β and two δ, and a release too high for strings."""
    grid = Grid({"beta": BETAS, "delta": DELTAS, "release_angle": [0.228, 1.6]}, Cradle(bobs=2), RELEASE)
    return explore_html(grid, duration=6.0)


@pytest.fixture
def browser(page, tmp_path):
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed")
    file = tmp_path / "explore.html"
    file.write_text(page, encoding="utf-8")
    with Page(file, tmp_path / "profile") as opened:
        yield opened
        assert not opened.told("Runtime.exceptionThrown")
        assert not [event for event in opened.told("Log.entryAdded") if event["entry"]["level"] == "error"]


def test_the_page_holds_the_angles_of_single_runs(page):
    content = json.loads(re.search(r'<script type="application/json" id="content">(.*?)</script>', page)[1])
    assert [axis["values"] for axis in content["axes"]] == [["0.1", "0.114", "0.2"], ["−0.01", "0"], ["0.228", "1.6"]]
    for k, run in enumerate(content["runs"]):
        beta, delta, possible = BETAS[k // 4], DELTAS[k // 2 % 2], k % 2 == 0
        assert bool(run["theta"]) is possible is not bool(run["problem"])
        if possible:
            true = simulate(Cradle.from_groups(bobs=2, beta=beta, delta=delta), RELEASE, 6.0)
            theta = np.frombuffer(base64.b64decode(run["theta"]), "<i2").reshape(-1, 2) * content["thetaScale"]
            # Rounded to whole steps of 0.228 rad/32767.
            np.testing.assert_allclose(theta, true.theta[::8], atol=0.51 * 0.24 / 32767)
            assert run["lambda"] == true.newton_exponent()


def test_a_bob_that_no_run_has_is_no_matter():
    """200 bobs at most: there are no runs of 201, nor their angles."""
    page = explore_html(Grid({"bobs": [2, 201]}, Cradle(bobs=2), RELEASE), duration=3.0)
    content = json.loads(re.search(r'<script type="application/json" id="content">(.*?)</script>', page)[1])
    assert content["thetaLargest"] == pytest.approx(RELEASE.angle, rel=0.01)


def test_the_page_of_the_defaults_is_not_too_large_and_a_larger_one_is_refused():
    check_size(Grid(AXES, Cradle(), RELEASE), 60.0)
    with pytest.raises(ValueError, match="at most 416 such runs"):
        check_size(Grid({"beta": np.linspace(0.1, 0.2, 417)}, Cradle(), RELEASE), 60.0)
    assert 416 * 5 * 60 * 30 * 8 / 3 < LARGEST < 417 * 5 * 60 * 30 * 8 / 3


DRAWN = """(id => { const canvas = document.getElementById(id);
  return Array.from(canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data); })("%s")"""


def drawn(browser: Page, name: str) -> np.ndarray:
    return np.array(browser.evaluate(DRAWN % name))


def text(browser: Page, name: str) -> str:
    return browser.evaluate(f'document.getElementById("{name}").textContent')


def test_sliders_go_from_one_simulated_run_to_the_next_by_keyboard(browser):
    rate = simulate(Cradle(bobs=2), RELEASE, 6.0).newton_exponent()
    assert text(browser, "result").startswith("β = 0.114, δ = 0, θ0 = 0.228: λ = ")
    assert float(text(browser, "result").split()[-2]) == pytest.approx(rate, rel=5e-3)  # three digits
    before = drawn(browser, "sigma")
    browser.evaluate('document.getElementById("axis-0").focus()')
    browser.press("ArrowRight", 39)
    rate = simulate(Cradle.from_groups(bobs=2, beta=0.2), RELEASE, 6.0).newton_exponent()
    assert text(browser, "result").startswith("β = 0.2, δ = 0, ")
    assert text(browser, "axis-0-told") == "0.2 (value 3 of 3)"
    assert browser.evaluate('document.activeElement.getAttribute("aria-valuetext")') == "β = 0.2, value 3 of 3"
    assert float(text(browser, "result").split()[-2]) == pytest.approx(rate, rel=5e-3)
    assert np.any(drawn(browser, "sigma") != before)
    for _ in range(3):
        browser.press("ArrowLeft", 37)
    assert text(browser, "axis-0-told") == "0.1 (value 1 of 3)"
    browser.evaluate('document.getElementById("axis-2").focus()')
    browser.press("ArrowRight", 39)
    assert "cannot be simulated: release angle is" in text(browser, "result")


def test_it_plays_and_pauses_and_the_bobs_are_where_the_simulation_has_them(browser):
    started = drawn(browser, "cradle")
    browser.press(" ", 32)
    assert text(browser, "play") == "Pause"
    browser.evaluate("new Promise(done => { const look = () => time < 0.2 ? setTimeout(look, 20) : done(); look(); })")
    browser.press(" ", 32)
    assert text(browser, "play") == "Play"
    paused = text(browser, "time-told")
    browser.evaluate("new Promise(done => setTimeout(done, 200))")
    assert text(browser, "time-told") == paused
    assert np.any(drawn(browser, "cradle") != started)
    browser.evaluate('at("time").value = 2.0; at("time").dispatchEvent(new Event("input"))')
    true = simulate(Cradle(bobs=2), RELEASE, 2.0).theta[-1]
    np.testing.assert_allclose(browser.evaluate("[angle(0), angle(1)]"), true, atol=1e-4)
    # Between two pictures it is a straight line, off by at most ω² θ dt²/8 = 1 mrad before the first impact.
    browser.evaluate('at("time").value = 0.05; at("time").dispatchEvent(new Event("input"))')
    true = simulate(Cradle(bobs=2), RELEASE, 0.05).theta[-1]
    np.testing.assert_allclose(browser.evaluate("[angle(0), angle(1)]"), true, atol=1.1e-3)
    browser.evaluate('at("time").value = 5.9; at("time").dispatchEvent(new Event("input")); at("play").click()')
    browser.evaluate("new Promise(done => { const look = () => playing ? setTimeout(look, 20) : done(); look(); })")
    assert text(browser, "play") == "Play" and text(browser, "time-told") == "6.00 s of 6 s"


@pytest.mark.parametrize("width", [320, 1100])
def test_it_fits_the_screen_and_asks_for_nothing(browser, width):
    browser.size(width, 800)
    browser.evaluate("new Promise(done => setTimeout(done, 200))")
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    for name in ("cradle", "sigma"):
        assert np.count_nonzero(drawn(browser, name)) > 1000
        assert browser.evaluate(f'at("{name}").clientWidth') > (250 if width == 320 else 400)
    requests = {event["request"]["url"].split(":")[0] for event in browser.told("Network.requestWillBeSent")}
    assert requests == {"file"}
