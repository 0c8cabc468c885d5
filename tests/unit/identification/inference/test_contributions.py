"""What each source contributes: against exact normal distributions, and through a calibration and its files."""

import dataclasses
import json
import math

import numpy as np
import pytest
from scipy.stats import chi2

from cradle_env import Cradle
from identification.cli.app import main
from identification.experiment.constraint import Constraint
from identification.experiment.experiment import Experiment
from identification.inference.contributions import measure_contributions
from identification.inference.likelihood import Likelihood
from identification.inference.normal_approximation import normal_approximation
from identification.inference.posterior import Posterior
from identification.storage.schema import check_schema
from tests.synthetic import simulated_run

B = 2e-3


def ringdown(b, sd, file="ringdown.json"):
    return Constraint("ringdown", ("b_1",), np.array([b]), np.array([[sd**2]]), file=file)


def found(*constraints, bobs=2, runs=1):
    """Contributions to a fit of 6 s of rigid pendulums; one alone has no λ, each of whose draws is a run of 60 s."""
    cradle = Cradle(bobs=bobs, model="pendulum", b=B)
    made = tuple(simulated_run(cradle, duration=6.0, seed=k + 1) for k in range(runs))
    likelihood = Likelihood(Experiment(cradle, made, constraints=constraints))
    likelihood, mode = normal_approximation(likelihood)
    return measure_contributions(likelihood, mode.point)


def test_one_source_alone_contributes_all():
    assert found(bobs=1) is None and found(bobs=1, runs=2) is None


def test_instruments_alone_and_without_the_others_are_normal():
    """Two ring-downs and a run: of each alone its own numbers, without the run their weighted mean."""
    one, two = ringdown(1.02 * B, 0.02 * B, "a.json"), ringdown(0.99 * B, 0.01 * B, "b.json")
    told = found(one, two)
    for constraint in (one, two):
        alone = told.alone[constraint.file]
        # 2e-3: the logarithm of b is sampled, and its distribution is taken as normal over 2 %.
        assert alone["b"]["median"] == pytest.approx(constraint.mean[0], rel=2e-3)
        assert alone["b"]["sd"] == pytest.approx(math.sqrt(constraint.covariance[0, 0]), rel=3e-2)
        assert alone["k_f"] is None and alone["lambda"] is None
    weights = np.array([1.0 / 0.02**2, 1.0 / 0.01**2])
    mean = float(weights @ [1.02, 0.99] / weights.sum())
    assert told.without["trajectories"]["b"]["median"] == pytest.approx(mean * B, rel=2e-3)
    assert told.without["trajectories"]["b"]["sd"] == pytest.approx(B / math.sqrt(weights.sum()), rel=3e-2)
    assert told.without["a.json"]["b"]["sd"] < told.alone["b.json"]["b"]["sd"]
    assert told.without["a.json"]["lambda"]["sd"] > 0.0
    assert told.disagreements == ()


@pytest.mark.parametrize("apart", [1.0, 3.5, 5.0])
def test_the_probability_of_a_difference_is_that_of_chi_squared(apart):
    """Two ring-downs whose difference is `apart` of its standard deviations, among three pairs."""
    sd = 0.01 * B
    told = found(ringdown(B, sd, "a.json"), ringdown(B + apart * math.sqrt(2.0) * sd, sd, "b.json"), bobs=1)
    p = {one.between: one.p for one in told.disagreements}.get(("a.json", "b.json"))
    exact = 3.0 * chi2.sf(apart**2, 1)
    assert (p is None) == (exact > 0.01)
    if p is not None:
        # b is sampled in the logarithm, in which 7 % is 3 % shorter: ln p changes by 6 %.
        assert math.log(p) == pytest.approx(math.log(exact), rel=0.08)


def test_an_instrument_that_the_model_cannot_give_is_told():
    """b of one and of three bobs differ by 10 sd; without group_drag they are one."""
    grouped = Constraint(
        "ringdown", ("b_1", "b_3"), np.array([B, 1.14 * B]), np.diag([(0.01 * B) ** 2, (0.01 * B) ** 2])
    )
    (one,) = [one for one in found(grouped).disagreements if one.between == ("ringdown", "ringdown")]
    assert one.p < 1e-10


def test_a_calibration_keeps_and_shows_them(tmp_path, capsys):
    cradle = Cradle(bobs=1, model="pendulum", b=B)
    constraints = (ringdown(4.0 * B, 0.05 * B),)
    experiment = Experiment(cradle, (simulated_run(cradle, duration=6.0),), constraints=constraints)
    path, out = experiment.save(tmp_path / "experiment"), tmp_path / "out"
    main(["calibrate", str(path), "--steps", "50", "--out", str(out)])
    assert "trajectories and ringdown disagree beyond their errors" in capsys.readouterr().err
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    check_schema(summary, "summary", out)
    posterior = Posterior.load(out / "posterior.nc")
    assert json.loads(json.dumps(posterior.contributions.content())) == summary["contributions"]
    assert (out / "contributions.png").stat().st_size > 10_000
    report = (out / "report.html").read_text(encoding="utf-8")
    assert "What each measurement contributes" in report and "disagree beyond their errors" in report
    rows = [label.get_text() for label in posterior.plot_contributions().axes[0].get_yticklabels()]
    assert rows == ["trajectories alone", "ringdown alone", "all", "without trajectories", "without ringdown"]
    told = posterior.contributions
    assert told.without["ringdown"]["b"]["ci95"] == pytest.approx(told.alone["trajectories"]["b"]["ci95"])
    assert told.alone["trajectories"]["b"]["median"] < summary["parameters"]["b"]["median"] < 4.0 * B
    with pytest.raises(ValueError, match="one source alone"):
        dataclasses.replace(posterior, contributions=None).plot_contributions()
