"""The examples run, and what they show is in step with the project."""

import itertools
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from identification.experiment.experiment import Experiment
from tests.paths import ROOT

EXAMPLES = ROOT / "examples"


def example(name: str) -> dict:
    """The names that an example defines."""
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))


def test_the_example_experiment_is_what_its_script_makes(tmp_path):
    example("make_example")["make"](tmp_path, duration=3.0)
    shipped, made = (Experiment.load(folder / "experiment.toml") for folder in (EXAMPLES / "ring-2", tmp_path))
    assert made.cradle == shipped.cradle
    rows = len(made.runs[0].times)
    np.testing.assert_allclose(made.runs[0].times, shipped.runs[0].times[:rows], rtol=0, atol=1e-12)
    # Noise is drawn for all readings at once, row by row: the shorter record begins like the longer one.
    np.testing.assert_allclose(made.runs[0].readings, shipped.runs[0].readings[:rows], rtol=0, atol=2e-6)


def test_the_example_film_is_what_its_script_makes(tmp_path):
    pytest.importorskip("av")
    from identification.apparatus.video.frames import Film

    example("make_film")["make"](tmp_path / "film.mp4", duration=1.0)
    shipped, made = (
        [picture for _, picture in itertools.islice(Film(path).gray(), 25)]
        for path in (EXAMPLES / "film-2" / "film.mp4", tmp_path / "film.mp4")
    )
    # The codec's version may differ, and a bob has 100 grey levels of contrast: 2 is the noise of a pixel.
    assert np.abs(np.subtract(shipped, made, dtype=float)).mean() < 2.0


def test_an_effect_of_ones_own_takes_energy(capsys):
    assert example("own_effect")["main"](duration=6.0) > 1e-4
    assert "with a magnet: λ = " in capsys.readouterr().out


def test_the_film_is_made(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["film.py", "--out", str(tmp_path), "--seconds", "4.0"])
    example("film")["main"]()
    assert "film.gif" in capsys.readouterr().out
    for name, frames in (("film.gif", 31), ("still.png", 1)):
        with Image.open(tmp_path / name) as picture:
            assert (picture.size, getattr(picture, "n_frames", 1)) == ((480, 360), frames)


def pictures_of(name: str, monkeypatch, capsys, folder: Path, *arguments: str) -> tuple[str, set[str]]:
    """What an example prints, and the pictures that it writes; every one of them is mentioned."""
    monkeypatch.setattr(sys, "argv", [f"{name}.py", "--out", str(folder), *arguments])
    monkeypatch.setattr(sys, "path", list(sys.path))
    example(name)["main"]()
    said, made = capsys.readouterr().out, {path.name for path in folder.iterdir()}
    assert all(str(folder / picture) in said for picture in made)
    return said, made


@pytest.mark.parametrize("task", ["sustain", "synchronize"])
def test_control_beats_every_fixed_setting(task, monkeypatch):
    """On average: a law synchronizes some starts no sooner than a fixed spacer."""
    tasks = example("tasks")
    fixed, by_hand = (
        tasks["play"](task, policy, 16)["returns"].mean()
        for policy in (tasks["constant"](tasks["best_fixed"](task, 9, 2)), tasks["by_hand"](task))
    )
    assert by_hand > fixed + 0.1


def test_a_run_played_again_is_the_same():
    tasks = example("tasks")
    interval = tasks["SETTINGS"]["control_interval"]
    seen = []

    def policy(observations):
        seen.append(observations[0, 5:10])
        return tasks["by_hand"]("sustain")(observations)

    played = tasks["play"]("sustain", policy, 1)
    motion = tasks["again"]("sustain", played, 3, 3.0)
    assert len(motion["time"]) == round(3.0 / interval) * 3
    np.testing.assert_allclose(motion["theta"][2::3], seen[1:31], rtol=0, atol=1e-4)


@pytest.mark.parametrize(("algorithm", "task"), [("PPO", "sustain"), ("SAC", "synchronize")])
def test_agents_learn(algorithm, task, tmp_path, monkeypatch, capsys):
    pytest.importorskip("stable_baselines3")
    arguments = ("--algorithm", algorithm, "--task", task, "--steps", "64", "--episodes", "2")
    said, made = pictures_of("train", monkeypatch, capsys, tmp_path, *arguments)
    assert made == {f"{task}-{algorithm}-learning.png", f"{task}-{algorithm}-behaviour.png"}
    assert f"{algorithm} learned for" in said


@pytest.mark.slow
def test_plans_are_better_than_fixed_settings(tmp_path, monkeypatch, capsys):
    arguments = ("--task", "sustain", "--candidates", "16", "--horizon", "1.5", "--episodes", "1")
    said, made = pictures_of("plan", monkeypatch, capsys, tmp_path, *arguments)
    assert made == {"sustain-plan.png"}
    gained = {name: float(said.split(name)[1].split()[1]) for name in ("best fixed δ", "planned")}
    assert gained["planned"] > gained["best fixed δ"]


def test_copies_of_a_cradle_move_like_it(monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    plan = example("plan")
    cradle, imagined = plan["make"]("sustain", 1), plan["make"]("sustain", 3)
    cradle.reset(seed=5)
    imagined.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, 60)
    for action in actions[:30]:
        cradle.step(np.array([[action]]))
    imagined.set_state(cradle.get_state().repeated(3))
    for action in actions[30:]:
        seen = imagined.step(np.full((3, 1), action))[0]
        np.testing.assert_array_equal(seen, np.repeat(cradle.step(np.array([[action]]))[0], 3, axis=0))


def test_designs_are_found(tmp_path, monkeypatch, capsys):
    pytest.importorskip("bayes_opt")
    said, made = pictures_of("design", monkeypatch, capsys, tmp_path, *"--budget 7 --repeats 1 --columns 4".split())
    assert made == {"design.png"}
    assert "slowest, Bayesian: λ = " in said


@pytest.mark.slow
def test_the_data_lead_from_ho_to_nsp(tmp_path, capsys):
    diagnosis = example("from_ho")["main"](tmp_path)
    assert diagnosis.effects == ("large_angle", "radial_elasticity", "string_hysteresis")
    training = [diagnosis.base.training_gap(), *(step.after.training_gap() for step in diagnosis.repaired.steps)]
    assert all(after < before for before, after in itertools.pairwise(training))
    assert diagnosis.gap_first > 30.0 and diagnosis.gap_last < 1.05
    truth = example("make_example")["TRUE"]
    for name in ("k_f", "kappa", "b"):
        low, high = diagnosis.parameters[name].ci95
        assert abs(diagnosis.parameters[name].median - truth[name]) < 0.75 * (high - low)  # three sd
    assert (tmp_path / "from-ho.png").is_file() and "report.html" in capsys.readouterr().out


@pytest.mark.slow
def test_the_demo_finds_the_truth(tmp_path):
    done = subprocess.run([sys.executable, EXAMPLES / "demo.py", "--out", tmp_path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for name in ("five-balls/run.png", "ring-2/report.html", "ring-2/summary.json", "prediction/prediction.png"):
        assert (tmp_path / name).is_file()


def test_the_demo_runs_its_commands(tmp_path, monkeypatch, capsys):
    """With the commands themselves replaced: each has tests of its own."""
    from identification.cli import app

    asked = []
    monkeypatch.setattr(app, "main", lambda arguments: asked.append(arguments[0]) or 0)
    monkeypatch.setattr(sys, "argv", ["demo.py", "--out", str(tmp_path), "--steps", "60"])
    example("demo")["main"]()
    assert asked == ["simulate", "calibrate", "predict"]
    assert "report.html" in capsys.readouterr().out
