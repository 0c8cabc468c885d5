"""What the package promises to whoever installs or imports it."""

import ast
import json
import re
import subprocess
import sys
import tomllib
from importlib import metadata

import pytest

from tests.paths import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def python(code: str, timeout: float = 60.0):
    """What `code` prints as JSON in a fresh interpreter."""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=timeout)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def cpu_seconds(module: str) -> float:
    """Processor time of one import: unlike the clock on the wall, it ignores what else the machine does."""
    return python(f"import time; t = time.process_time(); import {module}; print(time.process_time() - t)")


def test_version_is_the_declared_one():
    import cradle_env

    assert cradle_env.__version__ == metadata.version("newtons-cradle") == PROJECT["version"]


def test_the_citation_is_of_this_version():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.+)$", text, re.MULTILINE).group(1) == PROJECT["version"]


def test_both_packages_say_that_they_are_typed():
    assert all((ROOT / package / "py.typed").is_file() for package in ("cradle_env", "identification"))


def test_command_is_installed():
    (command,) = metadata.entry_points(group="console_scripts", name="cradle")
    assert callable(command.load())


def test_importing_the_environment_leaves_the_experimenter_out():
    loaded = python("import json, sys, cradle_env; print(json.dumps(list(sys.modules)))")
    heavy = {"arviz", "corner", "emcee", "h5py", "identification", "matplotlib", "pygame", "typer", "xarray"}
    assert "gymnasium" in loaded
    assert heavy.isdisjoint(loaded)


def test_importing_the_environment_takes_little_longer_than_gymnasium():
    times = [(cpu_seconds("cradle_env"), cpu_seconds("gymnasium")) for _ in range(3)]
    ours, theirs = (min(column) for column in zip(*times, strict=True))
    assert ours <= 1.5 * theirs, f"{ours:.3f} s against {theirs:.3f} s"


@pytest.mark.parametrize("package", ["cradle_env", "identification"])
def test_every_imported_package_is_declared(package):
    """A library that only another one brings along may be gone with its next release."""
    extras = PROJECT["optional-dependencies"]
    optional = ("render", "video", "cluster", "parquet", "examples", "audio", "jax")
    shipped = PROJECT["dependencies"] + [requirement for name in optional for requirement in extras[name]]
    declared = {re.match(r"[\w-]+", requirement).group() for requirement in shipped}
    home = {
        "llvmlite": "numba",
        "PIL": "pillow",
        "pygame": "pygame-ce",
        "stable_baselines3": "stable-baselines3",
    }
    imported = set()
    for file in (ROOT / package).rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add(node.module.split(".")[0])
    others = imported - sys.stdlib_module_names - {"cradle_env", "identification"}
    assert {home.get(name, name) for name in others} <= declared


def test_after_a_warm_up_nothing_is_left_to_compile():
    """Whatever is simulated or stepped then has its kernels, of the types it calls them with."""
    compiled, more = python(
        """
import json, gymnasium as gym, numpy as np
from cradle_env import Cradle, Release, simulate_batch, warmup
from cradle_env.mechanics import control_interval, event_loop, restitution, initial_state, strings

modules = (control_interval, event_loop, restitution, initial_state, strings)
kernels = [kernel for module in modules for kernel in vars(module).values()
           if getattr(kernel, "_can_compile", False) and kernel.targetoptions.get("no_cpython_wrapper") is None]
warmup.simulations(), warmup.environments()
known = {str(kernel): list(kernel.signatures) for kernel in kernels}
effects = {"quadratic_drag": {"c2": 1e-3}, "contact_duration": {"scale": 1.0}, "pivot_friction": {"tau_c": 1e-5}}
several = [Cradle(bobs=1), Cradle(bobs=3, model="ho", delta=(0.0, 0.01)), Cradle(bobs=2, effects=effects)]
simulate_batch(several, Release(angle=0.1), duration=0.2, ledger=True)
for name, some in (("NewtonCradle-v0", {"bobs": 2, "effects": effects}), ("NewtonCradleRelease-v0", {})):
    env = gym.make(name, **some)
    env.reset(seed=1), env.step(env.action_space.sample())
print(json.dumps([known, {str(kernel): list(kernel.signatures) for kernel in kernels}], default=str))
""",
        timeout=300.0,
    )  # of which it takes most where nothing is compiled yet
    assert len(compiled) == 10 and all(compiled.values())
    assert more == compiled
