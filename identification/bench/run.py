"""Speed and accuracy beside other engines, measured in one run on one core: `cradle bench`.

General engines run on a cradle that all of them can simulate (`engines`). On the paper's own cradle, NSP with
hysteretic strings, ours runs beside SciPy's DOP853 with events (`scipy_peer`) at rtol 1e-8. The reference for both
errors is the SciPy integrator at rtol 1e-13. For N >= 3 the comparison covers the first seconds only, because rounding
errors grow.
"""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from cradle_env import __version__
from cradle_env.cradle import Cradle
from cradle_env.errors import check_range
from cradle_env.kernel_records import TOLERANCE
from cradle_env.plot_style import png
from cradle_env.release import Release
from cradle_env.simulation import simulate
from identification.bench import engines, environment, scipy_peer
from identification.reporting.terminal import TerminalProgress, print_table
from identification.storage.files import json_text, write_together
from identification.storage.stamps import check_replaceable

_FILE, _PICTURE, _FORMAT = "bench.json", "bench.png", "cradle-bench/1"
_ANGLE, _RATE = 0.228, 60.0
#: Number of bobs, and the time over which accuracy is compared [s]: the whole run, or until rounding errors grow.
_RACES = {2: np.inf, 5: 3.0}
#: Our default tolerance, and a smaller one.
_TOLERANCES = (TOLERANCE, 1e-15)
_REPEATS = 5
_FIRST_CALL = "import time; t = time.process_time(); import cradle_env as c; c.simulate(c.Cradle(), c.Release(angle=0.228)); print(time.process_time() - t)"  # noqa: E501
_IMPORT = "import time; t = time.process_time(); import {}; print(time.process_time() - t)"


def race(bobs: int, duration: float, compared: float) -> list[dict[str, Any]]:
    """Measure time [s] and largest error of θ [rad] of our integrator and of SciPy's over the same run."""
    cradle, release = Cradle(bobs=bobs), Release(angle=_ANGLE)
    times = np.arange(int(duration * _RATE) + 1) / _RATE
    early = times <= compared

    def peer(rows: np.ndarray, **tolerances: Any) -> np.ndarray:
        return scipy_peer.simulate(bobs, angle=_ANGLE, times=times[rows], kappa=cradle.kappa, **tolerances)[0]

    reference = peer(early, rtol=1e-13, atol=1e-15, max_step=0.005)
    whole = np.ones_like(early)
    seconds, theta = _time_best(lambda: peer(whole, rtol=1e-8))
    rows = [{"integrator": "SciPy DOP853, rtol 1e-8", "seconds": seconds, "error": _error(theta, reference, early)}]
    for tolerance in _TOLERANCES:
        ours = lambda tolerance=tolerance: simulate(cradle, release, times=times, tolerance=tolerance).theta  # noqa: E731
        found, theta = _time_best(ours)
        name = "cradle_env" if tolerance == TOLERANCE else f"cradle_env, tolerance {tolerance:g}"
        rows.append({"integrator": name, "seconds": found, "error": _error(theta, reference, early)})
    return [{"bobs": bobs, "simulated": duration, **row, "ratio": seconds / row["seconds"]} for row in rows]


def _time_best(function: Callable[[], np.ndarray]) -> tuple[float, np.ndarray]:
    """Return the least of _REPEATS times [s] and the result. An earlier call, not timed, compiles and fills caches."""
    result, best = function(), np.inf
    for _ in range(_REPEATS):
        start = time.perf_counter()
        result = function()
        best = min(best, time.perf_counter() - start)
    return best, result


def _error(theta: np.ndarray, reference: np.ndarray, early: np.ndarray) -> float:
    return float(np.abs(theta[early] - reference).max())


def first_calls() -> dict[str, float]:
    """Measure the processor time of import and first simulation in a fresh process [s], without and with kernels."""
    spec = importlib.util.find_spec("cradle_env")
    assert spec is not None and spec.origin is not None
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(
            Path(spec.origin).parent, Path(folder) / "cradle_env", ignore=shutil.ignore_patterns("__pycache__")
        )
        cold, cached = (_run_python(_FIRST_CALL, folder) for _ in range(2))
    return {"first call": cold, "first call, cached": cached}


