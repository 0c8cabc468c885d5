"""Ring-downs: drag that independent integrations put in is found, and what cannot be used is refused."""

import json

import numpy as np
import pytest

from cradle_env import Cradle
from identification.apparatus import measure_ringdown
from identification.cli.app import main
from identification.storage.schema import read_json
from tests.reference.pendulum import MASS, csv_of, ring_down
from tests.reference.soft_contact import SoftCradle, simulate_soft

RIGID = Cradle(model="pendulum")
NOISE = 1e-3
EXPERIMENT = """format = "cradle-experiment/1"
[cradle]
bobs = 1
[model]
base = "pendulum"
[[run]]
file = "one.csv"
state = "free"
"""


def recorded(path, angle, bobs=1, seed=0, **damping):
    """A CSV of bobs that swing together for 40 s, each tracked with noise."""
    times, theta = ring_down(angle, duration=40.0, **damping)
    noise = NOISE * np.random.default_rng(seed).standard_normal((len(times), bobs))
    return csv_of(path, times, theta[:, None] + noise)


def inside(value, truth):
    """Whether a value is within 4 of its standard deviations: a right one fails once in 16 000."""
    return abs(value.median - truth) < 4.0 * value.sd


@pytest.mark.parametrize(
    ("damping", "terms"),
    [
        ({"b": 2e-3}, ()),
        ({"b": 1e-3, "c2": 2e-2}, ("quadratic_drag",)),
        ({"b": 1e-3, "tau_c": 3e-4}, ("pivot_friction",)),
    ],
    ids=["linear", "quadratic", "coulomb"],
)
def test_the_terms_that_act_are_found_and_no_others(tmp_path, damping, terms):
    found = measure_ringdown([recorded(tmp_path / "one.csv", 0.3, **damping)], RIGID)
    assert found.terms == terms
    names = {"b": "b_1", "c2": "c2", "tau_c": "tau_c"}
    for key, truth in damping.items():
        value = found.values[names[key]]
        assert inside(value, truth), (key, value)
        assert value.sd < 0.2 * truth  # of two that act alike, 40 s at 60 readings a second tell no more
    assert not found.warnings
    effects = {term: {term_key: damping[term_key]} for term in terms for term_key in damping if term_key != "b"}
    constraint = found.constraint()
    assert (np.abs(constraint.residuals(RIGID.replace(b=damping["b"], effects=effects))) < 4.0).all()
    # A model that takes the whole damping for another kind is told to be wrong, and one of b alone has its own b.
    other = {"quadratic_drag": {"c2": 5.0 * damping["b"]}}
    assert np.abs(constraint.residuals(RIGID.replace(b=0.0, effects=other))).max() > 10.0
    if not terms:
        b = damping["b"] + np.array([-1.0, 1.0]) * found.values["b_1"].sd
        low, high = (np.sum(constraint.residuals(RIGID.replace(b=one)) ** 2) for one in b)
        mean = found.values["b_1"].median
        below, above = (((one - mean) / found.values["b_1"].sd) ** 2 for one in b)
        assert low - high == pytest.approx(below - above, abs=0.3)  # by the estimates of noise, a few percent


def test_what_the_strings_take_is_not_drag(tmp_path):
    """One bob of the soft-contact reference, its strings new: read as rigid, b comes out 4 % low, 8 sd."""
    times = np.arange(60 * 60 + 1) / 60
    run = simulate_soft(SoftCradle(1, b=2e-3), {1: 0.15}, "hanging", times=times)
    noisy = run.theta + NOISE * np.random.default_rng(2).standard_normal(run.theta.shape)
    found = measure_ringdown([csv_of(tmp_path / "nylon.csv", times, noisy)], Cradle())
    assert found.terms == () and not found.warnings
    assert inside(found.values["b_1"], 2e-3)
    assert found.values["b_1"].sd < 1e-5
    assert abs(found.recordings[0].rigid.of("b")[0] - 2e-3) > 8.0 * found.values["b_1"].sd


def test_drag_against_the_number_of_bobs_feeds_group_drag(tmp_path):
    b, slope = 2e-3, 0.3
    paths = [
        recorded(tmp_path / f"{n}.csv", 0.15, n, seed=n, b=b * (1.0 + slope * 2.0 * (n - 1) / n)) for n in (1, 2, 4)
    ]
    found = measure_ringdown(paths, RIGID)
    assert inside(found.values["b"], b) and inside(found.values["slope"], slope)
    assert found.values["slope"].sd < 0.02
    assert 'effects = ["group_drag"]' in found.experiment_toml()
    constraint = found.constraint()
    assert constraint.quantities == ("b_1", "b_2", "b_4", "quadratic_drag.c2", "pivot_friction.tau_c")
    assert constraint.assumed == {"mass": MASS}
    grouped = RIGID.replace(b=b, effects={"group_drag": {"slope": slope, "range": 0.005}})
    assert (np.abs(constraint.residuals(grouped)) < 4.0).all()
    assert np.abs(constraint.residuals(RIGID.replace(b=b))).max() > 10.0  # without group_drag all b_n are one


