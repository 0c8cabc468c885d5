"""The study of films: its page is of what is kept, and its judge tells a wrong track from a right one."""

import numpy as np
import pytest

from cradle_env import Cradle
from identification.apparatus.video.tracking import Tracks
from studies.film import calibrations
from studies.film.__main__ import HERE, KEPT
from studies.film.draw import LONGEST, draw
from studies.film.judge import impact_errors
from studies.film.made import Case, Truth
from studies.film.page import page, share
from studies.kept_rows import read_rows


def test_the_page_is_of_what_is_kept() -> None:
    rows = read_rows(KEPT)
    assert (HERE / "results.md").read_text(encoding="utf-8") == page(rows)
    assert len({row["film"] for row in rows}) == len(rows)


def test_the_page_of_calibrations_is_of_what_is_kept() -> None:
    rows = read_rows(calibrations.ROWS)
    assert calibrations.PAGE.read_text(encoding="utf-8") == calibrations.page(rows)
    assert len({(row["film"], row["code"]) for row in rows}) == len(rows)


def test_calibrations_count_what_intervals_hold() -> None:
    found = {"median": 2.0, "sd": 0.5, "ci95": [1.0, 3.0]}
    of = {"bobs": 1, "rate": 60.0, "codec": "mjpeg", "code": "new"}
    before = {"film": 0, **of, "code": "old", "truth": {"b": 2.0}, "found": {"b": found}}
    rows = [{"film": k, **of, "truth": {"b": b}, "found": {"b": found}} for k, b in enumerate((2.5, 3.5))]
    told = calibrations.page([before, *rows, {"film": 9, **of, "truth": {"b": 1.0}, "refused": "film.mp4: too short"}])
    assert "| b | 1 of 2, 50 % (1.3 to 98.7 %) | 2.24 | 0.17 |" in told  # errors of 1 and 3 sd
    assert "| old | 1 | – | – | 1 of 1, 100 % (2.5 to 100 %) |" in told
    assert "| new | 1 | – | – | 1 of 2, 50 % (1.3 to 98.7 %) |" in told
    assert "Refused: 1 of 3." in told and "| 0 | 1 | 60 | mjpeg | – | – | -1.0 |" in told


def test_a_film_is_drawn_by_its_number() -> None:
    case, name = draw(7, 600)
    assert draw(7, 600) == (case, name) and draw(8, 600) != (case, name)
    assert case.duration <= LONGEST and case.duration * case.camera.rate <= 600.0 + 1e-9


def test_shares_have_the_interval_of_clopper_and_pearson() -> None:
    # Rule of three: none of 100 allows up to 1 - 0.025^(1/100) = 3.6 %.
    assert share(0, 100) == "0 of 100, 0 % (0 to 3.62 %)"


@pytest.mark.parametrize("late", [0.0, 0.3])
def test_a_track_that_is_late_has_late_impacts(late: float) -> None:
    """A bob that swings into its neighbour at 0.5025 s and back; the track is late by some frames."""
    case = Case(2, {2: 0.2}, 1.0)
    times, instant, omega = np.arange(60) / 60.0, 0.5025, np.sqrt(9.81 / 0.306)
    x = 100.0 + 60.0 * np.abs(np.sin(omega * (times - instant - late / 60.0)))
    places = np.stack([np.column_stack([np.full(60, 60.0), np.zeros(60)]), np.column_stack([x, np.zeros(60)])], axis=1)
    truth = Truth(times, places, np.zeros((60, 2)), np.array([[instant, 1.0]]), Cradle(bobs=2))
    errors = impact_errors(case, truth, Tracks(times, places, np.zeros((60, 2)), np.full((60, 2), 16.0)))
    assert errors == [pytest.approx(late, abs=1e-3)]
