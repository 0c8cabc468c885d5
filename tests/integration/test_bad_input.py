"""Measured runs with something wrong in them: each gets a clear error, a warning, or a verdict that holds all the same.

All are written by the soft-contact reference, and spoilt as instruments and experimenters do.
"""

import dataclasses
import json
import math
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from identification import Experiment, calibrate
from identification.cli.app import main
from identification.diagnosis import workflow
from identification.diagnosis.data_checks.instrument_faults import check_instrument_faults
from identification.diagnosis.data_checks.readings import check_readings
from identification.diagnosis.data_checks.run_consistency import check_run_consistency
from identification.diagnosis.selection.examined_model import examine
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.searcher import Searcher
from identification.inference.fit_result import FitResult, with_known_noise
from identification.inference.likelihood import Likelihood
from identification.reporting import terminal
from identification.storage.schema import check_schema
from studies.diagnosis.study import fit_near
from tests.paths import DATA as SHARED
from tests.reference.laboratory import Recording, drop_frames, lose_track, record, tracking_jump, write_experiment
from tests.reference.soft_contact import SoftCradle
from tests.synthetic import leave_candidates

TRUTH = {"k_f": 18000.0, "kappa": 190.0, "b": 0.002}
STATED = {"k_f": 17000.0, "kappa": 187.0, "b": 0.0023}
#: Real and reference data, where they are at hand.


def filmed(hidden=None, bobs=2, angle=0.228, **film) -> Recording:
    """A cradle with something hidden, contacts too short to matter."""
    cradle = SoftCradle(bobs, stiffness_factor=1e4, effects=hidden or {}, **TRUTH)
    return record(cradle, {bobs: angle}, **{"duration": 16.0, "seed": 4} | film)


@pytest.fixture(scope="module")
def good():
    return filmed()


