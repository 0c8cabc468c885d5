"""CSV of oscilloscopes: each maker's form gives the samples and the rate that were written, or a refusal in one line.

The forms are as public descriptions have them; the files here are written by this test.
"""

import numpy as np
import pytest

from identification.apparatus.contacts.trace import open_trace
from identification.storage.files import ExperimentError

RATE = 2.5e6
VOLTS = np.round(np.random.default_rng(3).uniform(-2.0, 2.0, 400), 4)
TIMES = np.arange(len(VOLTS)) / RATE - 2e-5


def columns(*values, separator=",", end=""):
    """A line for each sample."""
    return [
        separator.join(f"{v:.6e}" if isinstance(v, float) else str(v) for v in row) + end
        for row in zip(*values, strict=True)
    ]


def tektronix_tds():
    facts = [
        f"Record Length,{len(VOLTS):e}", f"Sample Interval,{1 / RATE:e}", "Trigger Point,1.25e+03", ",", "Source,CH1",
        "Vertical Units,V", "Vertical Scale,5.0e-01", "Horizontal Units,s", "Firmware Version,FV:v22.01",
    ]  # fmt: skip
    facts += [","] * (len(VOLTS) - len(facts))
    return [f"{fact},,{t:+.12f},{v:.4f}," for fact, t, v in zip(facts, TIMES, VOLTS, strict=True)]


def tektronix_dpo():
    head = ["Model,DPO4104B", "Firmware Version,3.18", "", "Waveform Type,ANALOG", "Point Format,Y"]
    head += ["Horizontal Units,s", f"Sample Interval,{1 / RATE:e}", f"Record Length,{len(VOLTS)}", "", "", "Label,,"]
    return [*head, "TIME,CH1", *columns(TIMES, VOLTS)]


def keysight():
    return ["x-axis,1", "second,Volt", *columns(TIMES, VOLTS)]


def rigol_ds1000z():
    head = ["X,CH1,Start,Increment", f"Sequence,Volt,{TIMES[0]:e},{1 / RATE:e}"]
    return [*head, *columns(range(len(VOLTS)), VOLTS, end=",,")]


def rigol_mso():
    return ["Time(s),CH1V", *columns(TIMES, VOLTS)]


def siglent():
    head = [f"Record Length,Analog:{len(VOLTS)}", f"Sample Interval,Analog:{1 / RATE:e}", "Vertical Units,CH1:V"]
    head += ["Vertical Scale,CH1:1.00", "Vertical Offset,CH1:0.00", "Horizontal Units,s", "Model Number,SDS1104X-E"]
    return [
        *head,
        "Serial Number,SDS00000",
        "Software Version,6.1",
        "Source,CH1",
        "Second,Volt",
        *columns(TIMES, VOLTS),
    ]


def lecroy():
    head = [
        "LECROYWR640Zi,61392,Waveform",
        f"Segments,1,SegmentSize,{len(VOLTS)}",
        "Segment,TrigTime,TimeSinceSegment1",
    ]
    return [*head, "#1,03-Apr-2024 14:53:22,0", "Time,Ampl", *columns(TIMES, VOLTS)]


def decimal_comma():
    return ["Zeit;Kanal A", "(s);(V)", "", *(line.replace(".", ",") for line in columns(TIMES, VOLTS, separator=";"))]


def spaces():
    return ["% time voltage", *columns(TIMES, VOLTS, separator="  ")]


def picoscope():
    return ["Time,Channel A", "(us),(mV)", "", *columns(1e6 * TIMES, 1e3 * VOLTS)]


FORMS = (
    tektronix_tds, tektronix_dpo, keysight, rigol_ds1000z, rigol_mso, siglent, lecroy, decimal_comma, spaces, picoscope,
)  # fmt: skip


def read(path, *arguments):
    trace = open_trace(path, *arguments)
    return np.concatenate(list(trace)), trace.rate


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"], ids=["LF", "CRLF"])
@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.__name__)
def test_each_maker(tmp_path, form, newline, encoding):
    path = tmp_path / "any.name"
    path.write_bytes(newline.join([*form(), ""]).encode(encoding))
    volts, rate = read(path, None)
    assert volts == pytest.approx(VOLTS, abs=1e-12)
    assert rate == pytest.approx(RATE, rel=1e-4)  # times have seven digits


def test_one_of_several_channels_is_chosen(tmp_path):
    path = tmp_path / "two.csv"
    path.write_text("\n".join(["x-axis,1,2", "second,Volt,Volt", *columns(TIMES, VOLTS, 0.1 * VOLTS)]))
    with pytest.raises(ExperimentError, match=r"2 of them channels \(1, 2\); say which to read: --channel 1"):
        read(path, None)
    assert read(path, None, 1)[0] == pytest.approx(VOLTS)
    assert read(path, None, 2)[0] == pytest.approx(0.1 * VOLTS, abs=1e-6)
    with pytest.raises(ExperimentError, match="no channel 3; it has 2"):
        read(path, None, 3)


def test_a_long_file_is_read_whole(tmp_path):
    """Longer than the head from which its form is determined."""
    long, path = np.tile(VOLTS, 250), tmp_path / "long.csv"
    path.write_text("\n".join(["Time(s),CH1V", *columns(np.arange(len(long)) / RATE, long)]))
    assert path.stat().st_size > 2 << 20
    assert read(path, RATE)[0] == pytest.approx(long, abs=1e-12)


