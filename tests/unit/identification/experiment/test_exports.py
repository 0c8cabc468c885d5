"""Exports of phyphox, Logger Pro and Capstone: the same swing in each form; what is no swing is refused in one line."""

import io
import zipfile

import numpy as np
import pytest

from identification.apparatus import measure_impacts
from identification.cli.app import main
from identification.experiment.table_columns import Columns
from identification.experiment.table_reader import read_table
from identification.storage.files import ExperimentError

T = np.arange(300) / 30.0
THETA = 0.2 * np.cos(5.7 * T) * np.exp(-0.02 * T)


def table(header, *columns, separator=",", decimal="."):
    rows = (separator.join(f"{v:.9E}".replace(".", decimal) for v in row) for row in zip(*columns, strict=True))
    return "\n".join([header, *rows, ""]).encode()


def zipped(**members):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name.replace("__", "/").replace("_csv", ".csv"), data)
    return buffer.getvalue()


TILT = table('"Time (s)","Tilt up/down (deg)"', T, np.degrees(THETA))
META = {"meta__device_csv": '"property","value"\n"version","1.1"\n', "meta__time_csv": '"event","system time"\n'}
RUNS = table('"Time (s) Run #1","Angle (rad) Run #1","Time (s) Run #2","Angle (rad) Run #2"', T, -THETA, T, THETA)

#: name: (content, what the user says); each reads as T and THETA of one bob.
READ = {
    "phyphox": (TILT, {}),
    "phyphox with semicolons": (
        table('"Time (s)";"Tilt up/down (deg)"', T, np.degrees(THETA), separator=";", decimal=","), {},
    ),
    "phyphox ZIP": (zipped(Raw_Data_csv=TILT, **META), {}),
    "a ZIP with a folder": (zipped(export__angles_csv=TILT), {}),
    "Logger Pro": (table("Latest: Time (s),Latest: Angle (rad),Latest: Velocity (rad/s)", T, THETA, T), {}),
    "Logger Pro with runs": (
        table("Run 1: Time (s),Run 1: Angle (rad),Latest: Time (s),Latest: Angle (rad)", T, -THETA, T, THETA),
        {"run": "latest"},
    ),
    "Capstone": (table('"Time (s) Run #1","Angle, Ch P1 (rad) Run #1"', T, THETA), {}),
    "Capstone with runs": (RUNS, {"run": "Run #2"}),
    "SPARKvue": (table("Time (s) Run 1,Angle (rad) Run 1,Angular Velocity (rad/s) Run 1", T, THETA, T), {}),
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_each_export_is_the_same_swing(tmp_path, name):
    content, said = READ[name]
    path = tmp_path / "any.file"
    path.write_bytes(content)
    found = read_table(path, Columns(**said))
    assert found.recording.quantity == "theta"
    assert found.recording.times == pytest.approx(T, abs=1e-8)
    assert found.recording.readings[:, 0] == pytest.approx(THETA, abs=1e-8)
    assert not found.strict  # cradle new writes a copy in the strict form


def test_two_rotary_sensors_are_two_bobs(tmp_path):
    path = tmp_path / "two.csv"
    head = '"Time (s) Run #1","Angle 1, Ch P1 (rad) Run #1","Angle 2, Ch P2 (rad) Run #1"'
    path.write_bytes(table(head, T, THETA, 0.5 * THETA))
    assert read_table(path).recording.readings == pytest.approx(np.column_stack([THETA, 0.5 * THETA]), abs=1e-8)


@pytest.mark.parametrize(
    ("content", "options", "said"),
    [
        (RUNS, [], 'holds the runs "Run #1", "Run #2"; say which to read: --run "Run #1"'),
        (RUNS, ["--run", "Run #3"], "there is no run 'Run #3'; it holds \"Run #1\", \"Run #2\""),
        (TILT, ["--run", "1"], "it holds none that its labels name"),
        (
            table('"Time (s)","Gyroscope x (rad/s)","Absolute (rad/s)"', T, THETA, THETA), [],
            "speeds and accelerations do not tell where a bob is: export its angle or position",
        ),
        (zipped(**META), [], "holds no table; unpack it"),
        (zipped(a_csv=TILT, b_csv=TILT), [], "holds 'a.csv', 'b.csv'; unpack it, and name the CSV"),
        (zipped(Raw_Data_csv=TILT)[:400], [], "a damaged ZIP file"),
        (zipped(a_csv=""), [], "empty; it needs a header line"),
        (zipped(**{"[Content_Types].xml": "<Types/>", "a_csv": TILT}), [], "is a workbook"),
    ],
)  # fmt: skip
def test_what_is_no_swing_is_refused_in_one_line(tmp_path, capsys, content, options, said):
    path = tmp_path / "data"
    path.write_bytes(content)
    assert main(["new", str(path), *options]) == 2
    told = capsys.readouterr().err
    assert said in told and told.count("\n") == 1
    assert [file.name for file in tmp_path.iterdir()] == ["data"]


@pytest.mark.parametrize("name", READ)
def test_whatever_happens_to_an_export_it_is_read_or_refused(tmp_path, name):
    """Bytes changed, lost and repeated, 60 times: finite times, or one line."""
    content, said = READ[name]
    rng, path = np.random.default_rng(2), tmp_path / "data"
    for _ in range(60):
        data = bytearray(content)
        for _ in range(rng.integers(1, 20)):
            data[rng.integers(len(data))] = rng.integers(256)
        begin, end = np.sort(rng.integers(len(data), size=2))
        kind = int(rng.integers(4))
        path.write_bytes([data, data[:begin], data[:begin] + data[end:], data[:end] + data[begin:]][kind])
        try:
            found = read_table(path, Columns(**said))
        except ExperimentError as refused:
            assert "\n" not in str(refused)
        else:
            assert np.isfinite(found.recording.times).all()
            assert not np.isinf(found.recording.readings).any()


def test_tables_of_instruments_come_in_any_encoding(tmp_path):
    """A table of speeds with decimal commas in UTF-16 is that in UTF-8."""
    rng = np.random.default_rng(0)
    v = rng.uniform(0.2, 0.8, 10)
    rows = [f"{a:.5f};{0.97 * a:.5f};0.001;0.001" for a in v]
    text = "\n".join(["v1 [m/s];v3 [m/s];v1_sd [m/s];v3_sd [m/s]", *rows, ""])
    found = []
    for name, data in (("a", text.encode()), ("b", text.replace(".", ",").replace("\n", "\r\n").encode("utf-16"))):
        (tmp_path / name).write_bytes(data)
        found.append(measure_impacts([tmp_path / name]).values["k_f"].median)
    assert found[0] == pytest.approx(found[1], rel=1e-6)  # the fit ends when a step is this small
