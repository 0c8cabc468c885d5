"""The numbers that an expert may change, and that a diagnosis decides by them."""

import dataclasses
from types import SimpleNamespace

import pytest

from identification import Experiment, diagnose
from identification.diagnosis.criteria import DEFAULT_CRITERIA, Criteria, may_hold_faults, only_noise
from identification.diagnosis.data_checks.readings import check_readings
from tests.reference.laboratory import record, write_experiment
from tests.reference.soft_contact import SoftCradle
from tests.synthetic import leave_candidates


def test_the_defaults_are_those_that_the_study_was_made_with():
    assert dataclasses.asdict(DEFAULT_CRITERIA) == {
        "significance_level": 0.01,
        "equivalent_log_odds": 3.0,
        "noise_excess_sd": 1.0,
        "fault_excess_sd": 6.0,
        "fault_explained_share": 0.9,
        "run_difference_sd": 10.0,
        "min_length_difference": 0.004,
        "min_k_f_difference": 0.1,
        "min_readings_per_unknown": 5,
        "min_periods": 2.0,
        "min_readings_per_period": 6.0,
    }


@pytest.mark.parametrize(
    ("name", "value"), [("significance_level", 1.5), ("equivalent_log_odds", 0.0), ("min_periods", float("nan"))]
)
def test_impossible_criteria_are_refused_by_name(name, value):
    with pytest.raises(ValueError, match=name):
        Criteria(**{name: value})


def test_the_excess_of_chi2_is_counted_in_its_standard_deviations():
    """χ² of R readings has the variance 2 R: of 5000 readings one standard deviation is 100."""
    fits = [SimpleNamespace(chi2=5000.0 + excess, count=5000) for excess in (99.0, 101.0, 599.0, 601.0)]
    assert [only_noise(fit, DEFAULT_CRITERIA) for fit in fits] == [True, False, False, False]
    assert [may_hold_faults(fit, DEFAULT_CRITERIA) for fit in fits] == [False, False, False, True]
    assert only_noise(fits[1], Criteria(noise_excess_sd=1.1))


@pytest.fixture(scope="module")
def dragged(tmp_path_factory):
    """One bob with a quadratic drag that saves a χ² of 23: p is some 1e-5, corrected for the number of candidates."""
    cradle = SoftCradle(1, effects={"quadratic_drag": {"c2": 0.03}}, kappa=190.0, b=0.002)
    recording = record(cradle, {1: 0.228}, duration=16.0, seed=4)
    folder = tmp_path_factory.mktemp("dragged")
    return Experiment.load(write_experiment(folder, [recording], stated={"kappa": 187.0, "b": 0.0023}))


def test_the_verdict_depends_on_the_level_of_significance(dragged, tmp_path, small_grid, monkeypatch):
    """With but one more effect in the catalogue, which is fitted beside it."""
    leave_candidates(monkeypatch, "quadratic_drag", "exposure_blur")
    named = diagnose(dragged, out=tmp_path)
    assert named.verdict == "named" and named.effects == ("quadratic_drag",) and named.warnings == ()
    # At a level above its p, what the named effect leaves counts as more than noise, and the name is taken back.
    p = named.repaired.last.p
    doubting = diagnose(dragged, out=tmp_path, criteria=Criteria(significance_level=0.5 * (1.0 + p)))
    assert doubting.verdict == "unknown" and doubting.effects == ()
    assert doubting.warnings[0].startswith("significance_level = 0.")


def test_more_swings_may_be_asked_for(dragged):
    assert check_readings(dragged) == ()
    with pytest.raises(ValueError, match="less than 50 swings"):
        check_readings(dragged, Criteria(min_periods=50.0))