def import_times() -> dict[str, float]:
    """Measure the processor time of each import in a fresh process [s], the least of five."""
    return {
        f"import {name}": min(_run_python(_IMPORT.format(name)) for _ in range(5))
        for name in ("cradle_env", "gymnasium")
    }


def _run_python(code: str, folder: str | None = None) -> float:
    """Run `code` in a fresh interpreter with `folder` first on its path; return the number that it prints."""
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True, env=_environment(folder)
    )
    return float(found.stdout)


def _environment(folder: str | None) -> dict[str, str]:
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    return environment if folder is None else environment | {"PYTHONPATH": folder}


def main(duration: float, out: Path | None) -> None:
    """Run all benchmarks, print tables, and write bench.json and bench.png if a folder is given."""
    check_range("duration", duration, "s", 1.0)
    if out is not None:
        check_replaceable(out, (_FILE, _PICTURE), _FILE, _FORMAT)
    with TerminalProgress() as progress:
        races = []
        for i, (bobs, compared) in enumerate(_RACES.items()):
            progress("race", i / len(_RACES), f"{bobs} bobs over {duration:g} s")
            races += race(bobs, duration, min(compared, duration))
        raced = []
        for bobs in engines.BOBS:
            told = lambda share, bobs=bobs: progress("engines", share, f"{bobs} bobs")  # noqa: E731
            raced += engines.race(bobs, duration, told)
        progress("environments", None, "steps per second beside Gymnasium's own")
        rates = environment.single_environments() | environment.vector_environments()
        progress("start", None, "fresh processes, without and with compiled kernels")
        starts = first_calls() | import_times()
    columns = ("bobs", "integrator", "time [s]", "SciPy's time over it", "largest error of θ [rad]")
    numbers = [(f"{row['seconds']:.3g}", f"{row['ratio']:.0f}", f"{row['error']:.1e}") for row in races]
    print_table(columns, [(str(row["bobs"]), row["integrator"], *n) for row, n in zip(races, numbers, strict=True)])
    print_table(
        (
            "bobs",
            "engine",
            "setting",
            "simulated time per processor time",
            f"sampled {engines.RATE:g}/s",
            "largest error of θ [rad]",
        ),
        [
            (
                *(str(row[name]) for name in ("bobs", "engine", "setting")),
                f"{row['speed']:,.0f}",
                f"{row['speed_sampled']:,.0f}",
                f"{row['error']:.1e}",
            )
            for row in raced
        ],
    )
    if absent := engines.missing():
        print(f"not installed, hence left out: {', '.join(absent)} (pip install 'newtons-cradle[bench]')")
    print_table(("in a fresh process", "time [s]"), [(name, f"{seconds:.2f}") for name, seconds in starts.items()])
    others = ("Pendulum-v1", "Acrobot-v1")
    rows = [(name, f"{rate:,.0f}", *(f"{rate / rates[other]:.2f}" for other in others)) for name, rate in rates.items()]
    print_table(("environment, random actions", "steps/s", *(f"over {other}" for other in others)), rows)
    relative = starts["import cradle_env"] / starts["import gymnasium"]
    print(f"import cradle_env takes {relative:.2f} times as long as import gymnasium")
    if out is not None:
        versions = {name: metadata.version(name) for name in ("numpy", "scipy", "numba", "gymnasium")}
        versions |= engines.versions()
        content = {
            "format": _FORMAT,
            "version": __version__,
            "python": platform.python_version(),
            "machine": platform.machine(),
            "versions": versions,
            "races": races,
            "engines": raced,
            "seconds": starts,
            "steps_per_second": rates,
            "import_ratio": relative,
        }
        write_together(out, {_FILE: json_text(content), _PICTURE: png(engines.figure(raced))})
        print(f"figures: {out / _FILE} and {out / _PICTURE}")
