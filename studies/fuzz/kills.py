"""Commands that are killed at random moments: nothing that was finished is lost, and the same command goes on."""

from __future__ import annotations

import filecmp
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

#: The commands by name: their arguments before --out DIR, and the files by which their end is compared with that of one
#: which nothing stopped.
COMMANDS = {
    "calibrate": (("calibrate", "experiment.toml", "--steps", "120"), ("summary.json", "chain.h5")),
    "diagnose": (("diagnose", "experiment.toml"), ("model.toml",)),
    "sweep": (("sweep", "--over", "beta=0.05:0.4:1500", "--bobs", "3"), ("sweep.csv",)),
}


@dataclass
class Tally:
    """What came of killing a command."""

    killed: int = 0
    finished: int = 0
    seconds: float = 0.0


def fuzz(name: str, kills: int, seed: int, sound: Path, scratch: Path) -> tuple[Tally, list[str]]:
    """Kills a command that often, at random moments of its run; what came of it, and what was broken."""
    arguments, compared = COMMANDS[name]
    rng = np.random.default_rng([seed, [*COMMANDS].index(name)])
    whole, part = scratch / f"{name}-whole", scratch / f"{name}-part"
    began = time.monotonic()
    status, text = _run(arguments, sound, whole, None)
    tally = Tally(seconds=time.monotonic() - began)
    if status not in (0, 1) or "Traceback" in text:
        return tally, [f"{name}: ends with {status}: {' '.join(text.split())}"]
    broken: list[str] = []
    while tally.killed < kills:
        ended, text = _run(arguments, sound, part, float(rng.uniform(0.0, tally.seconds)))
        if ended == -signal.SIGKILL:
            tally.killed += 1
            continue
        broken += _differences(f"{name}, after {tally.killed} kills", ended, text, status, whole, part, compared)
        tally.finished += 1
        shutil.rmtree(part)
    ended, text = _run(arguments, sound, part, None)
    broken += _differences(f"{name}, in the end", ended, text, status, whole, part, compared)
    tally.finished += 1
    return tally, broken


def _run(arguments: tuple[str, ...], folder: Path, out: Path, kill_after: float | None) -> tuple[int, str]:
    """Runs a command, killed so many seconds after its start; its status, and the end of what it said."""
    command = [sys.executable, "-m", "identification", *arguments, "--out", str(out)]
    root = Path(__file__).parents[2]
    process = subprocess.Popen(
        command, cwd=folder, env={**os.environ, "PYTHONPATH": str(root)},
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        _, said = process.communicate(timeout=kill_after)
    except subprocess.TimeoutExpired:
        process.kill()
        _, said = process.communicate()
    return process.returncode, said[-500:]


def _differences(
    at: str, ended: int, text: str, status: int, whole: Path, part: Path, compared: tuple[str, ...]
) -> list[str]:
    """What is not as it is without kills."""
    if ended != status or "Traceback" in text:
        return [f"{at}: ends with {ended} instead of {status}: {' '.join(text.split())}"]
    found = [f"{at}: {name} differs" for name in compared if not _same(whole / name, part / name)]
    left = {path.name for path in part.iterdir()} ^ {path.name for path in whole.iterdir()}
    return found + ([f"{at}: {', '.join(sorted(left))} is left or missing"] if left else [])


def _same(one: Path, other: Path) -> bool:
    if one.suffix != ".h5":
        return filecmp.cmp(one, other, shallow=False)
    import h5py

    with h5py.File(one) as a, h5py.File(other) as b:
        names = ("ensemble_1/chain", "ensemble_2/chain")
        return all(np.array_equal(a[name], b[name]) for name in names)
