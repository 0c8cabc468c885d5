"""Which readings a model is fitted to, and which are held out to test it."""

from __future__ import annotations

import numpy as np

from identification.experiment.experiment import Experiment
from identification.experiment.run import Run


def training_rows(experiment: Experiment) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """(rows to train on, rows held out), one (T,) of bool per run each.

    Held out is what lies beyond fit_to; where no run states it, the last of several runs if nothing of it is unknown
    but its noise and how exactly it was released, else the last third in time of each.
    """
    runs = experiment.runs
    if any(run.held_out.any() for run in runs):
        return [run.fitted for run in runs], [run.held_out for run in runs]
    if len(runs) > 1 and runs[-1].state == "release" and runs[-1].rest == "known":
        train = [run.fitted for run in runs[:-1]] + [np.zeros_like(runs[-1].fitted)]
        return train, [np.zeros_like(run.fitted) for run in runs[:-1]] + [runs[-1].fitted]
    ends = [_end_of_training(run) for run in runs]
    return (
        [run.fitted & (run.times <= end) for run, end in zip(runs, ends, strict=True)],
        [run.fitted & (run.times > end) for run, end in zip(runs, ends, strict=True)],
    )


def _end_of_training(run: Run) -> float:
    """The time [s] at which two thirds of what may be fitted of a run are over."""
    seen = run.times[run.fitted]
    return float(seen[0] + 2.0 / 3.0 * (seen[-1] - seen[0]))
