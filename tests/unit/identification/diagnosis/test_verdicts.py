"""What a calibration says of itself: whether the model describes the data, and whether a posterior is cut off."""

import dataclasses
import json

import numpy as np
import pytest

from cradle_env import Cradle, Release
from identification.diagnosis.selection.searcher import refine_to_mode
from identification.experiment.experiment import Experiment
from identification.experiment.run import ReleaseInfo, Run
from identification.inference.calibration import measure_gap
from identification.inference.convergence import Convergence
from identification.inference.gap import Gap
from identification.inference.likelihood import Likelihood
from identification.inference.posterior import Posterior
from identification.inference.unknowns import model_unknowns
from identification.reporting.verdicts import model_verdict
from tests.reference.laboratory import record
from tests.reference.soft_contact import SoftCradle
from tests.synthetic import made_up_posterior, simulated_run

TRUTH = {"k_f": 18000.0, "kappa": 196.6, "b": 0.002}
NOISE = 1e-3


def filmed(angle: float, stated: float, seed: int, noise: float | None = NOISE, rate=60.0, c2=0.0) -> Run:
    """12 s of two bobs by the soft reference, let go at an angle that is stated to 2 mrad."""
    cradle = SoftCradle(2, stiffness_factor=1e4, effects={"quadratic_drag": {"c2": c2}} if c2 else {}, **TRUTH)
    film = record(cradle, {2: angle}, duration=12.0, noise=NOISE, rate=rate, seed=seed)
    return Run(film.times, film.readings, release=ReleaseInfo(Release(angle=stated), angle_sd=2e-3), noise=noise)


def measured(*runs: Run) -> Posterior:
    """With the gaps of a posterior about the mode, of which they see nothing but the best point. The truth is stated:
    the mode beside it is the best."""
    likelihood = Likelihood(Experiment(Cradle(bobs=2, **TRUTH), runs))
    chain = np.tile(refine_to_mode(likelihood, likelihood.start()), (2, 1, 1, 1))
    never = Convergence(False, 2.0, 1.0, 1.0, 1, 0)
    posterior = Posterior(likelihood, chain, np.zeros(chain.shape[:3]), None, never, Gap(np.nan, np.nan))
    return dataclasses.replace(posterior, gap=measure_gap(posterior))


def test_a_run_held_out_may_begin_elsewhere_by_as_much_as_is_stated():
    """Released 2 standard deviations off; and 10, which no right model is."""
    first = filmed(0.228, 0.228, 1)
    near, far = (measured(first, filmed(0.15 + off, 0.15, 2)) for off in (0.004, 0.02))
    assert near.gap.held_out > 1.5 and near.gap.train < 1.05
    assert near.misfit == "none"
    assert far.misfit == "large"


@pytest.mark.parametrize(("c2", "misfit"), [(0.04, "large"), (0.0, "none")])
def test_noise_estimated_from_few_frames_hides_no_misfit(c2, misfit):
    """At 25 frames/s motion itself passes for noise; what the fit leaves of its own part says more. A gap of 1.31 with
    the drag would be 0.99 of the estimate."""
    posterior = measured(filmed(0.228, 0.228, 3, None, 25.0, c2))
    assert posterior.likelihood.noise_model.scales[0] > 1.25 * NOISE
    assert posterior.gap.train == pytest.approx(1.0) and posterior.misfit == misfit


@pytest.fixture(scope="module")
def experiment():
    cradle = Cradle(bobs=2)
    return Experiment(cradle, (simulated_run(cradle, duration=12.0),))


@pytest.mark.parametrize(
    ("gap", "misfit"),
    [(Gap(1.0, 1.01), "none"), (Gap(1.0, 1.10), "small"), (Gap(1.10, 1.0), "small"), (Gap(1.0, 1.2), "large"),
     (Gap(1.0, 1.2, allowed=1.3), "none")],
)  # fmt: skip
def test_a_small_misfit_is_told_from_noise(experiment, gap, misfit):
    """960 readings held out: chance passes 1.053 once in a hundred times."""
    posterior = made_up_posterior(experiment, gap=gap)
    assert posterior.misfit == misfit and posterior.describes_data is (misfit != "large")
    words = model_verdict(posterior.summary())
    assert ("with a small misfit" in words) is (misfit == "small")
    assert ("does not describe" in words) is (misfit == "large")
    json.dumps(posterior.summary()["misfit"])


def test_unstated_noise_tells_no_small_misfit(experiment):
    unstated = dataclasses.replace(experiment, runs=(dataclasses.replace(experiment.runs[0], noise=None),))
    assert made_up_posterior(unstated, gap=Gap(1.0, 1.10)).misfit == "none"


def test_a_posterior_that_its_bounds_cut_off_is_told(experiment):
    posterior = made_up_posterior(experiment)
    assert posterior.at_bounds == () and "cut off" not in model_verdict(posterior.summary())
    k = posterior.likelihood.names.index("kappa")
    chain = posterior.chain.copy()
    chain[..., k] = np.minimum(chain[..., k] - chain[..., k].mean() + np.log(posterior.unknowns[k].high), np.log(
        posterior.unknowns[k].high))  # fmt: skip
    cut = dataclasses.replace(posterior, chain=chain)
    assert cut.at_bounds == ("kappa",)
    assert "The posterior of kappa is cut off at a bound: the search covered 19.66 to 1966 N/m" in model_verdict(
        cut.summary()
    )


def test_stated_as_nothing_is_looked_for_where_cradles_are(experiment):
    for name in ("k_f", "b"):
        nothing = dataclasses.replace(experiment, cradle=Cradle(bobs=2, **{name: 0.0}))
        (unknown,) = (u for u in model_unknowns(nothing) if u.name == name)
        assert unknown.low < TRUTH[name] < unknown.high