def test_groups_of_which_one_bob_is_tracked_are_told_their_number(tmp_path):
    path = recorded(tmp_path / "three.csv", 0.15, b=2e-3)
    assert [*measure_ringdown([path], RIGID, bobs=[3]).groups] == [3]
    with pytest.raises(ValueError, match="2 numbers of bobs are given for 1 CSV"):
        measure_ringdown([path], RIGID, bobs=[1, 2])


def test_a_table_of_a_spreadsheet_gives_the_same_drag(tmp_path):
    """Degrees, semicolons, decimal commas, UTF-16 and CRLF; the report says how the table was read."""
    plain = recorded(tmp_path / "one.csv", 0.15, b=2e-3)
    times, theta = np.loadtxt(plain, delimiter=",", skiprows=1, unpack=True)
    rows = [f"{t:.6f};{np.degrees(angle):.9f}".replace(".", ",") for t, angle in zip(times, theta, strict=True)]
    other = tmp_path / "sheet.csv"
    other.write_bytes("\r\n".join(["Zeit (s);Winkel (°)", *rows, ""]).encode("utf-16"))
    strict, read = measure_ringdown([plain], RIGID), measure_ringdown([other], RIGID)
    assert read.values["b_1"].median == pytest.approx(strict.values["b_1"].median, rel=1e-5)
    assert 'sheet.csv: theta_1 [deg] is "Winkel (°)".' in read.findings
    assert not any("one.csv" in line for line in strict.findings)


def test_drag_is_proportional_to_the_mass(tmp_path):
    path = recorded(tmp_path / "one.csv", 0.15, b=2e-3)
    one, two = (measure_ringdown([path], RIGID.replace(mass=mass)) for mass in (MASS, 2.0 * MASS))
    assert two.values["b_1"].median == pytest.approx(2.0 * one.values["b_1"].median, rel=1e-5)


def test_the_command_writes_a_page_a_picture_and_numbers(tmp_path, capsys):
    path, out = recorded(tmp_path / "one.csv", 0.15, b=2e-3), tmp_path / "out"
    experiment = tmp_path / "experiment.toml"
    experiment.write_text(EXPERIMENT, encoding="utf-8")
    assert main(["measure", "ringdown", str(path), "--from", str(experiment), "--out", str(out)]) == 0
    content = read_json(out / "measurement.json", "measurement")
    assert content["kind"] == "ringdown" and {*content["files"]} == {"ringdown.png", "report.html"}
    assert content["values"]["b_1"]["median"] == pytest.approx(2e-3, rel=0.01)
    assert "data:image/png" in (out / "report.html").read_text(encoding="utf-8")
    assert "b_1" in capsys.readouterr().out
    assert main(["measure", "ringdown", str(experiment), "--out", str(tmp_path)]) == 0  # beside the data themselves
    (out / "measurement.json").write_text(json.dumps(content | {"kind": "string"}), encoding="utf-8")
    assert main(["measure", "ringdown", str(path), "--out", str(out)]) == 2
    assert "holds a measurement of string" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("t [s],theta_1 [rad]\n", "no rows"),
        ("t [s],speed\n0,1\n1,2\n", "`cradle new` has these options"),
        ("t [s],theta_1 [rad]\n0,0.1\n0.1,x\n", "not a number"),
        ("t [s],theta_1 [rad]\n0,0.1\n0.1,0.2\n0.2,0.1\n0.3,0\n", "lasts 0.3 s"),
        ("t [s],theta_1 [rad]\n" + "".join(f"{k / 10},0.1\n" for k in range(200)), "do not move"),
        (
            "t [s],theta_1 [rad],theta_2 [rad]\n"
            + "".join(f"{k / 20},{np.sin(k / 3.5)},{np.cos(k / 3.5)}\n" for k in range(400)),
            "do not swing together",
        ),
    ],
    ids=["empty", "no rows", "no angle", "text", "short", "still", "apart"],
)
def test_recordings_that_cannot_be_used_are_refused_in_one_line(tmp_path, capsys, text, said):
    path = tmp_path / "bad.csv"
    path.write_text(text, encoding="utf-8")
    assert main(["measure", "ringdown", str(path), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert said in told and told.count("\n") == 1
    assert not (tmp_path / "out").exists()
