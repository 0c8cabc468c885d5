"""A smoke test of the installed package: an environment, a calibration, a diagnosis, each as short as it can be."""

import json
import subprocess
import sys
import tempfile
import time
from importlib import metadata
from pathlib import Path

import gymnasium as gym

import cradle_env


def cradle(*arguments: object, status: int = 0) -> None:
    """Runs one command as a user does, and ends where its status is another than expected."""
    began = time.monotonic()
    command = [str(Path(sys.executable).with_name("cradle")), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    print(f"{time.monotonic() - began:5.1f} s  cradle {' '.join(command[1:])}", flush=True)
    if done.returncode != status:
        sys.exit(f"status {done.returncode}, expected {status}\n{done.stdout}{done.stderr}")


def main() -> None:
    """All steps; exit status 1 where one fails."""
    assert Path(cradle_env.__file__).is_relative_to(sys.prefix), f"{cradle_env.__file__} is not the installed package"
    assert cradle_env.__version__ == metadata.version("newtons-cradle")
    env = gym.make("NewtonCradle-v0")
    env.reset(seed=0)
    observation, *_ = env.step(env.action_space.sample())
    assert observation in env.observation_space
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch)
        tiny = ("--bobs", 1, "--model", "ho", "--duration", 6, "--sample-rate", 20, "--experiment")
        cradle("simulate", *tiny, "--out", out / "tiny")
        short = ("--steps", 50, "--out", out / "calibrated")  # so few steps do not converge: status 1
        cradle("calibrate", out / "tiny" / "experiment.toml", *short, status=1)
        summary = json.loads((out / "calibrated" / "summary.json").read_text(encoding="utf-8"))
        assert 0.0 < summary["parameters"]["b"]["median"] < 1.0
        cradle("diagnose", out / "tiny" / "experiment.toml", "--out", out / "diagnosed")
        diagnosis = json.loads((out / "diagnosed" / "diagnosis.json").read_text(encoding="utf-8"))
        assert diagnosis["verdict"] == "nothing_missing", diagnosis["verdict"]


if __name__ == "__main__":
    main()