def refusal(folder, recording, capsys, **entries) -> str:
    """The one line with which `cradle diagnose` refuses a recording."""
    path = write_experiment(folder, [recording], stated=STATED, **entries)
    with mock.patch.object(terminal, "_REPORT_INTERVAL", math.inf):  # progress is told on slow machines only
        assert main(["diagnose", str(path), "--out", str(folder / "out"), "--workers", "1"]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    return message


def slips(folder, recording, **entries) -> str:
    """What is said of the slips in a recording, nothing if none is found. The fit begins at the truth, for how its mode
    is found does not matter here."""
    experiment = with_known_noise(Experiment.load(write_experiment(folder, [recording], stated=STATED, **entries)))
    searcher = Searcher(FitCache(None, ""), 0, 1)
    try:
        check_instrument_faults(searcher.fit_all_data(fit_near(searcher, experiment, TRUTH)))
    except ValueError as problem:
        return str(problem)
    return ""


@pytest.mark.parametrize(
    "duration, words", [pytest.param(0.4, "50 or more", marks=pytest.mark.slow), (1.6, "record for longer")]
)
def test_too_few_data(tmp_path, capsys, duration, words):
    message = refusal(tmp_path, filmed(duration=duration), capsys)
    assert "too few" in message and words in message


def test_too_sparse_readings(tmp_path, capsys):
    assert "give 6 or more in each" in refusal(tmp_path, filmed(rate=5.0), capsys)


def test_readings_too_sparse_for_a_map_are_diagnosed_all_the_same(tmp_path, capsys):
    """Ten per second: the checks ask for six in a swing, a window for fourteen."""
    path = write_experiment(tmp_path, [filmed(bobs=1, rate=10.0, duration=24.0)], stated=STATED)
    assert main(["diagnose", str(path), "--out", str(tmp_path / "out"), "--workers", "1"]) == 0
    assert "nothing_missing" in capsys.readouterr().out
    assert "too few readings per swing for tests by window" in (tmp_path / "out" / "report.html").read_text(
        encoding="utf-8"
    )


def test_a_bob_that_is_seen_once_shows_no_frequency(tmp_path, good):
    readings = good.readings.copy()
    readings[np.arange(len(readings)) != 100, 0] = np.nan
    recording = dataclasses.replace(good, readings=readings)
    likelihood = Likelihood(Experiment.load(write_experiment(tmp_path, [recording], stated=STATED)), None, 1)
    tests = examine(FitResult(likelihood, likelihood.start()), 0, (False,)).residual_scan.tests
    assert {test.bob for test in tests if test.phase == "line"} == {-1, 1}


def relabelled(path: Path, old: str, new: str) -> Experiment:
    """The experiment, another unit written over its data."""
    data = path.parent / "run1.csv"
    data.write_text(data.read_text(encoding="utf-8").replace(f"[{old}]", f"[{new}]"), encoding="utf-8")
    return Experiment.load(path)


@pytest.mark.parametrize("truth, written", [("deg", "rad"), ("rad", "deg")])
def test_angles_in_another_unit_than_declared(tmp_path, truth, written):
    """5.7 deg are no impossible number of radians, and 0.1 rad none of degrees: the release tells."""
    small = filmed(angle=0.1, duration=6.0)
    path = write_experiment(tmp_path, [small], unit=truth, run={"noise": None})
    wrong = relabelled(path, truth, written)
    for refused in (check_readings, calibrate):
        with pytest.raises(
            ValueError, match=rf"run1.csv, (line \d+, )?bob [12].*looks like {truth}: write \[{truth}\]"
        ):
            refused(wrong)


def test_displacements_in_another_unit_than_declared(tmp_path):
    small = filmed(angle=0.1, duration=6.0, quantity="x", noise=3e-4)
    path = write_experiment(tmp_path, [small], unit="m", run={"noise": None})
    with pytest.raises(ValueError, match=r"bob 2.*looks like m: write \[m\]"):
        check_readings(relabelled(path, "m", "mm"))


def test_what_is_not_used_is_not_judged(tmp_path, good):
    """Before fit_from a hand may hold the bob anywhere."""
    messy = dataclasses.replace(good, readings=good.readings.copy())
    messy.readings[3] = 1.4
    path = write_experiment(tmp_path, [messy], stated=STATED, run={"fit_from": 0.2})
    assert check_readings(Experiment.load(path)) == ()


def test_degrees_declared_as_radians_without_a_release(tmp_path):
    small = filmed(angle=0.05, duration=6.0)
    path = write_experiment(tmp_path, [small], unit="deg", run={"noise": None, "release": None, "state": "free"})
    with pytest.raises(ValueError, match="looks like deg"):
        check_readings(relabelled(path, "deg", "rad"))


def test_radians_declared_as_degrees_without_a_release_are_doubted(tmp_path):
    small = filmed(angle=0.2, duration=6.0)
    path = write_experiment(tmp_path, [small], unit="rad", run={"noise": None, "release": None, "state": "free"})
    assert check_readings(Experiment.load(path)) == ()
    (warning,) = check_readings(relabelled(path, "rad", "deg"))
    assert "if the file is in radians" in warning


def test_the_right_unit_is_not_refused(tmp_path, good):
    for unit in ("rad", "deg"):
        assert check_readings(Experiment.load(write_experiment(tmp_path / unit, [good], unit=unit))) == ()


@pytest.mark.slow
def test_one_bob_hidden_for_a_while(tmp_path, good, capsys, small_grid):
    path = write_experiment(tmp_path, [lose_track(good, 1, 4.0, 7.0)], stated=STATED)
    assert main(["diagnose", str(path), "--out", str(tmp_path), "--workers", "1"]) == 0
    warning = "run1.csv: bob 1 is not seen from 3.983 to 7.017 s"
    assert warning in capsys.readouterr().err
    content = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    check_schema(content, "diagnosis", "diagnosis.json")
    assert content["verdict"] == "nothing_missing" and content["warnings"] == [warning]
    assert warning in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_one_wrong_reading(tmp_path, good):
    """What is said is about this reading, not about all before it."""
    message = slips(tmp_path, tracking_jump(tracking_jump(good, 2, 0.3, 4.0), 2, -0.3, 4.01))
    assert message.startswith("run1.csv, line 242, t = 4 s, bob 2: this reading is off by +0.")
    assert message.endswith("leave it empty")
    assert float(message.partition("off by ")[2].split()[0]) == pytest.approx(0.3, abs=4e-3)  # 4 × noise


@pytest.mark.parametrize("size", [0.01, pytest.param(-0.05, marks=pytest.mark.slow)])
def test_a_tracker_that_slips(tmp_path, good, size):
    """Ten and fifty times the noise, from the middle of the run on."""
    message = slips(tmp_path, tracking_jump(good, 2, size, 9.0))
    found = float(message.partition("shifted by ")[2].split()[0])
    assert message.startswith("run1.csv, line 542, t = 9 s, bob 2: the readings from here on")
    # Half the readings tell the size: 1 mrad over the root of 420, and a correlation with the fit.
    assert found == pytest.approx(size, abs=2e-4)
    held_out = slips(tmp_path, tracking_jump(good, 2, size, 9.0), run={"fit_to": 13.0})
    assert held_out.startswith("run1.csv, line 542, t = 9 s, bob 2: the readings from here on")


def test_a_tracker_that_slips_for_a_while(tmp_path, good):
    message = slips(tmp_path, tracking_jump(good, 1, 0.02, 5.0, 8.0))
    assert message.startswith("run1.csv, line 302, t = 5 s, bob 1: the readings up to line 482, t = 8 s,")


def test_a_tracker_that_loses_the_bob(tmp_path, good):
    readings = good.readings.copy()
    readings[400:408, 0] = np.random.default_rng(0).uniform(-0.2, 0.2, 8)
    message = slips(tmp_path, dataclasses.replace(good, readings=readings))
    assert message.startswith("run1.csv, line 40") and "bob 1" in message and "leave them empty" in message


@pytest.mark.parametrize("lost", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_a_frame_lost_without_a_gap_in_the_times(tmp_path, good, lost, capsys):
    """The camera counts on, and all that follows comes too early."""
    kept = np.r_[0:500, 500 + lost : len(good.times)]
    late = dataclasses.replace(good, times=good.times[: len(kept)], readings=good.readings[kept])
    message = refusal(tmp_path, late, capsys)
    assert f"{lost} frame" in message and "add that to the times" in message
    line = int(message.partition("line ")[2].partition(",")[0])
    assert abs(line - 502) <= 2  # at the turn of a swing a frame more or less is not seen


def test_frames_lost_with_their_times(tmp_path, good):
    """A gap in the times is no fault: the rest is right."""
    gappy = drop_frames(good, 0.05, seed=1)
    assert slips(tmp_path, gappy) == "" and check_readings(Experiment.load(tmp_path / "experiment.toml")) == ()


@pytest.mark.parametrize(
    "hidden",
    [{}, {"quadratic_drag": {"c2": 0.02}}, {"angle_offset": {"offset": 2e-3}}, {"clock_scale": {"scale": 1e-3}},
     {"exposure_blur": {"duration": 0.02}}, {"string_creep": {"rate": 5e-5}}],
)  # fmt: skip
def test_what_a_model_lacks_is_no_slip(tmp_path, hidden):
    """Misfits of 10 to 70 times their standard deviation; an offset is a shift from the first reading on."""
    assert slips(tmp_path, filmed(hidden)) == ""


@pytest.mark.parametrize(
    "scale, rivals",
    [pytest.param(1e-3, ("added_mass", "angle_scale", "contact_duration", "quadratic_drag"), marks=pytest.mark.slow),
     *(pytest.param(scale, None, marks=pytest.mark.slow) for scale in (1e-3, -1e-3))],
)  # fmt: skip
def test_a_clock_a_thousandth_off(tmp_path, scale, rivals, monkeypatch):
    """A clock that runs fast looks like longer strings and added mass; one that runs slow, which would need a negative
    mass, like shorter strings. rivals: the catalogue beside the clock, the whole where None; over 7 s another κ of the
    slow clock's leaves as little, and predicts worse."""
    monkeypatch.setattr(workflow, "_advise", lambda *_: None)  # half of the time, and nothing of it is judged here
    if rivals:
        leave_candidates(monkeypatch, "clock_scale", *rivals)
    path = write_experiment(
        tmp_path, [filmed({"clock_scale": {"scale": scale}}, duration=7.0 if rivals else 16.0)], stated=STATED
    )
    assert main(["diagnose", str(path), "--out", str(tmp_path), "--workers", "1"]) == 0
    content = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    named = [[step["effect"]] for step in content["steps"]] + content["equivalent"]
    assert ["clock_scale"] in named and content["gap_last"] < 1.1 < content["gap_first"]
    assert content["verdict"] == "equivalent" and (["added_mass"] in named) is (scale > 0.0)


def two_runs(folder, hidden=None, **other) -> Path:
    """Runs of 12 s from 0.228 and 0.15 rad, the second of a cradle of which this is otherwise."""
    recordings = [
        record(SoftCradle(2, stiffness_factor=1e4, effects=hidden or {}, **{**TRUTH, **fields}), {2: angle},
               duration=12.0, seed=seed)
        for fields, angle, seed in (({}, 0.228, 4), (other, 0.15, 5))
    ]  # fmt: skip
    return write_experiment(folder, recordings, stated=STATED | {"length": 0.3})


@pytest.mark.parametrize(
    "other, name",
    [({"k_f": 23400.0}, "k_f"), *(pytest.param({"length": length}, "length", marks=pytest.mark.slow)
                                  for length in (0.306, 0.294))],
)  # fmt: skip
def test_runs_of_two_cradles(tmp_path, capsys, other, name):
    path = two_runs(tmp_path, **other)
    assert main(["diagnose", str(path), "--out", str(tmp_path / "out"), "--workers", "1"]) == 2
    message = capsys.readouterr().err
    assert f"run2.csv and run1.csv are not of one cradle: fitted alone, their {name} is" in message
    (value,) = other.values()
    assert float(message.partition(f"their {name} is")[2].split()[0]) == pytest.approx(value, rel=0.02)


@pytest.mark.parametrize("hidden", [{}, {"quadratic_drag": {"c2": 0.02}}, {"pivot_friction": {"tau_c": 5e-5}}])
def test_runs_of_one_cradle(tmp_path, hidden):
    """Effects that act otherwise at other amplitudes make no other cradle."""
    experiment = with_known_noise(Experiment.load(two_runs(tmp_path, hidden)))
    searcher = Searcher(FitCache(None, ""), 0, 1)
    check_run_consistency(searcher.fit_all_data(fit_near(searcher, experiment, TRUTH)), 0, lambda *_: None)


@pytest.mark.parametrize(
    "name", ["real-cradle-5", "real-pendulum", "reference/plain-3", "reference/frame-compliance-2"]
)
def test_real_and_reference_data_pass(name):
    path = SHARED / name / "experiment.toml"
    if not path.is_file():
        pytest.skip("not at hand")
    check_readings(Experiment.load(path))
