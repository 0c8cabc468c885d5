"""Run a sweep on threads or any executor, with a bounded number of tasks in flight."""

from __future__ import annotations

import math
import time
from asyncio import CancelledError
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.errors import check_range
from cradle_env.release import Release
from cradle_env.simulation import SimulationError, simulate
from cradle_env.threads import InterruptedRun, Threads
from identification.storage.lock import locks_output
from identification.sweep.grid import Grid, build_run
from identification.sweep.quantities import Quantity, choose_quantities
from identification.sweep.store import DONE, Plan, Store, row_type
from identification.sweep.sweep_result import SweepResult

if TYPE_CHECKING:
    from identification.progress import Progress

#: Runs of one task, and tasks in flight. With these the overhead of a task is small and a large cluster stays busy.
_TASK, _IN_FLIGHT = 8, 256


@locks_output
def sweep(
    grid: Grid,
    quantities: Sequence[str | Quantity] = ("lambda",),
    *,
    duration: float = 60.0,
    sample_rate: float = 240.0,
    times: Sequence[float] | np.ndarray | None = None,
    out: str | Path | None = None,
    workers: int | None = None,
    executor: Any = None,
    progress: Progress | None = None,
) -> SweepResult:
    """Simulate every point of a grid and keep some quantities of each run.

    Each run has the same bits as `simulate` gives. A point that cannot be simulated is nan, and
    `SweepResult.failures` counts it by its reason.

    Parameters
    ----------
    grid : Grid
        Axes, cradle and release.
    quantities : sequence of str or Quantity
        Names in `QUANTITIES`, or quantities of your own.
    duration : float
        Simulated time of each run [s].
    sample_rate : float
        Samples of each run [1/s].
    times : array of shape (T,), optional
        Times at which series such as σ(t) are kept [s]. Default: every second.
    out : path, optional
        Folder for the rows. The same call resumes an interrupted sweep from it. Default: memory only.
    workers : int, optional
        Number of threads. Default: all cores.
    executor : object, optional
        Runs the tasks instead of threads. It has `submit`, whose futures have `result`, `cancel` and
        `add_done_callback`, as in concurrent.futures and `dask.distributed.Client`.
    progress : callable, optional
        Called as progress(stage, fraction, text).

    Returns
    -------
    SweepResult
        The quantities in the shape of the grid.

    Raises
    ------
    ValueError
        If an argument is unusable, or if no point of the grid can be simulated.
    """
    check_range("duration", duration, "s", 0.0, above=True)
    check_range("sample_rate", sample_rate, "1/s", 0.0, above=True)
    if times is None:
        times = np.arange(math.floor(duration) + 1.0)
    times = np.array([check_range("times", t, "s", 0.0, duration) for t in times])
    taken = (*grid.names, *(axis.name for axis in grid.axes))
    plan = Plan(grid, choose_quantities(quantities, taken), times, duration, sample_rate)
    if out is not None:
        return _run_plan(plan, Path(out), workers, executor, progress)
    with TemporaryDirectory() as folder:
        swept = _run_plan(plan, Path(folder), workers, executor, progress)
        return SweepResult(plan, np.array(swept.rows), swept.reasons)


def _run_plan(plan: Plan, folder: Path, workers: int | None, executor: Any, progress: Progress | None) -> SweepResult:
    store = Store(folder, plan)
    begun = store.done() > 0
    if executor is not None:
        _run_tasks(plan, store, executor, progress, lambda: None)
    else:
        with Threads(workers) as threads:
            _run_tasks(plan, store, threads, progress, threads.stop)
    swept = SweepResult(plan, store.open(), store.reasons)
    failures = swept.failures()
    if sum(failures.values()) == len(plan.grid):
        if not begun:  # the folder is free for what is corrected
            store.remove()
        raise ValueError(f"none of the {len(plan.grid)} points can be simulated: {next(iter(failures))}")
    return swept


def _run_tasks(plan: Plan, store: Store, executor: Any, progress: Progress | None, stop: Callable[[], None]) -> None:
    """Keeps a few tasks in flight, and writes down what comes back in whatever order; stop: has runs end early."""
    report = progress or (lambda *_: None)
    grid, finished, waiting = plan.grid, SimpleQueue(), {}
    before = store.done()
    new, began = 0, time.monotonic()

    def collect() -> None:
        nonlocal new
        future = finished.get()
        store.write(waiting[future], *future.result())
        new += len(waiting.pop(future))
        done, rate = before + new, new / (time.monotonic() - began)
        report("sweep", done / store.count, f"{done} of {store.count} runs, {rate:.1f}/s")

    # Few runs are spread too, however many work on them.
    size = min(_TASK, math.ceil(store.count / 64))
    try:
        for indices in store.pending(size):
            if len(waiting) >= _IN_FLIGHT:
                collect()
            future = executor.submit(
                evaluate, grid.cradle, grid.release, grid.names, grid.values(indices), plan.quantities, plan.times,
                plan.duration, plan.sample_rate,
            )  # fmt: skip
            waiting[future] = indices
            future.add_done_callback(finished.put)
        while waiting:
            collect()
    except BaseException:
        stop()
        raise
    finally:
        # Where it is interrupted: what has begun ends in moments, and what it has finished is kept.
        for future in [future for future in waiting if not future.cancel()]:
            with suppress(Exception, CancelledError):
                store.write(waiting[future], *future.result())


def evaluate(
    cradle: Cradle,
    release: Release,
    names: Sequence[str],
    values: np.ndarray,
    quantities: Sequence[Quantity],
    times: np.ndarray,
    duration: float,
    sample_rate: float,
) -> tuple[np.ndarray, Mapping[int, str]]:
    """Rows (n,) of the runs at parameters (n, K), and why some of them, by their number, are impossible.

    Rows that an interruption leaves out stay PENDING.
    """
    rows, problems = np.zeros(len(values), row_type(quantities, times)), {}
    ledger = any(q.ledger for q in quantities)
    for k, point in enumerate(values.tolist()):
        try:
            made = build_run(cradle, release, dict(zip(names, point, strict=True)))
            run = simulate(*made, duration, sample_rate, ledger=ledger)
            for q in quantities:
                found = q.measure(run)
                rows[q.name][k] = np.interp(times, run.t, found) if q.series else found
            rows["status"][k] = DONE
        except (ValueError, SimulationError) as problem:
            problems[k] = str(problem)
            for q in quantities:
                rows[q.name][k] = np.nan
        except InterruptedRun:
            break
    return rows, problems
