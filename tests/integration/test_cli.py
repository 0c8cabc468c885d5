"""The command line: what it writes, how it ends, and what it says when it refuses."""

import dataclasses
import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from cradle_env import Cradle, Release, simulate
from identification.cli import app
from identification.cli import sweep_command as sweep_command
from identification.experiment.experiment import Experiment
from identification.experiment.run import ReleaseInfo
from identification.inference.posterior import Posterior
from identification.sweep import Grid
from tests.synthetic import made_up_posterior, simulated_run

PNG_END = b"IEND\xaeB`\x82"


def run(*arguments) -> int:
    return app.main([str(argument) for argument in arguments])


def refusal(capsys) -> str:
    """The one line on stderr."""
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1 and captured.err.endswith("\n"), captured.err
    assert "Traceback" not in captured.err
    return captured.err


@pytest.fixture(scope="module")
def pair() -> Experiment:
    cradle = Cradle(bobs=2)
    return Experiment(cradle, (simulated_run(cradle, duration=6.0),))


@pytest.fixture(scope="module")
def calibrated(pair, tmp_path_factory):
    """A folder as `cradle calibrate` leaves it, the posterior made up."""
    folder = tmp_path_factory.mktemp("calibrated")
    made_up_posterior(pair).save(folder / "posterior.nc")
    return folder


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "Missing command"),
        (["simulat"], "simulate"),
        (["simulate"], "--out"),
        (["simulate", "--out", "o", "--delt", "0"], "did you mean --delta?"),
        (["simulate", "--out", "o", "--duration", "long"], "--duration"),
        (["simulate", "--out", "o", "--duration", "0"], "duration is 0 s"),
        (["simulate", "--out", "o", "--duration", "nan"], "duration is nan"),
        (["simulate", "--out", "o", "--sample-rate", "-5"], "sample_rate is -5"),
        (["simulate", "--out", "o", "--bobs", "0"], "bobs is 0"),
        (["simulate", "--out", "o", "--bobs", "2.5"], "--bobs"),
        (["simulate", "--out", "o", "--delta", "-1"], "delta is -1"),
        (["simulate", "--out", "o", "--delta", "0,zero"], "'zero', which is not a number"),
        (["simulate", "--out", "o", "--delta", "0,0.1"], "delta has 2 values"),
        (["simulate", "--out", "o", "--release-angle", "1.6"], "1.5 rad"),
        (["simulate", "--out", "o", "--lifted", "6"], "lifts 6 bobs"),
        (["simulate", "--out", "o", "--start", "up"], "'up'"),
        (["simulate", "--out", "o", "--model", "nps"], "did you mean 'nsp'?"),
        (["simulate", "--out", "o", "--beta", "0.1", "--kappa", "200"], "both beta and kappa"),
        (["simulate", "--out", "o", "--effect", "quadratic_dra.c2=1"], "did you mean 'quadratic_drag'?"),
        (["simulate", "--out", "o", "--effect", "quadratic_drag.c3=1"], "did you mean 'c2'?"),
        (["simulate", "--out", "o", "--effect", "quadratic_drag=1"], "NAME.KEY=VALUE"),
        (["simulate", "--out", "o", "--effect", "quadratic_drag.c2=two"], "'two', which is not a number"),
        (["simulate", "--out", "o", "--effect", "quadratic_drag.c2=-1"], "c2"),
        (["simulate", "--out", "o", "--set", "lenght=1"], "did you mean 'length'?"),
        (["simulate", "--out", "o", "--set", "mass=0"], "mass is 0 kg"),
        (["simulate", "--out", "o", "--set", "mass"], "NAME=VALUE"),
        (["simulate", "--out", "o", "--bobs", "3", "--set", "bobs=4"], "give --bobs 4"),
        (["simulate", "--out", "o", "--set", "beta=0.1"], "give --beta 0.1"),
        (["simulate", "--out", "o", "--experiment", "--noise", "-1"], "noise is -1"),
        (["simulate", "--out", "o", "--noise", "-3"], "noise is -3 rad, but only an experiment has readings"),
        (["simulate", "--out", ".", "--experiment"], "experiment.toml: exists and is no result of this command"),
        (["design", "experiment.toml", "--out", "."], "experiment.toml: exists and is no result of this command"),
        (["simulate", "--out", "o", "--beta", "1e-200"], "beta is 1e-200"),
        (["simulate", "--out", "o", "--from", "none.toml"], "none.toml: no such file"),
        (["simulate", "--out", "file.txt"], "file.txt"),
        (["new", "none.csv", "--out", "new.toml"], "none.csv: no such file"),
        (["new", "none.csv"], "none.csv: no such file"),
        (["new", "file.txt", "--out", "new.toml"], "file.txt"),
        (["new", "run1.csv", "--out", "run1.csv", "--overwrite"], "run1.csv: this is the data file"),
        (["calibrate", "none.toml", "--out", "o"], "none.toml: no such file"),
        (["calibrate", ".", "--out", "o"], "is a folder"),
        (["calibrate", "file.txt", "--out", "o"], "not valid TOML"),
        (["calibrate", "experiment.toml", "--out", "file.txt"], "file.txt"),
        (["calibrate", "experiment.toml", "--out", "o", "--steps", "3"], "steps is 3"),
        (["calibrate", "experiment.toml", "--out", "o", "--workers", "0"], "--workers"),
        (["predict", ".", "--out", "o"], "posterior.nc"),
        (["predict", "none", "--out", "o"], "no posterior there"),
        (["predict", "file.txt", "--out", "o"], "not a posterior"),
        (["sweep", "--out", "o"], "no axis to sweep over"),
        (["sweep", "--out", "o", "--over", "beta"], "NAME=VALUES"),
        (["sweep", "--out", "o", "--over", "bta=1,2"], "did you mean 'beta'?"),
        (["sweep", "--out", "o", "--over", "beta=1:2"], "FIRST:LAST:COUNT"),
        (["sweep", "--out", "o", "--over", "beta=0.1:0.2:0"], "0 values"),
        (["sweep", "--out", "o", "--over", "delta=-1:1:3:log"], "positive"),
        (["sweep", "--out", "o", "--over", "beta=1,two"], "numbers as 2,3,5"),
        (["sweep", "--out", "o", "--over", "beta=1", "--over", "beta=2"], "given twice"),
        (["sweep", "--out", "o", "--over", "beta=0.1", "--quantity", "lamda"], "did you mean 'lambda'?"),
        (["sweep", "--out", "o", "--over", "beta=0.1", "--times", "0,61"], "times is 61 s"),
        (["sweep", "--out", "o", "--over", "beta=0.1", "--table", "t.txt"], "ends in .csv"),
        (["sweep", "--out", "o", "--over", "beta=0.1:0.2:500", "--explore"], "at most 416"),
        (["sweep", "--out", "o", "--over", "beta=0.1", "--model", "none.toml"], "none.toml"),
        (["sweep", "--out", "file.txt", "--over", "beta=0.1"], "file.txt"),
        (["sweep", "--out", "o", "--over", "beta=0.1", "--kappa", "200"], "kappa is given and beta is swept"),
        (["sweep", "--out", "o", "--explore", "--kappa", "200"], "kappa is given and beta is swept"),
        (["sweep", "--out", "o", "--over", "kappa=200", "--beta", "0.1"], "beta is given and kappa is swept"),
        (["sweep", "--out", "o", "--over", "gamma=0.01", "--release-angle", "0.1"], "release_angle is given and gamma"),
        (["bench", "--duration", "0"], "--duration"),
        (["bench", "--duration", "inf"], "duration is inf s"),
        (["simulate", "--out", "o", "--effect", "mass_mismatch.relative=0.1,0.1,x"], "'x', which is not a number"),
        (["simulate", "--out", "o", "--effect", "quadratic_drag.c2=0.1,0.2"], "c2 takes one number"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_unusable_input_is_refused_in_one_line(arguments, said, pair, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.txt").write_text("no table, no file of ours\n")
    pair.save(tmp_path)
    before = sorted(path.name for path in tmp_path.iterdir())
    assert run(*arguments) == 2
    assert said in refusal(capsys)
    assert sorted(path.name for path in tmp_path.iterdir() if any(path.glob("*")) or path.is_file()) == before


@pytest.mark.parametrize(
    "setting",
    [["--delta", "-1.5"], ["--bobs", "0"], ["--bobs", "1"], ["--release-angle", "2"], ["--release-angle", "0"]],
)
def test_predict_refuses_impossible_settings(setting, calibrated, tmp_path, capsys):
    assert run("predict", calibrated, "--out", tmp_path / "o", "--draws", 2, *setting) == 2
    refusal(capsys)


@pytest.mark.parametrize("command", ["", "new", "simulate", "sweep", "calibrate", "predict", "reproduce", "bench"])
def test_help(command, capsys):
    assert run(*command.split(), "--help") == 0
    assert "Usage" in capsys.readouterr().out


def test_as_a_module():
    done = subprocess.run([sys.executable, "-m", "identification", "simulat"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "cradle: No such command 'simulat'. Did you mean 'simulate'? See cradle --help.\n"


def test_simulate_writes_all_of_it(tmp_path, capsys):
    assert run("simulate", "--bobs", 3, "--delta", "0,0.001", "--duration", 5, "--out", tmp_path) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "impacts.csv",
        "run.png",
        "summary.json",
        "trajectory.csv",
    ]
    assert "λ" in capsys.readouterr().out
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert {"format", "version", "seed", "inputs", "cradle", "release", "lambda", "energy_J"} <= summary.keys()
    assert summary["cradle"]["delta"] == [0.0, 0.001]
    assert (tmp_path / "trajectory.csv").read_text().startswith("t [s],theta_1 [rad],theta_2 [rad],theta_3 [rad]\n0.0,")
    assert (tmp_path / "impacts.csv").read_text().startswith("time [s],pair,speed [m/s],loss [J]\n")
    assert (tmp_path / "run.png").read_bytes().endswith(PNG_END)


@pytest.mark.parametrize("arguments", [["--bobs", "1"], ["--duration", "0.5"], ["--sample-rate", "5"], ["--bobs", "9"]])
def test_simulate_where_sigma_is_not_defined_or_bobs_are_many(arguments, tmp_path):
    arguments = arguments if "--duration" in arguments else [*arguments, "--duration", "3"]
    assert run("simulate", *arguments, "--out", tmp_path) == 0
    json.loads((tmp_path / "summary.json").read_text())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["--lifted", 2, "--duration", 2], "all 2 bobs are lifted alike"), (["--duration", 0.5], "duration is 0.5 s")],
)
def test_simulate_says_why_there_is_no_exponent(arguments, said, tmp_path, capsys):
    assert run("simulate", "--bobs", 2, *arguments, "--out", tmp_path) == 0
    assert f"– ({said}" in capsys.readouterr().out
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["lambda"] is None and (summary["sigma_final"] is None) is (2 in arguments)


