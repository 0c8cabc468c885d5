"""One experiment with a run, a table of impacts, curves of a string and a ring-down, with its truth drawn at random.

Data come from the simulators of tests/reference, which share no code with the package.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cradle_env import Cradle
from identification import Experiment
from identification.apparatus import measure_impacts, measure_ringdown, measure_string
from identification.apparatus.measurement import Measurement
from identification.apparatus.measurement_files import save
from tests.reference import impact_chain, pendulum, string_machine
from tests.reference.laboratory import record, write_experiment
from tests.reference.soft_contact import SoftCradle, simulate_soft

#: What is wrong: nothing; the string that was pulled is another one; the balls of the impacts are others; the drag
#: grows with the neighbours, which one bob alone does not show.
ARMS = ("nothing", "other string", "other balls", "group drag")
#: Contacts so much stiffer that they are as good as instantaneous, with the same e(v).
_STIFF = 1e6
_SPEEDS = np.geomspace(0.1, 1.0, 5)


@dataclass(frozen=True)
class Case:
    """One experiment: the true k_f, kappa and b, what is wrong, and the random numbers of its data."""

    number: int
    arm: str
    truth: dict[str, float]
    duration: float
    noise: float
    seed: int


def draw(arm: str, number: int) -> Case:
    """The case of that number."""
    rng = np.random.default_rng([ARMS.index(arm), number])
    truth = {"k_f": rng.uniform(12e3, 25e3), "kappa": rng.uniform(150.0, 260.0), "b": rng.uniform(1e-3, 4e-3)}
    duration, noise = rng.uniform(6.0, 20.0), rng.uniform(1e-3, 3e-3)
    if arm == "group drag":  # bobs come close to each other the longer they swing
        duration, noise = rng.uniform(30.0, 45.0), 1e-3
    return Case(number, arm, truth, duration, noise, int(rng.integers(2**31)))


def write(case: Case, folder: Path) -> Experiment:
    """Make the data of a case, measure them, and read the experiment that joins them."""
    rng = np.random.default_rng(case.seed)
    known = {name: value * rng.uniform(0.9, 1.1) for name, value in case.truth.items()}
    effects = {"group_drag": {"slope": 1.0, "range": 0.005}} if case.arm == "group drag" else {}
    soft = SoftCradle(2, stiffness_factor=_STIFF, effects=effects, **case.truth)
    angle = rng.uniform(0.15, 0.25)
    run = record(soft, {2: angle}, duration=case.duration, noise=case.noise, seed=int(rng.integers(2**31)))
    write_experiment(folder, [run], stated=known)
    kappa = case.truth["kappa"] * (1.05 if case.arm == "other string" else 1.0)
    k_f = case.truth["k_f"] * (1.25 if case.arm == "other balls" else 1.0)
    pulled = measure_string(_string(rng, folder, kappa))
    cradle = Cradle(**known).replace(kappa=pulled.values["kappa"].median)
    measured: dict[str, Measurement] = {
        "impacts": measure_impacts([_impacts(rng, folder, k_f)], cradle),
        "string": pulled,
        "ringdown": measure_ringdown([_ringdown(rng, folder, case)], cradle),
    }
    path = folder / "experiment.toml"
    tables = []
    for kind, one in measured.items():
        save(one, folder / kind)
        tables += ["", f"[[{kind}]]", f'file = "{kind}/measurement.json"']
    path.write_text(path.read_text(encoding="utf-8") + "\n".join([*tables, ""]), encoding="utf-8")
    return Experiment.load(path)


def _string(rng: np.random.Generator, folder: Path, kappa: float) -> list[Path]:
    """Three cycles to 1, 1.8 and 2.6 N and four in a row."""
    pulls = (((1.0,), 0.0), ((1.8,), 0.0), ((2.6,), 0.0), ((2.0,) * 4, 0.8))
    made = [
        string_machine.pull(np.array(peaks) / kappa, low=low / kappa, kappa=kappa, noise=0.05, seed=int(seed))
        for (peaks, low), seed in zip(pulls, rng.integers(2**31, size=len(pulls)), strict=True)
    ]
    return [string_machine.csv_of(folder / f"curve{k}.csv", *one) for k, one in enumerate(made)]


def _impacts(rng: np.random.Generator, folder: Path, k_f: float) -> Path:
    """30 impacts on two bobs at rest, speeds known to 3 mm/s."""
    passed = [impact_chain.collide(3, v, k_f)[0][-1] / v for v in _SPEEDS]
    smooth = np.polyfit(np.log(_SPEEDS), passed, 3)
    true = rng.uniform(0.15, 0.9, 30)
    before, after = (v + 3e-3 * rng.standard_normal(30) for v in (true, true * np.polyval(smooth, np.log(true))))
    rows = (f"{a},{b},0.003,0.003" for a, b in zip(before, after, strict=True))
    path = folder / "speeds.csv"
    path.write_text("\n".join(["v1 [m/s],v3 [m/s],v1_sd [m/s],v3_sd [m/s]", *rows, ""]), encoding="utf-8")
    return path


def _ringdown(rng: np.random.Generator, folder: Path, case: Case) -> Path:
    """40 s of one bob that hangs alone, readings of 2 mrad, 60 a second."""
    times = np.arange(2401) / 60.0
    alone = SoftCradle(1, kappa=case.truth["kappa"], b=case.truth["b"])
    theta = simulate_soft(alone, {1: rng.uniform(0.1, 0.2)}, "hanging", times=times).theta
    return pendulum.csv_of(folder / "one.csv", times, theta + 2e-3 * rng.standard_normal(theta.shape))
