"""Split readings into those that a model is fitted to and those that are held out to test it."""

from __future__ import annotations

import numpy as np

from identification.experiment.experiment import Experiment
from identification.experiment.run import Run


def training_rows(experiment: Experiment) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Split the rows of each run into training and held-out rows.

    If a run states `fit_to`, later rows are held out. Otherwise the last of several runs is held out, if it starts
    from a stated release and its rest positions are known. Otherwise the last third in time of each run is held out.

    Parameters
    ----------
    experiment : Experiment
        The runs.

    Returns
    -------
    training, held_out : list of ndarray of bool
        For each run, one array of shape (T,).
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
    """Time [s] at which two thirds of the fitted part of a run have passed."""
    seen = run.times[run.fitted]
    return float(seen[0] + 2.0 / 3.0 * (seen[-1] - seen[0]))
