"""Diagnoses of pendulums that MuJoCo swings: python -m studies.diagnosis.mujoco DIR [--cases 12]

One bob on a hinge with damping, which the base model has as b, and in every second case with friction loss, which it
has not: the engine's own dry friction, a constraint that gives way within two of its steps, stands for a real pivot.
Needs MuJoCo (`pip install mujoco`). Cases are kept one at a time; DIR/study.md is the table.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from identification.bench.diagnosis import diagnose_case, markdown_table
from identification.storage.files import json_text, write_together

LENGTH, MASS, STEP = 0.30, 0.2813, 2e-4
MODEL = """
<mujoco><option timestep="{step}" integrator="RK4" gravity="0 0 -9.81"/>
<worldbody><body><joint type="hinge" axis="0 -1 0" damping="{damping}" frictionloss="{friction}"
 solreffriction="{soft} 1" solimpfriction="0.99 0.9999 0.001"/>
<inertial pos="0 0 -{length}" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/></body></worldbody></mujoco>
"""


def swing(b: float, tau_c: float, angle: float, times: np.ndarray) -> np.ndarray:
    """θ [rad] at equidistant times [s] of a pendulum let go at an angle [rad], drag b [kg/s], friction τ_c [N m]."""
    import mujoco

    text = MODEL.format(step=STEP, soft=2 * STEP, damping=b * LENGTH**2, friction=tau_c, length=LENGTH, mass=MASS)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[0] = angle
    moments, found = [], []
    while data.time < times[-1] + STEP:
        moments.append(data.time)
        found.append(data.qpos[0])
        mujoco.mj_step(model, data)
    return np.interp(times, moments, found)


def write(folder: Path, seed: int) -> dict:
    """One experiment, 45 s at 60 frames per second; its answer."""
    rng = np.random.default_rng(seed)
    b, tau_c = float(10 ** rng.uniform(-3.0, -2.3)), float(10 ** rng.uniform(-4.3, -3.3)) if seed % 2 else 0.0
    angle, noise = float(rng.uniform(0.12, 0.3)), float(rng.choice([1e-3, 5e-3]))
    times = np.arange(2701) / 60.0
    readings = swing(b, tau_c, angle, times) + noise * rng.standard_normal(len(times))
    folder.mkdir(parents=True, exist_ok=True)
    rows = "\n".join(f"{t:.12g},{value:.12g}" for t, value in zip(times, readings, strict=True))
    (folder / "run1.csv").write_text(f"t [s],theta_1 [rad]\n{rows}\n", encoding="utf-8")
    lifted = angle + 1e-3 * rng.standard_normal()
    (folder / "experiment.toml").write_text(
        f'format = "cradle-experiment/1"\n[cradle]\nbobs = 1\nlength = {LENGTH}\nmass = {MASS}\n'
        f'b = {b * rng.uniform(0.85, 1.15)}\n[model]\nbase = "pendulum"\n[[run]]\nfile = "run1.csv"\n'
        f"noise = {noise}\nrelease = {{ angles = {{ 1 = {lifted} }}, angle_sd = 1e-3 }}\n",
        encoding="utf-8",
    )
    return {"effects": ["pivot_friction"] if tau_c else [], "truth": {"b": b}, "tau_c": tau_c, "noise": noise}


def main() -> None:
    """Makes and diagnoses what is not yet there."""
    parser = argparse.ArgumentParser(description="Diagnoses of pendulums that MuJoCo swings.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=12)
    chosen = parser.parse_args()
    rows = []
    for seed in range(chosen.cases):
        case = chosen.folder / f"{seed:02d}"
        if not (case / "result.json").is_file():
            answer = write(case, seed)
            row = diagnose_case(case / "experiment.toml", case / "out", answer, 0, None)
            hidden = f"{'friction' if answer['tau_c'] else 'nothing'} {answer['tau_c']:.1e} N m, {answer['noise']} rad"
            write_together(case, {"result.json": json_text({"case": hidden, **row})})
        rows.append(json.loads((case / "result.json").read_text(encoding="utf-8")))
        write_together(chosen.folder, {"study.md": markdown_table(rows)})
        print(rows[-1]["case"], rows[-1]["verdict"], rows[-1]["named"], rows[-1]["errors"], flush=True)


if __name__ == "__main__":
    main()
