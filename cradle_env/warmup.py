"""Kernels compiled before they are needed, on two cores; later processes find them on disk."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import gymnasium
import numpy as np

from cradle_env.constitutive import restitution_curve, string_tension
from cradle_env.cradle import Cradle
from cradle_env.mechanics import apart
from cradle_env.release import InitialState, Release
from cradle_env.simulation import raised, simulate


def warm_up() -> None:
    """Compiles every kernel for this machine, or loads it where that has been done."""
    # Fresh processes: a fork would copy whatever threads of this one hold.
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        for done in [pool.submit(simulations), pool.submit(environments)]:
            done.result()


def simulations() -> None:
    """Calls every kernel of simulations."""
    cradle = Cradle()
    for beginning in (Release(angle=0.2), InitialState(np.zeros(5), np.zeros(5))):
        simulate(cradle, beginning, duration=0.1)
    raised(cradle, Release(angle=0.2))
    restitution_curve(cradle, np.array([0.1]))
    string_tension(cradle, np.array([1e-6]))
    apart.compile_all()


def environments() -> None:
    """Calls every kernel of environments."""
    name, mode = "NewtonCradle-v0", "ansi"
    for env in (gymnasium.make(name, render_mode=mode), gymnasium.make_vec(name, 2, render_mode=mode)):
        env.reset(seed=0)
        env.step(env.action_space.sample())
        env.render()
        env.close()
