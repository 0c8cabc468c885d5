"""The search for the best mode, on readings of the soft-contact reference."""

import numpy as np
import pytest

from cradle_env import Cradle, Release
from identification import Experiment
from identification.experiment.run import Prior, ReleaseInfo, Run
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import find_mode
from identification.inference.normal_approximation import normal_approximation
from tests.reference.laboratory import record, write_experiment
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


@pytest.mark.slow
@pytest.mark.parametrize("stated", [200.0, 270.0])
def test_the_mode_of_a_film_of_three_bobs_is_found(stated):
    """The readings of a film: much about the camera and the release is uncertain, and the noise is not stated. Without
    shorter data first, this search ends with κ 8 % off; with draws of κ within 15 % of 270, 6 % off."""
    truth = {"k_f": 21566.2, "kappa": 211.838, "b": 0.0039162}
    delta, length, angles = 0.0219, 0.2996, {3: 0.1612}
    times = np.arange(0.0, 13.0, 1 / 60)
    seen = simulate_soft(SoftCradle(3, delta=delta, stiffness_factor=1e6, **truth), angles, times=times).theta
    readings = seen + 1.5e-4 * np.random.default_rng(1).standard_normal(seen.shape)
    view = {"slant": 0.0, "pitch": 0.0, "roll": 0.0, "spacing": 0.1364}
    camera = {"exposure_blur": {"duration": 5.8e-3}, "angle_scale": {"scale": 0.0}, "oblique_view": view}
    uncertain = {"length": Prior(mean=length, sd=6e-3), "angle_scale.scale": Prior(mean=0.0, sd=1e-2)}
    uncertain |= {"exposure_blur.duration": Prior(mean=5.8e-3, sd=4e-3), "oblique_view.roll": Prior(mean=0.0, sd=3e-3)}
    uncertain |= {f"oblique_view.{name}": Prior(mean=0.0, sd=0.02) for name in ("slant", "pitch")}
    cradle = Cradle(bobs=3, delta=delta, length=length, kappa=stated)
    cradle = cradle.replace(effects={**cradle.effects, **camera})
    release = ReleaseInfo(Release(angles=angles), angle_sd=1e-3, time_sd=1e-3)
    run = Run(times, readings, release=release, delta=delta, rest="free")
    experiment = Experiment(cradle, (run,), uncertain, tuple(name for name in uncertain if "." in name))
    likelihood, mode = find_mode(Likelihood(experiment), seed=1)
    found = likelihood.values(mode.point)
    # Errors are 0.004 % and 0.02 % here; other modes of κ are 1 % apart.
    assert found["kappa"] == pytest.approx(truth["kappa"], rel=1e-3)
    assert found["k_f"] == pytest.approx(truth["k_f"], rel=5e-3)


@pytest.mark.parametrize(
    ("bobs", "delta", "angles", "rate", "duration", "truth", "seed"),
    [
        (3, 0.047539905551117353, {3: 0.16739314615635392}, 120.0, 10.0,
         {"k_f": 17267.017011376647, "kappa": 185.64784546546978, "b": 1.3882045728738407e-3}, 1247),
        pytest.param(
            4, 0.007977646491890566, {1: -0.12159353700799272}, 60.0, 20.0,
            {"k_f": 22602.944593952805, "kappa": 215.05770623965418, "b": 1.6778581958187312e-3}, 1572,
            marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_the_mode_of_many_bobs_is_followed_from_the_first_swings(
    bobs, delta, angles, rate, duration, truth, seed, tmp_path
):
    """Differences that are small at first grow from impact to impact: fits to 8 periods and then to all data ended with
    residuals of 1.5 and 1.02 times the noise, and κ 25 and 6 standard deviations off."""
    cradle = SoftCradle(bobs, delta=delta, stiffness_factor=1e6, **truth)
    recording = record(cradle, angles, duration=duration, rate=rate, noise=4e-4, seed=seed)
    stated = {"k_f": 19e3, "kappa": 200.0, "b": 2.2e-3}
    path = write_experiment(tmp_path, [recording], stated=stated, run={"noise": None})
    likelihood, mode = normal_approximation(Likelihood(Experiment.load(path)))
    for name, true in truth.items():
        k = likelihood.names.index(name)
        # Farther off than 4 standard deviations once in 16,000 data sets.
        assert abs(mode.point[k] - np.log(true)) < 4.0 * np.sqrt(mode.covariance[k, k])
