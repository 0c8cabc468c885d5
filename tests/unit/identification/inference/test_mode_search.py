"""The search for the best mode, on readings of the soft-contact reference."""

import numpy as np

from cradle_env import Cradle, Release
from identification import Experiment
from identification.experiment.run import Prior, ReleaseInfo, Run
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import find_mode
from tests.reference.soft_contact import SoftCradle, simulate_soft


def test_the_covariance_covers_other_modes_of_kappa():
    """A lone bob at 30 frames/s, its strings' length, exposure and camera unknown, as from a film: κ shows in a
    vibration alone, which noise hides, and modes 1 to 2 % apart fit alike. The best is 5 % off here."""
    truth, frame = {"kappa": 190.0, "b": 3e-3}, 1.0 / 30.0
    times, rng = np.arange(0.0, 20.0, frame), np.random.default_rng(17)
    run = simulate_soft(SoftCradle(1, stiffness_factor=1e6, **truth), {1: 0.15}, times=times)
    readings = run.theta + 3e-4 * rng.standard_normal(run.theta.shape)
    cradle = Cradle(
        bobs=1, length=0.301, effects={"exposure_blur": {"duration": 0.35 * frame}, "angle_scale": {"scale": 0.0}}
    )
    infer = {
        "length": Prior(mean=0.301, sd=0.006),
        "angle_scale.scale": Prior(mean=0.0, sd=0.006),
        "exposure_blur.duration": Prior(mean=0.35 * frame, sd=0.25 * frame),
    }
    filmed = Run(
        times,
        readings,
        release=ReleaseInfo(Release(angle=0.151), 2e-3, 5e-3),
        state="release",
        rest="free",
        fit_from=0.0,
    )
    experiment = Experiment(cradle, (filmed,), infer, ("angle_scale.scale", "exposure_blur.duration"))
    likelihood, mode = find_mode(Likelihood(experiment, workers=1))
    k = likelihood.names.index("kappa")
    sd = float(np.sqrt(mode.covariance[k, k]))
    error = np.log(likelihood.values(mode.point)["kappa"] / truth["kappa"])
    # Of six seeds all lie within 1.7 sd. Without the other modes this one is off by 5 sd and more.
    assert abs(error) < 2.5 * sd < 0.15
