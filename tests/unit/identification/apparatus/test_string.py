"""Force-displacement curves of a machine that follows the string sample by sample: what was put in is found."""

import numpy as np
import pytest

from cradle_env import Cradle
from identification.apparatus import measure_string
from identification.apparatus.string.curve import curve_of
from identification.cli.app import main
from identification.storage.schema import read_json
from tests.reference.string_machine import csv_of, pull

PEAKS = (0.005, 0.009, 0.013)  # 1, 1.8 and 2.6 N


def curves(folder, *, sheer=False, **machine):
    """Single cycles to several forces and, unless `sheer`, four in a row between 0.8 and 2 N."""
    made = [pull([peak], seed=k, **machine) for k, peak in enumerate(PEAKS)]
    if not sheer:
        made.append(pull([0.01] * 4, low=0.004, seed=9, **machine))
    return [csv_of(folder / f"curve{k}.csv", *one) for k, one in enumerate(made)]


def inside(value, truth):
    """Within 4 standard deviations: a right value fails once in 16 000."""
    return abs(value.median - truth) < 4.0 * value.sd


def test_a_string_of_eq_4_is_found_to_be_one(tmp_path):
    found = measure_string(curves(tmp_path, kappa=187.0, zero=0.03))
    assert found.chosen.terms == ()
    assert inside(found.values["kappa"], 187.0) and found.values["kappa"].sd < 0.1
    assert inside(found.values["exponent"], 2.0) and found.values["exponent"].sd < 2e-3
    assert inside(found.values["loss"], 1.0 / 3.0) and found.values["loss"].sd < 5e-3
    assert found.findings[0].startswith("Eq. 4 describes the string") and not found.warnings
    assert found.constraint().quantities == ("kappa",)
    assert abs(found.constraint().residuals(Cradle(kappa=187.0))[0]) < 4.0


@pytest.mark.parametrize(
    ("name", "machine", "truth"),
    [
        pytest.param("exponent", {"exponent": 1.7}, 1.7, marks=pytest.mark.slow),
        ("curvature", {"stiffening": 15.0}, 15.0),
        ("creep", {"creep": 4e-5}, 4e-5),
        pytest.param("backlash", {"backlash": 6e-5}, 6e-5, marks=pytest.mark.slow),
    ],
)
def test_what_eq_4_does_not_say_is_found_and_named(tmp_path, name, machine, truth):
    found = measure_string(curves(tmp_path, **machine))
    assert found.chosen.terms == (name,)
    assert inside(found.values[name], truth), found.values[name]
    assert found.values[name].sd < 0.1 * truth
    assert inside(found.values["kappa"], 200.0)
    creeps = {"string_creep": {"rate": truth}} if name == "creep" else {}
    assert len(found.constraint().quantities) == 1 + len(creeps)
    assert (np.abs(found.constraint().residuals(Cradle(kappa=200.0, effects=creeps))) < 4.0).all()


def test_stiffness_against_speed(tmp_path):
    made = [pull([0.01], speed=v, rate=50e3 * v, speed_law=0.02, seed=k) for k, v in enumerate((1e-4, 1e-3, 1e-2))]
    found = measure_string([csv_of(tmp_path / f"{k}.csv", *one) for k, one in enumerate(made)])
    assert found.chosen.terms == ("rate",)
    assert inside(found.values["rate"], 0.02) and found.values["rate"].sd < 1e-3
    assert inside(found.values["kappa"], 200.0)  # at the geometric mean of the speeds, 1 mm/s


@pytest.mark.slow
def test_play_of_the_machine_is_not_counted_as_loss_of_the_string(tmp_path):
    found = measure_string(curves(tmp_path, backlash=2e-4))  # uncorrected, 0.27 to 0.31
    assert inside(found.values["loss"], 1.0 / 3.0)


def test_turns_are_seen_through_the_jitter_of_the_machine():
    t, x, f = pull([0.01] * 3, low=0.004, jitter=2e-5)
    legs = curve_of("x", x, f, t).legs
    assert [leg.loading for leg in legs] == [True, False] * 3
    assert all(abs(leg.rate - 1e-3) < 2e-5 for leg in legs)


@pytest.mark.parametrize("rate", [7.3, 11.1, 50.0])
def test_the_machine_turns_between_two_rows(rate):
    t, x, f = pull([0.0101] * 2, low=0.004, rate=rate, noise=0.0)
    legs = curve_of("x", x, f, t).legs
    # the last row before the turn is up to 1/rate · 1 mm/s away; the machine itself turns within a step of 3 µm
    assert [leg.end for leg in legs[:3]] == pytest.approx([0.0101, 0.004, 0.0101], abs=4e-6)
    assert [x[leg.last - 1] <= leg.end + 4e-6 if leg.loading else x[leg.last - 1] >= leg.end - 4e-6 for leg in legs[:3]]


def test_the_loss_of_a_cycle_with_few_rows(tmp_path):
    made = [pull([peak], seed=k, rate=5.0, noise=1e-4) for k, peak in enumerate(PEAKS)]
    found = measure_string([csv_of(tmp_path / f"{k}.csv", *one) for k, one in enumerate(made)])
    # the trapezoidal rule over rows 0.2 mm apart errs by (0.2/5)²/6 of a third
    assert found.values["loss"].median == pytest.approx(1.0 / 3.0, rel=5e-4)


def test_the_command_writes_what_it_found(tmp_path, capsys):
    out = tmp_path / "out"
    paths = curves(tmp_path, sheer=True, exponent=1.7)
    assert main(["measure", "string", *map(str, paths), "--out", str(out)]) == 0
    content = read_json(out / "measurement.json", "measurement")
    assert content["details"]["terms"] == ["exponent"]
    assert len(content["details"]["cycles"]) == len(PEAKS)
    assert "kappa = " in content["details"]["experiment_toml"]
    assert "Unloading is not quadratic" in capsys.readouterr().out
    assert (out / "string.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("displacement [mm]\n1\n", "no column force"),
        ("displacement [mm],force [kg]\n1,2\n", "unknown unit 'kg'"),
        ("displacement [mm],force [N],forse [N]\n1,2,3\n", "did you mean 'force'?"),
        ("displacement [mm],force [N]\n1,2\n", "1 rows"),
        ("displacement [mm],force [N]\n" + "1,2\n" * 40, "never changes"),
        ("displacement [mm],force [N]\n" + "".join(f"{-k},{k}\n" for k in range(40)), "only falls"),
        ("displacement [mm],force [N]\n" + "".join(f"{k},{-k}\n" for k in range(40)), "sign of the force"),
        ("t [s],displacement [mm],force [N]\n" + "".join(f"1,{k},{k}\n" for k in range(40)), "time does not grow"),
        ("displacement [mm],force [N]\n" + "".join(f"{k},inf\n" for k in range(40)), "infinite"),
    ],
)
def test_curves_that_cannot_be_used_are_refused_in_one_line(tmp_path, capsys, text, said):
    path = tmp_path / "bad.csv"
    path.write_text(text, encoding="utf-8")
    assert main(["measure", "string", str(path), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert said in told and told.count("\n") == 1


def test_a_zero_that_nobody_can_tell_is_warned_of(tmp_path):
    t, x, f = pull([0.01], lead=0.0)
    found = measure_string([csv_of(tmp_path / "tight.csv", t, x, f)])
    assert any("no reading with a slack string" in warning for warning in found.warnings)
    assert np.isfinite(found.values["kappa"].median)
