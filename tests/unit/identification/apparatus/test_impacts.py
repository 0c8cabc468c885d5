"""Impacts: the k_f of independent integrations of eq. 1 is found from speeds, durations and recordings."""

import numpy as np
import pytest

from cradle_env import Cradle
from identification.apparatus import measure_impacts
from identification.apparatus.impacts.chain import dissipation, duration, passed_on, restitution
from identification.cli.app import main
from identification.storage.schema import read_json
from tests.reference.impact_chain import K_EL, MASS, collide
from tests.reference.laboratory import record
from tests.reference.pendulum import csv_of
from tests.reference.soft_contact import SoftCradle

K_F = 15000.0
SPEEDS = np.geomspace(0.1, 1.0, 5)


def smooth(values, speeds):
    """What stands at SPEEDS, at others: smooth in ln v."""
    return np.polyval(np.polyfit(np.log(SPEEDS), values, 3), np.log(speeds))


@pytest.fixture(scope="module")
def truth():
    """(v3/v1 of three balls, contact duration of two) at SPEEDS."""
    return (
        np.array([collide(3, v, K_F)[0][-1] / v for v in SPEEDS]),
        np.array([collide(2, v, K_F)[1] for v in SPEEDS]),
    )


def speeds_table(path, truth, sd, *, stated=True, count=30, seed=0):
    rng = np.random.default_rng(seed)
    true = rng.uniform(0.15, 0.9, count)
    before, after = (v + sd * rng.standard_normal(count) for v in (true, true * smooth(truth[0], true)))
    header = "v1 [m/s],v3 [m/s]" + (",v1_sd [m/s],v3_sd [m/s]" if stated else "")
    end = f",{sd},{sd}" if stated else ""
    path.write_text("\n".join([header, *(f"{a},{b}{end}" for a, b in zip(before, after, strict=True)), ""]))
    return path


def durations_table(path, truth, sd, *, count=30, seed=1):
    rng = np.random.default_rng(seed)
    speed = rng.uniform(0.15, 0.9, count)
    time = smooth(truth[1], speed) + sd * rng.standard_normal(count)
    rows = (f"{v},{1e6 * t},{1e6 * sd}" for v, t in zip(speed, time, strict=True))
    path.write_text("\n".join(["v [m/s],duration [us],duration_sd [us]", *rows, ""]), encoding="utf-8")
    return path


def inside(value, truth):
    """Within 4 standard deviations: a right value fails once in 16 000."""
    return abs(value.median - truth) < 4.0 * value.sd


@pytest.mark.parametrize("bobs", [2, 3])
def test_the_chain_is_that_of_an_independent_integration(bobs):
    velocities, time = collide(bobs, 0.39, K_F)
    A = dissipation(K_F, K_EL, MASS, np.array([0.39]))
    assert passed_on(bobs, A)[0] == pytest.approx(velocities[-1] / 0.39, abs=1e-7)
    if bobs == 2:
        assert restitution(A)[0] == pytest.approx((velocities[1] - velocities[0]) / 0.39, abs=1e-7)
        scale = (0.5 * MASS / K_EL) ** 0.4 * 0.39**-0.2
        assert scale * duration(A)[0] == pytest.approx(time, rel=2e-4)  # that ends with a step of the integration


@pytest.mark.parametrize("stated", [True, False], ids=["stated errors", "scatter"])
def test_k_f_from_speeds(tmp_path, truth, stated):
    found = measure_impacts([speeds_table(tmp_path / "v.csv", truth, 1e-3, stated=stated)], Cradle())
    assert inside(found.values["k_f"], K_F)
    assert found.values["k_f"].sd < 0.05 * K_F
    assert inside(found.values["exponent"], 0.2)
    e = [collide(2, v, K_F)[0] @ [-1.0, 1.0] / v for v in (0.1, 1.0)]
    assert inside(found.values["e_0.1"], e[0]) and inside(found.values["e_1"], e[1])
    assert not found.warnings
    assert abs(found.constraint().residuals(Cradle(k_f=K_F))[0]) < 4.0


def test_speeds_and_durations_together_tell_the_stiffness_too(tmp_path, truth):
    files = [speeds_table(tmp_path / "v.csv", truth, 1e-3), durations_table(tmp_path / "t.csv", truth, 0.5e-6)]
    stiff = Cradle(youngs_modulus=220e9)  # as somebody may have believed
    found = measure_impacts(files, stiff)
    assert inside(found.values["k_el"], K_EL) and found.values["k_el"].sd < 0.01 * K_EL
    assert inside(found.values["k_f"], K_F)
    assert any("k_el is not the one" in warning for warning in found.warnings)
    # The constraint rests on neither: it holds k_el as well, and tells the believed stiffness to be wrong.
    assert (np.abs(found.constraint().residuals(Cradle(k_f=K_F))) < 4.0).all()
    assert np.abs(found.constraint().residuals(stiff.replace(k_f=K_F))).max() > 10.0


