"""Contacts and strings by themselves: e(v) and contact times of eq. 1, the force-displacement curve of eq. 4."""

from __future__ import annotations

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.impact_law import pair_impacts
from cradle_env.kernel_records import records


def restitution_curve(cradle: Cradle, speeds: np.ndarray) -> np.ndarray:
    """e of two bobs that meet at normal speeds v > 0 [m/s]; the shape of `speeds` (eq. 1, or the cradle's law)."""
    return pair_impacts(*cradle.contact_records(), np.ravel(speeds))[:, 0].reshape(np.shape(speeds))


def contact_times(cradle: Cradle, speeds: np.ndarray) -> np.ndarray:
    """How long [s] two bobs touch that meet at normal speeds v > 0 [m/s]; the shape of `speeds` (eq. 1)."""
    return pair_impacts(*cradle.contact_records(), np.ravel(speeds))[:, 1].reshape(np.shape(speeds))


def string_tension(cradle: Cradle, stretches: np.ndarray) -> np.ndarray:
    """Tension [N] of one new string of the cradle along a path of stretches s [m], both (K,) (eq. 4).

    s is the string's length less its unstretched length; the path begins at s = 0 and may turn only at its points.
    Raises ValueError for a path below 0, where the string is slack.
    """
    from cradle_env.mechanics import layout as p
    from cradle_env.mechanics.strings import follow

    path = np.ascontiguousarray(stretches, dtype=float)
    if path.ndim != 1 or not np.all(np.isfinite(path) & (path >= 0.0)):
        raise ValueError("stretches must be a one-dimensional array of finite metres, none below 0 (slack)")
    record, bobs = records(cradle)
    tensions = np.empty_like(path)
    follow(record[0], bobs[0], np.zeros((1, p.COLUMNS)), path, tensions)
    return tensions
