"""`cradle new` with files as people have them: what it prints, what it writes, and that it leaves theirs alone."""

import numpy as np
import pytest

from identification.cli.app import main
from identification.experiment.csv_file import read_recording
from identification.experiment.experiment import Experiment
from tests.paths import DATA

T = np.arange(0.0, 11.0, 1.0 / 60.0)
#: Two bobs that take turns, the second released at 0.2 rad; rad.
SWING = 0.2 * np.cos(2.0 * np.pi * T / 1.1)
THETA = np.column_stack([np.minimum(SWING, 0.0), np.maximum(SWING, 0.0)])


def run(capsys, *arguments):
    """(status, stdout, stderr) of `cradle new` with these arguments."""
    status = main(["new", *map(str, arguments)])
    printed = capsys.readouterr()
    return status, printed.out, printed.err


def table(folder, header, times=T, readings=THETA, name="swing.csv", encoding="utf-8"):
    """A file with this header line and rows."""
    lines = (",".join(map(repr, row)) for row in np.column_stack([times, readings]).tolist())
    file = folder / name
    file.write_bytes("\n".join([header, *lines, ""]).encode(encoding))
    return file


def test_what_was_understood_is_printed_and_written(tmp_path, capsys):
    file = table(tmp_path, "Time (s),Angle 1 (°),Angle 2 (°)", T, np.degrees(THETA), encoding="latin-1")
    before, out = file.read_bytes(), tmp_path / "made" / "here"
    status, printed, _ = run(capsys, file, "--out", out)
    assert status == 0
    assert printed.splitlines() == [
        "encoding: Windows-1252",
        't [s] is "Time (s)"',
        'theta_1 [deg] is "Angle 1 (°)"',
        'theta_2 [deg] is "Angle 2 (°)"',
        "a swing takes 1.1 s: that of a pendulum of 0.3 m",
        f"wrote {out / 'swing-si.csv'}: the same data in the strict form; swing.csv stays as it is",
        f"{out / 'experiment.toml'}: check each entry against your cradle, then: cradle calibrate"
        f" {out / 'experiment.toml'} --out DIR",
    ]
    assert file.read_bytes() == before
    assert sorted(path.name for path in out.iterdir()) == ["experiment.toml", "swing-si.csv"]
    (loaded,) = Experiment.load(out / "experiment.toml").runs
    assert np.allclose(loaded.readings, THETA, rtol=0.0, atol=1e-15) and np.array_equal(loaded.times, T)
    assert loaded.release.release.angle == 0.2
    strict = (out / "swing-si.csv").read_text(encoding="utf-8").splitlines()
    assert strict[0] == '# Written by cradle new from "swing.csv"' and '# t [s] is "Time (s)"' in strict
    assert "t [s],theta_1 [rad],theta_2 [rad]" in strict


