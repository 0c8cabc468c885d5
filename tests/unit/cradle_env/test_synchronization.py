"""σ(t) and λ: their definition on signals made up, and what PHYSICS.md says a right implementation shows."""

import numpy as np
import pytest

from cradle_env import Cradle, Release, newton_exponent, sigma, simulate, simulate_batch
from identification.bench import scipy_peer

ELASTIC = {"-string_hysteresis": {}}
ANGLE = 0.228
PERIOD = Cradle().period
T = np.arange(60 * 240 + 1) / 240


# --- definition -------------------------------------------------------------------------------------------------


def test_sigma_of_a_shifted_swing() -> None:
    """A cos ωt + B has the envelopes B ± A: σ = 2 |B|/θ0, but for the sampling of the peaks."""
    theta = 0.1 * np.cos(2 * np.pi * T / PERIOD) - 0.03
    missed = 0.1 * (2 * np.pi / PERIOD / 480) ** 2 / 2 * 2 / 0.2
    whole = T <= 60 - 0.525 * PERIOD  # before the window is cut off at the end of the record
    np.testing.assert_allclose(sigma(T, theta, 0.2, PERIOD)[whole], 0.3, rtol=0, atol=missed)
    many = sigma(T, np.stack([theta, 2 * theta]), np.array([0.2, 0.1]), PERIOD)
    np.testing.assert_array_equal(many[1], 4 * many[0])
    assert np.isnan(sigma(T, theta, 0.0, PERIOD)).all()  # relative to nothing


def test_sigma_looks_over_a_centred_window_of_1_05_periods() -> None:
    blip = np.zeros_like(T)
    blip[5000] = -0.2
    seen = np.flatnonzero(sigma(T, blip, 0.2, PERIOD))
    assert (seen[0] + seen[-1]) / 2 == 5000
    assert seen[-1] - seen[0] == pytest.approx(1.05 * PERIOD * 240, abs=1)
    blip[:] = 0
    blip[0] = 0.1  # the window is cut off at the end of the record
    assert np.count_nonzero(sigma(T, blip, 0.2, PERIOD)) == pytest.approx(1.05 * PERIOD * 120 + 1, abs=1)


def test_sigma_refuses_uneven_or_sparse_times() -> None:
    with pytest.raises(ValueError, match="evenly"):
        sigma(T**1.01, T, 0.2, PERIOD)
    with pytest.raises(ValueError, match="sparse"):
        sigma(T[::60], T[::60], 0.2, PERIOD)


def test_newton_exponent_of_an_exponential() -> None:
    assert newton_exponent(T, np.exp(-0.07 * T)) == pytest.approx(0.07, rel=1e-12)
    assert newton_exponent(T, 2 * np.exp(-0.07 * T), (10.0, 20.0)) == pytest.approx(
        0.07 - np.mean(np.log(2) / T[(T > 10) & (T <= 20)]), rel=1e-12
    )
    # Only 1 s < t ≤ 60 s counts, and only σ > 1e-3.
    fast = np.where(T <= 1.0, 0.9, np.exp(-0.2 * T))
    fast[fast <= 1e-3] = 1e-9
    assert newton_exponent(T, fast) == pytest.approx(0.2, rel=1e-12)
    long = np.arange(100 * 240) / 240
    assert newton_exponent(long, np.where(long <= 60.0, np.exp(-0.07 * long), 0.9)) == pytest.approx(0.07, rel=1e-12)
    assert np.isnan(newton_exponent(T, np.zeros_like(T)))
    np.testing.assert_allclose(newton_exponent(T, np.exp(-np.outer([0.03, 0.09], T))), [0.03, 0.09], rtol=1e-12)


# --- what a cradle shows ----------------------------------------------------------------------------------------


def exponents(cradles: list[Cradle], release: Release | list[Release] | None = None) -> np.ndarray:
    return np.array([run.newton_exponent() for run in simulate_batch(cradles, release or Release(angle=ANGLE))])


@pytest.mark.parametrize(
    ("start", "published"),
    [("unstretched", [0.0592, 0.0718, 0.102]), ("hanging", [0.0525, 0.0657, 0.099])],
)
def test_published_exponents(start: str, published: list[float]) -> None:
    cradles = [Cradle(bobs=bobs, kappa=196.61, b=0.002) for bobs in (2, 3, 5)]
    # 0.3 % below the published in all cases; for N = 2 the next test agrees to 1e-8 with what we find. The rounded
    # k_el of Table 1 would take 0.1 % more.
    np.testing.assert_allclose(exponents(cradles, Release(angle=ANGLE, start=start)), published, rtol=6e-3)


@pytest.mark.parametrize("k_f", [18000.0, 0.0])
def test_exponent_of_an_independent_integration(k_f: float) -> None:
    """Over the first 15 s: the other integrator takes a second for each four."""
    cradle, times = Cradle(bobs=2, k_f=k_f), T[T <= 15.0]
    theta, _, _ = scipy_peer.simulate(2, angle=ANGLE, times=times, kappa=cradle.kappa, k_f=k_f, rtol=1e-9, atol=1e-11)
    peer = newton_exponent(times, sigma(times, theta[:, 1], ANGLE, PERIOD))
    # Angles agree to 1e-7 over 60 s; σ is 1e-2 at least.
    assert simulate(cradle, Release(angle=ANGLE), 15.0).newton_exponent() == pytest.approx(peer, rel=1e-6)


