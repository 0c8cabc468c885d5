"""Makes the example experiment, examples/ring-2, with the independent integrator of the tests.

    python examples/make_example.py [DIR]

Two bobs for 45 s at 60 readings a second with 1 mrad of noise. The integrator shares no code with the project and
follows every contact in time; with contacts this stiff (the same restitution, 250 times shorter) its impacts are
instantaneous. The experiment states k_f, κ and b several percent off: calibration must find the true ones, below.
"""

import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]

#: What is hidden in the data.
TRUE = {"k_f": 17350.0, "kappa": 203.4, "b": 0.00216}
ANGLE, ANGLE_ERROR, NOISE, SEED = 0.228, 0.0006, 0.001, 20240116
#: Shares of the true values by which the stated ones are off.
OFF = {"k_f": 0.07, "kappa": -0.05, "b": -0.12}

EXPERIMENT = """\
# Two bobs on strings, one released at 0.228 rad: made by examples/make_example.py, which knows the true values.
format = "cradle-experiment/1"

[cradle]
bobs = 2
length = 0.30
pivot_half_spacing = 0.10
mass = 0.2813
radius = 0.020
k_f = {k_f:.0f}     # a guess to start from, as are kappa and b
kappa = {kappa:.1f}
b = {b:.5f}

[model]
base = "nsp"

[[run]]
file = "run1.csv"
release = {{ bobs = 1, angle = {angle}, angle_sd = 0.001, start = "unstretched" }}
delta = 0.0
noise = {noise}
"""


def make(folder: Path, duration: float = 45.0) -> None:
    """Writes experiment.toml and run1.csv, of `duration` seconds."""
    sys.path.insert(0, str(ROOT))
    from tests.reference.soft_contact import SoftCradle, simulate_soft

    times = np.arange(round(60 * duration) + 1) / 60.0
    cradle = SoftCradle(2, **TRUE, stiffness_factor=1e6)
    theta = simulate_soft(cradle, {2: ANGLE + ANGLE_ERROR}, times=times).theta
    theta = theta + NOISE * np.random.default_rng(SEED).standard_normal(theta.shape)
    stated = {name: value * (1.0 + OFF[name]) for name, value in TRUE.items()}
    folder.mkdir(parents=True, exist_ok=True)
    rows = [f"{t:.6f},{a:.6f},{b:.6f}" for t, (a, b) in zip(times, theta, strict=True)]
    (folder / "run1.csv").write_text("\n".join(["t [s],theta_1 [rad],theta_2 [rad]", *rows, ""]), encoding="utf-8")
    text = EXPERIMENT.format(**stated, angle=ANGLE, noise=NOISE)
    (folder / "experiment.toml").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "examples" / "ring-2")
