"""Recordings of simulated cradles, drawn by their number, with the truth about them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cradle_env import Cradle, Release, simulate
from tests.reference.click_sound import record

#: Backgrounds and loudness: peak of the loudest click over the RMS of the background [dB].
CONDITIONS = (("hiss", 40), ("hiss", 30), ("music", 30), ("music", 20), ("speech", 30), ("speech", 20))
#: Length of a recording [s].
SECONDS = 60.0
#: Samples that are written at a time: libsndfile encodes OGG on the stack.
_BLOCK = 4096


@dataclass(frozen=True, eq=False)
class Case:
    """A recording: the cradle, and the instants [s] in the file and speeds [m/s] of its impacts, in order of time."""

    number: int
    cradle: Cradle
    release: Release
    late: float
    background: str
    snr: float
    rate: int
    format: str
    instants: np.ndarray
    speeds: np.ndarray


def draw(number: int) -> Case:
    """The case of a number; each sixth number has the same background, each fourth case has three bobs."""
    rng = np.random.default_rng([7, number])
    background, snr = CONDITIONS[number % len(CONDITIONS)]
    bobs = 3 if (number // len(CONDITIONS)) % 4 == 3 else 2
    cradle = Cradle(bobs=bobs, b=float(rng.uniform(1e-3, 3e-3)), k_f=18000.0 * float(np.exp(rng.normal(0.0, 0.2))),
                    kappa=196.6 * float(np.exp(rng.normal(0.0, 0.1))))  # fmt: skip
    release, late = Release(angle=float(rng.uniform(0.12, 0.28))), float(rng.uniform(0.5, 2.0))
    impacts = simulate(cradle, release, duration=SECONDS, sample_rate=10.0).impacts
    order = np.argsort(impacts["time"], kind="stable")
    instants, speeds = impacts["time"][order] + late, impacts["speed"][order]
    kept = instants < SECONDS - 0.1
    rate, kind = int(rng.choice([44100, 48000])), str(rng.choice(["wav", "flac", "ogg", "ogg"]))
    return Case(number, cradle, release, late, background, snr, rate, kind, instants[kept], speeds[kept])


def write(case: Case, folder: Path) -> Path:
    """The recording as a file."""
    import soundfile

    rng = np.random.default_rng([8, case.number])
    sound = record(case.instants, case.speeds, SECONDS, rate=case.rate, background=case.background, snr=case.snr,
                   reverberation=rng.uniform(0.2, 0.8), seed=case.number)  # fmt: skip
    path = folder / f"cradle.{case.format}"
    with soundfile.SoundFile(str(path), "w", case.rate, 1) as file:
        for first in range(0, len(sound), _BLOCK):
            file.write(sound[first : first + _BLOCK])
    return path
