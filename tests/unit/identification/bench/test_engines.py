"""The engines of the race solve one problem; the extra `bench` has those that are no dependencies."""

import importlib

import numpy as np
import pytest

from cradle_env import Cradle, Release, simulate
from identification.bench import engines, heyoka_peer, mujoco_peer, pymunk_peer
from identification.bench.scipy_contact import Peer, kk_pair, restitution_curve

CRADLE = {"angle": 0.228, "delta": 0.01}


def ours(bobs, times):
    cradle = Cradle(bobs=bobs, delta=0.01, pivot_half_spacing=0.0, effects={"-string_hysteresis": {}})
    return cradle.kappa, simulate(cradle, Release(angle=0.228, start="hanging"), times=times)


@pytest.mark.parametrize("speed", [1e-3, 0.4, 9.0])
def test_restitution_of_the_peers_is_that_of_the_contact(speed):
    """1e-13: the series is good to 1e-14."""
    peer = Peer(2)
    a = peer.k_f * peer.k_el**-0.6 * (peer.mass / 2) ** -0.4 * speed**0.2
    assert restitution_curve(peer)(speed) == pytest.approx(kk_pair(a)[0], abs=1e-13)


@pytest.mark.parametrize("bobs", [2, 5])
def test_heyoka_and_we_agree(bobs):
    """To 1e-11 rad over 3 s and some ten impacts: ours are located to 1e-12 s each."""
    pytest.importorskip("heyoka")
    times = np.arange(601) / 200.0
    kappa, run = ours(bobs, times)
    theta = heyoka_peer.integrator(bobs, tol=0.0, pivot_half_spacing=0.0, kappa=kappa, **CRADLE)(times)
    assert np.abs(theta - run.theta).max() < 1e-11


@pytest.mark.parametrize(("package", "peer"), [("mujoco", mujoco_peer), ("pymunk", pymunk_peer)])
def test_engines_with_fixed_steps_solve_the_same_problem(package, peer):
    """Both are of first order: a tenth of the step, a tenth of the error before the first impact, to within a third."""
    pytest.importorskip(package)
    times = np.arange(68) / 250.0
    kappa, run = ours(2, times)
    assert len(run.impacts) == 0
    coarse, fine = (
        np.abs(peer.integrator(2, step=step, kappa=kappa, **CRADLE)(times) - run.theta).max() for step in (1e-3, 1e-4)
    )
    assert fine < 1e-4
    assert 7.0 < coarse / fine < 15.0


@pytest.mark.parametrize(("package", "peer"), [("mujoco", mujoco_peer), ("pymunk", pymunk_peer)])
def test_their_contacts_have_the_restitution_of_ours(package, peer):
    """After the first impact the struck bob rises as high to 0.7 %; e = 1 would add 2 %."""
    pytest.importorskip(package)
    times = np.arange(201) / 250.0
    kappa, run = ours(2, times)
    theta = peer.integrator(2, step=1e-4, kappa=kappa, **CRADLE)(times)
    assert theta[:, 0].min() == pytest.approx(run.theta[:, 0].min(), rel=0.007)


def test_the_race_leaves_out_what_is_not_installed(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *_: None)
    assert engines.missing() == ["heyoka", "MuJoCo", "pymunk"]
    rows = engines.race(2, 0.5)
    assert {row["engine"] for row in rows} == {"cradle_env", "cradle_env, hysteretic strings", "SciPy DOP853"}
    assert all(row["error"] < 1e-6 and row["speed"] > 0.0 for row in rows)
