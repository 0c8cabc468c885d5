"""Selection by evidence: its evidence against integrals, its search against other histories."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from cradle_env.cradle import Cradle
from cradle_env.release import Release
from identification import diagnose
from identification.diagnosis import repair
from identification.diagnosis.criteria import FIRST_PERIODS, HORIZON_GROWTH, LAST_SHARE, Criteria
from identification.diagnosis.selection.candidates import list_candidates, parameter_of, starts, with_effects
from identification.diagnosis.selection.continuation import Basin, EarlyMisfit, Minimum, horizons
from identification.diagnosis.selection.evidence import LaplaceTerms, PriorTerms, log_prior
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.model import Model
from identification.diagnosis.selection.model_search import ModelSearch
from identification.experiment.experiment import Experiment
from identification.experiment.run import Prior, ReleaseInfo, Run
from identification.experiment.train_test import training_rows
from identification.inference.fit_result import with_known_noise
from identification.inference.least_squares import cost, refine
from identification.inference.likelihood import Likelihood
from identification.inference.search_options import DEFAULT
from identification.inference.start_points import point_at
from identification.inference.unknowns import model_unknowns
from tests.reference.laboratory import record, write_experiment
from tests.reference.soft_contact import SoftCradle
from tests.synthetic import leave_candidates, simulated_run

DRAG = {"quadratic_drag": {"c2": 6e-3}}
FRICTION = {"pivot_friction": {"tau_c": 6e-5}}
PAIR = {"quadratic_drag": {"c2": 2e-2}, "pivot_friction": {"tau_c": 3e-4}}


def search_of(experiment: Experiment) -> ModelSearch:
    return ModelSearch(experiment, FitCache(None, ""), 1)


def pendulum(effects: dict, seed: int = 1) -> Experiment:
    """A pendulum with these effects, described without them."""
    described = Cradle(bobs=1, b=0.002)
    run = simulated_run(described.replace(effects=effects), duration=20.0, noise=2e-4, seed=seed)
    return Experiment(described, (run,))


@pytest.mark.parametrize("room", [math.inf, 0.4, 0.0])
def test_evidence_of_a_gaussian_is_its_integral(room):
    """Laplace is exact here, so that only rounding is left; c = 2 divides what the readings say, but no prior."""
    information, curvature, c = np.array([[3.0, 0.0], [0.0, 2.0]]), (0.5, 4.0), 2.0
    gradient, stated = np.array([0.3, -0.7]), (0.2, np.array([0.0, 0.1]), np.diag([0.0, 1.5]))
    priors = (PriorTerms(-0.3, -0.2, curvature[0], room=room), PriorTerms(0.1, 0.4, curvature[1]))
    H = information / c + stated[2] + np.diag(curvature)
    g = -gradient / c - stated[1] + np.array([-0.2, 0.4])

    def inner(y: float) -> float:
        def density(x: float) -> float:
            step = np.array([x, y])
            return math.exp(-0.5 * (1.7 / c + 0.2) - 0.3 + 0.1 + g @ step - 0.5 * step @ H @ step)

        return quad(density, max(-room, -20.0), 20.0)[0]

    terms = LaplaceTerms(np.zeros(2), 1.7, gradient, information, stated, priors)
    assert terms.log_evidence(c) == pytest.approx(math.log(quad(inner, -20, 20)[0]), abs=1e-6)


@pytest.mark.parametrize("address", ["quadratic_drag.c2", "frame_compliance.frame_mass", "frame_compliance.frequency",
                                     "clock_scale.scale", "group_drag.range"])  # fmt: skip
def test_prior_of_an_effect_parameter_is_normalized(address):
    """Over its sampled coordinate, whether sampled as a logarithm or not; a missing Jacobian or factor of 2 shows."""
    name = address.partition(".")[0]
    candidate = next(c for c in list_candidates(Cradle(bobs=2)) if c.name == name)
    cradle = Cradle(bobs=2, effects={name: next(starts(candidate.declaration, 2, (1.0,)))})
    run = Run(np.arange(3.0), np.zeros((3, 2)), release=ReleaseInfo(Release(angle=0.2)), noise=1e-3, delta=0.0)
    experiment = Experiment(cradle, (run,), unknown_effect_parameters=(address,))
    u = next(u for u in model_unknowns(experiment) if u.name == address)
    scale = parameter_of(address).scale
    if u.log:  # tails fall at least as exp(-|z|)
        mass = quad(
            lambda z: math.exp(log_prior(u, z).log_density), math.log(scale) - 30.0, math.log(scale) + 30.0, limit=500
        )[0]
    else:  # the tangent maps the whole line to an interval: heavy tails need no cut
        mass = quad(
            lambda a: math.exp(log_prior(u, scale * math.tan(a)).log_density) * scale / math.cos(a) ** 2,
            0.0 if u.low >= 0.0 else -math.pi / 2,
            math.pi / 2,
        )[0]
    assert mass == pytest.approx(1.0, abs=1e-3)  # of the numerical integral


@pytest.mark.parametrize(("address", "values"), [
    ("quadratic_drag.c2", (0.0, 3e-4, 5e-3)), ("angle_offset.offset", (-5e-3, 0.0, 1e-3)),
    ("frame_compliance.frame_mass", (0.5, 4.0, 300.0)), ("frame_compliance.frequency", (2.0, 30.0)),
    ("kappa", (150.0, 300.0)),
])  # fmt: skip
def test_slope_and_residual_of_a_prior_are_those_of_its_density(address, values):
    name = address.partition(".")[0]
    effects, unknown = {}, ()
    if name != address:
        candidate = next(c for c in list_candidates(Cradle(bobs=2)) if c.name == name)
        effects, unknown = {name: next(starts(candidate.declaration, 2, (1.0,)))}, (address,)
    run = Run(np.arange(3.0), np.zeros((3, 2)), release=ReleaseInfo(Release(angle=0.2)), noise=1e-3, delta=0.0)
    experiment = Experiment(Cradle(bobs=2, effects=effects), (run,), unknown_effect_parameters=unknown)
    u = next(u for u in model_unknowns(experiment) if u.name == address)
    heights = set()
    for value in values:
        z, h = u.coordinate(value), 1e-5 * value or 1e-9
        found = log_prior(u, z)
        slope = (log_prior(u, z + h).log_density - log_prior(u, z - h).log_density) / (2.0 * h)
        assert found.slope == pytest.approx(slope, rel=1e-4, abs=1e-3)  # of the differences
        heights.add(round(found.log_density + 0.5 * found.residual**2, 9))
    assert len(heights) == 1


def test_weak_priors_are_those_of_logarithms():
    """A uniform prior of the value itself is all that is known: the log-normal one of k_f does not hold beside it."""
    described = Cradle(bobs=2)
    run = simulated_run(described, duration=6.0)
    stated = Experiment(described, (run,), infer={"k_f": Prior(low=1e4, high=3e4)})
    u = next(u for u in model_unknowns(stated) if u.name == "k_f")
    assert log_prior(u, 2e4) == log_prior(u, 1.1e4)
    free, held = (EarlyMisfit(Likelihood(e, training_rows(e)[0]), 2.0) for e in (Experiment(described, (run,)), stated))
    assert len(free.residuals(free.likelihood.start())) == len(held.residuals(held.likelihood.start())) + 1


@pytest.mark.parametrize("label", ["quadratic_drag", pytest.param("string_creep", marks=pytest.mark.slow)])
def test_evidence_is_the_integral_of_the_posterior(label):
    """By importance sampling. Without drag by the square of the speed, the minimum of χ² has some and a third of b: the
    prior of b pulls it back, which the evidence at that minimum misses by 1."""
    described = Cradle(bobs=1, b=0.002)
    run = simulated_run(described, duration=12.0, noise=2e-3, seed=1)
    search = search_of(Experiment(described, (run,)))
    fitted = search.extended(search.fit_base(), label).fitted
    likelihood = fitted.likelihood
    terms = LaplaceTerms.of(fitted)
    H = terms.all_information + np.diag([prior.curvature for prior in terms.priors])
    # A t distribution that is wider than the posterior, about its maximum.
    q = multivariate_t(terms.point, 1.7 * np.linalg.inv(H), df=4, seed=0)
    logs = []
    for z in q.rvs(2000):
        if all(u.low <= u.value(x) <= u.high for u, x in zip(likelihood.unknowns, z, strict=True)):
            priors = sum(log_prior(u, float(x)).log_density for u, x in zip(likelihood.unknowns, z, strict=True))
            logs.append(priors - 0.5 * cost(likelihood, z) - q.logpdf(z))
    exact = logsumexp(logs) - math.log(2000)
    assert np.exp(2.0 * logsumexp(logs) - logsumexp(2.0 * np.array(logs))) > 40.0  # effective sample: 0.16 nats
    assert terms.log_evidence(1.0) == pytest.approx(exact, abs=0.4)


def test_a_point_with_far_less_misfit_than_predicted_lies_in_another_basin():
    """A double well: the parabola about the higher minimum says nothing of the lower one."""
    basin = Basin(Minimum(np.zeros(1), 100.0), np.array([[50.0]]), unit=1.0)
    assert basin.holds(Minimum(np.array([0.5]), 100.0 + 50.0 * 0.5**2))
    assert not basin.holds(Minimum(np.array([3.0]), 90.0))
    assert not basin.holds(Minimum(np.array([3.0]), 110.0))  # 450 predicted
    assert not basin.holds(Minimum(np.array([0.5]), 150.0))
    assert basin.sd(0) == pytest.approx(50.0**-0.5)


@pytest.mark.parametrize(("bobs", "growth"), [(1, HORIZON_GROWTH), (2, HORIZON_GROWTH), (3, DEFAULT.early_growth)])
def test_horizons_grow_and_end_before_the_data(bobs, growth):
    cradle = Cradle(bobs=bobs)
    experiment = Experiment(cradle, (simulated_run(cradle, duration=20.0),))
    found = horizons(Likelihood(experiment, training_rows(experiment)[0]))
    assert found[0] == FIRST_PERIODS and np.allclose(np.diff(np.log(found)), math.log(growth))
    assert found[-1] < LAST_SHARE * (2.0 / 3.0) * 20.0 / cradle.period < growth * found[-1]


@pytest.mark.slow
def test_the_mode_of_five_unequal_gaps_is_found(tmp_path):
    """With horizons that double, and 6 evaluations over each, χ² ended 270 units above that reached from the truth."""
    offsets = 4e-4 * np.random.default_rng(4).standard_normal(4)
    truth = {"k_f": 18000.0, "kappa": 200.0, "b": 0.002}
    cradle = SoftCradle(5, stiffness_factor=1e6, effects={"spacer_offset": {"offset": offsets.tolist()}}, **truth)
    recording = record(cradle, {5: 0.2}, noise=1e-3, duration=30.0, seed=4)
    stated = {"k_f": 19500.0, "kappa": 206.0, "b": 0.0021}
    search = search_of(Experiment.load(write_experiment(tmp_path, [recording], stated=stated, run={"noise": 1e-3})))
    model = search.extended(search.fit_base(), "spacer_offset")
    values = {f"spacer_offset.offset[{gap + 1}]": offset for gap, offset in enumerate(offsets)}
    readings = model.likelihood.reading_slices()[-1].stop
    at_truth = refine(model.likelihood, point_at(model.likelihood, truth | values), 40)[1]
    # 6005 readings of the training part. Modes that differ in the order of impacts alone differ by about 10.
    assert model.chi2 < at_truth + 10.0 < 1.2 * readings


def test_chi2_of_a_model_is_a_function_of_the_model():
    """Two effects, reached by adding either first, have one χ² to within a unit: basins exist in strengths, too."""
    experiment = pendulum(DRAG | FRICTION)
    found = []
    for order in (("quadratic_drag", "pivot_friction"), ("pivot_friction", "quadratic_drag")):
        search = search_of(experiment)
        model = search.fit_base()
        for label in order:
            model = search.extended(model, label)
        search.share_modes([*search.models.values()])
        found.append(model.chi2)
    assert found[0] == pytest.approx(found[1], abs=1.0)


@pytest.mark.slow
def test_25_models_have_one_chi2_each_by_three_histories():
    """Three orders of adding the members of sets of three of five candidates."""
    experiment = pendulum(DRAG | FRICTION)
    labels = ("quadratic_drag", "pivot_friction", "angle_offset", "angle_scale", "exposure_blur")
    sets = [frozenset(s) for n in (1, 2, 3) for s in itertools.combinations(labels, n)]
    found: dict[frozenset[str], list[float]] = {names: [] for names in sets}
    for rotation in range(3):
        search = search_of(experiment)
        base = search.fit_base()
        for names in sets:
            ordered = sorted(names)
            model = base
            for label in (*ordered[rotation % len(ordered) :], *ordered[: rotation % len(ordered)]):
                model = search.extended(model, label)
        search.share_modes([*search.models.values()])
        for names in sets:
            found[names].append(search.models[names].chi2)
    assert len(found) == 25
    assert max(max(several) - min(several) for several in found.values()) < 1.0


def test_a_model_is_tried_with_its_row_reversed(tmp_path):
    """A long bob beside a short one swings much as a short one beside a long one: where a descent from the wrong one
    ends, χ² is 87 above that of the right one."""
    lengths, stated = (0.0056, 0.0022), {"kappa": 185.0, "k_f": 17000.0, "b": 0.002}
    cradle = SoftCradle(2, stiffness_factor=1e6, effects={"length_mismatch": {"relative": lengths}}, **stated)
    recording = record(cradle, {2: 0.2}, duration=45.0, seed=1, noise=5e-3)
    experiment = with_known_noise(Experiment.load(write_experiment(tmp_path, [recording], stated=stated)))
    likelihood = Likelihood(with_effects(experiment, {"length_mismatch": {"relative": lengths[::-1]}}))
    wrong, chi2 = refine(likelihood, likelihood.start(), 40)
    model = Model(frozenset({"length_mismatch"}), frozenset({"length_mismatch"}), likelihood, FitCache(None, ""))
    model.approach("the wrong way round", lambda: [wrong])
    model.finish()
    first, second = (model.fitted.values[f"length_mismatch.relative[{i}]"] for i in (1, 2))
    assert model.chi2 < chi2 - 80.0
    assert first - second == pytest.approx(lengths[0] - lengths[1], abs=5e-4)  # κ makes up for what both have in common


def test_an_interrupted_search_goes_on(monkeypatch):
    """What was found is kept: the same search again looks for no mode."""
    experiment, store = pendulum(DRAG), FitCache(None, "")
    first = ModelSearch(experiment, store, 1)
    model = first.extended(first.fit_base(), "quadratic_drag")
    kept = len(store.points)
    monkeypatch.setattr("identification.diagnosis.selection.model.refine_all", lambda *_: pytest.fail("this was known"))
    again = ModelSearch(experiment, store, 1)
    assert again.extended(again.fit_base(), "quadratic_drag").modes[0].point == pytest.approx(
        model.modes[0].point, abs=0
    )
    assert len(store.points) == kept > 0


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [{}, DRAG, PAIR])
def test_what_is_hidden_is_named_and_nothing_else(hidden):
    diagnosis = diagnose(pendulum(hidden))
    assert set(diagnosis.effects) == set(hidden)
    assert diagnosis.verdict == ("named" if hidden else "nothing_missing")
    sets = diagnosis.repaired.sets
    assert sum(one.probability for one in sets) == pytest.approx(1.0)
    best = max(sets, key=lambda one: one.probability)
    assert best.effects == tuple(sorted(hidden)) and best.kind == ("set" if hidden else "nothing")
    assert best.probability > 0.5


def test_a_part_of_the_best_set_is_named_if_the_data_do_not_ask_for_the_rest(monkeypatch):
    """The data ask for both of two effects. Where far less evidence counts as equal, one of them is named, unless what
    it leaves counts as more than noise. No law competes, which would take most of the time."""
    leave_candidates(monkeypatch, *PAIR)
    monkeypatch.setattr(repair, "learn_law", lambda *_: None)
    for level, count in ((0.01, 1), (0.5, 2)):
        diagnosis = diagnose(pendulum(PAIR), criteria=Criteria(equivalent_log_odds=1e6, significance_level=level))
        names = diagnosis.effects or diagnosis.repaired.removed  # held-out data refute one alone
        assert len(names) == count
