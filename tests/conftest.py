"""What several test modules share."""

import pytest

from identification.diagnosis.next_experiment import run_grid


@pytest.fixture
def small_grid(monkeypatch):
    """Few planned runs, for tests in which it does not matter which is best."""
    for name, values in (("_ANGLES", (0.1, 0.2)), ("_DELTAS", (0.0,)), ("_DURATIONS", (8.0, 16.0))):
        monkeypatch.setattr(run_grid, name, values)