def test_simulate_makes_an_experiment_and_reads_one(tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    simulated = ["--bobs", 2, "--duration", 3, "--sample-rate", 60, "--effect", "angle_offset.offset=0.01"]
    assert run("simulate", *simulated, "--experiment", "--noise", 0.002, "--seed", 5, "--out", first) == 0
    experiment = Experiment.load(first / "experiment.toml")
    residual = experiment.runs[0].readings - np.loadtxt(first / "trajectory.csv", delimiter=",", skiprows=1)[:, 1:]
    assert residual.mean() == pytest.approx(0.01, abs=5e-4)
    assert residual.std() == pytest.approx(0.002, rel=0.1)
    source = ["--from", first / "experiment.toml", "--duration", 1]
    assert run("simulate", *source, "--b", 0.003, "--lifted", 2, "--out", second) == 0
    summary = json.loads((second / "summary.json").read_text())
    assert (summary["cradle"]["bobs"], summary["cradle"]["b"], summary["release"]["bobs"]) == (2, 0.003, 2)
    assert summary["cradle"]["effects"] == {"angle_offset": {"offset": 0.01}}


@pytest.mark.parametrize("option", [[], ["--experiment"]])
def test_simulate_replaces_only_what_it_has_written(option, pair, tmp_path, capsys):
    """Measured data stay, be they there before the first run or put beside its results."""
    command = ["simulate", "--bobs", 2, "--duration", 2, "--out", tmp_path]
    name = "run1.csv" if option else "trajectory.csv"
    (tmp_path / name).write_text("measured")
    assert run(*command, *option) == 2
    assert f"{name}: exists and is no result of this command" in refusal(capsys)
    (tmp_path / name).unlink()
    for repeated in (["--experiment"], [], option):
        assert run(*command, *repeated) == 0
    (tmp_path / name).write_text("measured")
    capsys.readouterr()
    assert run(*command, *option) == 2
    assert f"{name}: exists and is no result of this command" in refusal(capsys)
    assert (tmp_path / name).read_text() == "measured"


def test_simulate_beside_an_experiment_leaves_its_data(pair, tmp_path, capsys):
    """A first simulate without --experiment does not make the folder's data ours."""
    path = pair.save(tmp_path)
    command = ["simulate", "--from", path, "--duration", 2, "--out", tmp_path]
    before = (tmp_path / "run1.csv").read_bytes()
    assert run(*command) == 0
    capsys.readouterr()
    assert run(*command, "--experiment") == 2
    assert "experiment.toml: exists and is no result of this command" in refusal(capsys)
    assert (tmp_path / "run1.csv").read_bytes() == before


def test_noise_that_no_simulation_resolves_is_refused_before_one_is_made(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("identification.cli.commands.simulation", None)
    assert run("simulate", "--experiment", "--noise", 1e-9, "--out", tmp_path) == 2
    assert "noise is 1e-09 rad; it must be at least 1e-07" in refusal(capsys)


def test_effects_are_taken_out_and_beta_is_of_the_lengths_set(tmp_path):
    settings = ["--effect=-string_hysteresis", "--set", "length=0.2", "--duration", 1]
    assert run("simulate", *settings, "--out", tmp_path) == 0
    cradle = json.loads((tmp_path / "summary.json").read_text())["cradle"]
    assert "-string_hysteresis" in cradle["effects"]
    assert cradle["groups"]["beta"] == pytest.approx(0.114)


def test_a_parameter_of_each_bob_is_given_as_a_list(tmp_path):
    command = ["simulate", "--bobs", 2, "--effect", "mass_mismatch.relative=0.1,-0.1", "--duration", 1]
    assert run(*command, "--out", tmp_path) == 0
    cradle = json.loads((tmp_path / "summary.json").read_text())["cradle"]
    assert cradle["effects"]["mass_mismatch"]["relative"] == [0.1, -0.1]


def test_a_terminal_without_greek_is_no_error(tmp_path):
    code = "import sys; from identification.cli import app; from identification.reporting.terminal import print_table\n"
    code += "app.app = lambda **_: print_table(['λ [1/s]'], [['δ = −0.1']])\nsys.exit(app.main())"
    environment = os.environ | {"PYTHONIOENCODING": "cp1252", "PYTHONUTF8": "0"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, env=environment)
    assert (done.returncode, done.stderr) == (0, b"") and b"? [1/s]" in done.stdout


def test_what_the_source_leaves_open_is_told(tmp_path, capsys):
    cradle = Cradle(bobs=2, effects={"quadratic_drag": {"c2": 0.01}})
    free = simulated_run(cradle, duration=2.0, state="free", release=None)
    path = Experiment(cradle, (free,), unknown_effect_parameters=("quadratic_drag.c2",)).save(tmp_path)
    command = ["simulate", "--from", path, "--duration", 1, "--out", tmp_path / "o"]
    assert run(*command) == 0
    release, parameter = capsys.readouterr().err.splitlines()
    assert release.startswith("cradle: the first run of") and "0.228 rad is taken" in release
    taken = json.loads((tmp_path / "o" / "summary.json").read_text())["cradle"]["effects"]["quadratic_drag"]["c2"]
    assert f"states no quadratic_drag.c2; {taken} kg/m is taken; --effect quadratic_drag.c2=VALUE" in parameter
    assert run(*command, "--release-angle", 0.2, "--effect", "quadratic_drag.c2=0.01") == 0
    assert capsys.readouterr().err == ""
    assert run(*command, "--release-angle", 0.2, "--effect=-quadratic_drag") == 0
    assert capsys.readouterr().err == ""
    swept = ["--over", "release_angle=0.1,0.2", "--over", "quadratic_drag.c2=0.01,0.02", "--duration", 2]
    assert run("sweep", "--from", path, *swept, "--out", tmp_path / "swept") == 0
    assert capsys.readouterr().err == ""


def test_angles_of_a_source_are_scaled_or_stay_with_their_bobs(tmp_path, capsys):
    cradle, release = Cradle(bobs=2), Release(angles={1: -0.2, 2: 0.1})
    run_of = simulated_run(cradle, duration=2.0, release=ReleaseInfo(release))
    command = ["simulate", "--from", Experiment(cradle, (run_of,)).save(tmp_path), "--duration", 1, "--out"]
    assert run(*command, tmp_path / "o", "--release-angle", 0.05) == 0
    stated = json.loads((tmp_path / "o" / "summary.json").read_text())["release"]
    assert stated["angles"] == pytest.approx({"1": -0.1, "2": 0.05})
    assert run(*command, tmp_path / "o", "--bobs", 3) == 2
    assert "bobs is 3, but the release states angles of bobs 1, 2 of 2" in refusal(capsys)
    assert run(*command, tmp_path / "o", "--bobs", 3, "--lifted", 1) == 0


def test_a_model_with_a_value_per_gap_is_put_on_as_many_bobs_as_are_asked_for(tmp_path):
    model = tmp_path / "model.toml"
    model.write_text('[model]\neffects = ["spacer_offset"]\nparameters = {spacer_offset = {offset = [0.001, 0.002]}}\n')
    command = ["simulate", "--model", model, "--bobs", 3, "--effect", "quadratic_drag.c2=0.002", "--duration", 1]
    assert run(*command, "--out", tmp_path / "o") == 0
    cradle = json.loads((tmp_path / "o" / "summary.json").read_text())["cradle"]
    assert cradle["effects"] == {"spacer_offset": {"offset": [0.001, 0.002]}, "quadratic_drag": {"c2": 0.002}}


def test_sweep(tmp_path, capsys):
    (tmp_path / "model.toml").write_text('[model]\nbase = "pendulum"\neffects = ["-large_angle"]\n')
    command = ["sweep", "--model", tmp_path / "model.toml", "--bobs", 2, "--duration", 4, "--out", tmp_path / "o"]
    command += ["--over", "delta=-0.01,0", "--over", "k_f=1e4:4e4:3:log", "--quantity", "lambda", "--quantity", "sigma"]
    assert run(*command, "--times", "0:4:3", "--table", "t.nc") == 0
    said = capsys.readouterr().out
    assert "λ" in said and "δ = -0.01" in said and "sweep.png" in said
    names = {"plan.json", "runs.npy", "sweep.json", "sweep.png", "t.nc"}
    assert {path.name for path in (tmp_path / "o").iterdir()} == names
    content = json.loads((tmp_path / "o" / "sweep.json").read_text())
    assert {"format", "version", "seed", "inputs", "cradle", "release"} <= content.keys()
    assert (content["cradle"]["model"], content["runs"], content["impossible"]) == ("pendulum", 6, {})
    assert content["axes"]["k_f"] == {"unit": "N s m^-3/2", "first": 1e4, "last": 4e4, "count": 3}
    assert content["quantities"]["lambda"]["largest"]["at"].keys() == {"delta", "k_f"}
    before = (tmp_path / "o" / "runs.npy").stat().st_mtime_ns
    assert run(*command, "--times", "0:4:3") == 0
    assert (tmp_path / "o" / "runs.npy").stat().st_mtime_ns == before
    table = np.genfromtxt(tmp_path / "o" / "sweep.csv", delimiter=",", skip_header=1, usecols=range(6))
    np.testing.assert_allclose(table[:3, 1], [1e4, 2e4, 4e4], rtol=1e-12)
    assert run(*command[:-4], "--quantity", "impacts") == 2
    assert "another sweep" in refusal(capsys)


def test_a_sweep_replaces_only_its_own_tables(tmp_path, capsys):
    (tmp_path / "run1.csv").write_text("measured")
    command = ["sweep", "--over", "delta=0,0.001", "--bobs", 2, "--duration", 2, "--out", tmp_path, "--table"]
    for table in ("sweep.csv", "t.csv", "sweep.csv"):
        assert run(*command, table) == 0
    capsys.readouterr()
    for name, table in (("run1.csv", "run1.csv"), ("t.csv", "t.csv"), ("sweep.png", "sweep.csv")):
        (tmp_path / name).write_text("mine")
        assert run(*command, table) == 2
        assert f"{name}: exists and is no result of this command" in refusal(capsys)
        assert (tmp_path / name).read_text() == "mine"


@pytest.mark.parametrize(
    ("command", "names"),
    [
        (["sweep", "--over", "delta=0", "--explore"], ["runs.npy", "sweep.png", "explore.html", "sweep.csv"]),
        (["calibrate", "experiment.toml"], ["fit.png", "posterior.nc", "lambda.png"]),
        (["diagnose", "experiment.toml"], ["report.html", "model.toml", "diagnosis.json"]),
        (["design", "experiment.toml"], ["report.html", "design.png"]),
        (["predict", "calibrated"], ["prediction.csv", "prediction.png"]),
        (["bench"], ["bench.json"]),
        (["reproduce"], ["claims.md"]),
    ],
    ids=lambda value: value[0],
)
def test_what_a_command_has_not_written_is_refused_before_any_work(
    command, names, pair, calibrated, tmp_path, monkeypatch, capsys
):
    """And so is a file where the folder should be."""
    monkeypatch.chdir(tmp_path)
    pair.save(tmp_path)
    (tmp_path / "calibrated").symlink_to(calibrated)
    work = ("inference.calibration.normal_approximation", "diagnosis.selection.searcher.find_mode",
            "inference.posterior.Posterior.load", "bench.run.race",
            "sweep.engine.simulate")  # fmt: skip
    for name in work:
        monkeypatch.setattr(f"identification.{name}", lambda *_, **__: pytest.fail("worked"))
    for name in names:
        out = tmp_path / f"beside-{name}"
        out.mkdir()
        (out / name).write_text("mine")
        assert run(*command, "--out", out) == 2
        said = refusal(capsys)
        assert name in said or "holds the report of" in said
        assert [(path.name, path.read_text()) for path in out.iterdir()] == [(name, "mine")]
    assert run(*command, "--out", out / name) == 2
    assert "is a file; name a folder" in refusal(capsys)


def test_sweep_tells_what_was_never_reached(tmp_path, capsys):
    """No pair is synchronized after 3 s, so there is no time of it."""
    settings = ["--over", "delta=0,0.001", "--bobs", 2, "--duration", 3, "--quantity", "synchronization_time"]
    assert run("sweep", *settings, "--out", tmp_path) == 0
    assert "–" in capsys.readouterr().out
    found = json.loads((tmp_path / "sweep.json").read_text())["quantities"]["synchronization_time"]
    assert (found["least"], found["largest"]) == (None, None)


def test_sweep_tells_what_does_not_matter(tmp_path, capsys):
    settings = ["--model", "pendulum", "--bobs", 2, "--duration", 3, "--out"]
    assert run("sweep", "--over", "beta=0.1,0.2", "--over", "k_f=1e4,2e4", *settings, tmp_path / "rigid") == 0
    told = capsys.readouterr().err
    assert told.startswith("cradle: beta does not matter") and told.count("\n") == 1
    assert run("sweep", "--over", "beta=0.1,0.2", *settings[2:], tmp_path / "elastic") == 0
    assert "does not matter" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("axis", "idle", "busy"),
    [
        ("alpha=0.03,0.04", {"effects": {"-velocity_dependent_restitution": {}}}, {}),
        ("n=0.1,0.2", {"bobs": 1}, {"power_law": (0.03, 0.2)}),
        ("pivot_half_spacing=0.05,0.1", {"model": "pendulum"}, {}),
        ("youngs_modulus=1e11,2e11", {"power_law": (0.03, 0.2)}, {}),
        ("poisson_ratio=0.1,0.3", {"effects": {"-velocity_dependent_restitution": {}}}, {"model": "ho"}),
    ],
)
def test_what_is_said_not_to_matter_leaves_the_motion_as_it_is(axis, idle, busy):
    name, values = sweep_command.parse_axis(axis)
    for fields, matters in ((idle, False), (busy, True)):
        grid = Grid({name: values}, Cradle(**{"bobs": 2, **fields}), Release(angle=0.2))
        assert sweep_command._ignored_axes(grid) == ([] if matters else [name])
        one, other = (simulate(*grid.point(i), 2.0).theta for i in range(2))
        assert np.array_equal(one, other) is not matters


def test_sweep_makes_a_page(tmp_path, capsys):
    settings = ["--over", "beta=0.1,0.2", "--bobs", 2, "--duration", 3]
    assert run("sweep", "--explore", *settings, "--out", tmp_path) == 0
    assert f"page: {tmp_path / 'explore.html'}" in capsys.readouterr().out
    assert "<canvas" in (tmp_path / "explore.html").read_text()


def test_new_writes_an_experiment_and_does_not_overwrite_it(pair, tmp_path, capsys):
    pair.save(tmp_path)
    (tmp_path / "experiment.toml").unlink()
    assert run("new", tmp_path / "run1.csv") == 0
    assert Experiment.load(tmp_path / "experiment.toml").cradle.bobs == 2
    assert run("new", tmp_path / "run1.csv") == 2
    assert run("new", tmp_path / "run1.csv", "--overwrite") == 0


@pytest.mark.slow  # the trial of the wheel calibrates, too
@pytest.mark.parametrize(
    ("total", "status", "said"), [(["--steps", 60], 1, "have not converged"), ([], 0, "have converged")]
)
def test_calibrate_from_end_to_end_with_one_bob(total, status, said, tmp_path, capsys):
    """An unconverged chain is kept, with status 1 and the reason; the same command goes on to the asked total."""
    cradle = Cradle(bobs=1, model="pendulum")
    path = Experiment(cradle, (simulated_run(cradle, duration=8.0),)).save(tmp_path)
    out = tmp_path / "out"
    assert run("calibrate", path, "--out", out, "--steps", 50) == 1
    assert "have not converged" in capsys.readouterr().err
    names = {"chain.h5", "corner.png", "fit.png", "posterior.nc", "report.html", "residuals.png", "summary.json"}
    assert {path.name for path in out.iterdir()} == names
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["converged"], summary["steps"], summary["lambda"]) == (False, 50, None)
    assert run("calibrate", path, "--out", out, *total) == status
    assert said in "".join(capsys.readouterr())
    summary = json.loads((out / "summary.json").read_text())
    assert summary["converged"] == (status == 0) and summary["steps"] >= 60
    assert list(summary["parameters"]) == ["b"]


