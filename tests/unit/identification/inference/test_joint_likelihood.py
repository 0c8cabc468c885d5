"""One likelihood of runs and instruments: what a constraint adds, and that files of instruments are read."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from cradle_env import Cradle
from identification.experiment.constraint import Constraint
from identification.experiment.experiment import Experiment
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import find_mode
from identification.inference.search_options import SearchOptions
from tests.synthetic import simulated_run

RINGDOWN = Constraint(
    "ringdown", ("b_1", "quadratic_drag.c2"), np.array([2.1e-3, 1e-3]), np.array([[4e-8, -1e-8], [-1e-8, 9e-8]])
)  # fmt: skip
STRING = Constraint("string", ("kappa",), np.array([210.0]), np.array([[25.0]]))


def pair(**fields):
    cradle = Cradle(bobs=2)
    return Experiment(cradle, (simulated_run(cradle, duration=3.0),), **fields)


def test_a_constraint_adds_its_normal_log_density():
    """The correlated errors of a ring-down, whose quadratic drag the model lacks: it counts as 0."""
    alone, joint = Likelihood(pair()), Likelihood(pair(constraints=(RINGDOWN, STRING)))
    rng, added, exact = np.random.default_rng(2), [], []
    for _ in range(5):
        point = alone.start() + 0.02 * rng.standard_normal(len(alone.unknowns)) * (1.0 + np.abs(alone.start()))
        values = alone.values(point)
        added.append(joint.log_density(point)[0] - alone.log_density(point)[0])
        exact.append(
            multivariate_normal(RINGDOWN.mean, RINGDOWN.covariance).logpdf([values["b"], 0.0])
            + multivariate_normal(STRING.mean, STRING.covariance).logpdf([values["kappa"]])
        )
        # Least squares sees the same: half the sum of squares falls as the log density does.
        squares = [np.sum(one.residuals(point) ** 2) for one in (alone, joint)]
        assert squares[1] - squares[0] == pytest.approx(
            np.sum(RINGDOWN.residuals(alone.cradle(values)) ** 2) + np.sum(STRING.residuals(alone.cradle(values)) ** 2)
        )
    assert np.ptp(np.array(added) - exact) < 1e-6  # up to one constant


def test_the_mode_is_the_precision_weighted_mean():
    """A constraint as strong as the run itself moves κ half way, and its variance falls to half."""
    options = SearchOptions(draws=64)
    experiment = pair()
    likelihood, mode = find_mode(Likelihood(experiment), 0, None, options)
    k = likelihood.names.index("kappa")
    kappa = float(np.exp(mode.point[k]))
    sd = kappa * float(np.sqrt(mode.covariance[k, k]))
    string = Constraint("string", ("kappa",), np.array([kappa + 0.2 * sd]), np.array([[sd**2]]))
    joint, both = find_mode(Likelihood(dataclasses.replace(experiment, constraints=(string,))), 0, None, options)
    # 0.03: the motion is not quite linear in κ; at a whole standard deviation it would be 0.04 off.
    assert (np.exp(both.point[k]) - kappa) / (0.2 * sd) == pytest.approx(0.5, abs=0.03)
    assert both.covariance[k, k] / mode.covariance[k, k] == pytest.approx(0.5, abs=0.03)
    assert joint.reading_slices()[-1].stop == likelihood.reading_slices()[-1].stop  # no reading more


def test_what_is_saved_loads_the_same(tmp_path):
    made = pair(constraints=(RINGDOWN, STRING, dataclasses.replace(STRING, mean=np.array([190.0]))))
    path = made.save(tmp_path)
    names = ["experiment.toml", "ringdown.json", "run1.csv", "string-2.json", "string.json"]
    assert sorted(file.name for file in tmp_path.iterdir()) == names
    for read in (Experiment.load(path), Experiment.from_texts(made.texts())):
        assert read.digest == made.digest
        kept, stated = ([(one.kind, *one.mean) for one in each.constraints] for each in (read, made))
        assert kept == stated
    assert made.digest != pair().digest


TEXT = """format = "cradle-experiment/1"
[cradle]
bobs = 2
[[sound]]
file = "sound/measurement.json"
release = { bobs = 1, angle = 0.228 }
noise = 2e-5
[[string]]
file = "string/measurement.json"
"""


def files(folder, kind="string", **change):
    """Folders of a sound and of a string, as cradle measure writes them."""
    stamp = {"format": "cradle-measurement/1", "kind": "sound", "files": {"clicks.csv": "", "report.html": ""}}
    (folder / "sound").mkdir()
    (folder / "string").mkdir()
    (folder / "sound" / "measurement.json").write_text(json.dumps(stamp | change), encoding="utf-8")
    (folder / "sound" / "clicks.csv").write_text("t [s],amplitude\n1.0,2\n1.55,2\n2.1,1\n", encoding="utf-8")
    (folder / "string" / "measurement.json").write_text(STRING.text().replace("string", kind), encoding="utf-8")
    (folder / "experiment.toml").write_text(TEXT, encoding="utf-8")
    return folder / "experiment.toml"


def test_a_sound_and_a_string_are_an_experiment(tmp_path):
    read = Experiment.load(files(tmp_path))
    (run,) = read.runs
    assert run.of_impacts and run.times.tolist() == [1.0, 1.55, 2.1] and run.noise == 2e-5
    assert read.constraints[0].quantities == ("kappa",) and read.constraints[0].mean.tolist() == [210.0]
    again = Experiment.load(read.save(tmp_path / "again"))
    assert again.runs[0].of_impacts and again.runs[0].file == "clicks.csv"


@pytest.mark.parametrize(
    ("change", "toml", "said"),
    [
        ({"kind": "impacts"}, {}, r"^string/measurement.json: holds a measurement of impacts"),
        ({"files": {}}, {}, "^sound/measurement.json: names no table of clicks"),
        ({"files": {"other.csv": ""}}, {}, "line 5: .*no file.*other.csv"),
        ({}, {"string/measurement": "string/other"}, r"line 9: string\[1\].file: there is no file"),
        ({}, {"[[string]]": "[string]"}, r"one \[\[string\]\] table"),
        ({}, {"[[string]]": "[[strings]]"}, "unknown table 'strings'.*string"),
        ({}, {"noise = 2e-5": 'quantity = "impacts"'}, "quantity"),
        ({}, {'file = "string/measurement.json"': ""}, "file is missing"),
    ],
)
def test_unusable_instruments_are_refused_in_one_line(tmp_path, change, toml, said):
    path = files(tmp_path, **change)
    text = TEXT
    for old, new in toml.items():
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=said) as refused:
        Experiment.load(path)
    assert "\n" not in str(refused.value)


def test_a_ring_down_of_another_mass_is_refused(tmp_path):
    other = dataclasses.replace(RINGDOWN, assumed={"mass": 0.5})
    with pytest.raises(ValueError, match=r"measured with mass = 0.5 kg, but \[cradle\] has 0.2813"):
        pair(constraints=(other,))
