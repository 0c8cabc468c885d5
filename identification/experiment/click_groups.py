"""Which impacts are heard as one click: the rule that sound is read by, and by which clicks are predicted."""

from __future__ import annotations

import numpy as np

#: Impacts that follow a click within this time are part of it [s]: their sound and its first echoes overlap.
DEAD_TIME = 0.05
#: Loudness that a room leaves of a click right after it, and the time in which it falls to 1/e [s]: 60 dB in 0.6 s.
ECHO, ECHO_TIME = 0.6, 0.087
#: Loudness over that of the loudest of a group, from which on its first impact is the instant of the click.
FIRST = 0.5


def without_echoes(instants: np.ndarray, loudness: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Which of the sounds (K,), taken in an order, are neither in the dead time of one taken before, nor its echo."""
    kept = np.zeros(len(instants), bool)
    for k in order:
        after = instants[k] - instants[kept]
        echo = loudness[kept] * np.where(after > 0.0, ECHO * np.exp(-np.abs(after) / ECHO_TIME), 0.0)
        kept[k] = not ((np.abs(after) < DEAD_TIME) | (echo > loudness[k])).any()
    return kept


def first_of_group(instants: np.ndarray, loudness: np.ndarray, k: int, able: np.ndarray | None = None) -> int:
    """The sound with which the group of sound k begins, of those that are able (K,)."""
    before = instants[k] - instants
    group = (before >= 0.0) & (before < DEAD_TIME) & (loudness >= FIRST * loudness[k])
    return int(np.flatnonzero(group if able is None else group & able)[0])


def click_impacts(instants: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Indices of the impacts that make clicks, of impacts (K,) at these instants [s], in order, and speeds [m/s].

    >>> click_impacts(np.array([1.0, 1.003, 1.5]), np.array([0.3, 0.3, 0.2]))
    array([0, 2])
    """
    if len(instants) < 2 or np.diff(instants).min() > max(DEAD_TIME, 5.0 * ECHO_TIME):  # two bobs: each is a click
        return np.arange(len(instants))
    kept = np.flatnonzero(without_echoes(instants, speeds, np.argsort(-speeds, kind="stable")))
    return np.unique([first_of_group(instants, speeds, int(k)) for k in kept])
