"""Whole experiments: those at hand, saved and read again, made from arrays, and the scaffold for a data file."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from cradle_env.cradle import Cradle
from cradle_env.release import Release
from identification.experiment.experiment import Experiment, ExperimentError, Prior, ReleaseInfo, Run
from identification.experiment.scaffold import scaffold
from identification.storage.files import write_together
from identification.storage.stamps import check_replaceable, write_results
from tests.paths import DATA


def test_the_experiments_at_hand_load():
    found = sorted(DATA.glob("**/experiment.toml"))
    if not found:
        pytest.skip(f"no data in {DATA}")
    for path in found:
        experiment = Experiment.load(path)
        assert experiment.runs[0].fitted.any()
        assert experiment.path == path
    pendulum = Experiment.load(DATA / "real-pendulum" / "experiment.toml")
    assert pendulum.runs[0].release is None
    assert pendulum.infer == {"length": Prior(low=0.05, high=1.0)}
    balls = Experiment.load(DATA / "real-cradle-5" / "experiment.toml")
    (run,) = balls.runs
    assert (run.quantity, run.state, run.rest, run.fit_from, run.fit_to) == ("x", "free", "free", 1.2, 12.0)
    assert not (run.fitted & run.held_out).any()
    assert balls.cradle.effects["exposure_blur"] == {"duration": 0.0417}
    assert balls.unknown_effect_parameters == ()


def two_runs():
    t, rng = np.linspace(0.0, 1.0, 30), np.random.default_rng(1)
    readings = 0.1 * rng.standard_normal((30, 2))
    readings[3:7, 1] = np.nan
    effects = {"quadratic_drag": {"c2": 1e-3}, "pivot_friction": {"tau_c": 0.1}}
    return Experiment(
        Cradle(bobs=2, delta=(1e-3,), model="ho", effects=effects),
        (
            Run(t, readings, release=ReleaseInfo(Release(angles={1: -0.1, 2: 0.2}, start="hanging"), 1e-3, 0.01)),
            Run(t + 5.0, readings / 3.0, "x", unit="m", delta=0.02, noise=1e-4, fit_from=5.1, fit_to=5.5, state="free",
                rest="free", file="run2.csv"),
        ),
        {"length": Prior(mean=0.3, sd=0.01), "pivot_friction.tau_c": Prior(low=0.0, high=1.0)},
        ("pivot_friction.tau_c",),
    )  # fmt: skip


def test_what_is_saved_loads_the_same(tmp_path):
    made = two_runs()
    path = made.save(tmp_path / "new")
    assert sorted(file.name for file in path.parent.iterdir()) == ["experiment.toml", "run1.csv", "run2.csv"]
    read = Experiment.load(path)
    assert read.digest == made.digest
    assert dict(read.infer) == dict(made.infer)
    assert read.unknown_effect_parameters == made.unknown_effect_parameters
    assert read.cradle.replace(effects={}) == made.cradle.replace(effects={})
    assert read.cradle.effects["quadratic_drag"] == made.cradle.effects["quadratic_drag"]
    for a, b in zip(read.runs, made.runs, strict=True):
        for name in ("times", "readings"):
            assert np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True)
        for name in ("quantity", "release", "delta", "noise", "fit_from", "fit_to", "state", "rest", "file", "unit"):
            assert getattr(a, name) == getattr(b, name), name


def test_the_digest_follows_the_data():
    made = two_runs()
    assert made.digest == two_runs().digest
    moved = dataclasses.replace(made.runs[1], readings=made.runs[1].readings + 1e-9)
    assert Experiment(made.cradle, (made.runs[0], moved), made.infer).digest != made.digest


def test_the_digest_follows_what_python_changes(tmp_path):
    """However the experiment was made: no result of one may be gone on with for another."""
    made = two_runs()
    for experiment in (made, Experiment.load(made.save(tmp_path))):
        run = experiment.runs[0]
        changes = (
            {"cradle": experiment.cradle.replace(mass=0.5)},
            {"runs": (dataclasses.replace(run, readings=1.01 * run.readings), *experiment.runs[1:])},
            {"infer": {**experiment.infer, "length": Prior(mean=0.3, sd=0.02)}},
        )
        digests = {dataclasses.replace(experiment, **change).digest for change in changes}
        assert len(digests | {experiment.digest}) == 4


def test_from_arrays_and_what_python_cannot_state(tmp_path):
    t, readings = np.arange(3.0), np.zeros((3, 2))
    experiment = Experiment.from_arrays(Cradle(bobs=2), t, readings, Release(angle=0.1), noise=1e-3)
    assert experiment.runs[0].delta == 0.0
    assert experiment.cradle_of(experiment.runs[0]) == Cradle(bobs=2)
    for wrong, match in (
        ({"readings": np.zeros((2, 2))}, "do not match"),
        ({"readings": np.zeros((3, 1))}, "cradle has 2 bobs"),
        ({"times": t[::-1]}, "later than the one before"),
        ({"readings": np.full((3, 2), np.inf)}, "infinite"),
        ({"readings": np.full((3, 2), np.nan)}, "no usable rows"),
        ({"release": Release(angle=0.1, bobs=3)}, "lifts 3 bobs"),
        ({"quantity": "phi"}, "'theta' or 'x'"),
    ):
        stated = {"times": t, "readings": readings, "release": Release(angle=0.1), **wrong}
        with pytest.raises(ValueError, match=match):
            Experiment.from_arrays(Cradle(bobs=2), **stated)
    with pytest.raises(ValueError, match="at least one run"):
        Experiment(Cradle(), ())
    several = Experiment(
        Cradle(bobs=2), (*experiment.runs, Run(t + 1.0, readings, state="free", file="other/run1.csv"))
    )
    assert [*several.texts()] == ["experiment.toml", "run1.csv", "run1-2.csv"]
    again = Experiment.load(several.save(tmp_path))
    assert [run.times[0] for run in again.runs] == [t[0], t[0] + 1.0]


def test_nothing_is_half_written(tmp_path):
    (tmp_path / "b").mkdir()
    with pytest.raises(OSError):
        write_together(tmp_path, {"a": "new", "b": "a folder is in the way"})
    assert not [file for file in tmp_path.iterdir() if file.name.startswith(".")]


def test_an_interruption_between_two_files_leaves_both_and_what_lists_them(tmp_path, monkeypatch):
    """So that the same command finds its own files."""
    replace = Path.replace

    def interrupted(self, target):
        monkeypatch.setattr(Path, "replace", replace)
        replace(self, target)
        raise KeyboardInterrupt

    write_results(tmp_path, {"a": "old"}, "stamp.json", {"format": "f"})
    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_results(tmp_path, {"a": "new"}, "stamp.json", {"format": "f"})
    assert (tmp_path / "a").read_text() == "new"
    check_replaceable(tmp_path, ("a", "stamp.json"), "stamp.json", "f")


@pytest.mark.parametrize(
    ("csv", "bobs", "base", "release"),
    [("t,theta_1,theta_2,theta_3\n0,0,0,0.2\n1,0.1,0.1,0.1\n", 3, "nsp", Release(angle=0.2)),
     ("t,theta_1 [deg],theta_2 [deg],theta_3 [deg]\n0,0,9,9\n1,4,4,4\n", 3, "nsp", Release(angle=0.1571, bobs=2)),
     ("t,theta_1,theta_2\n0,-0.2,0.0\n1,0.1,0.1\n", 2, "nsp", Release(angles={1: -0.2})),
     ("t,theta_1\n0,1.6\n1,0.1\n", 1, "pendulum", Release(angle=1.6)),
     ("t,theta_1,theta_2\n0,0.0,0.0\n1,0.1,0.1\n", 2, "nsp", None),
     ("t,theta_1,theta_2\n3,0.2,0.0\n4,0.1,0.1\n", 2, "nsp", None),
     ("t,x_2 [mm]\n0,60\n1,-50\n", 2, "nsp", Release(angle=0.2014)),
     ("t,x_2\n0,1\n1,-1\n", 2, "nsp", Release(angle=0.7297)),
     ("mass_A\nt\tx\ty\n0.0\t0.02\t-0.3\n0.1\t0.01\t-0.3\n", 1, "pendulum", Release(angle=0.01667))],
    ids=["last bob", "two bobs", "first bob", "rod", "at rest", "later", "mm", "long", "tracker"],
)  # fmt: skip
def test_a_scaffold_loads_at_once(tmp_path, csv, bobs, base, release):
    data = tmp_path / "data.csv"
    data.write_text(csv, encoding="utf-8")
    path = scaffold(data)
    assert path == tmp_path / "experiment.toml"
    experiment = Experiment.load(path)
    (run,) = experiment.runs
    assert (experiment.cradle.bobs, experiment.cradle.model) == (bobs, base)
    assert (run.release and run.release.release) == release
    assert run.state == ("free" if release is None else "release")
    entries = [line for line in path.read_text(encoding="utf-8").splitlines() if "=" in line.partition("#")[0]]
    assert all("#" in line for line in entries if not line.startswith(("format", "file")))


def swung(angle, length, rate=60.0, held=0.0):
    """(t, θ) of an undamped swing of small angle that lasts 5 s after it was held."""
    t = np.arange(0.0, 5.0 + held, 1.0 / rate)
    return t, angle * np.cos(np.sqrt(9.81 / length) * np.maximum(t - held, 0.0))


def csv_of(t, column, quantity="theta_2 [rad]"):
    return f"t [s],{quantity}\n" + "".join(f"{a:.6f},{b:.6f}\n" for a, b in zip(t, column, strict=True))


@pytest.mark.parametrize("length", [0.15, 0.3, 0.6, 1.0])
def test_the_angle_of_a_scaffold_is_as_uncertain_as_the_length_it_guesses(length, tmp_path):
    data, (t, theta) = tmp_path / "data.csv", swung(0.2, length)
    data.write_text(csv_of(t, 1e3 * length * np.sin(theta), "x_2 [mm]"), encoding="utf-8")
    path = scaffold(data)
    (run,) = Experiment.load(path).runs
    assert abs(run.release.release.angle - 0.2) < 2.5 * run.release.angle_sd
    line = next(line for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("release"))
    assert f"asin({length * np.sin(0.2):.4g} m / length)" in line and "write angle_sd = 0.002" in line


@pytest.mark.parametrize("seconds", [1.7, 3.1, 5.0])
def test_the_median_of_a_tracker_export_is_no_rest_position(seconds, tmp_path):
    """The uncertainty of the angle for a known length includes that of the rest position."""
    t, theta = swung(0.2, 0.3)
    rows = [f"{a:.6f}\t{b:.6f}\t0" for a, b in zip(t, 0.3 * np.sin(theta) + 0.5, strict=True) if a < seconds]
    (tmp_path / "data.txt").write_text("\n".join(["mass_A", "t\tx\ty", *rows]), encoding="utf-8")
    text = scaffold(tmp_path / "data.txt").read_text(encoding="utf-8")
    angle, then = (float(re.search(rf"{name} = ([\d.]+){after}", text)[1]) for name, after in
                   (("angle", ","), ("write angle_sd", ", x is relative to the median")))  # fmt: skip
    assert abs(angle - 0.2) < 2.0 * then
    assert then > 0.002


@pytest.mark.parametrize(("rate", "length"), [(60.0, 0.3), (60.0, 1.5), (15.0, 0.3)])
@pytest.mark.parametrize("held", [0.0, 0.5, 2.0])
def test_a_scaffold_sees_that_a_bob_is_held_at_first(held, rate, length, tmp_path):
    data, (t, theta) = tmp_path / "data.csv", swung(0.2, length, rate, held)
    data.write_text(csv_of(t, theta + 1e-3 * np.random.default_rng(0).standard_normal(len(t))), encoding="utf-8")
    path = scaffold(data)
    (run,) = Experiment.load(path).runs
    if held == 0.0:
        assert run.state == "release" and run.fit_from == 0.0
        return
    told = re.search(r"held until ([\d.]+) s, the time of the release", path.read_text(encoding="utf-8"))
    assert float(told[1]) == pytest.approx(held, abs=0.03)
    assert run.state == "free" and held < run.fit_from < held + 0.15 * np.sqrt(length / 0.3) + 1.0 / rate


@pytest.mark.parametrize("still", [True, False])
def test_a_scaffold_sees_a_release_at_zero_in_data_that_begin_earlier(still, tmp_path):
    data, (t, theta) = tmp_path / "data.csv", swung(0.2, 0.3, 60.0, 3.0)
    if not still:  # it was moved there by hand
        theta = np.where(t < 2.0, 0.1 * t, theta)
    data.write_text(csv_of(t - 3.0, theta), encoding="utf-8")
    (run,) = Experiment.load(scaffold(data)).runs
    assert run.state == ("release" if still else "free")
    assert run.fit_from == (pytest.approx(0.0, abs=0.02) if still else -3.0)


def test_the_text_of_an_experiment_is_as_it_was_read(tmp_path):
    data, (t, theta) = tmp_path / "data.csv", swung(0.2, 0.3, 60.0, 0.0)
    data.write_text(csv_of(t, theta), encoding="utf-8")
    path = scaffold(data)
    experiment, text = Experiment.load(path), path.read_text(encoding="utf-8")
    path.write_text(text.replace("mass", "# mass"), encoding="utf-8")
    assert experiment.text == text
    heavier = dataclasses.replace(experiment, cradle=experiment.cradle.replace(mass=0.5))
    assert "mass = 0.5" in heavier.text


def test_a_scaffold_refuses_what_would_not_load(tmp_path):
    data = tmp_path / "data.csv"
    data.write_text("t,theta_1,theta_2\n0,,\n1,,\n", encoding="utf-8")
    with pytest.raises(ExperimentError, match=r"data\.csv: holds no reading"):
        scaffold(data)
    data.write_text("t,theta_1,theta_2\n0,0.0,-0.2\n1,0.0,0.1\n", encoding="utf-8")
    with pytest.raises(ExperimentError, match=r"^\S*/data\.csv: the readings are mirrored: .* add --mirror"):
        scaffold(data)
    data.write_text("t,theta_1,theta_2,theta_3\n0,0.0,-0.2,0.0\n1,0.0,0.1,0.0\n", encoding="utf-8")
    with pytest.raises(ExperimentError, match=r"^\S*/data\.csv: bobs overlap .* outwards"):
        scaffold(data)
    data = data.rename(tmp_path / "two\nlines.csv")
    data.write_text("t,theta_1\n0,0.2\n1,0.1\n", encoding="utf-8")
    with pytest.raises(ExperimentError, match="rename the data"):
        scaffold(data)
    assert not (tmp_path / "experiment.toml").exists()


def test_a_scaffold_overwrites_only_when_told(tmp_path):
    data = tmp_path / "data.csv"
    data.write_text("t,theta_1,theta_2\n0,0,0.2\n1,0.1,0.1\n", encoding="utf-8")
    path = scaffold(data, tmp_path / "sub" / "mine.toml")
    assert Experiment.load(path).runs[0].file == "data.csv"
    assert path.with_name("data.csv").read_bytes() == data.read_bytes()
    with pytest.raises(ExperimentError, match="exists already"):
        scaffold(data, path)
    assert scaffold(data, path, overwrite=True) == path
    written = path.read_text(encoding="utf-8")
    data.write_text("t,x_2\n0,0.1\n1,-0.1\n", encoding="utf-8")
    with pytest.raises(ExperimentError, match="exists already, and is not a copy"):
        scaffold(data, path, overwrite=True)
    path.with_name("data.csv").unlink()
    data.write_text("t,x_2\n0,10\n1,-1\n", encoding="utf-8")
    with pytest.raises(ExperimentError, match=r"10 m is beyond 2 m; add --unit mm"):
        scaffold(data, path, overwrite=True)
    assert path.read_text(encoding="utf-8") == written
