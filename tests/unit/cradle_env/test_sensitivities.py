"""Derivatives of runs by parameters: against formulas, one for each kind of event, and against differences of runs."""

import dataclasses
import math
import re

import numpy as np
import pytest

from cradle_env import Cradle, InitialState, Release, simulate

# Differences of two runs are good to 1e-7 of the derivatives here: runs hold θ to some 1e-13 rad, taken over steps of
# 2e-5 of a parameter's size, whose fifth power is far less. Sizes of those that are small or no fields of a cradle:
SIZES = {"b": 0.05, "release_angle": 0.2, "added_mass.mass": 0.05}


def moved(cradle, release, name, by):
    """Cradle and release with one parameter larger by some amount."""
    if name == "release_angle":
        return cradle, dataclasses.replace(release, angle=release.angle + by)
    if "." in name:
        effect, key = name.split(".")
        return cradle.with_values({name: cradle.effects[effect][key] + by}), release
    return cradle.replace(**{name: getattr(cradle, name) + by}), release


def difference(cradle, release, name, step, **how):
    """Derivatives of θ, r and the instants of impacts, differences of order 4."""

    def central(h):
        ahead, behind = (simulate(*moved(cradle, release, name, x), **how) for x in (h, -h))
        assert len(ahead.impacts) == len(behind.impacts) > 0
        pairs = ((run.theta, run.r, run.impacts["time"]) for run in (ahead, behind))
        return [(a - b) / (2.0 * h) for a, b in zip(*pairs, strict=True)]

    near, far = central(step), central(2.0 * step)
    return [(4.0 * a - b) / 3.0 for a, b in zip(near, far, strict=True)]


@pytest.mark.parametrize(
    ("cradle", "release"),
    [
        (Cradle(bobs=2), Release(angle=0.2)),
        (Cradle(bobs=2, model="pendulum", effects={"radial_elasticity": {}}), Release(angle=0.2, start="hanging")),
        (Cradle(bobs=3, delta=0.01), Release(angles={3: 0.2})),
        (Cradle(bobs=2, delta=0.01, effects={"added_mass": {"mass": 1e-3}}), Release(angle=0.2)),
        (Cradle(bobs=2, power_law=(0.03, 0.2), kappa=30.0), Release(angle=1.2)),  # goes slack
    ],
)
def test_derivatives_are_those_of_the_runs(cradle, release):
    names = ["kappa", "b", "length", "mass", "gravity", "radius", "pivot_half_spacing"]
    names += ["k_f", "youngs_modulus"] if cradle.power_law is None else []
    names += ["added_mass.mass"] if cradle.effects.get("added_mass") else []
    names += ["release_angle"] if release.angle else []
    how = {"duration": 2.0, "sample_rate": 50.0, "ledger": False, "tolerance": 1e-18}
    run = simulate(cradle, release, sensitivities=names, **how)
    for name in names:
        size = SIZES.get(name) or getattr(cradle, name)
        wanted = difference(cradle, release, name, 2e-5 * size, **how)
        found = run.d_theta[name], run.d_r[name], run.d_impact_times[name]
        for d, w, unit in zip(found, wanted, (1.0, cradle.length, 1.0), strict=True):
            # 1e-6 of the largest, or where that is small, the rounding of runs over the step
            np.testing.assert_allclose(d, w, rtol=0.0, atol=1e-6 * np.abs(w).max() + 1e-8 * unit / size, err_msg=name)


@pytest.mark.parametrize(("bobs", "duration"), [(3, 0.8), (5, 0.3)])
def test_a_row_that_touches_is_struck_as_one(bobs, duration):
    """A run holds such an impact to 1e-10 of its speeds, so that differences over 0.4 % of a parameter hold 2e-5 of the
    least of these derivatives, that by k_f; without the variation of the chain the others are off by 1e-2 and more."""
    cradle, release = Cradle(bobs=bobs), Release(angle=0.1)
    names = ("kappa", "b", "k_f", "mass", "release_angle")
    how = {"duration": duration, "sample_rate": 50.0, "ledger": False, "tolerance": 1e-18}
    run = simulate(cradle, release, sensitivities=names, **how)
    assert len(run.impacts) == bobs - 1
    for name in names:
        size = SIZES.get(name) or getattr(cradle, name)
        wanted = difference(cradle, release, name, 4e-3 * size, **how)
        for d, w in zip((run.d_theta[name], run.d_r[name]), wanted[:2], strict=True):
            np.testing.assert_allclose(d, w, rtol=0.0, atol=2e-5 * np.abs(w).max(), err_msg=name)


