"""Experiments with something hidden, for the study of diagnoses: python -m tests.reference.hidden FOLDER

Written by the soft-contact reference, with contacts 250 times shorter than real ones so that impacts are as good as
instantaneous; what the files state of k_f, kappa and b is up to 15 % off, and answers.json says what is hidden.
"""

import json
import sys
from pathlib import Path

import numpy as np

from .laboratory import record, write_experiment
from .soft_contact import SoftCradle

#: Ranges of strength of what is hidden one at a time; None: nothing. Values per bob or gap are drawn for each.
HIDDEN: dict[str, tuple[str, float, float] | None] = {
    "nothing": None,
    "quadratic_drag": ("c2", 2e-3, 1.5e-2),
    "pivot_friction": ("tau_c", 1e-5, 8e-5),
    "angle_offset": ("offset", 2e-4, 2e-3),
    "exposure_blur": ("duration", 8e-3, 3e-2),
    "contact_duration": ("scale", 0.5, 1.5),
}


def write_case(folder: Path, name: str, kind: str, seed: int) -> dict:
    """One experiment, and its answer."""
    rng = np.random.default_rng(seed)
    bobs = int(rng.choice([2, 2, 3, 5]))
    truth = {
        "k_f": float(rng.uniform(14e3, 24e3)),
        "kappa": float(rng.uniform(160.0, 240.0)),
        "b": float(10 ** rng.uniform(-3, -2.3)),
    }
    effects, factor = {}, 1e6
    declared = HIDDEN[kind]
    if declared is not None:
        key, low, high = declared
        effects = {kind: {key: float(low * (high / low) ** rng.random())}}
    if kind == "contact_duration":
        factor = 1.0
    cradle = SoftCradle(bobs, stiffness_factor=factor, effects=effects, **truth)
    noise = float(rng.choice([1e-3, 5e-3]))
    angle = float(rng.uniform(0.12, 0.3))
    recording = record(cradle, {bobs: angle}, noise=noise, rate=60.0, duration=45.0, seed=seed)
    stated = {key: value * rng.uniform(0.85, 1.15) for key, value in truth.items()}
    lifted = angle + 1e-3 * rng.standard_normal()
    write_experiment(folder / name, [recording], stated=stated, release={"angles": {bobs: float(lifted)}})
    return {"effects": [kind] if declared is not None else [], "truth": truth, "hidden": effects, "noise": noise}


def main(folder: Path, each: int, first: int = 1) -> None:
    """`each` cases of every kind."""
    answers = {}
    for seed in range(first, first + each):
        for kind in HIDDEN:
            for turn in range(5 if kind == "nothing" else 1):
                name = f"{kind}-{seed}-{turn}"
                answers[name] = write_case(folder, name, kind, 1000 * seed + 10 * list(HIDDEN).index(kind) + turn)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "answers.json").write_text(json.dumps(answers, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 2)
