"""The examples run, and what they show is in step with the project."""

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from identification.experiment import Experiment

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"


def example(name: str) -> dict:
    """The names that an example defines."""
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))


def test_the_readme_has_the_catalogue_of_now():
    catalogue = example("catalogue")
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert catalogue["table"]() in text
    assert catalogue["updated"](text) == text, "run python examples/catalogue.py --write"


def test_the_example_experiment_is_what_its_script_makes(tmp_path):
    example("make_example")["make"](tmp_path, duration=3.0)
    shipped, made = (Experiment.load(folder / "experiment.toml") for folder in (EXAMPLES / "ring-2", tmp_path))
    assert made.cradle == shipped.cradle
    rows = len(made.runs[0].times)
    np.testing.assert_allclose(made.runs[0].times, shipped.runs[0].times[:rows], rtol=0, atol=1e-12)
    # Noise is drawn for all readings at once, row by row: the shorter record begins like the longer one.
    np.testing.assert_allclose(made.runs[0].readings, shipped.runs[0].readings[:rows], rtol=0, atol=2e-6)


def test_an_effect_of_ones_own_takes_energy(capsys):
    assert example("own_effect")["main"](duration=6.0) > 1e-4
    assert "with a magnet: λ = " in capsys.readouterr().out


def test_the_film_is_made(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["film.py", "--out", str(tmp_path), "--seconds", "1.0"])
    example("film")["main"]()
    assert "film.gif" in capsys.readouterr().out
    for name, frames in (("film.gif", 21), ("still.png", 1)):
        with Image.open(tmp_path / name) as picture:
            assert (picture.size, getattr(picture, "n_frames", 1)) == ((800, 600), frames)


@pytest.mark.slow
def test_the_demo_finds_the_truth(tmp_path):
    done = subprocess.run([sys.executable, EXAMPLES / "demo.py", "--out", tmp_path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for name in ("five-balls/run.png", "ring-2/report.html", "ring-2/summary.json", "prediction/prediction.png"):
        assert (tmp_path / name).is_file()


def test_the_demo_runs_its_commands(tmp_path, monkeypatch, capsys):
    """With the commands themselves replaced: each has tests of its own."""
    from identification import cli

    asked = []
    monkeypatch.setattr(cli, "main", lambda arguments: asked.append(arguments[0]) or 0)
    monkeypatch.setattr(sys, "argv", ["demo.py", "--out", str(tmp_path), "--steps", "60"])
    example("demo")["main"]()
    assert asked == ["simulate", "calibrate", "predict"]
    assert "report.html" in capsys.readouterr().out