@pytest.mark.parametrize("lost", [20, 99_000])
@pytest.mark.parametrize("rows", [3000, 150_000])
def test_a_gap_is_refused_wherever_it_is(tmp_path, rows, lost):
    """Samples are missing behind the rows from which the rate is taken; also where a file is read in pieces."""
    times, path = np.arange(rows + 2000.0) / RATE, tmp_path / "gap.csv"
    times[rows:] += lost / RATE
    path.write_text("\n".join(["Time(s),CH1V", *columns(times, np.zeros(len(times)))]))
    with pytest.raises(ExperimentError, match="as at a gap or another segment"):
        read(path, None)
    assert len(read(path, RATE)[0]) == len(times)  # a user who states the rate knows better


@pytest.mark.parametrize("start", [0.0, 9.9e-4, 9.98313e-3])
@pytest.mark.parametrize("interval", [3e-10, 4e-10, 1e-9])
def test_times_with_few_digits_are_no_gap(tmp_path, start, interval):
    """Six digits: beyond 1 ms the times are tens of samples apart, ten times more beyond 10 ms."""
    times, path = start + np.arange(60_000) * interval, tmp_path / "rounded.csv"
    path.write_text("\n".join(["Time(s),CH1V", *(f"{t:.5e},0.5" for t in times)]))
    volts, rate = read(path, None)
    assert len(volts) == len(times) and rate == pytest.approx(1.0 / interval, rel=3e-3)


@pytest.mark.parametrize(
    ("head", "separator", "scale", "clock"),
    [
        ("Time (ms),CH1 (mV)", ",", 1e-3, 1e-3),
        ("t/ms,U/mV", ",", 1e-3, 1e-3),
        ("Time_us,CH1_mV", ",", 1e-3, 1e-6),
        ("in s,C1 in V", ",", 1.0, 1.0),
        ('"Time, ms";"CH1, mV"', ";", 1e-3, 1e-3),
        ("Time (msec);CH1 (mV) (X10)", ";", 1e-3, 1e-3),
        ("# Time (ms)  CH1 (mV)", "  ", 1e-3, 1e-3),
        ("Delay (ms),0\nTime,CH1", ",", 1.0, 1.0),
        ("Bandwidth limit (MHz),20\nTime (s),CH1 (V)", ",", 1.0, 1.0),
        ("# a comment,Gain (dB)\nTime,Amp", ",", 1.0, 1.0),
        ("Time,Channel (A)\n(ms),(mV)", ",", 1e-3, 1e-3),
        ("Time,A", ",", 1.0, 1.0),
    ],
)
def test_units_beside_the_samples_count_and_no_others(tmp_path, head, separator, scale, clock):
    path = tmp_path / "t.csv"
    path.write_text("\n".join([head, *columns(TIMES, VOLTS, separator=separator)]))
    volts, rate = read(path, None)
    assert volts == pytest.approx(scale * VOLTS)
    assert rate == pytest.approx(RATE / clock, rel=1e-4)


def test_a_single_column_has_a_unit_too(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("\n".join(["CH1 (mV)", *map(str, VOLTS)]))
    assert read(path, RATE)[0] == pytest.approx(1e-3 * VOLTS)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["Frequency,Channel A", "(MHz),(dBu)", *columns(TIMES, VOLTS)], "has 'dBu' where a voltage should be"),
        (["Hz,V", *columns(TIMES, VOLTS)], "has 'Hz' where a time should be"),
        (["in s,C2 in mA", *columns(TIMES, VOLTS)], "has 'mA' where a voltage should be"),
        ([line.replace("Units,V", "Units,A") for line in tektronix_tds()], "has 'A' where a voltage should be"),
        (["Time (min),CH1", *columns(TIMES, VOLTS)], "times are in 'min', an unknown unit; give --rate"),
        (
            ["Time,A", "(ms),(mV)", *columns(TIMES, VOLTS)[:200], f"{TIMES[200]:.6e},∞"],
            "is no sample; the voltage was out of range",
        ),
        (["t,V", *(f"{k // 1500},1" for k in range(4000))], "rounded too much; give --rate"),
        ([], "no line of numbers"),
        (["Model,DPO4104", "TIME,CH1"], "no line of numbers"),
        ([line.replace("Segments,1", "Segments,3") for line in lecroy()], "holds 3 segments"),
        (
            [line.replace(f"Analog:{1 / RATE:e}", "Analog:1e-3") for line in siglent()],
            "states 0.001 s between samples, but its times",
        ),
        (["t,V", "0,1", "1,1", "1,2", "0,2", "1,1"], "times do not grow"),
        ([*keysight()[:300], "9.92e-05,", *keysight()[301:]], "line 301: '9.92e-05,' is no sample"),
        ([*keysight()[:-1], keysight()[-1][:13]], "line 402: .* is no sample"),  # cut off
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path, lines, said):
    path = tmp_path / "t.csv"
    path.write_text("\n".join(lines))
    with pytest.raises(ExperimentError, match=said) as refused:
        read(path, None)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.__name__)
def test_whatever_happens_to_a_file_it_is_read_or_refused(tmp_path, form):
    """Bytes changed, lost and repeated, 60 times: samples of finite voltage, or one line."""
    rng, whole, path = np.random.default_rng(1), "\n".join(form()).encode(), tmp_path / "t.csv"
    for _ in range(60):
        data = bytearray(whole)
        for _ in range(rng.integers(1, 20)):
            data[rng.integers(len(data))] = rng.integers(256)
        begin, end = np.sort(rng.integers(len(data), size=2))
        kind = rng.integers(4)
        data = {0: data, 1: data[:begin], 2: data[:begin] + data[end:], 3: data[:end] + data[begin:]}[int(kind)]
        path.write_bytes(bytes(data))
        try:
            volts, rate = read(path, None)
        except ExperimentError as refused:
            assert "\n" not in str(refused)
        else:
            assert np.isfinite(volts).all() and rate > 0.0
