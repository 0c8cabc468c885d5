"""Tables as programs and people write them: what is read, what is said of it, and what is refused."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from identification.experiment.column_meaning import Meaning, parse_label
from identification.experiment.csv_file import csv_text, read_recording
from identification.experiment.plausibility import is_mirrored, swing_period
from identification.experiment.table_columns import Columns
from identification.experiment.table_reader import mirror_signs, read_table
from identification.storage.files import ExperimentError
from tests.paths import DATA

NAN = float("nan")
#: Three instants of two bobs, in s and rad; the second bob's in deg and, at 0.3 m, in mm.
T = [0.0, 0.5, 1.0]
RAD = [[0.0, 0.2], [-0.1, 0.1], [0.05, -0.05]]
DEG = np.degrees(RAD).tolist()


def rows(times, readings, delimiter=",", show=repr, more=()):
    """Lines of numbers; more: the text at the end of each."""
    lines = [delimiter.join([*map(show, (t, *row))]) for t, row in zip(times, readings, strict=True)]
    ends = [delimiter + end for end in more] or [""] * len(lines)
    return "".join(f"{line}{end}\n" for line, end in zip(lines, ends, strict=True))


def decimal_comma(value):
    return repr(value).replace(".", ",")


RAD_ROWS, DEG_ROWS = rows(T, RAD), rows(T, DEG)
COMMENTS = ["ok", "hit, twice", ""]

#: name: (content, what the user says, words of what was understood); each reads as T and RAD.
READ = {
    "strict": ("t [s],theta_1 [rad],theta_2 [rad]\n" + RAD_ROWS, {}, ['theta_2 [rad] is "theta_2 [rad]"']),
    "words": ("Time (s),Angle 1 (deg),Angle 2 (deg)\n" + DEG_ROWS, {}, ['t [s] is "Time (s)"', "theta_1 [deg] is"]),
    "no units": ("time,angle1,angle2\n" + RAD_ROWS, {}, ["no unit is stated", "up to 0.2; --unit"]),
    "degrees without a unit": ("time,angle1,angle2\n" + DEG_ROWS, {}, ["read in deg", "would reach 11.46"]),
    "sign of degrees": ("t,theta_1 [°],theta_2 [°]\n" + DEG_ROWS, {}, ["theta_1 [deg]"]),
    "Latin-1": (("t,theta_1 [°],theta_2 [°]\n" + DEG_ROWS).encode("latin-1"), {}, ["encoding: Windows-1252"]),
    "UTF-16": (("t,θ1 (°),θ2 (°)\n" + DEG_ROWS).encode("utf-16"), {}, ["encoding: UTF-16", "θ2"]),
    "UTF-16 without a mark": (("t,θ1 (°),θ2 (°)\n" + DEG_ROWS).encode("utf-16-le"), {}, ["UTF-16-LE"]),
    "subscripts": ("t,θ₁,θ₂\n" + RAD_ROWS, {}, ["θ₁"]),
    "milliseconds": ("t_ms,theta_1_deg,theta_2_deg\n" + rows([0.0, 500.0, 1000.0], DEG), {}, ["t [ms]"]),
    "units below": ("t,theta_1,theta_2\n(s),(deg),(deg)\n" + DEG_ROWS, {}, ["units in line 2", "theta_1 [deg]"]),
    "units of one each": (
        "t,theta_1 [deg],theta_2 [rad]\n" + rows(T, [[a, b] for (a, _), (_, b) in zip(DEG, RAD, strict=True)]), {},
        ["theta_1 [deg]", "theta_2 [rad]"],
    ),
    "frames": (
        "frame,t,theta_1,theta_2\n" + "".join(f"{i},{row}\n" for i, row in enumerate(RAD_ROWS.splitlines())), {},
        ['ignored: "frame"'],
    ),
    "frames for a time": (
        "frame,theta_1,theta_2\n" + rows([0, 120, 240], RAD), {"rate": 240.0}, ['t [frames] is "frame"'],
    ),
    "comments": ("t,theta_1,theta_2,comment\n" + rows(T, RAD, more=COMMENTS), {}, ['ignored: "comment"']),
    "speeds and errors": (
        "t,theta_1,theta_2,angular velocity 1,theta_1 error\n" + rows(T, [[*row, 9.0, 0.1] for row in RAD]), {},
        ['ignored: "angular velocity 1", "theta_1 error"'],
    ),
    "quotes and decimal commas": (
        '"Time (s)","Angle 1, rad","Angle 2, rad"\n' + rows(T, RAD, show=lambda v: f'"{decimal_comma(v)}"'), {},
        ['"Angle 1, rad"'],
    ),
    "semicolons": ("Zeit (s);Winkel 1 (rad);Winkel 2 (rad)\n" + rows(T, RAD, ";", decimal_comma), {}, ["Winkel 2"]),
    "white space": ("t (s)  theta_1 (rad)   theta_2 (rad)\n" + rows(T, RAD, "   "), {}, ["theta_1 [rad]"]),
    "header in a comment": ("# t theta_1 theta_2\n" + rows(T, RAD, " "), {}, ['theta_1 is "theta_1"']),
    "lines above": ("My cradle\nDate: 1, May\n\nt,theta_1,theta_2\n" + RAD_ROWS, {}, ["header in line 4"]),
    "Logger Pro": ("Run 1: Time (s),Run 1: Angle 1 (rad),Run 1: Angle 2 (rad)\n" + RAD_ROWS, {}, ["Run 1: Time"]),
    "counted from 0": ("t,theta_0,theta_1\n" + RAD_ROWS, {}, ['theta_1 is "theta_0"', "numbered from 0"]),
    "letters": ("t,ball A angle,ball B angle\n" + RAD_ROWS, {}, ['theta_2 is "ball B angle"']),
    "other order": ("theta_1,theta_2,t\n0.0,0.2,0.0\n-0.1,0.1,0.5\n0.05,-0.05,1.0\n", {}, ['t is "t"']),
    "angles before displacements": (
        "t,theta_1,x_1 [px],theta_2,x_2 [px]\n" + rows(T, [[a, 7.0, b, 8.0] for a, b in RAD]), {},
        ['ignored: "x_1 [px]", "x_2 [px]"'],
    ),
    "unsorted": (
        "t,theta_1,theta_2\n" + rows([T[i] for i in (1, 0, 2)], [RAD[i] for i in (1, 0, 2)]), {},
        ["sorted by time: line 3 is the first out of order"],
    ),
    "repeated": (
        "t,theta_1,theta_2\n" + rows([T[i] for i in (0, 1, 1, 2, 0)], [RAD[i] for i in (0, 1, 1, 2, 0)]), {},
        ["sorted", "dropped 2 rows of an instant that another row has: line 4"],
    ),
    "completed": ("t,theta_1,theta_2\n0,0,\n0,,0.2\n0.5,-0.1,0.1\n1,0.05,-0.05\n", {}, ["dropped 1 row "]),
    "mapped": (
        "clock,left,right,note\n" + rows(T, DEG, more=["a", "b", "c"]),
        {"time": "clock", "bobs": {1: "left", 2: "right"}, "units": ("deg",)}, ['theta_1 [deg] is "left"', "note"],
    ),
    "mapped in any spelling": (
        "Time (s),Angle  1 (deg),ANGLE 2 (deg)\n" + DEG_ROWS,
        {"time": "time (s)", "bobs": {1: "angle 1 (deg)", 2: "Angle 2 (deg)"}}, ["theta_1 [deg]"],
    ),
    "mapped with units": (
        "Clock (ms),Left (deg),Right (deg)\n" + rows([0.0, 500.0, 1000.0], DEG),
        {"time": "Clock (ms)", "bobs": {1: "Left (deg)", 2: "Right (deg)"}}, ["t [ms] is", 'theta_2 [deg] is "Right'],
    ),
    "mapped with units below": (
        "Clock,Left,Right\nms,deg,deg\n" + rows([0.0, 500.0, 1000.0], DEG),
        {"time": "Clock", "bobs": {1: "Left", 2: "Right"}}, ["t [ms] is", 'theta_2 [deg] is "Right'],
    ),
    "a unit for all": ("t,angle 1 [deg],angle 2\n" + DEG_ROWS, {}, ['theta_2 [deg] is "angle 2"']),
    "no quantity": ("time,ball 1,ball 2\n" + DEG_ROWS, {"units": ("deg",)}, ['theta_1 [deg] is "ball 1"']),
    "another unit than stated": ("t,theta_1 [rad],theta_2 [rad]\n" + DEG_ROWS, {"units": ("deg",)}, ["theta_1 [deg]"]),
    "masses": (
        "t,theta_1,theta_2,mass,ball\n" + rows(T, [[*row, 0.28, 1.0] for row in RAD]), {}, ['ignored: "mass", "ball"'],
    ),
    "missing words": ("t,theta_1,theta_2\n0,0,0.2\n0.5,-0.1,0.1\n1,0.05,-0.05\n2,NA,-\n", {}, []),
    "minus signs": ("t,theta_1,theta_2\n" + RAD_ROWS.replace("-", "\u2212"), {}, []),
}  # fmt: skip


def read(folder, content, **said):
    file = folder / "data.csv"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_table(file, Columns(**said))


@pytest.mark.parametrize("name", READ)
def test_tables_are_read_by_meaning(name, tmp_path):
    content, said, words = READ[name]
    table = read(tmp_path, content, **said)
    recording = table.recording
    assert table.strict == (name in ("strict", "other order"))
    assert recording.quantity == "theta"
    assert recording.times[:3] == pytest.approx(T)
    assert recording.readings[:3] == pytest.approx(np.array(RAD), abs=1e-15)
    assert np.isnan(recording.readings[3:]).all()
    for word in words:
        assert any(word in line for line in table.understood), table.understood


def test_displacements_are_read_in_their_unit(tmp_path):
    for header, said, scale in (("time,x1,x2", {}, 1.0), ("time,x1 (mm),x2 (mm)", {}, 1e-3),
                                ("time,x1,x2", {"units": ("cm",)}, 1e-2)):  # fmt: skip
        recording = read(tmp_path, f"{header}\n0,0,0.2\n1,0.1,0.1\n", **said).recording
        assert recording.quantity == "x"
        assert recording.readings == pytest.approx(scale * np.array([[0.0, 0.2], [0.1, 0.1]]))


def test_a_unit_may_be_the_size_of_a_pixel(tmp_path):
    table = read(tmp_path, "t,x_1 (px),x_3 (px)\n0,0,100\n1,-50,0\n", units=("0.5 mm",))
    assert table.recording.readings[:, [0, 2]] == pytest.approx(np.array([[0.0, 0.05], [-0.025, 0.0]]))
    assert 'x_1 [0.5 mm] is "x_1 (px)"' in table.understood and "no column of bob 2" in table.understood


def test_where_readings_stand_survives_sorting(tmp_path):
    recording = read(tmp_path, "t,theta_1\n\n0.2,0.3\n# a comment\n0.1,0.2\n").recording
    assert recording.lines.tolist() == [[5], [3]]


REFUSED = {
    "no header": ("0.0,0.1\n0.1,0.2\n", {}, ["line 1", "'0.0'", "header line"]),
    "empty": ("", {}, ["line 1: empty"]),
    "header only": ("time,angle1\n", {}, ["line 2", "no rows"]),
    "no time": ("when,angle1\n0,1\n", {}, ["no column of time among", '"when"', "--time"]),
    "neither": ("Clock,Left\n0,1\n", {}, ["no column of time or of a bob", '"Clock", "Left"', "--time", "--bob 1="]),
    "no frames": ("t,theta_1\n0,1\n", {"rate": 60.0}, ["no column of frames"]),
    "two times": ("time,t,angle1\n0,0,1\n", {}, ['"time", "t"', "--time"]),
    "no bob": ("time,left\n0,1\n", {}, ["no column of a bob", '"left"', '--bob 1="NAME"']),
    "two of a bob": ("t,theta_1,angle 1\n0,0,1\n", {}, ['"theta_1", "angle 1" are both of bob 1', "--bob 1="]),
    "no number": ("t,angle left,theta,phi\n0,0,1,2\n", {}, ['"theta", "phi" do not say of which bob', "--bob"]),
    "no quantity": ("time,ball 1\n0,1\n", {}, ["angle or displacement?", "--unit deg, rad, mm, cm or m"]),
    "unknown unit": ("t,theta_1 [gon]\n0,1\n", {}, ['"theta_1 [gon]"', "'gon'", "--unit rad or mrad or deg"]),
    "unit of another quantity": ("t,theta_1 [mm]\n0,1\n", {}, ["'mm'", "--unit rad"]),
    "unit of a time": ("t [h],theta_1\n0,1\n", {}, ["'h'", "--unit s or ms"]),
    "units for some": ("t,angle 1,angle 2 [deg],angle 3 [mrad]\n0,1,1,1\n", {}, ['"angle 1" without a unit']),
    "rows of bobs": ("t,particle,x\n0,1,0.1\n0,2,0.2\n", {}, ["lines 2 and 3", "a column of its own"]),
    "pixels": ("t,x_1 (px)\n0,1\n", {}, ["'px'", '--unit "0.44 mm"']),
    "frames": ("frame,theta_1\n0,1\n", {}, ["no column of time, only", "--rate"]),
    "mapped to none": ("time,left\n0,1\n", {"bobs": {1: "lft"}}, ["'lft'", "did you mean 'left'"]),
    "mapped to two": ("time,left,left\n0,1,2\n", {"bobs": {1: "left"}}, ["2 columns are called 'left'"]),
    "mapped twice": ("time,left\n0,1\n", {"bobs": {1: "left", 2: "left"}}, ["twice"]),
    "mapped mixture": ("t,x,angle\n0,1,2\n", {"bobs": {1: "x", 2: "angle"}}, ["mix angles and displacements"]),
    "no such bob": ("t,theta_201\n0,1\n", {}, ["there is no bob 201", "1 to 200"]),
    "conflict": (
        "t,theta_1,theta_2\n0,0,0.1\n1,0.1,0.2\n1,0.1,0.3\n", {},
        ["lines 3 and 4", "at 1 s", "bob 2", "keep one"],
    ),
    "two recordings": (
        "t,theta_1\n" + 2 * "".join(f"{i},0.1\n" for i in range(20)), {}, ["line 22", "starts over", "file of its own"],
    ),
    "time missing": ("t,theta_1\n0,1\n,1\n", {}, ["line 3", "no time"]),
    "text": ("t,theta_1\n0,1\nmean,1\n", {}, ["line 3", '"t"', "'mean' is not a number", "#"]),
    "grouped digits": ("t,theta_1\n0,1_0\n", {}, ["line 2", "'1_0'"]),
    "infinite": ("t,theta_1\n0,inf\n", {}, ["line 2", "infinite"]),
    "decimal commas": ("t,theta_1\n0,0,0,1\n", {}, ["4 fields", "2 columns", "semicolons"]),
    "decimal commas and a comment": ("t,theta_1,note\n0,0,0,1,good\n", {}, ["5 fields", "3 columns", "semicolons"]),
    "short row": ("t,theta_1,theta_2\n0,0,1\n1,0\n", {}, ["line 3", "2 fields", "3 columns"]),
    "broken ZIP": (b"PK\x03\x04 and so on", {}, ["a damaged ZIP file", "export it again"]),
    "old workbook": (b"\xd0\xcf\x11\xe0 and so on", {}, ["is a workbook"]),
    "binary": (b"t,theta_1\n\x00\x01\x02", {}, ["not a text file"]),
    "stated rad": ("t,theta_1 [rad]\n0,13\n1,-12\n", {}, ["line 2", "13 rad is beyond a full turn", "--unit deg"]),
    "stated m": ("t,x_1 [m]\n0,13\n1,-12\n", {}, ["line 2", "13 m is beyond 2 m", "--unit mm"]),
    "no unit of x": ("t,x_1\n0,13\n1,-12\n", {}, ["13 m", "--unit mm or cm"]),
    "far in any unit": ("t,theta_1\n0,13000\n1,-12\n", {}, ["13000 deg is beyond a full turn", "check the unit"]),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_can_be_read_in_two_ways_is_refused(name, tmp_path):
    content, said, fragments = REFUSED[name]
    with pytest.raises(ExperimentError) as refused:
        read(tmp_path, content, **said)
    message = str(refused.value)
    assert message.startswith("data.csv") and len(message.splitlines()) == 1
    for fragment in fragments:
        assert fragment in message, message


@pytest.mark.parametrize(
    ("said", "match"),
    [({"units": ("furlong",)}, "unknown unit 'furlong'"), ({"units": ("rad", "mm")}, "one of time and one of the read"),
     ({"bobs": {0: "a"}}, "bob is 0"), ({"rate": 0.0}, "greater than 0 frames per second")],
)  # fmt: skip
def test_what_the_user_says_must_be_possible(said, match):
    with pytest.raises(ValueError, match=match):
        Columns(**said)


@pytest.mark.parametrize(
    ("label", "meaning"),
    [("Time", Meaning("t")), ("t[ms]", Meaning("t", None, "ms")), ("seconds", Meaning("t", None, "s")),
     ("x_1 [mm]", Meaning("x", 1, "mm")), ("Ball 3 (cm)", Meaning("x", 3, "cm")), ("theta(2)", Meaning("theta", 2)),
     ("Position of ball 12 in mm", Meaning("x", 12, "mm")), ("frame", Meaning("frame")), ("mass_C x", Meaning("x", 3)),
     ("µs", Meaning("t", None, "us")), ("y_1", None), ("x velocity 1", None), ("theta_1 sd", None), ("", None),
     ("#", None), ("omega_1", None), ("comment", None), ("time of ball 1", None), ("x_1_2", None), ("0.25", None)],
)  # fmt: skip
def test_labels_mean(label, meaning):
    assert parse_label(label) == meaning


# A strict file in other clothes

CLOTHES = {
    "theta": [
        "theta_{} [rad]",
        "Angle {} (rad)",
        "θ{} (radians)",
        "theta{}",
        "ball {} angle",
        "phi_{}",
        "angle_{}_rad",
    ],
    "x": ["x_{} [m]", "x{} (m)", "Position {} (m)", "ball_{}_x", "displacement of bob {} [metres]"],
}
TIMES = ["t [s]", "Time (s)", "time", "time_s", "Elapsed time (sec)", "Run 2: Time (s)", "TIME / s"]


@st.composite
def dressed(draw):
    """A strict CSV, and the same table with other labels, delimiter, quotes and encoding."""
    width, quantity = draw(st.integers(1, 4)), draw(st.sampled_from(["theta", "x"]))
    times = sorted(draw(st.sets(st.floats(-10.0, 1e3), min_size=1, max_size=20)))
    reading = st.one_of(st.just(NAN), st.floats(-1.5, 1.5))
    readings = draw(
        st.lists(st.lists(reading, min_size=width, max_size=width), min_size=len(times), max_size=len(times))
    )
    strict = csv_text(np.array(times), np.array(readings), quantity)
    delimiter = draw(st.sampled_from([",", ";", "\t", "|", "  "]))
    clothes = [c for c in CLOTHES[quantity] if delimiter.strip() or " " not in c.replace(" [", "").replace(" (", "")]
    pattern = draw(st.sampled_from(clothes))
    clocks = ["t [s]", "time"] if not delimiter.strip(" ") else TIMES
    labels = [draw(st.sampled_from(clocks)), *(pattern.format(i + 1) for i in range(width))]
    quoted = delimiter.strip() == delimiter and draw(st.booleans())
    comma = quoted or (delimiter != "," and draw(st.booleans()))
    missing = draw(st.sampled_from(["nan", "NA", "-"] + ([""] if delimiter.strip(" ") else [])))

    def field(value):
        text = value if isinstance(value, str) else missing if value != value else repr(value)
        text = text.replace(".", ",") if comma and not isinstance(value, str) else text
        return f'"{text}"' if quoted else text

    table = [labels, *([t, *row] for t, row in zip(times, readings, strict=True))]
    text = draw(st.sampled_from(["\n", "\r\n"])).join(delimiter.join(map(field, row)) for row in table)
    encodings = ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"] + ["cp1252"] * ("θ" not in text)
    return strict, text.encode(draw(st.sampled_from(encodings)))


@settings(max_examples=150, deadline=None, derandomize=True)
@given(dressed())
def test_a_strict_table_in_other_clothes_keeps_its_numbers(tmp_path_factory, tables):
    folder = tmp_path_factory.getbasetemp()
    strict, other = tables
    (folder / "strict.csv").write_text(strict, encoding="utf-8")
    expected, found = read_recording(folder / "strict.csv"), read(folder, other).recording
    assert found.quantity == expected.quantity
    assert np.array_equal(found.times, expected.times)
    assert np.array_equal(found.readings, expected.readings, equal_nan=True)
    assert read(folder, strict).strict and read(folder, strict).recording.data == strict.encode()


# What readings tell of themselves


def swings(duration=20.0, rate=60.0, period=1.1, bobs=2):
    """(t, θ): a cradle in which the end bobs take turns, with 1 mrad of noise."""
    t = np.arange(0.0, duration, 1.0 / rate)
    swing = 0.2 * np.exp(-t / 20.0) * np.cos(2.0 * np.pi * t / period)
    theta = np.zeros((len(t), bobs))
    theta[:, 0], theta[:, -1] = np.minimum(swing, 0.0), np.maximum(swing, 0.0)
    return t, theta + 1e-3 * np.random.default_rng(0).standard_normal(theta.shape)


@pytest.mark.parametrize("header, scale, unit", [("time", 1e3, "ms"), ("time", 1e6, "us"), ("t [ms]", 1.0, "s")])
def test_the_swing_tells_the_unit_of_time(tmp_path, header, scale, unit):
    t, theta = swings()
    text = f"{header},angle1,angle2\n" + rows((scale * t).tolist(), theta.tolist())
    if "[" in header:
        with pytest.raises(ExperimentError, match=f"seem to be in {unit}, not in ms: .* add --unit s, or --unit ms"):
            read(tmp_path, text)
        table = read(tmp_path, text, units=("s",))
    else:
        table = read(tmp_path, text)
        assert any(f"times are read in {unit}: in s a swing would take" in line for line in table.understood)
    assert table.recording.times == pytest.approx(t)
    assert "a swing takes 1.1 s: that of a pendulum of 0.3 m" in table.understood


@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_the_time_of_a_clock_is_counted_from_the_first_row(tmp_path, scale):
    t, theta = swings()
    clock = scale * (1732543200.0 + t)
    table = read(tmp_path, "timestamp,theta_1,theta_2\n" + rows(clock.tolist(), theta.tolist()))
    assert table.recording.times == pytest.approx(t, abs=1e-6)
    assert any("counted from the first row, 1732543200.0" in line for line in table.understood)
    assert not table.strict


def test_bobs_swing_no_farther_than_their_pendulum_is_long(tmp_path):
    """At 1.1 s, 0.3 m: 0.6 without a unit is no displacement in m, and 0.2 may be one."""
    t, theta = swings()
    with pytest.raises(
        ExperimentError, match=r"beyond the pendulum of 0.3 m that swings in 1.1 s; add --unit mm or cm"
    ):
        read(tmp_path, "t,x1,x2\n" + rows(t.tolist(), (3.0 * theta).tolist()))
    assert read(tmp_path, "t,x1,x2\n" + rows(t.tolist(), theta.tolist())).recording.quantity == "x"


def test_a_unit_that_the_user_states_stays(tmp_path):
    t, theta = swings()
    text = "t [s],theta_1,theta_2\n" + rows((1e3 * t).tolist(), theta.tolist())
    with pytest.raises(ExperimentError, match="add --unit ms, or --unit s if they are right"):
        read(tmp_path, text)
    assert read(tmp_path, text, units=("s",)).recording.times == pytest.approx(1e3 * t)


def test_milliseconds_in_a_strict_file_are_no_longer_strict(tmp_path):
    t, theta = swings()
    table = read(tmp_path, "t,theta_1 [rad],theta_2 [rad]\n" + rows((1e3 * t).tolist(), theta.tolist()))
    assert not table.strict and table.recording.times == pytest.approx(t)


@pytest.mark.parametrize("period", [0.2, 0.74, 1.1, 5.0])
def test_the_period_is_told_from_any_part_of_a_run(tmp_path, period):
    t, theta = swings(duration=30.0, period=period)
    for part in (slice(None), slice(500, 1700)):
        text = "t,theta_1,theta_2\n" + rows(t[part].tolist(), theta[part].tolist())
        assert swing_period(read(tmp_path, text).recording) == pytest.approx(period, rel=0.06)


def test_noise_has_no_period(tmp_path):
    for seed in range(20):
        noise = 1e-3 * np.random.default_rng(seed).standard_normal((200, 2))
        text = "t,theta_1,theta_2\n" + rows(np.arange(200.0).tolist(), noise.tolist())
        assert swing_period(read(tmp_path, text).recording) is None


def test_positions_in_the_picture_are_counted_from_the_median(tmp_path):
    t, theta = swings()
    x = 300.0 * theta + [500.0, 540.0]
    table = read(tmp_path, "t,x1 (mm),x2 (mm)\n" + rows(t.tolist(), x.tolist()))
    assert table.recording.absolute and any("median" in line for line in table.understood)
    assert np.abs(table.recording.displacements() - 0.3 * theta).max() < 2e-3


@pytest.mark.parametrize("bobs", [2, 5])
@pytest.mark.parametrize("part", [slice(None), slice(100, 900)])
def test_mirrored_readings_are_recognised(tmp_path, bobs, part):
    t, theta = swings(bobs=bobs)
    labels = ",".join(f"theta_{i + 1}" for i in range(bobs))
    recording = read(tmp_path, f"t,{labels}\n" + rows(t[part].tolist(), theta[part].tolist())).recording
    assert not is_mirrored(recording)
    assert is_mirrored(mirror_signs(recording))
    assert np.array_equal(mirror_signs(mirror_signs(recording)).readings, recording.readings)


def test_bobs_that_swing_together_or_alone_are_not_mirrored(tmp_path):
    t, theta = swings(bobs=1)
    together = theta + 1e-3 * np.random.default_rng(1).standard_normal((len(t), 3))
    for readings in (together, -together, theta, -theta):
        labels = ",".join(f"theta_{i + 1}" for i in range(readings.shape[1]))
        recording = read(tmp_path, f"t,{labels}\n" + rows(t.tolist(), readings.tolist())).recording
        assert not is_mirrored(recording)


# Real data, dressed as programs export them

real = pytest.mark.skipif(not DATA.is_dir(), reason="measured data are not at hand")


@real
@pytest.mark.parametrize(
    "kind", ["real-cradle-5", "real-pendulum", "reference/plain-3", "reference/frame-compliance-2"]
)
def test_measured_runs_are_read_in_other_clothes(kind, tmp_path):
    file = next((DATA / kind).glob("*.csv"))
    expected = read_recording(file)
    table = read_table(file)
    assert table.strict and not is_mirrored(table.recording)
    header, _, body = file.read_text(encoding="utf-8").partition("\n")
    other = re.sub(r"(theta|x)_(\d) \[(rad|m)\]", r"Ball \2 \1 (\3)", header.replace("t [s]", "Time (s)"))
    lines = body.replace(",", "\t").replace(".", ",").splitlines()
    lines[3:5], lines[7:7] = lines[4:2:-1], lines[7:8]
    other = "\n".join(["Exported", other.replace(",", "\t"), *lines, ""])
    found = read(tmp_path, other.encode("utf-16"))
    assert np.array_equal(found.recording.times, expected.times)
    assert np.array_equal(found.recording.readings, expected.readings, equal_nan=True)
    assert sum("sorted" in line or "dropped 1 row " in line for line in found.understood) == 2
