"""The JSON Schemas that the package publishes: what commands write is as they say, and what they refuse is unusable."""

import dataclasses
import json
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from cradle_env import Cradle
from identification import Experiment
from identification.cli.app import main
from identification.storage.schema import check_schema
from tests.paths import ROOT
from tests.synthetic import made_up_posterior, simulated_run

SCHEMAS = sorted((ROOT / "identification" / "storage" / "schemas").glob("*.schema.json"))
SHIPPED = sorted((ROOT / "examples").rglob("*.toml"))
GOOD = """
format = "cradle-experiment/1"
[cradle]
bobs = 2
delta = [0.001]
[model]
base = "nsp"
effects = ["quadratic_drag", "-string_hysteresis"]
[model.parameters]
quadratic_drag = { c2 = 0.002 }
[[run]]
file = "run1.csv"
release = { angles = { 2 = 0.2, 1 = -0.1 }, angle_sd = 0.001, start = "hanging" }
noise = 0.001
fit_to = 4.0
state = "release"
[infer]
length = { mean = 0.30, sd = 0.002 }
"quadratic_drag.c2" = { low = 0.0, high = 0.01 }
"""


def check_experiment(path: Path) -> None:
    """ExperimentError unless an experiment.toml is as its schema says."""
    check_schema(tomllib.loads(path.read_text(encoding="utf-8")), "experiment", path)


def check_result(path: Path, name: str) -> None:
    """ExperimentError unless a JSON file is as the schema of that name says."""
    check_schema(json.loads(path.read_text(encoding="utf-8")), name, path)


@pytest.fixture(scope="module")
def pair() -> Experiment:
    cradle = Cradle(bobs=2, model="pendulum")
    return Experiment(cradle, (simulated_run(cradle, duration=6.0),))


@pytest.mark.parametrize("path", SCHEMAS, ids=lambda path: path.name)
def test_schemas_are_schemas(path):
    schema = json.loads(path.read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(schema)
    assert schema["title"]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.name)
def test_the_experiments_of_the_examples_are_valid(path):
    check_experiment(path)


def test_the_experiments_that_commands_write_are_valid(pair, tmp_path):
    check_experiment(pair.save(tmp_path / "saved"))
    (tmp_path / "saved" / "experiment.toml").unlink()
    assert main(["new", str(tmp_path / "saved" / "run1.csv")]) == 0
    check_experiment(tmp_path / "saved" / "experiment.toml")
    settings = "--bobs 3 --duration 3 --effect quadratic_drag.c2=0.002 --experiment".split()
    assert main(["simulate", *settings, "--out", str(tmp_path / "simulated")]) == 0
    check_experiment(tmp_path / "simulated" / "experiment.toml")
    check_result(tmp_path / "simulated" / "summary.json", "run")


def test_a_cradle_has_the_keys_of_the_schema():
    schema = json.loads((SCHEMAS[0].parent / "experiment.schema.json").read_text(encoding="utf-8"))
    fields = {field.name for field in dataclasses.fields(Cradle)} - {"model", "effects"}
    assert schema["properties"]["cradle"]["properties"].keys() == fields


@pytest.mark.parametrize(
    ("valid", "invalid"),
    [
        ("", ""),
        ("cradle-experiment/1", "cradle-experiment/0"),
        ("bobs = 2", "bobs = 0"),
        ("bobs = 2", "bob = 2"),
        ("bobs = 2", "bobs = 2\nmass = 0"),
        ('base = "nsp"', 'base = "nps"'),
        ("c2 = 0.002", "c2 = true"),
        ('"run1.csv"', "1"),
        ("[[run]]", "[run]"),
        ("2 = 0.2", "two = 0.2"),
        ("angle_sd = 0.001", "angle_sd = -0.001"),
        ('start = "hanging"', 'start = "loose"'),
        ("noise = 0.001", "noise = 0.0"),
        ('state = "release"', 'state = "known"'),
        ("sd = 0.002", "low = 0.29"),
        ("low = 0.0, ", ""),
    ],
)
def test_the_schema_and_the_program_accept_and_refuse_the_same(pair, tmp_path, valid, invalid):
    pair.save(tmp_path)
    path = tmp_path / "experiment.toml"
    path.write_text(GOOD.replace(valid, invalid) if valid else GOOD, encoding="utf-8")
    for read in (check_experiment, Experiment.load):
        if valid:
            with pytest.raises(ValueError, match=r"experiment\.toml"):
                read(path)
        else:
            read(path)


def test_calibrations_and_predictions_are_as_their_schemas_say(pair, tmp_path):
    posterior = made_up_posterior(pair)
    check_schema(json.loads(json.dumps(posterior.summary())), "summary", "summary.json")
    posterior.save(tmp_path / "posterior.nc")
    assert main(["predict", str(tmp_path), "--draws", "2", "--out", str(tmp_path / "predicted")]) == 0
    check_result(tmp_path / "predicted" / "prediction.json", "prediction")
