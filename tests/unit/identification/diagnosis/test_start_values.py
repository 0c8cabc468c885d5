"""What one effect would have to be to do what another does."""

from types import SimpleNamespace

import pytest

from identification.diagnosis.selection import model_comparison
from identification.diagnosis.selection.candidates import Candidate, list_candidates, with_effects
from identification.diagnosis.selection.search import FitCache, Searcher
from identification.diagnosis.selection.start_values import standing_in
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import FitResult, with_known_noise
from identification.inference.likelihood import Likelihood
from identification.inference.start_points import flatten_values, point_at
from tests.reference.laboratory import record, write_experiment
from tests.reference.soft_contact import SoftCradle

TRUTH = {"k_f": 18000.0, "kappa": 190.0, "b": 0.002}
#: How much pendulums are too long, relatively: all of them, far beyond what a derivative at none foretells: over 16 s,
#: some 16 swings, the last swing comes a quarter of a period late.
LONGER = 0.03


@pytest.fixture(scope="module", params=[1, 2])
def fits(request, tmp_path_factory):
    """The model as given, and with lengths of each bob, at the truth."""
    bobs = request.param
    hidden = {"length_mismatch": {"relative": [LONGER] * bobs}}
    cradle = SoftCradle(bobs, stiffness_factor=1e4, effects=hidden, **TRUTH)
    recording = record(cradle, {bobs: 0.228}, duration=16.0, seed=4)
    path = write_experiment(tmp_path_factory.mktemp("longer"), [recording], stated=TRUTH)
    base = Searcher(FitCache(None, ""), 0, None).likelihood(with_known_noise(Experiment.load(path)))
    other = Likelihood(with_effects(base.experiment, hidden), base.rows)
    return FitResult(base, base.start()), FitResult(
        other, point_at(other, TRUTH | flatten_values(*next(iter(hidden.items()))))
    )


def wanted(fits, name: str, shared: bool = False):
    """The candidate of a name, and the only values it is to begin with."""
    candidate = next(c for c in list_candidates(fits[0].cradle) if c.name == name and c.shared == shared)
    (values,) = standing_in(*fits, candidate)
    return candidate, values


def test_at_the_truth_there_is_but_noise(fits):
    assert fits[1].chi2 < 1.2 * fits[1].count < 0.1 * fits[0].chi2


@pytest.mark.parametrize(
    ("name", "key", "expected"),
    # ω² = g/r (1 + ε): T grows by half of ε, which a clock does that runs fast by as much, or inertia ε m without
    # weight. Exact in the small; what is left out is of the order of ε.
    [("clock_scale", "scale", 0.5 * LONGER), ("added_mass", "mass", LONGER * SoftCradle.mass)],
)
def test_what_acts_alike_takes_its_place_however_strong(fits, name, key, expected):
    candidate, values = wanted(fits, name)
    assert values[key] == pytest.approx(expected, rel=3.0 * LONGER)
    model = Likelihood(with_effects(fits[0].experiment, {name: values}, candidate.unknown), fits[0].likelihood.rows)
    left = model.residuals(point_at(model, TRUTH | flatten_values(name, values)))
    assert left @ left < 0.01 * fits[0].chi2  # what is not alike in impacts, and the order of ε


def test_the_same_effect_is_said_with_one_value(fits):
    base, other = fits
    if base.cradle.bobs == 1:
        pytest.skip("one bob has but one length")
    uneven = [0.5 * LONGER, 1.5 * LONGER]
    values = {f"length_mismatch.relative[{i}]": value for i, value in enumerate(uneven, 1)}
    other = FitResult(other.likelihood, point_at(other.likelihood, other.values | values))
    assert wanted((base, other), "length_mismatch", shared=True)[1] == {"relative": pytest.approx([LONGER] * 2)}
    assert wanted((base, other), "length_mismatch")[1] == {"relative": pytest.approx(uneven)}


def test_what_came_from_infinity_tells_nothing(fits):
    """A frame that is infinitely heavy does not move; there is no first order from there in its mass."""
    base, _ = fits
    frame = {"frame_mass": 5.0, "frequency": 5.0, "damping_ratio": 0.01}
    shaken = with_effects(base.experiment, {"frame_compliance": frame})
    likelihood = Likelihood(shaken, base.likelihood.rows)
    other = FitResult(likelihood, likelihood.start())
    clock = next(c for c in list_candidates(base.cradle) if c.name == "clock_scale")
    assert standing_in(base, other, clock) == []


def test_what_was_fitted_from_elsewhere_is_fitted_again(fits):
    """Refits in the place of another are kept by where they begin, too."""
    base, other = fits
    store, clock = FitCache(None, ""), next(c for c in list_candidates(base.cradle) if c.name == "clock_scale")
    Searcher(store, 0, None).fit_with_candidate_from_mode(base, clock, other)
    counted = len(store.points)
    for times in (1, 2):
        Searcher(store, 0, None).fit_with_candidate_from_mode(base, clock, other, standing_in(base, other, clock))
        assert len(store.points) == counted + 1, times


def test_what_looks_the_same_begins_where_it_stands_in(monkeypatch):
    """From where the best of several refits has its mode, that is; others begin where their own scores say."""
    best, same, another = (Candidate(name, (name,), ()) for name in ("clock_scale", "added_mass", "spacer_offset"))
    fits = {best: SimpleNamespace(chi2=100.0), another: SimpleNamespace(chi2=150.0)}
    scores = [
        SimpleNamespace(candidate=candidate, likely=("own",), parallel=parallel)
        for candidate, parallel in ((best, (same,)), (same, (best,)), (another, ()))
    ]
    begun = {}
    searcher = SimpleNamespace(
        fit_with_candidate_from_mode=lambda _, candidate, __, likely, *___: begun.update({candidate: likely})
    )
    monkeypatch.setattr(model_comparison, "standing_in", lambda *_: ["in its place"])
    base = SimpleNamespace(chi2=1000.0, chi2_scale=1.0)
    model_comparison._alike(base, fits, SimpleNamespace(scores=scores), searcher, lambda *_: None)  # type: ignore[arg-type]
    assert begun == {same: ["in its place", "own"], another: ["own"]}