def test_exponent_rises_with_alpha() -> None:
    found = exponents([Cradle.from_groups(bobs=2, alpha=alpha, n=0.197) for alpha in np.linspace(0, 0.2, 11)])
    assert np.all(np.diff(found) > 0.005)
    # Published: 0.019 to 0.200, by another way of varying α. At α = 0 exactly, drag and strings alone give 0.0167,
    # with SciPy too; 0.0193 belongs to k_f = 1000, α = 0.002.
    assert found[0] == pytest.approx(0.019, abs=3e-3)
    assert found[-1] == pytest.approx(0.200, rel=0.04)


def test_radial_and_angular_motion_resonate() -> None:
    beta = np.arange(0.100, 0.2401, 0.002)
    found = exponents([Cradle.from_groups(bobs=2, beta=float(x)) for x in beta])
    assert beta[np.argmax(found)] == pytest.approx(0.21, abs=0.005)
    assert found.max() == pytest.approx(0.2, abs=0.02)
    for place in (0.115, 0.145):  # lesser peaks, within ±0.006, that stand out from what lies 0.012 off
        near = np.abs(beta - place) <= 0.0061
        around = (np.abs(beta - place) > 0.0061) & (np.abs(beta - place) <= 0.0121)
        assert found[near].max() > 1.1 * np.median(found[around])


def test_gaps_make_it_beat() -> None:
    def rebound(delta: float) -> float:
        """By how much σ rises above where it has been, at most; before the window is cut off at the end."""
        run = simulate(Cradle(bobs=2, delta=delta), Release(angle=ANGLE), 90.0)
        s = run.sigma()[run.t < 89.0]
        return float((s - np.minimum.accumulate(s)).max())

    assert rebound(0.0) < 1e-3
    assert rebound(2e-3) > 0.01
    assert rebound(5e-3) > 0.03


def test_exponent_is_least_near_no_gap() -> None:
    delta = np.array([-2e-3, -5e-4, -2e-4, -1.2e-4, -5e-5, 0.0, 2e-4, 5e-4, 2e-3])
    found = exponents([Cradle(bobs=2, delta=float(d)) for d in delta])
    least = int(np.argmin(found))
    assert -2e-4 <= delta[least] <= 0
    flat = found[(delta >= -2e-4) & (delta <= 0)]
    assert np.ptp(flat) < 2e-4
    assert np.all(np.diff(found[: least + 1]) < 0)
    assert np.all(np.diff(found[least:]) > 0)
    assert found[-1] == pytest.approx(0.070, abs=5e-4)


def test_amplitude() -> None:
    """λ levels off with γ on elastic strings, bobs let go at their hanging length; with hysteresis it goes on."""
    gamma = np.array([0.00868, 0.015, 0.02, 0.03, 0.05])
    releases = [Release(angle=float(np.sqrt(6 * g)), start="hanging") for g in gamma]
    elastic = exponents([Cradle(bobs=2, effects=ELASTIC)] * len(gamma), releases)
    hysteretic = exponents([Cradle(bobs=2)] * len(gamma), releases)
    # γ = 0.04 is left out: there a radial resonance doubles λ, in SciPy's integration too.
    assert np.ptp(elastic) < 0.1 * elastic[0]
    assert np.all(np.diff(hysteretic) > 0)
    assert hysteretic[-1] > 1.7 * hysteretic[0]


@pytest.mark.parametrize("bobs", [2, 3, 5])
@pytest.mark.parametrize(("model", "angle"), [("ho", 0.1), ("pendulum", 0.01)])
def test_a_share_of_1_in_n_is_left(bobs: int, model: str, angle: float) -> None:
    """Impacts keep the momentum of the common swing, and take the rest (section 4.1); small swings for the pendulum,
    whose common swing is not harmonic."""
    cradle = Cradle(bobs=bobs, model=model, b=0.0)
    run = simulate(cradle, Release(angle=angle), times=np.array([0.0, 600.0]))
    energy = run.energy()
    rest = -bobs * cradle.mass * cradle.gravity * cradle.length
    share = (energy.kinetic + energy.gravity - rest)[1] / (energy.kinetic + energy.gravity - rest)[0]
    assert share == pytest.approx(1 / bobs, abs=1e-6)  # what relative motion is left: e → 1 as it dies
    assert np.ptp(run.theta[1]) < 0.1 * angle


def test_the_lifted_end_counts() -> None:
    """σ is that of the lifted end bob, at either end."""
    cradle = Cradle(bobs=3)
    right = simulate(cradle, Release(angles={3: ANGLE}), 10.0)
    left = simulate(cradle, Release(angles={1: -ANGLE}), 10.0)
    np.testing.assert_allclose(left.sigma(), right.sigma(), rtol=0, atol=1e-6)
    np.testing.assert_array_equal(right.sigma(), sigma(right.t, right.theta[:, 2], ANGLE, PERIOD))