def test_durations_alone_say_what_they_rest_on(tmp_path, truth):
    found = measure_impacts([durations_table(tmp_path / "t.csv", truth, 0.2e-6, count=200)], Cradle())
    assert inside(found.values["k_f"], K_F)
    assert any("Durations alone" in warning for warning in found.warnings)
    assert abs(found.constraint().residuals(Cradle(k_f=K_F))[0]) < 4.0


def test_errors_that_are_stated_too_small_widen_the_interval(tmp_path, truth):
    path = speeds_table(tmp_path / "v.csv", truth, 3e-3)
    path.write_text(path.read_text().replace("0.003,0.003", "0.001,0.001"))
    found = measure_impacts([path], Cradle())
    assert 2.0 < found.chosen.widened < 4.0
    assert any("times as much as the stated errors" in warning for warning in found.warnings)
    assert inside(found.values["k_f"], K_F)


def test_speeds_from_recordings(tmp_path):
    """Three bobs of the soft-contact reference on rigid strings; the film has 240 frames a second."""
    cradle = SoftCradle(3, strings="rigid", k_f=K_F)
    files = []
    for k, angle in enumerate((0.12, 0.2, 0.28)):
        made = record(cradle, {3: angle}, duration=1.2, rate=240.0, noise=2e-4, seed=k)
        files.append(csv_of(tmp_path / f"{k}.csv", made.times, made.readings))
    found = measure_impacts(files, Cradle(model="pendulum"))
    true = [np.sqrt(2 * 9.81 * 0.3 * (1 - np.cos(angle))) for angle in (0.12, 0.2, 0.28)]
    before = np.array([one.before[0] for one in found.passed])
    assert before == pytest.approx(true, rel=3e-3)  # drag takes 0.1 %
    assert inside(found.values["k_f"], K_F)
    assert found.values["k_f"].sd < 0.1 * K_F
    rows = ["Time (ms)\tAngle 1 (°)\tAngle 2 (°)\tAngle 3 (°)"]
    rows += [
        "\t".join(map(repr, map(float, row))) for row in np.column_stack([1e3 * made.times, np.degrees(made.readings)])
    ]
    sheet = tmp_path / "sheet.txt"
    sheet.write_text("\n".join(rows), encoding="utf-8")
    again = measure_impacts([*files[:2], sheet], Cradle(model="pendulum"))
    assert again.values["k_f"].median == pytest.approx(found.values["k_f"].median, rel=1e-4)
    assert 'sheet.txt: theta_3 [deg] is "Angle 3 (°)".' in again.findings


def test_the_command_writes_what_it_found(tmp_path, truth, capsys):
    files = [speeds_table(tmp_path / "v.csv", truth, 1e-3), durations_table(tmp_path / "t.csv", truth, 0.5e-6)]
    out = tmp_path / "out"
    assert main(["measure", "impacts", *map(str, files), "--out", str(out), "--set", "mass=0.2813"]) == 0
    content = read_json(out / "measurement.json", "measurement")
    assert content["values"].keys() >= {"k_f", "k_el", "alpha", "n", "exponent"}
    assert "k_f = " in capsys.readouterr().out
    assert (out / "impacts.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("v1 [m/s]\n1\n", "neither speeds nor durations"),
        ("speed 1,speed 3\n1,1\n", "neither speeds nor durations"),
        ("V1 (m/s),V3 (m/s)\n1,-1\n", "greater than 0"),
        ("t,theta_1,theta_2,v1\n0,0,0,1\n1,0,0,1\n", "no end bob is lifted"),
        ("v1 [m/s],v3 [km/h]\n1,1\n", "unknown unit"),
        ("v1,v3\n1,-1\n", "greater than 0"),
        ("v1,v3\n1,\n", "no row with both"),
        ("v1,v3\n1,0.9\n", "without standard deviations"),
        ("v1,v3,v1_sd,v3_sd\n1,0.2,0.01,0.01\n", "no bobs of steel"),
        ("t,theta_1,theta_2\n0,0,0\n1,0,0\n", "no end bob is lifted"),
        ("t,theta_1,theta_2\n0,-0.1,0\n1,0,0.1\n2,0,0\n", "readings of the flight"),
        ("t,theta_1\n0,-0.1\n1,0\n2,0\n", "one bob"),
    ],
)
def test_tables_that_cannot_be_used_are_refused_in_one_line(tmp_path, capsys, text, said):
    path = tmp_path / "bad.csv"
    path.write_text(text, encoding="utf-8")
    assert main(["measure", "impacts", str(path), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert said in told and told.count("\n") == 1
