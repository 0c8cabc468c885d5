"""Clicks against predicted impacts: the density is that of missed, heard and false clicks over all ways to match."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from scipy.stats import norm

from cradle_env import Cradle, Release, simulate
from identification import diagnose
from identification.diagnosis.data_checks.readings import check_readings, without_clicks
from identification.experiment.experiment import Experiment, ExperimentError
from identification.experiment.scaffold import scaffold
from identification.inference.click_likelihood import GATE, log_density, release_instant
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import find_mode
from tests.reference.click_sound import CONTACT

TEXT = """format = "cradle-experiment/1"
[cradle]
bobs = 2
[[run]]
file = "clicks.csv"
quantity = "impacts"
release = { bobs = 1, angle = 0.228 }
"""


def every_match(clicks, predicted, noise, missed, rate):
    """The density by all assignments of clicks to predicted ones, one to one, clicks in between being false."""
    span, total = clicks[-1] - clicks[0] + 2.0 * GATE, 0.0
    for owners in itertools.product(range(-1, len(clicks)), repeat=len(predicted)):
        used = [j for j in owners if j >= 0]
        if len(set(used)) < len(used):
            continue
        term = math.exp(-rate * span) * rate ** (len(clicks) - len(used))
        for i, j in enumerate(owners):
            term *= missed if j < 0 else (1.0 - missed) * norm.pdf(clicks[j], predicted[i], noise)
        total += term
    return math.log(total)


@pytest.mark.parametrize("clicks", [[1.0, 1.5, 2.0001, 2.5], [1.0, 1.0002, 1.7, 2.5], [1.0, 2.5]])
def test_the_density_is_the_sum_over_all_ways_to_match(clicks):
    """Clicks are at least 100 σ from a second predicted one: what the formula neglects is nil."""
    clicks, predicted = np.array(clicks), np.array([1.0, 1.5, 2.0, 2.5])
    exact = every_match(clicks, predicted, 2e-4, 0.1, 0.3)
    # A predicted one may own several clicks in the formula, only one here: two clicks 1 σ apart lie between.
    assert log_density(clicks, predicted, 2e-4, 0.1, 0.3) == pytest.approx(exact, abs=1e-9)


def heard(seed=0, noise=1e-5, lag=0.0):
    """(clicks of 60 s, release at 1.234 s, a tenth missed and three false ones; the cradle).

    lag: part of the contact by which clicks follow the touch, of contacts by Hertz's law as `CONTACT` has it.
    """
    rng, cradle = np.random.default_rng(seed), Cradle(bobs=2, k_f=16000.0, kappa=202.0, b=0.0023)
    impacts = simulate(cradle, Release(angle=0.228), duration=58.0, sample_rate=10.0).impacts
    kept = rng.random(len(impacts)) > 0.1
    kept[0] = True
    heard = impacts[kept]
    clicks = (
        1.234 + heard["time"] + lag * CONTACT * heard["speed"] ** -0.2 + noise * rng.standard_normal(int(kept.sum()))
    )
    return np.sort(np.concatenate([clicks, rng.uniform(2.0, 58.0, 3)])), cradle


def experiment_of(clicks, text=TEXT):
    lines = ["t [s],amplitude", *(f"{t!r},1.0" for t in clicks.tolist()), ""]
    return Experiment.from_texts({"experiment.toml": text, "clicks.csv": "\n".join(lines)})


def test_the_release_is_found_before_the_first_impact():
    experiment = experiment_of(heard()[0])
    # Of the start values, whose strings are 3 % softer.
    assert release_instant(experiment.cradle, experiment.runs[0]) == pytest.approx(1.234, abs=2e-3)


def test_the_mode_is_that_of_the_cradle_that_clicked():
    """Within four standard deviations, and these are of the size of a timing error over a minute."""
    clicks, cradle = heard(lag=0.8)
    weighted, mode = find_mode(Likelihood(experiment_of(clicks), workers=1), seed=1)
    values = weighted.values(mode.point)
    for name, sd in zip(weighted.names, np.sqrt(np.diag(mode.covariance)), strict=True):
        if name in ("k_f", "kappa", "b"):
            assert sd < 0.02
            assert math.log(values[name] / getattr(cradle, name)) == pytest.approx(0.0, abs=4.0 * sd)
    assert values["release_time@1"] == pytest.approx(1.234, abs=2e-4)
    # False clicks would make this milliseconds, and clicks that follow the touch at once 20 µs.
    assert weighted.noise_model.weights[0] < 4e-5
    assert values["noise@1"] < 1.6e-5
    assert values["click_lag@1"] > 0.3


def test_an_experiment_of_clicks_round_trips(tmp_path):
    experiment = experiment_of(heard()[0])
    again = Experiment.load(experiment.save(tmp_path))
    assert again.runs[0].of_impacts and np.array_equal(again.runs[0].times, experiment.runs[0].times)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("angle = 0.228 }", 'angle = 0.228 }\nstate = "free"'), "a click shows no position"),
        (("angle = 0.228", "angle = 0.228, time_sd = 0.1"), "time_sd must be 0"),
        (('"impacts"', '"sounds"'), 'expected "impacts"'),
    ],
)
def test_what_clicks_cannot_be_is_refused(change, words):
    with pytest.raises(ExperimentError, match=words):
        experiment_of(heard()[0], TEXT.replace(*change))


def test_a_diagnosis_of_clicks_is_refused():
    experiment = experiment_of(heard()[0])
    assert without_clicks(experiment) == (experiment, ())
    with pytest.raises(ValueError, match="needs angles or displacements"):
        check_readings(experiment)


def seen_and_heard():
    """(angles of 12 s, the same beside clicks)."""
    clicks, cradle = heard()
    run = simulate(cradle, Release(angle=0.228), duration=12.0, sample_rate=60.0)
    theta = run.theta + 1e-3 * np.random.default_rng(1).standard_normal(run.theta.shape)
    seen = Experiment.from_arrays(cradle, run.t, theta, Release(angle=0.228), noise=1e-3)
    return seen, dataclasses.replace(seen, runs=(*experiment_of(clicks).runs, *seen.runs))


def test_clicks_beside_angles_are_left_out_of_a_diagnosis():
    seen, both = seen_and_heard()
    kept, warnings = without_clicks(both)
    assert [run.file for run in kept.runs] == [run.file for run in seen.runs]
    assert len(warnings) == 1 and "clicks.csv: clicks are left out" in warnings[0]
    assert kept.digest == both.digest  # results are of the files as given


@pytest.mark.slow
def test_a_diagnosis_leaves_clicks_out_and_says_so(tmp_path):
    seen, both = seen_and_heard()
    diagnosis = diagnose(both)
    assert diagnosis.verdict == diagnose(seen).verdict == "nothing_missing"
    diagnosis.report(tmp_path / "report.html")
    assert "clicks are left out" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_new_writes_an_experiment_of_clicks(tmp_path):
    """Its length is that of the period: strings of 0.3 m that stretch by up to 3 %."""
    head, instants = "t [s],t_sd [s],amplitude,amplitude_sd,snr,likeness,doubtful", heard()[0]
    rows = [f"{t!r},2e-05,0.5,0.001,100.0,0.98,0" for t in instants.tolist()]
    (tmp_path / "clicks.csv").write_text("\n".join([head, *rows, ""]))
    experiment = Experiment.load(scaffold(tmp_path / "clicks.csv"))
    assert experiment.runs[0].of_impacts and np.array_equal(experiment.runs[0].times, instants)
    assert experiment.cradle.length == pytest.approx(0.3, rel=0.04)
