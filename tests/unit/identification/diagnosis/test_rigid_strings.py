"""A model that the data are far from either way is diagnosed without what they hold no evidence for."""

from types import SimpleNamespace

import pytest

from cradle_env import Cradle
from identification import Experiment
from identification.diagnosis.criteria import MISSPECIFIED_GAP
from identification.diagnosis.result import Diagnosis
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.rigid_strings import choose_base_model, describe_removed_effects
from identification.diagnosis.selection.searcher import Searcher
from identification.inference.fit_result import with_known_noise
from tests.reference.laboratory import record, write_experiment
from tests.reference.soft_contact import SoftCradle


def base_of(folder, strings, offset, **entries):
    """The fit of the NSP to two bobs of free state, a spacer's offset hidden, and a search over their data."""
    hidden = {"spacer_offset": {"offset": [offset]}}
    cradle = SoftCradle(2, strings=strings, stiffness_factor=1e4, effects=hidden, kappa=190.0)
    recording = record(cradle, {2: 0.228}, duration=12.0, seed=4)
    entries = {"infer": {"length": {"mean": 0.3, "sd": 0.003}}, **entries}
    path = write_experiment(folder, [recording], run={"state": "free", "release": None}, **entries)
    searcher = Searcher(FitCache(None, ""), 0, None)
    return searcher.fit_global(with_known_noise(Experiment.load(path))), searcher


@pytest.mark.slow
def test_strings_that_do_not_show_are_taken_as_rigid(tmp_path):
    given, searcher = base_of(tmp_path, "rigid", 0.01)
    rigid = choose_base_model(given, searcher, lambda *_: None)
    assert rigid.cradle.model == "nsp"
    assert [e.name for e in given.cradle.composition if not rigid.cradle.has(e.name)] == [
        "radial_elasticity", "string_hysteresis"
    ]  # fmt: skip
    assert len(given.point) - len(rigid.point) == 1 + 2 * 3  # κ, and stretch, its rate and the tension of each bob
    (told,) = describe_removed_effects(rigid, given)
    assert "radial_elasticity and string_hysteresis" in told
    assert "7 more unknowns" in told
    for base, name in ((rigid, "with rigid strings"), (given, "as given")):
        repaired = SimpleNamespace(examined=[SimpleNamespace(fitted=base)])
        assert Diagnosis(given.experiment, repaired, base, None, 0).base_name == name  # type: ignore[arg-type]


@pytest.mark.slow
def test_strings_that_show_stay(tmp_path):
    given, searcher = base_of(tmp_path, "hysteretic", 0.01)
    assert given.training_gap() > MISSPECIFIED_GAP
    kept = choose_base_model(given, searcher, lambda *_: None)
    assert kept.cradle.has("radial_elasticity")
    assert describe_removed_effects(kept, given) == []


@pytest.mark.parametrize(
    ("gap", "infer", "unknown"),
    [
        (1.2, {}, True),  # the model is right otherwise: what is missing must be told, not hidden
        (3.0, {"kappa": {"mean": 190.0, "sd": 1.0}}, True),  # the strings are known
        (3.0, {"string_creep.rate": {"low": 0.0, "high": 1e-4}}, True),  # so is what needs them
        (3.0, {}, False),  # by its value
    ],
)
def test_what_is_known_or_near_the_noise_is_not_questioned(gap, infer, unknown):
    cradle = Cradle(bobs=2, effects={"string_creep": {"rate": 1e-5}})
    named = ("string_creep.rate",) if unknown else ()
    experiment = SimpleNamespace(infer=infer, unknown_effect_parameters=named)
    given = SimpleNamespace(cradle=cradle, experiment=experiment, training_gap=lambda: gap)
    assert choose_base_model(given, None, None) is given  # type: ignore[arg-type]  # nothing is searched for
