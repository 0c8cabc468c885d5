"""What an instrument shows of a motion that is known in closed form."""

import numpy as np
import pytest

from cradle_env.cradle import Cradle
from identification.inference.instrument import Instrument

TIMES = np.arange(0.0, 2.0, 0.01)


def cradle(model="nsp", **effects):
    return Cradle(bobs=2, model=model, effects=effects)


def motion(t, phase=0.0):
    """θ of two bobs, (T, 2) [rad], and their r [m]."""
    theta = 0.3 * np.cos(6.0 * t[:, None] + phase + np.array([0.0, 1.0]))
    return theta, 0.30 + 0.001 * theta**2


def test_without_effects_it_shows_the_angles_themselves():
    instrument = Instrument(cradle())
    theta, _ = motion(TIMES)
    assert instrument.instants(TIMES) is TIMES
    assert instrument.readings(theta) is theta


@pytest.mark.parametrize("duration", [0.002, 0.0417], ids=["apart", "overlapping"])
def test_an_exposure_averages_about_its_centre(duration):
    instrument = Instrument(cradle(exposure_blur={"duration": duration}))
    instants = instrument.instants(TIMES)
    offsets, weights = instrument.exposure
    assert weights.sum() == pytest.approx(1.0)
    assert len(instants) == len(TIMES) * len(offsets)
    assert np.all(np.diff(instants) > 0.0) == (duration < 0.01)
    theta, _ = motion(TIMES)
    exact = theta * np.sinc(6.0 * duration / (2.0 * np.pi))
    seen = instrument.readings(motion(instants)[0])
    assert np.abs(seen - exact).max() < 1e-4 * 0.3  # midpoint rule of 10
    assert duration < 0.01 or np.abs(seen - theta).max() > 5e-4


def test_no_exposure_is_no_blur():
    instrument = Instrument(cradle(exposure_blur={"duration": 0.0}))
    assert instrument.instants(TIMES) is TIMES


def test_a_shifted_scale_shifts_angles():
    theta, _ = motion(TIMES)
    seen = Instrument(cradle(angle_offset={"offset": 0.01})).readings(theta)
    assert np.array_equal(seen, theta + 0.01)


def test_x_is_the_displacement_from_the_rest_position():
    theta, r = motion(TIMES)
    assert np.array_equal(Instrument(cradle(), "x").readings(theta, r), r * np.sin(theta))
    assert np.array_equal(Instrument(cradle("ho"), "x").readings(theta, r), r * theta)
    rest = np.array([-0.01, 0.01]), np.array([0.301, 0.302])
    leaning = Instrument(cradle(), "x").readings(theta, r, rest)
    assert np.array_equal(leaning, r * np.sin(theta) - rest[1] * np.sin(rest[0]))
    with pytest.raises(ValueError, match="need r"):
        Instrument(cradle(), "x").readings(theta)


def test_a_tilted_camera_sees_the_rest_position_shifted_too():
    tilted = Instrument(cradle(angle_offset={"offset": 0.05}), "x")
    assert tilted.readings(np.zeros((3, 2)), np.full((3, 2), 0.30)) == pytest.approx(np.zeros((3, 2)), abs=1e-15)


def test_x_is_averaged_as_a_position():
    instrument = Instrument(cradle(exposure_blur={"duration": 0.05}), "x")
    instants = instrument.instants(TIMES)
    theta, r = motion(instants)
    expected = (r * np.sin(theta)).reshape(len(TIMES), -1, 2).mean(axis=1)
    assert instrument.readings(theta, r) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("quantity", ["theta", "x"])
def test_a_batch_reads_as_one_by_one(quantity):
    instrument = Instrument(cradle(exposure_blur={"duration": 0.03}, angle_offset={"offset": 0.01}), quantity)
    instants = instrument.instants(TIMES)
    runs = [motion(instants, phase) for phase in (0.0, 0.5, 1.0)]
    theta, r = (np.array(part) for part in zip(*runs, strict=True))
    rest = np.full((3, 2), 0.02), np.full((3, 2), 0.301)
    together = instrument.readings(theta, r, rest)
    assert together.shape == (3, len(TIMES), 2)
    for k, run in enumerate(runs):
        assert np.array_equal(together[k], instrument.readings(*run, (rest[0][k], rest[1][k])))
