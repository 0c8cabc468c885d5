"""What data may hide, held against data of the soft-contact reference in which it is hidden."""

import math

import pytest

from identification import Experiment
from identification.diagnosis.repair import RepairResult
from identification.diagnosis.result import Diagnosis
from identification.diagnosis.selection.candidates import with_effects
from identification.diagnosis.selection.examined_model import examine
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.searcher import Searcher
from identification.diagnosis.uncertainty.detection_limits import compute_detection_limits
from identification.inference.fit_result import with_known_noise
from studies.diagnosis.study import fit_near
from tests.reference.laboratory import record, write_experiment
from tests.reference.soft_contact import SoftCradle
from tests.synthetic import fit_with

B = 0.002


def examined(folder, hidden: dict, seed: int = 3, bobs: int = 2, noise: float = 1e-3):
    """20 s of 30 s fitted: the base model and what its data show."""
    cradle = SoftCradle(bobs, stiffness_factor=1e6, effects=hidden, kappa=190.0, k_f=18000.0, b=B)
    recording = record(cradle, {bobs: 0.2}, duration=30.0, seed=seed, noise=noise)
    searcher = Searcher(FitCache(None, ""), 0, None)
    path = write_experiment(folder, [recording], stated={"kappa": 187.0, "b": 0.0023})
    truth = {"kappa": 190.0, "k_f": 18000.0, "b": B}
    return examine(fit_near(searcher, with_known_noise(Experiment.load(path)), truth), 0, (False,))


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return examined(tmp_path_factory.mktemp("plain"), {})


@pytest.mark.parametrize("name", [pytest.param("pivot_friction", marks=pytest.mark.slow), "quadratic_drag"])
def test_what_is_as_strong_as_data_may_hide_moves_b_as_told(plain, name, tmp_path):
    """Hidden at its limit, an effect bends b by the number told, to the noise of the fit (3 sd) and to second order
    (b moves by a sixth: a third of the number at most); b is far off, and the data do not show it beyond chance."""
    limits = {one.effect: one for one in compute_detection_limits(plain.fitted, plain.score_test.scores)}
    told = limits[name]
    assert told.shifts_sd["b"] < -10.0
    bent = examined(tmp_path, {name: {told.parameter.key: told.limit}}, seed=4)
    place = bent.fitted.likelihood.names.index("b")
    sd = math.sqrt(bent.fitted.covariance[place, place])
    off = (bent.fitted.point[place] - math.log(B)) / sd
    assert off == pytest.approx(-told.shifts_sd["b"], abs=3.0 + 0.33 * abs(told.shifts_sd["b"]))
    gain = next(s.gain for s in bent.score_test.scores if s.candidate.name == name)
    assert gain < 16.0  # at its limit it gains 2.7, by chance up to (1.6 + 2.4)²


@pytest.mark.parametrize("name", ["quadratic_drag", "exposure_blur", "spacer_offset"])
def test_limits_are_those_of_fits(plain, name):
    """Held at its limit, and everything fitted again, an effect leaves more χ² than at its best: 1.645² = 2.7 from a
    best above zero, 1.96² = 3.8 from zero or to both sides, 3.96² − 2² = 11.7 where the data alone would have it two
    standard deviations on the impossible side."""
    assert 1.9 < left_at_the_limit(plain, name) < 12.0


@pytest.mark.slow
def test_limits_of_three_bobs_are_followed_too(tmp_path):
    """To first order, dry friction would leave 25 at its limit."""
    assert 1.9 < left_at_the_limit(examined(tmp_path, {}, bobs=3, noise=5e-3), "pivot_friction") < 12.0


def left_at_the_limit(found, name: str) -> float:
    """By how much more χ² an effect leaves, everything else fitted again, held at its limit than at its best."""
    own = next(s for s in found.score_test.scores if s.candidate.name == name and s.sensitivities[0].S.shape[1] == 1)
    (told,) = compute_detection_limits(found.fitted, [own])
    searcher = Searcher(FitCache(None, ""), 0, None)
    free = fit_with(searcher, found.fitted, own.candidate.label)
    held = with_effects(found.fitted.experiment, {name: {told.parameter.key: told.limit}}, ())
    return fit_near(searcher, held, found.fitted.values).chi2 - free.chi2


def test_nothing_is_said_of_data_that_the_model_does_not_describe(tmp_path):
    cradle = SoftCradle(1, stiffness_factor=1e6, effects={"smooth_friction": {"tau_c": 1e-3}}, kappa=190.0, b=B)
    recording = record(cradle, {1: 0.3}, duration=24.0, seed=3, noise=3e-4)
    experiment = with_known_noise(Experiment.load(write_experiment(tmp_path, [recording], stated={"b": 0.0023})))
    found = examine(Searcher(FitCache(None, ""), 0, None).fit_global(experiment), 0, (False,))
    nothing_helped = RepairResult((found,))
    diagnosis = Diagnosis(experiment, nothing_helped, found.fitted, None, 0)
    assert diagnosis.verdict == "unknown" and diagnosis.detection_limits == () and diagnosis.content()["unseen"] == []


def test_what_bends_the_readings_of_one_bob_has_a_limit(tmp_path):
    """No neighbour can attract it or change its drag: nothing is said of that."""
    cradle = SoftCradle(1, stiffness_factor=1e6, kappa=190.0, b=B)
    recording = record(cradle, {1: 0.3}, duration=24.0, seed=3, noise=1e-3)
    experiment = with_known_noise(Experiment.load(write_experiment(tmp_path, [recording])))
    found = examine(Searcher(FitCache(None, ""), 0, None).fit_global(experiment), 0, (False,))
    limits = {one.effect: one.limit for one in compute_detection_limits(found.fitted, found.score_test.scores)}
    assert not limits.keys() & {"group_drag", "bob_attraction"}
    assert all(0.0 < abs(limits[name]) < math.inf for name in ("quadratic_drag", "pivot_friction", "exposure_blur"))


def test_what_kappa_makes_up_for_is_followed_beyond_first_order(tmp_path):
    """κ makes up for added mass over hundreds of its standard deviations, where readings are far from what they are to
    first order: by that one bob could not hide this mass. It does, κ is off by as much as is told for it, and twice the
    limit leaves so much more χ², all else fitted again, as chance does once in twenty times: 3.8."""
    mass = 3e-4
    cradle = SoftCradle(1, stiffness_factor=1e6, effects={"added_mass": {"mass": mass}}, kappa=190.0, b=B)
    recording = record(cradle, {1: 0.22}, duration=45.0, seed=3, noise=1e-3)
    path = write_experiment(tmp_path, [recording], stated={"kappa": 187.0, "b": 0.0023})
    searcher = Searcher(FitCache(None, ""), 0, None)
    found = examine(searcher.fit_global(with_known_noise(Experiment.load(path))), 0, (False,))
    assert not found.significant
    own = next(s for s in found.score_test.scores if s.candidate.name == "added_mass")
    (told,) = compute_detection_limits(found.fitted, [own])
    place = found.fitted.likelihood.names.index("kappa")
    off = (math.log(190.0) - found.fitted.point[place]) / math.sqrt(found.fitted.covariance[place, place])
    assert told.limit is not None and mass < told.limit < 3.0 * mass
    assert off == pytest.approx(told.shifts_sd["kappa"] * mass / told.limit, rel=0.1)
    held = with_effects(found.fitted.experiment, {"added_mass": {"mass": 2.0 * told.limit}}, ())
    assert (
        fit_near(searcher, held, found.fitted.values).chi2 - fit_with(searcher, found.fitted, own.candidate.label).chi2
        > 3.8
    )
