"""How far the clicks that were found are from the impacts that there were."""

from __future__ import annotations

from typing import Any

import numpy as np

from identification.apparatus.sound.measure import SoundMeasurement
from studies.sound.made import Case

#: A click this near to an impact is of it [s].
_NEAR = 2e-3
#: Speeds [m/s] that part loud, middling and soft impacts.
CLASSES = (0.1, 0.03)


def groups(instants: np.ndarray, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(instants, loudest speed) of the clicks that impacts should make: the loudest first, with all that follow within
    50 ms or are softer than the echo of one, 60 % falling by 60 dB in 0.6 s; a group begins with its first impact of
    half the loudest speed."""
    heads: list[int] = []
    for k in np.argsort(-speeds, kind="stable"):
        apart = instants[k] - instants[heads]
        echo = np.where(apart > 0.0, 0.6 * 10.0 ** (-3.0 * np.abs(apart) / 0.6), 0.0) * speeds[heads]
        if not ((np.abs(apart) < 0.05) | (echo > speeds[k])).any():
            heads.append(int(k))
    heads.sort()
    first = [
        instants[(instants > instants[k] - 0.05) & (instants <= instants[k]) & (speeds >= 0.5 * speeds[k])][0]
        for k in heads
    ]
    return np.array(first), speeds[heads]


def judge(case: Case, measured: SoundMeasurement) -> dict[str, Any]:
    """Counts of impacts and of those found by class of speed, false clicks, and errors of instants [s].

    Errors are less their median: all clicks of a recording are late by the same, which no interval knows.
    """
    true, speeds = groups(case.instants, case.speeds)
    clicks = measured.clicks
    apart = clicks.instants[:, None] - true
    nearest = np.abs(apart).argmin(axis=0)
    errors = apart[nearest, np.arange(len(true))]
    late = float(np.median(errors[np.abs(errors) < 2.0 * _NEAR])) if (np.abs(errors) < 2.0 * _NEAR).any() else 0.0
    errors -= late
    found = np.abs(errors) < _NEAR
    false = np.ones(len(clicks.instants), bool)
    false[nearest[found]] = False
    parts = np.searchsorted(-np.array(CLASSES), -speeds)
    sds = clicks.instants_sd[nearest[found]]
    return {
        "impacts": [int((parts == k).sum()) for k in range(len(CLASSES) + 1)],
        "found": [int((found & (parts == k)).sum()) for k in range(len(CLASSES) + 1)],
        "false": int(false.sum()),
        "false_not_doubtful": int((false & ~clicks.doubtful).sum()),
        "late": late,
        "rms": float(np.sqrt(np.mean(errors[found] ** 2))) if found.any() else None,
        "median": float(np.median(np.abs(errors[found]))) if found.any() else None,
        "pull": float(np.sqrt(np.mean((errors[found] / sds) ** 2))) if found.any() else None,
    }