def test_a_lone_swing_decays_by_its_drag():
    """θ of a linear pendulum: r θ'' + (b/m) r θ' + g θ = 0, r where the bob hangs. Terms of θ0² are 1e-8."""
    b, m, g, theta0 = 0.05, 0.3, 9.81, 1e-4
    cradle = Cradle(bobs=1, b=b, mass=m, gravity=g, model="pendulum", effects={"radial_elasticity": {}})
    run = simulate(cradle, Release(angle=theta0, start="hanging"), 5.0, 40.0, sensitivities=("b", "release_angle"))
    r, c, t = run.r[0, 0], b / m, run.t
    w = math.sqrt(g / r - 0.25 * c * c)
    decay, cos, sin = theta0 * np.exp(-0.5 * c * t), np.cos(w * t), np.sin(w * t)
    by_w = decay * (-t * sin + 0.5 * c * (t * cos / w - sin / w**2))
    by_c = -0.5 * t * decay * (cos + 0.5 * c / w * sin) + 0.5 * decay * sin / w + by_w * (-0.25 * c / w)
    np.testing.assert_allclose(run.d_theta["b"][:, 0], by_c / m, rtol=0.0, atol=1e-7 * np.abs(by_c / m).max())
    np.testing.assert_allclose(
        run.d_theta["release_angle"][:, 0], decay / theta0 * (cos + 0.5 * c / w * sin), atol=1e-7
    )


def test_an_impact_comes_later_where_the_gap_is_wider():
    """A small swing θ0 cos(ωt) meets a bob at rest where r θ = −2 R δ. Terms of θ0² are 1e-6."""
    theta0, delta = 1e-3, 1e-3
    cradle = Cradle(bobs=2, b=0.0, delta=delta, model="pendulum", effects={"radial_elasticity": {}})
    run = simulate(cradle, Release(angle=theta0, start="hanging"), 0.5, 10.0, sensitivities=("delta", "release_angle"))
    r = run.r[0, 0]
    w, meets = math.sqrt(cradle.gravity / r), -2.0 * cradle.radius * delta / r
    t = math.acos(meets / theta0) / w
    assert run.impacts["time"][0] == pytest.approx(t, rel=1e-6)
    speed = theta0 * w * math.sin(w * t)
    assert run.d_impact_times["delta"][0] == pytest.approx(2.0 * cradle.radius / r / speed, rel=1e-5)
    assert run.d_impact_times["release_angle"][0] == pytest.approx(math.cos(w * t) / speed, abs=1e-5 / speed)


def test_a_string_remembers_where_it_turned():
    """Upright strings, a = 0: they load from (s0, v0) to s1, and unload by T1 (s / s1)² to s2. Energy gives both; where
    the bob stands still, dr is that of s1 or s2."""
    g, m, r0 = 9.81, 0.3, 0.3

    def turns(kappa, v0=0.02, s0=0.004):
        k = 4.0 * kappa / m  # s'' = g − k s, then g − k s² / s1
        s1 = g / k + math.sqrt((s0 - g / k) ** 2 + v0 * v0 / k)
        roots = np.roots([k / (3.0 * s1), 0.0, -g, g * s1 - k * s1 * s1 / 3.0])
        return s1, max(x.real for x in roots if abs(x.imag) < 1e-9 and x.real < s1 * (1.0 - 1e-9))

    kappa = 150.0
    cradle = Cradle(bobs=1, b=0.0, mass=m, length=r0, pivot_half_spacing=0.0, kappa=kappa, gravity=g)
    start = InitialState(np.zeros(1), np.zeros(1), r=np.array([r0 + 0.004]), r_dot=np.array([0.02]))
    run = simulate(cradle, start, 0.2, 1e5, sensitivities=("kappa",))
    s = run.r[:, 0] - r0
    rising = np.diff(s) > 0.0
    turned = np.flatnonzero(rising[:-1] != rising[1:]) + 1
    for which, k in enumerate(turned[:2]):
        assert s[k] == pytest.approx(turns(kappa)[which], rel=1e-6)
        slope = (turns(kappa + 0.01)[which] - turns(kappa - 0.01)[which]) / 0.02
        # The sample is up to 5 µs from the turn, where r changes by some 1e-4 of what is told.
        assert run.d_r["kappa"][k, 0] == pytest.approx(slope, rel=2e-3)