@pytest.mark.parametrize("length", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("scale, label", [(1.0, "theta_{} [rad]"), (1e3, "x_{} [mm]")])
def test_the_period_tells_the_length(length, scale, label, tmp_path, capsys):
    swing = 0.2 * np.cos(np.sqrt(9.81 / length) * T)
    theta = np.column_stack([np.minimum(swing, 0.0), np.maximum(swing, 0.0)])
    file = table(
        tmp_path, f"t [s],{label.format(1)},{label.format(2)}", T, theta * (length * scale if scale > 1 else 1.0)
    )
    assert run(capsys, file)[0] == 0
    path = tmp_path / "experiment.toml"
    prior = "[infer]\n# length = "
    text = path.read_text(encoding="utf-8")
    assert prior in text and "by the period, " in text
    path.write_text(text.replace(prior, prior.replace("# ", "")), encoding="utf-8")
    experiment = Experiment.load(path)
    assert experiment.cradle.length == pytest.approx(length, rel=0.04)
    assert abs(experiment.infer["length"].mean - length) < 2.0 * experiment.infer["length"].sd < 0.2 * length
    assert experiment.runs[0].release.release.angle == pytest.approx(0.2, rel=0.05)


@pytest.mark.skipif(not DATA.is_dir(), reason="measured data are not at hand")
@pytest.mark.parametrize("kind, length", [("real-cradle-5", 0.133), ("reference/plain-5", 0.3)])
def test_measured_runs_get_their_length(kind, length, tmp_path, capsys):
    file = next((DATA / kind).glob("*.csv"))
    assert run(capsys, file, "--out", tmp_path)[0] == 0
    assert Experiment.load(tmp_path / "experiment.toml").cradle.length == pytest.approx(length, rel=0.04)


def test_a_strict_file_is_its_own_data(tmp_path, capsys):
    file = table(tmp_path, "t [s],theta_1 [rad],theta_2 [rad]")
    assert run(capsys, file)[0] == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["experiment.toml", "swing.csv"]
    assert Experiment.load(tmp_path / "experiment.toml").runs[0].file == "swing.csv"


def test_columns_are_as_the_user_says(tmp_path, capsys):
    file = table(tmp_path, "clock,right,left", 1e3 * T, np.degrees(THETA[:, ::-1]))
    assert run(capsys, file)[0] == 2
    said = ["--time", "clock", "--bob", "1=left", "--bob", "2=right", "--unit", "deg", "--unit", "ms"]
    status, printed, _ = run(capsys, file, *said)
    assert status == 0 and 'theta_2 [deg] is "right"' in printed
    (loaded,) = Experiment.load(tmp_path / "experiment.toml").runs
    assert np.allclose(loaded.readings, THETA) and np.allclose(loaded.times, T)


@pytest.mark.parametrize("since", [0.0, 3.0])
@pytest.mark.parametrize("header", ["t [s],theta_1 [rad],theta_2 [rad]", "time,angle1 (rad),angle2 (rad)"])
def test_mirrored_readings_are_turned_when_told(header, since, tmp_path, capsys):
    rows = since <= T
    file = table(tmp_path, header, T[rows], -THETA[rows])
    before = file.read_bytes()
    status, _, refused = run(capsys, file)
    assert status == 2 and refused.count("\n") == 1
    assert "the readings are mirrored" in refused and "add --mirror" in refused
    status, printed, _ = run(capsys, file, "--mirror")
    assert status == 0 and "the signs of all readings are changed (--mirror)" in printed
    assert file.read_bytes() == before
    (loaded,) = Experiment.load(tmp_path / "experiment.toml").runs
    assert loaded.file == "swing-si.csv" and np.array_equal(loaded.readings, THETA[rows])


def test_readings_that_are_not_mirrored_are_not_turned(tmp_path, capsys):
    file = table(tmp_path, "t [s],theta_1 [rad],theta_2 [rad]")
    status, _, refused = run(capsys, file, "--mirror")
    assert status == 2 and "leave out --mirror" in refused
    assert [path.name for path in tmp_path.iterdir()] == ["swing.csv"]


def test_only_files_of_this_command_are_replaced(tmp_path, capsys):
    file = table(tmp_path, "time,angle1,angle2")
    theirs = tmp_path / "swing-si.csv"
    theirs.write_text("theirs", encoding="utf-8")
    for more in ([], ["--overwrite"]):
        status, _, refused = run(capsys, file, *more)
        assert status == 2 and "swing-si.csv: exists already" in refused
    assert theirs.read_text(encoding="utf-8") == "theirs"
    theirs.unlink()
    assert run(capsys, file)[0] == 0
    table(tmp_path, "time,angle1,angle2", T, 0.5 * THETA)
    assert run(capsys, file)[0] == 2
    assert run(capsys, file, "--overwrite")[0] == 0
    assert np.array_equal(Experiment.load(tmp_path / "experiment.toml").runs[0].readings, 0.5 * THETA)


def test_positions_in_a_picture_become_displacements(tmp_path, capsys):
    file = table(tmp_path, "time,x1 (mm),x2 (mm)", T, 300.0 * THETA + [500.0, 540.0])
    assert run(capsys, file)[0] == 0
    (loaded,) = Experiment.load(tmp_path / "experiment.toml").runs
    assert loaded.rest == "free" and np.abs(loaded.readings - 0.3 * THETA).max() < 0.003
    assert read_recording(tmp_path / "swing-si.csv").quantity == "x"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["--bob", "left"], "--bob left: expected N=COLUMN"), (["--bob", "1="], "expected N=COLUMN"),
     (["--bob", "1=left"], "'left'"), (["--unit", "inch"], "unknown unit 'inch'"), (["--rate", "-1"], "rate is -1"),
     (["--out", "swing.csv"], "this is the data file"), (["--out", "notes.txt"], "notes.txt: is a file")],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line(arguments, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    table(tmp_path, "time,angle1,angle2")
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    status, _, refused = run(capsys, "swing.csv", *arguments)
    assert status == 2 and said in refused and refused.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.txt", "swing.csv"]