@pytest.mark.parametrize("converged", [True, False])
def test_calibrate_ends_as_the_chains_do(converged, pair, tmp_path, monkeypatch, capsys):
    from identification.inference import calibration

    posterior = made_up_posterior(pair, converged=converged)
    monkeypatch.setattr(calibration, "calibrate", lambda *_, **__: posterior)
    path = pair.save(tmp_path)
    assert run("calibrate", path, "--out", tmp_path / "out") == (0 if converged else 1)
    captured = capsys.readouterr()
    assert ("R̂ = 1.0700, wanted below 1.01; ESS = 120" in captured.err) is not converged
    assert (tmp_path / "out" / "lambda.png").read_bytes().endswith(PNG_END)
    assert f"report: {tmp_path / 'out' / 'report.html'}" in captured.out


def test_simulate_and_calibrate_leave_each_others_summary(pair, tmp_path, capsys):
    path, summary = pair.save(tmp_path / "data"), tmp_path / "summary.json"
    for command, other in ((["simulate"], "cradle-posterior/1"), (["calibrate", path], "cradle-run/1")):
        summary.write_text(json.dumps({"format": other}))
        assert run(*command, "--out", tmp_path) == 2
        assert "summary.json: exists and is no result of this command" in refusal(capsys)
        assert json.loads(summary.read_text()) == {"format": other}


