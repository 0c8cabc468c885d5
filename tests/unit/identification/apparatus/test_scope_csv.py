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


@pytest.mark.parametrize("lost", [40, 99_000])
def test_a_gap_is_refused_wherever_it_is(tmp_path, lost):
    """Samples are missing behind the rows from which the rate is taken; also where a file is read in pieces."""
    for rows in (3000, 150_000):
        times, path = np.arange(rows + 2000.0) / RATE, tmp_path / "gap.csv"
        times[rows:] += lost / RATE
        path.write_text("\n".join(["Time(s),CH1V", *columns(times, np.zeros(len(times)))]))
        with pytest.raises(ExperimentError, match="as at a gap or another segment"):
            read(path, None)
        assert len(read(path, RATE)[0]) == len(times)  # a user who states the rate knows better


def test_times_with_few_digits_are_no_gap(tmp_path):
    """Six digits: beyond 1 ms the times are 25 samples of 0.4 ns apart."""
    times, path = 9.9e-4 + np.arange(60_000) * 4e-10, tmp_path / "rounded.csv"
    path.write_text("\n".join(["Time(s),CH1V", *(f"{t:.5e},0.5" for t in times)]))
    volts, rate = read(path, None)
    assert len(volts) == len(times) and rate == pytest.approx(2.5e9, rel=0.01)


@pytest.mark.parametrize(
    ("labels", "scale"),
    [("Time (ms),CH1 (mV)", 1e-3), ("t [s],U [V]", 1.0), ("s,V", 1.0), ("Time,A", 1.0), ("Second,Volt", 1.0)],
)
def test_units_of_voltages_count(tmp_path, labels, scale):
    path = tmp_path / "t.csv"
    path.write_text("\n".join([labels, *columns(TIMES, VOLTS)]))
    volts, rate = read(path, None)
    assert volts == pytest.approx(scale * VOLTS)
    assert rate == pytest.approx(RATE / (1e-3 if "ms" in labels else 1.0), rel=1e-4)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["Frequency,Channel A", "(MHz),(dBu)", *columns(TIMES, VOLTS)], "samples are in dbu, not in V"),
        (["Hz,V", *columns(TIMES, VOLTS)], "is a spectrum, against hz"),
        (["Time (s),CH2 (A)", *columns(TIMES, VOLTS)], "samples are in a, not in V"),
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
