"""What several test modules share."""

import os

import pytest

from identification.diagnosis.next_experiment import run_grid


def pytest_configure():
    """A core of its own for each of several test workers: threads of two on the same cores take a third longer."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    if worker and hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {cores[int(worker.removeprefix("gw")) % len(cores)]})


@pytest.fixture(scope="module")
def small_grid():
    """Few planned runs, from its first use to the end of a module in which it does not matter which is best."""
    with pytest.MonkeyPatch.context() as patch:
        for name, values in (("_ANGLES", (0.1, 0.2)), ("_DELTAS", (0.0,)), ("_DURATIONS", (8.0, 16.0))):
            patch.setattr(run_grid, name, values)
        yield
