"""Run Gymnasium's own tests of environments, vectors and wrappers on the cradles.

    git clone --depth 1 --branch v1.4.0 https://github.com/Farama-Foundation/Gymnasium FOLDER
    python -m studies.gymnasium_conformance FOLDER

FOLDER is a checkout of Gymnasium's repository (its package holds no tests), of the version installed. All registered
environments of this project stand where the tests look for Gymnasium's. NewtonCradle-v0 also stands in for CartPole-v1,
Pendulum-v1 and MountainCarContinuous-v0, which tests of vectors and wrappers make by name.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import gymnasium

from cradle_env import __version__
from studies.gymnasium_conformance.assumptions import ASSUMED
from studies.gymnasium_conformance.plugin import OUTCOMES, STAND_INS

#: What of Gymnasium's tests is run, by kind.
KINDS = {
    "environments": ("tests/envs/test_envs.py", "tests/envs/test_rendering.py", "tests/envs/test_action_dim_check.py"),
    "vectors": ("tests/vector",),
    "wrappers": ("tests/wrappers",),
}
# Errors of tests that need a package which is not installed.
_MISSING = ("gymnasium.error.DependencyNotInstalled", "ModuleNotFoundError")
_ROOT = Path(__file__).resolve().parents[2]
_RESULTS = Path(__file__).with_name("results.md")


def main() -> int:
    """Run them, write the page; 1 if a cradle failed a test that assumes nothing of another environment."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.gymnasium_conformance",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=Path, help="a checkout of Gymnasium's repository")
    parser.add_argument("--out", type=Path, default=_RESULTS, help="the page to write")
    asked = parser.parse_args()
    if not (asked.folder / "tests" / "testing_env.py").is_file():
        parser.error(f"{asked.folder} holds no tests/testing_env.py; give a checkout of Gymnasium's repository")
    rows = outcomes(asked.folder)
    asked.out.write_text(page(rows), encoding="utf-8")
    print(asked.out.read_text(encoding="utf-8"))
    return 1 if unexplained(rows) else 0


def outcomes(folder: Path) -> list[dict[str, Any]]:
    """Run the tests of a checkout: for each its name, outcome, whether a cradle took part, and why it failed."""
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        shutil.copytree(folder / "tests", scratch / "tests")
        (scratch / "pytest.ini").write_text("[pytest]\n", encoding="utf-8")
        file = scratch / "outcomes.jsonl"
        environment = {
            **os.environ, OUTCOMES: str(file), "PYTHONPATH": str(_ROOT), "SDL_VIDEODRIVER": "dummy",
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        }  # fmt: skip
        command = [sys.executable, "-m", "pytest", "-q", "--continue-on-collection-errors", "--tb=no"]
        command += ["-p", "studies.gymnasium_conformance.plugin", *(path for paths in KINDS.values() for path in paths)]
        subprocess.run(command, cwd=scratch, env=environment, check=False)
        return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


def outcome(row: dict[str, Any]) -> str:
    """How a test ended: passed; skipped, also where a package is missing; assuming; or failed."""
    if row["outcome"] != "failed":
        return row["outcome"]
    if row["why"].startswith(_MISSING):
        return "skipped"
    return "assuming" if assumption(row["test"]) else "failed"


def assumption(test: str) -> str:
    """What a test assumes that no cradle has; empty where it assumes nothing."""
    return next((reason for pattern, reason in ASSUMED.items() if test.startswith(pattern)), "")


def unexplained(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The failures of cradles in tests that assume nothing of another environment."""
    return [row for row in rows if row["cradle"] and outcome(row) == "failed"]


def page(rows: list[dict[str, Any]]) -> str:
    """The results as Markdown."""
    text = [
        "# Gymnasium's own tests, run on the cradles",
        "",
        f"Made by `python -m studies.gymnasium_conformance FOLDER`: newtons-cradle {__version__}, Gymnasium "
        f"{gymnasium.__version__}, Python {platform.python_version()}.",
        "",
        "Counted are the tests in which a cradle is made or played; the others concern Gymnasium alone. "
        f"NewtonCradle-v0 stands in for {', '.join(STAND_INS[:-1])} and {STAND_INS[-1]}. "
        "Tests that need a package which is not installed count as skipped.",
        "",
        "| tests of | passed | skipped | failed, assuming another environment | failed |",
        "|---|---|---|---|---|",
    ]
    for kind, paths in KINDS.items():
        mine = [row for row in rows if row["cradle"] and row["test"].startswith(paths)]
        count = Counter(map(outcome, mine))
        text.append(f"| {kind} | {count['passed']} | {count['skipped']} | {count['assuming']} | {count['failed']} |")
    assuming = [row for row in rows if row["cradle"] and outcome(row) == "assuming"]
    if assuming:
        text += ["", "These tests state what holds of the environment that a cradle replaces:", ""]
        reasons = Counter((row["test"].split("[")[0], assumption(row["test"])) for row in assuming)
        text += [f"- `{test}` ({count}): {reason}" for (test, reason), count in sorted(reasons.items())]
    failures = unexplained(rows)
    if failures:
        text += ["", "Failures of the cradles:", ""]
        text += [f"- `{row['test']}`: {row['why']}" for row in failures]
    return "\n".join(text) + "\n"


if __name__ == "__main__":
    sys.exit(main())
