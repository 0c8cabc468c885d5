"""A film of a simulated cradle, and what is true of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cradle_env import Cradle, Release, simulate
from studies.film.camera import Camera, film, filmed, write_film
from tests.reference.soft_contact import SoftCradle, simulate_soft

#: Contacts this much stiffer are as good as instantaneous; see tests/integration/test_reference.py.
STIFFENED = 1e6


@dataclass(frozen=True)
class Case:
    """A film to make. angles: [rad] of the lifted bobs, by number, held for `held` seconds; soft: moved by the
    soft-contact reference, else by the package; hand, hidden: as in `camera.film`; truth: k_f, kappa, b."""

    bobs: int = 2
    angles: dict[int, float] = field(default_factory=lambda: {2: 0.2})
    duration: float = 5.0
    held: float = 0.4
    camera: Camera = field(default_factory=Camera)
    truth: dict[str, float] = field(default_factory=dict)
    delta: float = 0.0
    soft: bool = False
    seed: int = 0
    codec: str = "libx264"
    hand: tuple[float, int] | None = None
    hidden: tuple[float, float, int] | None = None


@dataclass(frozen=True, eq=False)
class Truth:
    """times (T,) of the frames [s]; places (T, N, 2), mean over each exposure [pixels]; theta (T, N), likewise [rad];
    impacts (M, 2): time [s] of the film and pair, 1 for the first two; cradle: nominal."""

    times: np.ndarray
    places: np.ndarray
    theta: np.ndarray
    impacts: np.ndarray
    cradle: Cradle


def make(path: Path, case: Case) -> Truth:
    """Writes the film."""
    camera, cradle = case.camera, Cradle(bobs=case.bobs, delta=case.delta, **case.truth)
    times = np.arange(int(case.duration * camera.rate)) / camera.rate
    instants = filmed(camera, times)
    moved = np.maximum(instants - case.held, 0.0)
    unique, where = np.unique(moved, return_inverse=True)
    if case.soft:
        soft = SoftCradle(case.bobs, delta=case.delta, stiffness_factor=STIFFENED, **case.truth)
        run = simulate_soft(soft, case.angles, times=unique)
        impacts = np.column_stack([run.contacts["time"], run.contacts["pair"]])
    else:
        run = simulate(cradle, Release(angles=case.angles), times=unique)
        impacts = np.column_stack([run.impacts["time"], run.impacts["pair"]])
    spacing = 2.0 * cradle.radius * (1.0 + case.delta)
    pivots = np.column_stack([(np.arange(case.bobs) - (case.bobs - 1) / 2.0) * spacing, np.zeros(case.bobs)])
    swung = np.stack([run.r * np.sin(run.theta), run.r * np.cos(run.theta)], axis=-1)
    room = (pivots + swung)[where].reshape(*instants.shape, case.bobs, 2)
    theta = run.theta[where].reshape(*instants.shape, case.bobs).mean(axis=1)
    write_film(
        path,
        film(camera, times, room, cradle.radius, pivots, case.seed, case.hand, case.hidden),
        times,
        case.codec,
    )
    return Truth(times, camera.pixels(room).mean(axis=1), theta, impacts + np.array([case.held, 0.0]), cradle)