def test_an_interrupted_calibration_says_how_to_go_on(pair, tmp_path, monkeypatch, capsys):
    from identification.inference import calibration

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(calibration, "calibrate", interrupted)
    assert run("calibrate", pair.save(tmp_path), "--out", tmp_path / "out") == 130
    said = refusal(capsys)
    assert "chain.h5" in said and "the same command goes on" in said


def test_predict(calibrated, tmp_path, capsys):
    settings = ["--delta", 0.001, "--release-angle", 0.1, "--bobs", 3, "--draws", 5]
    assert run("predict", calibrated, "--out", tmp_path, *settings) == 0
    assert "σ(30 s)" in capsys.readouterr().out
    content = json.loads((tmp_path / "prediction.json").read_text())
    assert (content["bobs"], content["delta"], content["draws"]) == (3, 0.001, 5)
    assert {"unit", "mean", "sd", "median", "ci68", "ci95", "window_s"} <= content["lambda"].keys()
    assert content["lambda"]["window_s"] == [1.0, 60.0]
    bands = np.loadtxt(tmp_path / "prediction.csv", delimiter=",", skiprows=1)
    assert np.all(bands[:, 4] <= bands[:, 1]) and np.all(bands[:, 1] <= bands[:, 5])
    assert (tmp_path / "prediction.png").read_bytes().endswith(PNG_END)


