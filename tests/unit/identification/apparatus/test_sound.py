"""Sound: clicks at known instants are found in recordings that share no code with the package."""

import json
import sys

import numpy as np
import pytest
import soundfile

from identification.apparatus import measure_sound
from identification.apparatus.sound.whitening import whiten
from identification.cli.app import main
from identification.experiment.click_groups import click_impacts
from identification.storage.schema import read_json
from studies.sound.judge import groups
from tests.reference.click_sound import record

#: Two bobs of 0.3 m: a click in each half swing, of which the first are 1 % longer; their speeds fall.
INSTANTS = 1.2345678 + np.cumsum(0.557 + 0.005 * np.exp(-np.arange(20) / 5.0))
SPEEDS = 0.35 * np.exp(-0.08 * np.arange(20))
SECONDS = 14.0


def written(path, sound, rate):
    """OGG is written in blocks: libsndfile encodes on the stack."""
    with soundfile.SoundFile(str(path), "w", rate, 1) as file:
        for first in range(0, len(sound), 4096):
            file.write(sound[first : first + 4096])
    return path


def errors_of(clicks, instants=INSTANTS):
    """Errors [s] of the clicks nearest to the instants, less what they have in common; number of other clicks."""
    apart = clicks.instants[:, None] - instants
    nearest = np.abs(apart).argmin(axis=0)
    errors = apart[nearest, np.arange(len(instants))]
    return errors - np.median(errors), len(clicks.instants) - len({*nearest.tolist()})


@pytest.mark.parametrize(
    ("name", "rate", "background", "snr"),
    [("a.wav", 48000, "hiss", 40.0), ("a.flac", 44100, "music", 30.0), ("a.ogg", 44100, "music", 30.0)],
)
def test_every_click_is_found_to_a_sample_or_two(tmp_path, name, rate, background, snr):
    """The contact times of these speeds differ by 20 µs; one sample is 21 µs."""
    sound = record(INSTANTS, SPEEDS, SECONDS, rate=rate, background=background, snr=snr, seed=3)
    measured = measure_sound(written(tmp_path / name, sound, rate))
    errors, others = errors_of(measured.clicks)
    assert others == 0 and not measured.clicks.doubtful.any()
    assert np.abs(errors).max() < 60e-6 and np.sqrt(np.mean(errors**2)) < 25e-6
    assert measured.half_swing == pytest.approx(np.median(np.diff(INSTANTS)), abs=2e-3)


def test_amplitudes_follow_the_speeds(tmp_path):
    """Pressure grows as v over the contact time, v^1.2: Hertz."""
    sound = record(INSTANTS, SPEEDS, SECONDS, snr=50.0, seed=4)
    clicks = measure_sound(written(tmp_path / "a.wav", sound, 48000)).clicks
    slope = np.polyfit(np.log(SPEEDS), np.log(clicks.amplitudes), 1)[0]
    assert 1.0 < slope < 1.4


def test_what_is_no_click_of_the_cradle_is_doubtful(tmp_path):
    """Louder clicks of something else, at odds with the sequence, one of them 40 ms before one of the cradle's."""
    odd = np.array([3.01, 7.777, INSTANTS[14] - 0.2])
    both = np.concatenate([INSTANTS, odd])
    speeds = np.concatenate([SPEEDS, [0.3, 0.3, 0.3]])
    sound = record(both, speeds, SECONDS, snr=40.0, seed=5)
    clicks = measure_sound(written(tmp_path / "a.wav", sound, 48000)).clicks
    errors, _ = errors_of(clicks)
    assert np.abs(errors).max() < 60e-6
    assert clicks.doubtful.sum() == 3
    assert np.abs(clicks.instants[clicks.doubtful] - np.sort(odd)).max() < 2e-3


def test_clicks_sink_into_noise_one_by_one(tmp_path):
    """Noise alone may give no sequence, and what is found in loud noise is of the loudest clicks."""
    sound = record(INSTANTS, SPEEDS, SECONDS, snr=16.0, seed=6)
    clicks = measure_sound(written(tmp_path / "a.wav", sound, 48000)).clicks
    near = np.abs(clicks.instants[:, None] - INSTANTS).min(axis=1) < 2e-3
    assert (near | clicks.doubtful).all()
    assert 3 <= near.sum() < len(INSTANTS)


def test_blocks_make_no_difference():
    """One block or many: a recording is read in one pass, whatever its length."""
    rng = np.random.default_rng(0)
    sound = rng.standard_normal(48000 * 3)
    one, many = ([*whiten(blocks, 48000)] for blocks in ([sound], np.array_split(sound, 37)))
    for first, second in zip(one, many, strict=True):
        assert first.start == second.start and np.array_equal(first.whitened, second.whitened)
    middle = np.concatenate([stretch.whitened for stretch in one])[24000:-24000]
    # 10.5 kHz of 24 kHz are in the band, and the median of 17 powers scatters.
    assert np.var(middle) == pytest.approx(10.5 / 24.0, rel=0.1)


def test_impacts_group_as_an_independent_rule_has_them():
    rng = np.random.default_rng(1)
    instants = np.sort(rng.uniform(0.0, 10.0, 200))
    speeds = rng.uniform(0.01, 0.4, 200)
    # The rule of the study rounds 0.6 s for 60 dB to no time constant of 87 ms: compare where that does not matter.
    assert np.mean(np.isin(groups(instants, speeds)[0], instants[click_impacts(instants, speeds)])) > 0.97


def test_the_command_writes_clicks_and_the_report(tmp_path, capsys):
    sound = record(INSTANTS, SPEEDS, SECONDS, snr=40.0, seed=3)
    path, out = written(tmp_path / "a.wav", sound, 48000), tmp_path / "out"
    assert main(["measure", "sound", str(path), "--out", str(out)]) == 0
    assert "20 clicks" in capsys.readouterr().out
    content = read_json(out / "measurement.json", "measurement")
    assert content["kind"] == "sound" and content["details"]["doubtful"] == 0
    assert json.loads((out / "measurement.json").read_text())["values"]["half_swing"]["unit"] == "s"
    rows = np.genfromtxt(out / "clicks.csv", delimiter=",", skip_header=1)
    assert rows.shape == (20, 7)


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"no sound", "cannot be read as sound"), (None, "no such file")],
)
def test_files_that_are_no_sound_are_refused_in_one_line(tmp_path, capsys, content, words):
    path = tmp_path / "a.wav"
    if content is not None:
        path.write_bytes(content)
    assert main(["measure", "sound", str(path), "--out", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err


def test_silence_and_slow_sampling_are_refused(tmp_path):
    with pytest.raises(ValueError, match="nothing clicks"):
        measure_sound(written(tmp_path / "s.wav", np.zeros(48000), 48000))
    with pytest.raises(ValueError, match="4000 samples a second"):
        measure_sound(written(tmp_path / "t.wav", np.zeros(4000), 4000))


def test_a_missing_extra_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "soundfile", None)
    assert main(["measure", "sound", str(tmp_path / "a.wav"), "--out", str(tmp_path / "out")]) == 2
    assert "pip install 'newtons-cradle[audio]'" in capsys.readouterr().err
