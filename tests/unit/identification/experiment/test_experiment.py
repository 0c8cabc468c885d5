"""Experiments in: what loads, what comes back, and that everything else is refused in one line."""

import dataclasses
import math
import os
import re

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cradle_env.cradle import Cradle
from cradle_env.release import Release
from identification.experiment.csv_file import read_recording
from identification.experiment.experiment import Experiment, ExperimentError, Prior, ReleaseInfo
from identification.experiment.noise import estimate_correlation, estimate_noise, noise_gap_bound
from identification.experiment.run import Run, Tracking
from identification.experiment.scaffold import scaffold
from identification.storage.files import write_together
from tests.reference.laboratory import correlated_noise

TOML = """\
format = "cradle-experiment/1"
[cradle]
bobs = 3
mass = 0.2813
[model]
base = "nsp"
effects = []
[[run]]
file = "run1.csv"
release = { bobs = 1, angle = 0.228 }
noise = 0.001
"""
CSV = "t [s],theta_1 [rad],theta_3 [rad]\n0.0,0.001,0.228\n0.1,nan,0.2\n0.2,,0.1\n"


@pytest.fixture
def load(tmp_path):
    def load(toml=TOML, csv=CSV):
        for name, content in (("experiment.toml", toml), ("run1.csv", csv)):
            (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        return Experiment.load(tmp_path / "experiment.toml")

    return load


def edit(old, new="", text=TOML):
    assert old in text
    return text.replace(old, new)


def infer(line):
    return f"{TOML}[infer]\n{line}\n"


def test_a_plain_experiment(load):
    experiment = load()
    (run,) = experiment.runs
    assert experiment.cradle == Cradle(bobs=3, mass=0.2813)
    assert run.release == ReleaseInfo(Release(angle=0.228, bobs=1))
    assert (run.noise, run.delta, run.fit_from, run.fit_to, run.state, run.rest) == (
        0.001, 0.0, 0.0, None, "release", "known",
    )  # fmt: skip
    expected = [[0.001, np.nan, 0.228], [np.nan, np.nan, 0.2], [np.nan, np.nan, 0.1]]
    assert np.array_equal(run.readings, expected, equal_nan=True)
    assert run.times.tolist() == [0.0, 0.1, 0.2]
    assert run.bobs_seen == (1, 3)


@pytest.mark.parametrize(
    ("header", "unit", "scale"),
    [("theta_1", "rad", 1.0), ("theta_1 [deg]", "deg", np.pi / 180), ("x_1", "m", 1.0), ("x_1[mm]", "mm", 1e-3),
     ("x_1 [ cm ]", "cm", 1e-2)],
)  # fmt: skip
def test_units(load, header, unit, scale):
    run = load(csv=f"t [ms],{header}\n0,0.02\n10,0.03\n").runs[0]
    assert run.times == pytest.approx([0.0, 0.010])
    assert run.readings[:, 0] == pytest.approx([0.02 * scale, 0.03 * scale])
    assert (run.unit, run.scale, run.quantity) == (unit, scale, header.partition("_")[0])
    assert run.noise == pytest.approx(0.001 * scale)


def test_tracking_noise_is_in_the_unit_of_the_file_and_comes_back(load):
    toml = edit("noise = 0.001", "tracking = { ratio = 0.5, place = 0.2, speed = 3.0 }")
    experiment = load(toml, "t [s],x_1 [cm]\n0,2.0\n1,2.1\n")
    assert experiment.runs[0].tracking == Tracking(0.5, 0.002, 0.03)
    again = Experiment.from_texts(experiment.texts())
    assert again.runs[0].tracking == experiment.runs[0].tracking


@pytest.mark.parametrize(
    "csv",
    ["\ufeff" + CSV, CSV.replace("\n", "\r\n"), CSV.replace("\n", "\r"), "# comment\n\n" + CSV + "# the end\n,,\n\n",
     CSV.replace(",", " , "), CSV.replace(",", "\t"), CSV.replace(",", ";").replace(".", ","),
     CSV.replace("\n", ",\n")],
    ids=["bom", "crlf", "cr", "comments", "spaces", "tabs", "decimal commas", "trailing delimiter"],
)  # fmt: skip
def test_spellings_of_one_file(load, csv):
    assert np.array_equal(load(csv=csv).runs[0].readings, load().runs[0].readings, equal_nan=True)


TRACKER_1 = "mass_A\nt\tx\ty\n0.000E0\t2.0E-2\t-0.3\n1.0E-1\t1.0E-2\t-0.3\n2.0E-1\t\t\n"
TRACKER_2 = "#multi:\n\tmass B\t\tmass A\t\t\nt\tx\ty\tx\ty\t\n0\t0.02\t0\t0.01\t0\n0.1\t0.03\t0\n"


@pytest.mark.parametrize(
    ("csv", "times", "readings"),
    [(TRACKER_1, [0.0, 0.1], [[0.02, np.nan, np.nan], [0.01, np.nan, np.nan]]),
     (TRACKER_2, [0.0, 0.1], [[0.01, 0.02, np.nan], [np.nan, 0.03, np.nan]]),
     (TRACKER_1 + "\nmass_C\nt\tx\ty\n0\t0.03\t0\n0.3\t0.02\t0\n", [0.0, 0.1, 0.3],
      [[0.02, np.nan, 0.03], [0.01, np.nan, np.nan], [np.nan, np.nan, 0.02]]),
     ("ball 2\t\t\tball 3\nt\tx\ty\tt\tx\ty\n0\t0,01\t0\t0\t0,02\t0\n", [0.0], [[np.nan, 0.01, 0.02]])],
    ids=["one mass", "#multi", "tables in a row", "tables side by side"],
)  # fmt: skip
def test_tracker_exports(tmp_path, csv, times, readings):
    (tmp_path / "run1.csv").write_text(csv)
    found = read_recording(tmp_path / "run1.csv", 3)
    assert found.quantity == "x" and found.absolute
    assert found.times == pytest.approx(times)
    assert np.array_equal(found.readings, readings, equal_nan=True)


def test_a_common_origin_leaves_the_rest_open(load):
    """Tracker counts x from one origin: no bob is known to rest there."""
    one = load(csv=TRACKER_1).runs[0]
    assert one.rest == "free"
    with pytest.raises(
        ExperimentError, match=r'line 12.*run\[1\].rest.*from one origin for all bobs; write rest = "free"'
    ):
        load(edit("noise = 0.001", 'noise = 0.001\nrest = "known"'), TRACKER_1)
    alone = load(edit("bobs = 3", "bobs = 1", edit("noise = 0.001", 'noise = 0.001\nrest = "known"')), TRACKER_1)
    assert alone.runs[0].rest == "known"


def test_a_free_rest_is_that_of_the_readings(load):
    """Tracker counts x from a common origin; what is then unknown of the rest position is what the median leaves."""
    export = "mass_A\nt\tx\ty\n" + "".join(f"{k}\t{0.25 + x}\t-0.3\n" for k, x in enumerate((-0.05, 0.0, 0.04)))
    free = edit("noise = 0.001", 'noise = 0.001\nrest = "free"', edit("bobs = 3", "bobs = 1"))
    run = load(free, export).runs[0]
    assert run.readings[:, 0] == pytest.approx([-0.05, 0.0, 0.04])
    assert run.angles(Cradle(bobs=1, length=0.3))[0, 0] == pytest.approx(-math.asin(0.05 / 0.3))


@pytest.mark.parametrize(
    ("rate", "missing", "sigma"), [(60, 0.0, 1e-3), (60, 0.2, 1e-3), (30, 0.0, 3e-4), (15, 0.0, 1e-3)]
)
def test_the_noise_is_told_from_the_swing(rate, missing, sigma):
    """Third differences alone, over gaps too, say 1, 1.7, 1.25 and 3 times as much."""
    rng = np.random.default_rng(1)
    times = np.arange(1800) / rate
    readings = 0.228 * np.sin(2.0 * np.pi * times / 1.1) + sigma * rng.standard_normal(len(times))
    readings[rng.random(len(times)) < missing] = np.nan
    # The median of 500 independent differences scatters by 4 %; a higher order is taken only if a tenth lower.
    assert estimate_noise(Run(times, readings[:, None], state="free")) == pytest.approx(sigma, rel=0.2)


def test_the_noise_is_that_of_what_may_be_fitted():
    """Before, a hand holds the bob; later readings are held out, and choose nothing."""
    rng = np.random.default_rng(1)
    times = np.arange(-600, 1200) / 60.0
    shaken = np.where((times < 0.0) | (times > 12.0), 0.03, 1e-3) * rng.standard_normal(len(times))
    run = Run(times, (0.2 * np.sin(6.0 * times) + shaken)[:, None], state="free", fit_from=0.0, fit_to=12.0)
    assert estimate_noise(run) == pytest.approx(1e-3, rel=0.2)


def test_bobs_that_are_lost_before_the_window_are_not_seen():
    readings = np.full((100, 2), 0.1)
    readings[40:, 0] = np.nan
    run = Run(np.arange(100) / 10.0, readings, state="free")
    assert run.bobs_seen == (1, 2)
    assert dataclasses.replace(run, fit_from=5.0).bobs_seen == (2,)


def test_a_window_begins_with_the_first_reading():
    """For from there on there is a first peak."""
    run = Run(12.0 + np.arange(100) / 10.0, np.full((100, 1), 0.1), state="free", fit_from=0.0)
    assert run.fit_from == 12.0


def test_correlated_noise_passes_its_gap_once_in_a_hundred_times():
    rho, n = 0.5, 200
    run = Run(np.arange(n) / 60, np.full((n, 1), 0.1), state="free")
    noise = correlated_noise((n, 20_000), -1.0 / np.log(rho), np.random.default_rng(3))
    over = np.sqrt(np.mean(noise**2, axis=0))
    limit = noise_gap_bound((run,), [np.ones(n, bool)], [(1.0 + rho) / (1.0 - rho)])
    # As white noise it would be passed by 4 %; a χ² of as many fewer readings is not quite theirs.
    assert np.mean(over > limit) == pytest.approx(0.01, abs=0.003)
    assert np.mean(over > noise_gap_bound((run,), [np.ones(n, bool)])) > 0.03


def test_noise_alone_passes_its_gap_once_in_a_hundred_times():
    run = Run(np.arange(60) / 60, np.where(np.arange(60) < 50, 0.1, np.nan)[:, None], state="free")
    noise = np.random.default_rng(3).standard_normal((40_000, 50))
    limit = noise_gap_bound((run,), [np.ones(60, bool)])  # missing readings do not count
    # A share of 0.01 scatters by 0.0005 in so many draws.
    assert np.mean(np.sqrt(np.mean(noise**2, axis=1)) > limit) == pytest.approx(0.01, abs=0.002)


def test_readings_of_two_tables_have_their_own_spacing():
    rng = np.random.default_rng(2)
    readings = 1e-3 * rng.standard_normal((600, 2))
    readings[::2, 0] = readings[1::2, 1] = np.nan  # bobs seen in turns
    assert estimate_noise(Run(np.arange(600) / 60, readings, state="free")) == pytest.approx(1e-3, rel=0.2)


@pytest.mark.parametrize("rho, off", [(0.0, 0.0), (0.3, 0.1), (0.7, 0.1)])
def test_correlation_of_noise_whatever_the_model_lacks(rho, off):
    """Of 4000 readings ρ scatters by 0.022; a slow misfit of the size of the noise adds 0.005."""
    times = np.arange(2200) / 60
    seen = np.random.default_rng(5).random(2200) > 0.03
    bobs = correlated_noise((2200, 2), -1.0 / np.log(rho) if rho else 0.0, np.random.default_rng(6))
    bobs += np.sin(2.0 * np.pi * times / 1.1)[:, None]
    assert estimate_correlation([(times[seen], bob[seen]) for bob in bobs.T]) == pytest.approx(rho, abs=off)


def test_effects_known_and_unknown(load):
    toml = edit("effects = []", 'effects = ["exposure_blur", "quadratic_drag", "-string_hysteresis"]')
    toml += "[model.parameters]\nquadratic_drag = { c2 = 0.002 }\npivot_friction = { tau_c = 1e-4 }\n"
    toml += "[infer]\nexposure_blur.duration = { low = 0.0, high = 0.02 }\n"
    toml += '"quadratic_drag.c2" = { mean = 2e-3, sd = 1e-4 }\n'
    experiment = load(toml)
    assert experiment.unknown_effect_parameters == ("exposure_blur.duration",)
    assert experiment.cradle.effects["exposure_blur"] == {"duration": 0.01}
    assert experiment.cradle.effects["quadratic_drag"] == {"c2": 0.002}
    assert experiment.cradle.has("pivot_friction")
    assert not experiment.cradle.has("string_hysteresis")
    assert experiment.infer == {
        "exposure_blur.duration": Prior(low=0.0, high=0.02),
        "quadratic_drag.c2": Prior(mean=2e-3, sd=1e-4),
    }


REFUSED = {
    "no such data": (edit("run1.csv", "run2.csv"), CSV, ["line 9", "no file", "run2.csv"]),
    "a folder": (edit("run1.csv", "."), CSV, ["line 9", "no file"]),
    "syntax": (edit("bobs = 3", "bobs = = 3"), CSV, ["experiment.toml", "not valid TOML", "line 3"]),
    "format": (edit("experiment/1", "experiment/9"), CSV, ["line 1", "format", "cradle-experiment/1"]),
    "no format": (edit('format = "cradle-experiment/1"\n'), CSV, ["format", "missing"]),
    "unknown table": (edit("[model]", "[modle]"), CSV, ["line 5", "'modle'", "'model'"]),
    "unknown key": (edit("mass", "mas"), CSV, ["line 4", "cradle.mas", "'mass'"]),
    "unknown run key": (edit("noise", "nois"), CSV, ["line 11", "run[1].nois", "'noise'"]),
    "one run in single brackets": (edit("[[run]]", "[run]"), CSV, ["line 8", "[[run]]"]),
    "no run": (TOML.partition("[[run]]")[0], CSV, ["run is missing", "[[run]]"]),
    "no file": (edit('file = "run1.csv"\n'), CSV, ["line 8", "file is missing"]),
    "model in cradle": (edit("mass = 0.2813", 'model = "nsp"'), CSV, ["line 4", "[model]"]),
    "wrong type": (edit("0.2813", '"heavy"'), CSV, ["line 4", "cradle.mass", "heavy", "a number"]),
    "a truth for a number": (edit("0.2813", "true"), CSV, ["line 4", "a number"]),
    "infinite": (edit("0.2813", "inf"), CSV, ["line 4", "finite"]),
    "extreme": (edit("0.2813", "1e308\nlength = 1e-300"), CSV, ["cradle"]),
    "mass": (edit("0.2813", "-1"), CSV, ["line 4", "mass is -1 kg", "greater than 0 kg"]),
    "bobs": (edit("bobs = 3", "bobs = 0"), CSV, ["line 3", "bobs is 0", "at least 1 and at most 200"]),
    "tracking": (edit("noise = 0.001", "tracking = { ratio = 0.5, place = -0.2, speed = 3.0 }"), CSV,
                 ["tracking.place is -0.2", "greater than 0"]),
    "tracking without speed": (edit("noise = 0.001", "tracking = { ratio = 0.5, place = 0.2 }"), CSV, ["speed"]),
    "delta": (edit("noise = 0.001", "delta = -1.0"), CSV, ["line 11", "delta is -1", "greater than -1"]),
    "inward release": (edit("angle = 0.228", "angle = -0.228"), CSV, ["overlap", "positive towards the last bob"]),
    "delta list": (edit("noise = 0.001", "delta = [0.1]"), CSV, ["line 11", "1 values", "2 gaps"]),
    "base": (edit('"nsp"', '"nps"'), CSV, ["line 6", "nps", '"nsp"']),
    "effect": (edit("effects = []", 'effects = ["quadratic_darg"]'), CSV, ["line 7", "'quadratic_drag'"]),
    "effect in and out": (
        edit("effects = []", 'effects = ["quadratic_drag", "-quadratic_drag"]'), CSV,
        ["line 7", "quadratic_drag is both added and removed"],
    ),
    "effect needs another": (edit('"nsp"\neffects = []', '"ho"\neffects = ["string_hysteresis"]'), CSV, ["requires"]),
    "effect value": (TOML + "[model.parameters]\nquadratic_drag = { c2 = -1 }", CSV, ["line 13", "c2 is -1 kg/m"]),
    "effect key": (TOML + "[model.parameters]\nquadratic_drag = { c3 = 1 }", CSV, ["line 13", "'c3'", "'c2'"]),
    "effect list": (TOML + "[model.parameters]\nquadratic_drag = { c2 = [1] }", CSV, ["line 13", "not a list"]),
    "no release": (edit("release = { bobs = 1, angle = 0.228 }\n"), CSV, ["line 8", "no release", 'state = "free"']),
    "steep release": (edit("0.228", "1.6"), CSV, ["line 10", "1.6 rad", "1.5 rad", "pendulum"]),
    "release in degrees": (edit("0.228", "13"), CSV, ["line 10", "degrees", "0.2269"]),
    "release of no bob": (edit("bobs = 1", "bobs = 4"), CSV, ["line 10", "4 bobs", "has 3"]),
    "release angles": (edit("bobs = 1, angle = 0.228", "angles = { 7 = 0.1 }"), CSV, ["line 10", "bob 7", "1 to 3"]),
    "release key": (edit("angle =", "angel ="), CSV, ["line 10", "'angel'", "'angle'"]),
    "start": (edit("0.228 }", '0.228, start = "up" }'), CSV, ["line 10", "unstretched"]),
    "angle_sd": (edit("0.228 }", "0.228, angle_sd = -1 }"), CSV, ["line 10", "angle_sd is -1 rad", "at least 0"]),
    "noise": (edit("0.001", "0"), CSV, ["line 11", "noise is 0 rad", "at least 1e-07", "inferred"]),
    "noise of nothing": (edit("0.001", "1e-30"), CSV, ["line 11", "noise is 1e-30 rad", "leave noise out"]),
    "state": (TOML + 'state = "fre"', CSV, ["line 12", "fre", '"free"']),
    "fit_to": (TOML + "fit_from = 1\nfit_to = 1", CSV, ["line 13", "fit_to is 1 s", "1 s"]),
    "fit_from before release": (TOML + "fit_from = -1", CSV, ["line 12", "fit_from is -1 s", "t = 0", "free"]),
    "window": (TOML + "fit_from = 5", CSV, ["line 12", "no usable rows", "0 and 0.2 s"]),
    "prior sd": (infer("length = { mean = 0.3, sd = 0 }"), CSV, ["line 13", "sd is 0", "greater than 0"]),
    "prior ends": (infer("length = { low = 2, high = 1 }"), CSV, ["line 13", "low is 2", "less than high"]),
    "prior of both": (infer("length = { mean = 2, high = 1 }"), CSV, ["line 13", "mean and sd, or low and high"]),
    "prior key": (infer("length = { men = 2, sd = 1 }"), CSV, ["line 13", "'men'", "'mean'"]),
    "prior number": (infer("length = 0.3"), CSV, ["line 13", "infer.length", "a prior"]),
    "prior name": (infer("lenght = { mean = 2, sd = 1 }"), CSV, ["line 13", "'lenght'", "'length'"]),
    "prior beyond": (infer("mass = { low = -1, high = 1 }"), CSV, ["line 13", "mass is -1 kg", "greater than 0"]),
    "prior of an effect": (infer("quadratic_drag.c2 = { low = 0, high = 1 }"), CSV, ["line 13", "not in the model"]),
    "toml not UTF-8": (b'format = "\xff"', CSV, ["experiment.toml, line 1", "UTF-8"]),
    "not UTF-8": (TOML, CSV.encode("utf-16"), ["run1.csv, line 1", "UTF-8"]),
    "empty": (TOML, "", ["run1.csv, line 1", "empty", "t [s],theta_1 [rad]"]),
    "header only": (TOML, "t,theta_1\n", ["run1.csv", "no rows"]),
    "no header": (TOML, "0.0,0.1\n0.1,0.2\n", ["line 1", "'0.0'", "header"]),
    "no readings": (TOML, "t,theta_1\n0.0,\n0.1,nan\n", ["run1.csv", "no usable rows"]),
    "not a number": (TOML, edit("0.2,,0.1", "0.2,,O.1", CSV), ["run1.csv, line 4", "theta_3 [rad]", "'O.1'"]),
    "grouped digits": (TOML, edit("0.2,,0.1", "0.2,,1_0", CSV), ["run1.csv, line 4", "theta_3 [rad]", "'1_0'"]),
    "infinite reading": (TOML, edit("0.2,,0.1", "0.2,,inf", CSV), ["line 4", "theta_3 [rad]", "infinite"]),
    "short row": (TOML, edit("0.2,,0.1", "0.2,0.1", CSV), ["line 4", "theta_3 [rad]", "2 fields", "3 columns"]),
    "time back": (TOML, edit("0.2,,0.1", "0.05,,0.1", CSV), ["line 4", "column t [s]", "runs back", "0.05 s"]),
    "time repeated": (TOML, edit("0.2,,0.1", "0.1,,0.1", CSV), ["line 4", "column t [s]", "repeats"]),
    "no time": (TOML, edit("0.2,,0.1", ",,0.1", CSV), ["line 4", "column t [s]", "no time"]),
    "bob": (TOML, edit("theta_3", "theta_4", CSV), ["line 1", "theta_4 [rad]", "no bob 4", "1 to 3"]),
    "column twice": (TOML, edit("theta_3", "theta_1", CSV), ["line 1", "theta_1 [rad]", "twice"]),
    "theta and x": (TOML, edit("theta_3 [rad]", "x_3 [m]", CSV), ["line 1", "either theta or x"]),
    "two units": (TOML, edit("theta_3 [rad]", "theta_3 [deg]", CSV), ["line 1", "deg and rad"]),
    "theta in m": (TOML, edit("theta_3 [rad]", "theta_3 [m]", CSV), ["line 1", "theta_3 [m]", "rad or deg"]),
    "unknown unit": (TOML, "t [h],theta_1\n0,0\n", ["line 1", "t [h]", "'h'", "s or ms"]),
    "unknown column": (TOML, edit("theta_3", "thta_3", CSV), ["line 1", "'thta_3 [rad]'", "'theta_3 [rad]'"]),
    "no t": (TOML, "theta_1\n0\n", ["line 1", "no column t"]),
    "no bobs": (TOML, "t\n0\n", ["line 1", "theta_1 [rad]"]),
    "degrees": (TOML, edit("0.228", "13.1", CSV), ["line 2", "theta_3 [rad]", "13.1", "theta_3 [deg]"]),
    "millimetres": (TOML, "t,x_2\n0,1\n1,30\n", ["line 3", "x_2", "30 m", "x_2 [mm]"]),
    "beyond reach": (TOML, "t,x_2 [mm]\n0,1\n1,3000\n", ["line 3", "3000 mm", "0.3 m", "length"]),
    "tracker beyond reach": (TOML, "ball 1\nt\tx\n0\t0.1\n1\t3\n2\t0.1\nball 2\nt\tx\n0\t0.1\n1\t0.1\n",
                             ["line 4", "x of ball 1", "2.9 m"]),
    "tracker mass": (TOML, "ball 9\nt\tx\ty\n0\t0.1\t0\n", ["run1.csv", "ball 9", "bob 9 of 3"]),
    "tracker cell": (TOML, "ball 1\nt\tx\ty\n0\tO\t0\n", ["run1.csv, line 3", "column x", "'O'"]),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_refusals_name_place_and_remedy(load, name):
    toml, csv, fragments = REFUSED[name]
    with pytest.raises(ExperimentError) as refused:
        load(toml, csv)
    message = str(refused.value)
    assert len(message.splitlines()) == 1
    for fragment in fragments:
        assert fragment in message, message


@pytest.mark.parametrize("name", ["~/run.csv", "../run.csv", "sub/../../run.csv", "{outside}", "C:run.csv", "link.csv"])
def test_an_experiment_names_no_file_outside_its_folder(load, tmp_path, name):
    """One from somebody else could otherwise read whatever its reader may read."""
    outside = tmp_path.parent / f"{tmp_path.name}-outside.csv"
    outside.write_text(CSV)
    load(TOML)
    (tmp_path / "link.csv").symlink_to(outside)
    with pytest.raises(ExperimentError, match=r"line \d+: run\[1\]\.file: .*(copy it there|copy it here)"):
        load(TOML.replace('"run1.csv"', f'"{name.format(outside=outside)}"'))


@pytest.mark.parametrize("name", ["pipe.csv", "folder.csv", "loop.csv"])
def test_an_experiment_names_no_device(load, tmp_path, name):
    """A pipe without a writer would hang for ever."""
    load(TOML)
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "loop.csv").symlink_to(tmp_path / "loop.csv")
    with pytest.raises(ExperimentError, match=r"run\[1\]\.file: .*name the data to read"):
        load(TOML.replace('"run1.csv"', f'"{name}"'))


def test_missing_files_and_folders_are_refused(tmp_path):
    with pytest.raises(ExperimentError, match=r"nowhere\.toml: no such file"):
        Experiment.load(tmp_path / "nowhere.toml")
    with pytest.raises(ExperimentError, match="is a folder"):
        Experiment.load(tmp_path)


# Pieces that a file may hold where it should hold something else.
VALUES = [
    "true", "inf", "-inf", "nan", "0", "-1", "3", "200", "1e400", "1e308", "1e-320", "0x" + "f" * 6000, "1979-05-27",
    "''", "'nsp'", "'ho'", "'free'", "'-nsp'", "['quadratic_drag']", "['-string_hysteresis', 'exposure_blur']", "[]",
    "[0.1, 0.1]", "[1e308, 0.1]", "[true]", "[[1]]", "[{}]", "{}", "{ 1 = 2 }", "{ angle = 2 }", "{ c2 = 'a' }",
    "{ bobs = 2, angle = 1e9 }", "{ angles = { 2 = 0.1 } }", "{ mean = 0.3, sd = 0.1 }", "{ low = 1e-300, high = 1 }",
    "{ c2 = { low = 0, high = 1 } }", "'..'", '"run1.csv\\u0000"', '"a\\nb"', '"\\u2028"', "'" + "x" * 400 + "'", "=",
]  # fmt: skip
CELLS = [
    "", " ", "nan", "-nan", "inf", "1e400", "-1", "7", "1e308", "-1e308", "1e-320", "x", '"1"', "1_0", "1,5", "0x1",
    "\x00", "\u0663", "theta_2", "theta_0 [deg]", "x_1", "x_2 [mm]", "t", "t [ms]", "theta_99999999999", "#multi:", "y",
    "mass A", "t\tx\ty", "t\tx", "mass 2\nt\tx\n0\t1",
]  # fmt: skip
FULL = (
    edit("mass = 0.2813", "mass = 0.2813\nlength = 0.3\nkappa = 190\ndelta = [0.0, 0.0]\npower_law = [0.03, 0.2]")
    + "delta = 0\nfit_from = 0.0\nfit_to = 9.0\nstate = 'release'\nrest = 'free'\n"
    + "[model.parameters]\nquadratic_drag = { c2 = 0.002 }\n[infer]\nlength = { mean = 0.3, sd = 0.01 }\n"
    + "delta = { low = -0.1, high = 0.1 }\nquadratic_drag.c2 = { low = 0, high = 1 }\n"
)


def mutated(draw, text, patterns, pieces):
    """The text with some matches of the patterns replaced, dropped, repeated, or with characters in between."""
    for _ in range(draw(st.integers(1, 3))):
        matches = list(re.finditer(draw(st.sampled_from(patterns)), text))
        if matches:
            start, end = matches[draw(st.integers(0, len(matches) - 1))].span()
            old, at = text[start:end], draw(st.integers(0, end - start))
            odd = [draw(st.sampled_from(pieces)), "", old + old, old[:at] + draw(st.text(max_size=2)) + old[at:]]
            text = text[:start] + odd[draw(st.sampled_from([0, 0, 0, 1, 2, 3]))] + text[end:]
    return text


@st.composite
def files(draw):
    """Contents of an experiment.toml and its data, one or both of them broken."""
    toml = draw(st.sampled_from([TOML, FULL]))
    csv = draw(st.sampled_from([CSV, CSV.replace("theta", "x").replace("rad", "m"), TRACKER_1, TRACKER_2]))
    broken = draw(st.sampled_from(["toml", "toml", "csv", "csv", "both"]))
    whole_value, scalar, key, line = r"(?<== )[^\n]+", r"(?<== )[\w.'\"/-]+", r"\w+(?= =)", r"[^\n]+\n"
    if broken != "csv":
        toml = mutated(draw, toml, [whole_value, scalar, scalar, key, line], VALUES)
    if broken != "toml":
        csv = mutated(draw, csv, [r"[^,\t\n]+", r"[^,\t\n]+", line], CELLS)
    noise = draw(st.binary(max_size=20)) if draw(st.integers(0, 19)) == 7 else b""
    return (text.encode("utf-8", "surrogatepass") + noise for text in (toml, csv))


def test_the_files_that_are_to_be_broken_load(load):
    for toml in (TOML, FULL):
        for csv in (CSV, CSV.replace("theta", "x").replace("rad", "m"), TRACKER_1, TRACKER_2):
            load(toml, csv)


@settings(max_examples=200, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(files())
def test_nothing_but_a_refusal_comes_out_of_broken_files(tmp_path_factory, contents):
    folder = tmp_path_factory.getbasetemp() / "fuzz"
    write_together(folder, {"placeholder": ""})
    for name, content in zip(("experiment.toml", "run1.csv"), contents, strict=True):
        (folder / name).write_bytes(content)
    for attempt in (
        lambda: Experiment.load(folder / "experiment.toml").save(folder / "saved"),
        lambda: scaffold(folder / "run1.csv", folder / "scaffold.toml", overwrite=True),
    ):
        try:
            Experiment.load(attempt())
        except ExperimentError as refused:
            assert len(str(refused).splitlines()) == 1