def test_asking_for_what_was_calibrated_changes_nothing(calibrated):
    posterior = Posterior.load(calibrated / "posterior.nc")
    own, asked = posterior.predict(count=2), posterior.predict(bobs=posterior.experiment.cradle.bobs, count=2)
    assert own.cradle == asked.cradle
    np.testing.assert_array_equal(own.sigma, asked.sigma)


def test_a_prediction_tells_the_inputs_of_its_calibration(pair, tmp_path):
    """Those are the files as they were written, comments included."""
    path = pair.save(tmp_path)
    path.write_text("# of my cradle\n" + path.read_text(encoding="utf-8"), encoding="utf-8")
    posterior = made_up_posterior(Experiment.load(path), steps=20)
    file = posterior.save(tmp_path / "posterior.nc")
    assert run("predict", file, "--draws", 2, "--out", tmp_path) == 0
    predicted = json.loads((tmp_path / "prediction.json").read_text())
    assert predicted["inputs"] == posterior.summary()["inputs"] == Experiment.load(path).digest != pair.digest


def test_a_prediction_takes_a_draw_at_least(calibrated):
    with pytest.raises(ValueError, match="count is 0; it must be at least 1"):
        Posterior.load(calibrated / "posterior.nc").predict(count=0)


def test_prediction_follows_its_seed(calibrated):
    posterior = Posterior.load(calibrated / "posterior.nc")
    again, other = dataclasses.replace(posterior), dataclasses.replace(posterior, seed=posterior.seed + 1)
    np.testing.assert_array_equal(posterior.draws(5), again.draws(5))
    assert not np.array_equal(posterior.draws(5), other.draws(5))


