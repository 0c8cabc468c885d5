"""What the package promises to whoever installs or imports it."""

import ast
import json
import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def python(code: str):
    """What `code` prints as JSON in a fresh interpreter."""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def cpu_seconds(module: str) -> float:
    """Processor time of one import: unlike the clock on the wall, it ignores what else the machine does."""
    return python(f"import time; t = time.process_time(); import {module}; print(time.process_time() - t)")


def test_version_is_the_declared_one():
    import cradle_env

    assert cradle_env.__version__ == metadata.version("newtons-cradle") == PROJECT["version"]


def test_command_is_installed():
    (command,) = metadata.entry_points(group="console_scripts", name="cradle")
    assert callable(command.load())


def test_importing_the_environment_leaves_the_experimenter_out():
    loaded = python("import json, sys, cradle_env; print(json.dumps(list(sys.modules)))")
    heavy = {"arviz", "corner", "emcee", "h5py", "identification", "matplotlib", "pygame", "typer", "xarray"}
    assert "gymnasium" in loaded
    assert heavy.isdisjoint(loaded)


def test_importing_the_environment_takes_little_longer_than_gymnasium():
    times = [(cpu_seconds("cradle_env"), cpu_seconds("gymnasium")) for _ in range(5)]
    ours, theirs = (min(column) for column in zip(*times, strict=True))
    assert ours <= 1.5 * theirs, f"{ours:.3f} s against {theirs:.3f} s"


@pytest.mark.parametrize("package", ["cradle_env", "identification"])
def test_every_imported_package_is_declared(package):
    """A library that only another one brings along may be gone with its next release."""
    extras = PROJECT["optional-dependencies"]
    shipped = PROJECT["dependencies"] + extras["render"] + extras["video"] + extras["cluster"] + extras["parquet"]
    declared = {re.match(r"[\w-]+", requirement).group() for requirement in shipped}
    home = {"cv2": "opencv-python-headless", "llvmlite": "numba", "PIL": "pillow", "pygame": "pygame-ce"}
    imported = set()
    for file in (ROOT / package).rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add(node.module.split(".")[0])
    others = imported - sys.stdlib_module_names - {"cradle_env", "identification"}
    assert {home.get(name, name) for name in others} <= declared
