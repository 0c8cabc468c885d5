"""The race of engines: `cradle_env` and general ones on one cradle, error against cost.

The cradle is one that all can pose exactly: elastic strings without hysteresis, their pivots in one line, gaps between
the bobs, so that no more than two meet at once. `cradle_env` runs with hysteresis, too.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.plot_style import bob_styles, quiet_grid, styled
from cradle_env.release import Release
from cradle_env.simulation import simulate
from identification.bench import heyoka_peer, mujoco_peer, pymunk_peer, scipy_peer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BOBS = (2, 5)
_ANGLE, _DELTA = 0.228, 0.01
#: Samples per second where a run is sampled.
RATE = 250.0
#: Errors count over so long [s]: thereafter those of five bobs grow from rounding. Engines with fixed steps run no
#: longer.
_COMPARED = 3.0
#: Every engine is timed once in each round, so that all meet the same moods of the machine; the least time counts.
_ROUNDS = 5
#: A run is repeated for so long [s] in a round: short ones come back to warm caches.
_LEAST_TIMED = 0.02
_OURS, _HYSTERETIC = "cradle_env", "cradle_env, hysteretic strings"
#: Name, and the package that it needs beyond those of the project.
_PACKAGES = {"heyoka": "heyoka", "MuJoCo": "mujoco", "pymunk": "pymunk"}

_Run = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Entry:
    """An engine with one setting: `prepare` compiles and returns what maps times (T,) [s] to theta (T, N) [rad]."""

    engine: str
    setting: str
    prepare: Callable[[], _Run]
    fixed_steps: bool = False

    @property
    def hysteretic(self) -> bool:
        """Whether its strings are."""
        return self.engine == _HYSTERETIC


def entries(bobs: int) -> Iterator[Entry]:
    """All that take part, the missing packages left out."""
    elastic, hysteretic = _cradle(bobs, False), _cradle(bobs, True)
    cradle = {"angle": _ANGLE, "delta": _DELTA, "kappa": elastic.kappa}
    for tolerance in (1e-14, 1e-10, 1e-8, 1e-6):
        yield Entry(_OURS, f"tolerance {tolerance:g}", lambda t=tolerance: _ours(elastic, t))
        yield Entry(_HYSTERETIC, f"tolerance {tolerance:g}", lambda t=tolerance: _ours(hysteretic, t))
    for tol in (0.0, 1e-12, 1e-8):
        name = f"tol {tol:g}" if tol else "machine precision"
        yield Entry("heyoka", name, lambda t=tol: heyoka_peer.integrator(bobs, tol=t, pivot_half_spacing=0.0, **cradle))
    for rtol in (1e-8, 1e-11):
        yield Entry("SciPy DOP853", f"rtol {rtol:g}", lambda r=rtol: _scipy(bobs, rtol=r, strings="elastic"))
    for engine, peer in (("MuJoCo", mujoco_peer), ("pymunk", pymunk_peer)):
        for step in (1e-4, 1e-5):
            prepare = lambda peer=peer, h=step: peer.integrator(bobs, step=h, **cradle)  # noqa: E731
            yield Entry(engine, f"step {step:g} s", prepare, fixed_steps=True)


def missing() -> list[str]:
    """The engines that are not installed."""
    return [name for name, package in _PACKAGES.items() if importlib.util.find_spec(package) is None]


def versions() -> dict[str, str]:
    """Of the engines that are installed."""
    absent = missing()
    return {package: metadata.version(package) for name, package in _PACKAGES.items() if name not in absent}


def race(bobs: int, duration: float, progress: Callable[[float], None] = lambda _: None) -> list[dict[str, Any]]:
    """Simulated seconds per processor second, over `duration` [s], and the largest error of theta [rad] of each entry.

    `speed` is that of a run without samples between its ends, `speed_sampled` that with RATE samples a second.
    """
    absent = missing()
    taking_part = [entry for entry in entries(bobs) if entry.engine not in absent]
    compared = np.arange(round(min(duration, _COMPARED) * RATE) + 1) / RATE
    references = {
        hysteretic: _scipy(bobs, rtol=1e-13, atol=1e-15, strings="hysteretic" if hysteretic else "elastic")(compared)
        for hysteretic in (False, True)
    }
    runs = [entry.prepare() for entry in taking_part]
    errors = [
        float(np.abs(run(compared) - references[entry.hysteretic]).max())
        for entry, run in zip(taking_part, runs, strict=True)
    ]
    ends = [float(compared[-1]) if entry.fixed_steps else duration for entry in taking_part]
    times = np.full((len(runs), 2), np.inf)
    for round_ in range(_ROUNDS):
        for k, (run, end) in enumerate(zip(runs, ends, strict=True)):
            progress((round_ + k / len(runs)) / _ROUNDS)
            sampled = np.arange(round(end * RATE) + 1) / RATE
            times[k, 1] = min(times[k, 1], _least_time(run, sampled))
            # Engines with fixed steps pass the samples anyway.
            bare = times[k, 1] if taking_part[k].fixed_steps else _least_time(run, np.array([0.0, end]))
            times[k, 0] = min(times[k, 0], bare)
    return [
        {
            "bobs": bobs,
            "engine": entry.engine,
            "setting": entry.setting,
            "error": error,
            "speed": end / float(bare),
            "speed_sampled": end / float(sampled),
        }
        for entry, error, end, (bare, sampled) in zip(taking_part, errors, ends, times, strict=True)
    ]


def _cradle(bobs: int, hysteretic: bool) -> Cradle:
    effects = {} if hysteretic else {"-string_hysteresis": {}}
    return Cradle(bobs=bobs, delta=_DELTA, pivot_half_spacing=0.0, effects=effects)


def _ours(cradle: Cradle, tolerance: float) -> _Run:
    release = Release(angle=_ANGLE, start="hanging")
    return lambda times: simulate(cradle, release, times=times, ledger=False, tolerance=tolerance).theta


def _scipy(bobs: int, **options: Any) -> _Run:
    kappa = _cradle(bobs, False).kappa
    options |= {"angle": _ANGLE, "start": "hanging", "delta": _DELTA, "pivot_half_spacing": 0.0, "kappa": kappa}
    return lambda times: scipy_peer.simulate(bobs, times=times, **options)[0]


def _least_time(run: _Run, times: np.ndarray) -> float:
    """Processor time [s] of a run, the least of those that fit into _LEAST_TIMED, of one at least."""
    best, spent = np.inf, 0.0
    while spent < _LEAST_TIMED:
        start = time.process_time()
        run(times)
        taken = time.process_time() - start
        best, spent = min(best, taken), spent + taken
    return best


@styled
def figure(rows: list[dict[str, Any]]) -> Figure:
    """Simulated time per processor time against the error of theta: a curve for each engine, a panel for each N."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(9.0, 4.2), layout="constrained")
    panels: Any = drawn.subplots(1, len(BOBS), sharey=True)
    engines = list(dict.fromkeys(row["engine"] for row in rows))
    for panel, bobs in zip(panels, BOBS, strict=True):
        for engine, style in zip(engines, bob_styles(len(engines)), strict=True):
            own = sorted(
                (row for row in rows if (row["bobs"], row["engine"]) == (bobs, engine)), key=lambda row: row["error"]
            )
            panel.plot([r["error"] for r in own], [r["speed"] for r in own], marker="o", label=engine, **style)
        panel.set(
            xscale="log", yscale="log", title=f"N = {bobs}", xlabel=f"largest error of θ in {_COMPARED:g} s (rad)"
        )
        quiet_grid(panel)
    panels[0].set_ylabel("simulated time per processor time")
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return drawn