KILLED = """
import os, signal, sys
from pathlib import Path
from identification.storage.files import atomic_replacement
with atomic_replacement(Path(sys.argv[1])) as temporary:
    temporary.write_text("half of")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_kill_halfway_leaves_nothing_half_written(tmp_path):
    target = tmp_path / "summary.json"
    for before in (None, "whole"):
        if before is not None:
            target.write_text(before)
        done = subprocess.run([sys.executable, "-c", KILLED, target], check=False)
        assert done.returncode == -signal.SIGKILL
        assert (target.read_text() if target.exists() else None) == before


def test_a_reader_that_goes_away_is_no_error():
    command = f"'{sys.executable}' -m identification simulate --help | true"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert done.stderr == ""


def test_the_race_is_fair(monkeypatch):
    """Both run as often and are timed by their best; what SciPy's peer can know beforehand is not timed."""
    from identification.bench import run as bench
    from identification.bench import scipy_contact, scipy_peer

    ran = []

    def told(name, function):
        return lambda *run, **how: ran.append((name, how.get("rtol"), how.get("tolerance"))) or function(*run, **how)

    monkeypatch.setattr(bench, "simulate", told("ours", bench.simulate))
    monkeypatch.setattr(scipy_peer, "simulate", told("SciPy", scipy_peer.simulate))
    bench.race(2, 0.2, 0.2)
    reference, *timed = ran
    assert reference == ("SciPy", 1e-13, None)
    assert [timed.count(("SciPy", 1e-8, None)), *(timed.count(("ours", None, t)) for t in (1e-14, 1e-15))] == [6, 6, 6]
    assert scipy_contact.restitution_curve.cache_info().currsize > 0


@pytest.mark.slow
def test_bench(tmp_path, monkeypatch, capsys):
    from identification.bench import run as bench

    monkeypatch.setattr(bench, "first_calls", lambda: {"first call": 9.0, "first call, cached": 0.5})
    monkeypatch.setattr(bench, "import_times", lambda: {"import cradle_env": 0.3, "import gymnasium": 0.2})
    assert run("bench", "--duration", 1, "--out", tmp_path) == 0
    assert "SciPy DOP853" in capsys.readouterr().out
    content = json.loads((tmp_path / "bench.json").read_text())
    assert [row["bobs"] for row in content["races"]] == [2, 2, 2, 5, 5, 5]
    for row in content["races"]:
        assert row["error"] < 1e-6
        assert row["ratio"] > 20.0 or "SciPy" in row["integrator"]
    assert content["import_ratio"] == pytest.approx(1.5)
