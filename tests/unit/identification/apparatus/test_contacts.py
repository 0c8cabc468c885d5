"""Contact resistance: traces of contacts that are known are decoded, whatever noise, offset, edges and file."""

import json
import wave

import numpy as np
import pytest

from cradle_env import Cradle
from identification.apparatus import Circuit, measure_contacts
from identification.apparatus.contacts import trace as reading
from identification.cli.app import main
from identification.storage.schema import read_json
from tests.reference.impact_chain import MASS, collide
from tests.reference.oscilloscope import RATE, SUPPLY, schedule, trace


def decoded(path, volts, bobs, **options):
    np.save(path, volts)
    return measure_contacts([path], Circuit.binary(bobs, SUPPLY), rate=RATE, **options)


def check(measured, found):
    """All contacts are found with their pairs; (errors, their standard deviations) of the durations, in samples."""
    contacts = measured.traces[0].contacts
    true = sorted(found, key=lambda one: (one[1], one[0]))
    assert [(c.pair - 1) for c in contacts] == [pair for pair, _, _ in true]
    assert not any(contact.ambiguous for contact in contacts)
    errors = np.array([c.duration * RATE - (b - a) for c, (_, a, b) in zip(contacts, true, strict=True)])
    return errors, np.array([c.duration_sd * RATE for c in contacts])


def test_levels_are_a_binary_code_of_the_pairs_that_touch():
    levels = Circuit.binary(4, 5.0).levels
    for state, level in enumerate(levels):
        assert 5.0 * 22.0 / level - 22.0 == pytest.approx(11.0 * (7 - state))


@pytest.mark.parametrize(
    "fault",
    [
        {},
        {"gain": 1.02, "offset": 0.03},
        {"bits": 8, "gain": 0.98},
        {"closing": 20.0, "opening": 8.0},
    ],
    ids=["plain", "gain and offset", "8 bits", "slow contacts"],
)
def test_contacts_of_five_bobs_are_told_with_their_durations(tmp_path, fault):
    """Noise of 0.1 % of the supply. A grain of 8 bits, 24 mV, is two thirds of the smallest step."""
    found, samples = schedule(120, 4, 4000, 600, seed=3)
    errors, spreads = check(
        decoded(tmp_path / "t.npy", trace(found, 4, samples, noise=0.005, seed=5, **fault), 5), found
    )
    assert np.median(np.abs(errors)) < 1.0 and np.sqrt(np.mean(errors**2)) < (1.0 if not fault.get("closing") else 4.0)
    assert 0.4 < np.sqrt(np.mean((errors / spreads) ** 2)) < 2.5


def test_noise_that_hides_the_smallest_step_is_owned_up_to(tmp_path):
    """0.4 % of the supply against a step of 0.74 %: the standard deviation must grow with the error."""
    found, samples = schedule(120, 4, 4000, 600, seed=3)
    errors, spreads = check(decoded(tmp_path / "t.npy", trace(found, 4, samples, noise=0.02, seed=6), 5), found)
    assert np.abs(errors).max() > 3.0
    assert np.quantile(np.abs(errors) / spreads, 0.9) < 3.0
    with pytest.raises(ValueError, match="drowns levels"):
        decoded(tmp_path / "t.npy", trace(found, 4, samples, noise=0.5, seed=6), 5)


@pytest.mark.parametrize("block", [5_000, 40_001])
def test_what_is_read_in_parts_is_read_as_in_one(tmp_path, monkeypatch, block):
    found, samples = schedule(60, 2, 3000, 600, seed=1)
    volts = trace(found, 2, samples, noise=0.005, seed=2)
    whole = decoded(tmp_path / "t.npy", volts, 3).traces[0].contacts
    monkeypatch.setattr(reading, "BLOCK", block)
    parts = decoded(tmp_path / "t.npy", volts, 3).traces[0].contacts
    assert [c.pair for c in parts] == [c.pair for c in whole]
    # Noise and edges are measured on the first block.
    assert np.abs([RATE * (a.start - b.start) for a, b in zip(parts, whole, strict=True)]).max() < 1.0


def test_formats(tmp_path):
    found, samples = schedule(5, 1, 3000, 600, seed=1)
    volts = np.round(trace(found, 1, samples, noise=0.005, seed=2) / 2e-4) * 2e-4
    files = {name: tmp_path / f"t.{name}" for name in ("npy", "csv", "raw", "wav")}
    np.save(files["npy"], volts)
    rows = (f"{k / RATE:.12g};{v:.4f}".replace(".", ",") for k, v in enumerate(volts))
    files["csv"].write_text("\n".join(["Model;XY", "Time;Volt", *rows]), encoding="utf-8")
    head = {"rate": RATE, "dtype": "<i2", "scale": 2e-4, "offset": 0.0}
    files["raw"].write_bytes(json.dumps(head).encode() + b"\n" + np.round(volts / 2e-4).astype("<i2").tobytes())
    with wave.open(str(files["wav"]), "wb") as file:  # a tenth of the voltage, as ±1 is full scale
        file.setparams((1, 4, 48000, 0, "NONE", ""))
        file.writeframes(np.round(0.1 * volts * 2**31).astype("<i4").tobytes())
    contacts = {
        name: measure_contacts([path], Circuit.binary(2, SUPPLY * (0.1 if name == "wav" else 1.0)), rate=RATE)
        for name, path in files.items()
    }
    starts = {name: [c.start * RATE for c in one.traces[0].contacts] for name, one in contacts.items()}
    for name in files:
        assert len(starts[name]) == len(found)
        assert starts[name] == pytest.approx(starts["npy"], abs=0.1), name
    assert measure_contacts([files["csv"]], Circuit.binary(2, SUPPLY)).traces[0].decoded.rate == pytest.approx(RATE)


