"""Selection by evidence: its evidence against integrals, its search against other histories."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad

from cradle_env.cradle import Cradle
from cradle_env.release import Release
from identification import diagnose
from identification.diagnosis.criteria import FIRST_PERIODS, HORIZON_GROWTH, LAST_SHARE
from identification.diagnosis.selection.candidates import list_candidates, parameter_of, starts
from identification.diagnosis.selection.continuation import Basin, Minimum, horizons
from identification.diagnosis.selection.evidence import LaplaceTerms, log_prior
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.model_search import ModelSearch
from identification.experiment.experiment import Experiment
from identification.experiment.run import ReleaseInfo, Run
from identification.experiment.train_test import training_rows
from identification.inference.least_squares import refine
from identification.inference.likelihood import Likelihood
from identification.inference.search_options import DEFAULT
from identification.inference.start_points import point_at
from identification.inference.unknowns import model_unknowns
from tests.reference.laboratory import record, write_experiment
from tests.reference.soft_contact import SoftCradle
from tests.synthetic import simulated_run

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


def test_evidence_of_a_gaussian_is_its_integral():
    # Laplace is exact here, so that only rounding is left; c = 2 checks that χ² and information are both divided.
    information, curvature, c = np.array([[3.0, 1.0], [1.0, 2.0]]), np.array([0.5, 4.0]), 2.0
    terms = LaplaceTerms(1.7, information, -0.3, curvature)
    H = information / c + np.diag(curvature)

    def inner(y: float) -> float:
        return quad(lambda x: math.exp(-0.5 * 1.7 / c - 0.3 - 0.5 * np.array([x, y]) @ H @ [x, y]), -20, 20)[0]

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
        mass = quad(lambda z: math.exp(log_prior(u, z)[0]), math.log(scale) - 30.0, math.log(scale) + 30.0, limit=500)[
            0
        ]
    else:  # the tangent maps the whole line to an interval: heavy tails need no cut
        mass = quad(
            lambda a: math.exp(log_prior(u, scale * math.tan(a))[0]) * scale / math.cos(a) ** 2,
            0.0 if u.low >= 0.0 else -math.pi / 2,
            math.pi / 2,
        )[0]
    assert mass == pytest.approx(1.0, abs=1e-3)  # of the numerical integral


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