def test_sigma_and_the_newton_exponent_follow():
    cradle, release, how = Cradle(bobs=2), Release(angle=0.2), {"duration": 6.0, "sample_rate": 240.0}
    names = ("k_f", "release_angle")
    run = simulate(cradle, release, sensitivities=names, **how)
    for name, h in zip(names, (1.0, 1e-5), strict=True):
        ahead, behind = (simulate(*moved(cradle, release, name, x), **how) for x in (h, -h))
        wanted = (ahead.sigma() - behind.sigma()) / (2.0 * h)
        # Envelopes that jump from one sample to the next between the two runs are few.
        off = np.abs(run.d_sigma[name] - wanted) > 1e-4 * np.abs(wanted).max()
        assert off.mean() < 0.02
        exponent = (ahead.newton_exponent() - behind.newton_exponent()) / (2.0 * h)
        assert run.d_newton_exponent[name] == pytest.approx(exponent, rel=1e-3)


def test_a_run_is_the_same_without():
    cradle, release = Cradle(bobs=3), Release(angle=0.2)
    plain, run = simulate(cradle, release, 3.0), simulate(cradle, release, 3.0, sensitivities=("b",))
    for name in ("theta", "r", "theta_dot", "r_dot", "impacts", "ledger"):
        assert np.array_equal(getattr(plain, name), getattr(run, name))
    assert plain.d_theta == {}


def test_nothing_is_told_where_nothing_exists():
    """The order of impacts in a row that touches depends on the gaps; bobs in touch press on each other."""
    run = simulate(Cradle(bobs=3), Release(angle=0.2), 1.0, sensitivities=("delta[1]", "b"))
    first = np.searchsorted(run.t, run.impacts["time"][0])
    assert np.isfinite(run.d_theta["b"][:first]).all()
    assert np.isnan(run.d_theta["delta[1]"][first:]).all()
    run = simulate(Cradle(bobs=3, delta=-0.01), Release(angle=0.2), 0.1, sensitivities=("b",))
    assert np.isnan(run.d_theta["b"][1:, :2]).all() and np.isfinite(run.d_theta["b"][:, 2]).all()


@pytest.mark.parametrize(
    ("cradle", "name", "said"),
    [
        (Cradle(bobs=2), "kapa", "did you mean 'kappa'"),
        (Cradle(bobs=2), "theta[1]", "release_angle"),
        (Cradle(bobs=2), "quadratic_drag.c2", "the cradle must have the effect"),
        (Cradle(bobs=2, model="pendulum"), "b", "elastic strings"),
        (Cradle(bobs=2, effects={"contact_duration": {"scale": 1.0}}), "b", "instantaneous impacts"),
    ],
)
def test_what_is_not_known_is_refused(cradle, name, said):
    with pytest.raises(ValueError, match=said):
        simulate(cradle, Release(angle=0.1), 0.1, sensitivities=(name,))


@pytest.mark.parametrize("name", ["delta[9]", "delta[*]", "k_f[1]", "nothing", "k f[", "spacer_offset.offset[7]"])
def test_a_parameter_that_is_not_there_is_named(name):
    cradle = Cradle(bobs=3, delta=0.01, effects={"spacer_offset": {"offset": [0.0, 0.0]}})
    with pytest.raises(ValueError, match=re.escape(name)):
        simulate(cradle, Release(angle=0.1), 0.1, sensitivities=(name,))
