"""The demo: simulates a five-ball cradle, calibrates the example experiment, and predicts another cradle from it.

    python examples/demo.py [--out DIR] [--steps N]

The example's data come from an independent integrator (examples/make_example.py), which knows the true values.
"""

import argparse
import sys
import time
from pathlib import Path

from identification.cli.app import main as cradle

ROOT = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT))

from make_example import TRUE  # noqa: E402


def step(title: str, *arguments: str, may_end: tuple[int, ...] = (0,)) -> None:
    """Runs one command of `cradle`, and says which; ends with it where it ends in another way than it may."""
    print(f"\n{title}\n$ cradle {' '.join(arguments)}", flush=True)
    status = cradle(arguments)
    if status not in may_end:
        sys.exit(status)


def main() -> None:
    """All three steps, and where everything is."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for the results")
    parser.add_argument("--steps", help="so many steps of the calibration, instead of until converged")
    options = parser.parse_args()
    began = time.monotonic()
    simulated, calibrated, predicted = (str(options.out / name) for name in ("five-balls", "ring-2", "prediction"))
    step("1. Five balls, one released", "simulate", "--bobs", "5", "--out", simulated)
    limit = ("--steps", options.steps) if options.steps else ()
    example = str(ROOT / "ring-2" / "experiment.toml")
    asked, may_end = "2. What do the example's data say of its cradle?", (0, 1) if limit else (0,)  # 1: not converged
    step(asked, "calibrate", example, "--out", calibrated, *limit, may_end=may_end)
    print("true values:", ", ".join(f"{name} = {value:g}" for name, value in TRUE.items()))
    step("3. How fast would three such balls synchronize?", "predict", calibrated, "--bobs", "3", "--out", predicted)
    print(f"\nDone in {time.monotonic() - began:.0f} s. Look at")
    for path in (f"{simulated}/run.png", f"{calibrated}/report.html", f"{predicted}/prediction.png"):
        print(f"  {path}")


if __name__ == "__main__":
    main()