def test_the_first_impact_is_told_from_those_that_follow(tmp_path):
    """Three bobs in touch while one impact passes; two at a time afterwards."""
    found = [(0, 4000, 9000), (1, 4400, 9300), (0, 20000, 25000), (1, 30000, 35000)]
    measured = decoded(tmp_path / "t.npy", trace(found, 2, 40000, noise=0.005), 3)
    assert [c.most for c in measured.traces[0].contacts] == [3, 3, 2, 2]
    assert measured.constraint() is None  # no speed is stated
    assert any("joins 3 bobs; none of the 2 contacts after" in finding for finding in measured.findings)


def test_k_f_from_durations(tmp_path):
    """Contacts that SciPy integrates, at 1 GS/s, speeds known to 0.02 %: k_f within 4 standard deviations."""
    k_f, rate, rng = 18000.0, 1e9, np.random.default_rng(4)
    files, speeds = [], []
    for k, speed in enumerate((0.15, 0.4, 0.9)):
        length = collide(2, speed, k_f)[1] * rate
        volts = trace([(0, 5000, 5000 + round(length))], 1, 10000 + round(length), noise=0.005, rate=rate, seed=k)
        files.append(tmp_path / f"{k}.npy")
        np.save(files[-1], volts)
        speeds.append(speed * (1.0 + 2e-4 * rng.standard_normal()))
    measured = measure_contacts(
        files, Circuit.binary(2, SUPPLY), Cradle(mass=MASS), rate=rate, speeds=speeds, speed_sd=1e-4
    )
    value = measured.values["k_f"]
    assert abs(value.median - k_f) < 4.0 * value.sd
    assert value.sd < 0.1 * k_f
    constraint = measured.constraint()
    assert constraint.quantities[0].startswith("contact_duration[")
    # A k_f that is 2 sd off gives a duration that is 2 sd off; a right one lies within 4 sd.
    off = [abs(constraint.residuals(Cradle(mass=MASS, k_f=value.median + n * value.sd))[0]) for n in (0.0, 2.0)]
    assert off == pytest.approx([0.0, 2.0], abs=0.1)
    assert abs(constraint.residuals(Cradle(mass=MASS, k_f=k_f))[0]) < 4.0


def test_the_command_writes_a_table(tmp_path, capsys):
    found, samples = schedule(10, 2, 3000, 600, seed=1)
    np.save(tmp_path / "t.npy", trace(found, 2, samples, noise=0.005))
    out = tmp_path / "out"
    arguments = ["contacts", str(tmp_path / "t.npy"), "--bobs", "3", "--supply", str(SUPPLY), "--rate", str(RATE)]
    for _ in range(2):  # its own results are replaced
        assert main(["measure", *arguments, "--out", str(out)]) == 0
    assert read_json(out / "measurement.json", "measurement")["details"]["traces"][0]["contacts"] == 10
    rows = (out / "contacts.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 11 and rows[0].startswith("trace,pair,start [s]")
    (out / "contacts.csv").write_text("mine", encoding="utf-8")
    assert main(["measure", *arguments, "--out", str(out)]) == 2
    assert "contacts.csv: exists and is no result" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("t.csv", b"", "no line of numbers"),
        ("t.csv", b"1,2,3\n1,2,3\n", "3 columns, 2 of them channels"),
        ("t.csv", b"0,1\n1,1\n3,1\n", "not evenly sampled"),
        ("t.csv", b"0,1\n1,1\n2,x\n", "no sample"),
        ("t.csv", b"0,1\n1,1\n2,1\n", "too few"),
        ("t.npy", b"\x93NUMPY", "no NumPy array"),
        ("t.npy", b"", "no line of numbers"),
        ("t.npy", b"\x93NUMPY\x01\x00\x10\x00{'descr': '<f8(\n" + bytes(80), "no NumPy array"),
        ("t.raw", b"{\x01\n", "no header"),
        ("t.raw", b'{"rate": 1, "dtype": "<i2"}\n\x00', "cut off"),
        ("t.wav", b"RIFF", "no WAV file"),
        ("t.isf", b":WFMPRE:BYT_NR 2;", "a format of one maker"),
        ("t.txt", b"1\n2\n", "states no sampling rate"),
    ],
)
def test_traces_that_cannot_be_used_are_refused_in_one_line(tmp_path, capsys, name, content, said):
    (tmp_path / name).write_bytes(content)
    arguments = ["contacts", str(tmp_path / name), "--bobs", "3", "--supply", "5", "--out", str(tmp_path / "out")]
    assert main(["measure", *arguments]) == 2
    told = capsys.readouterr().err
    assert said in told and told.count("\n") == 1
