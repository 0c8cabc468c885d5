"""Contacts and strings by themselves: e(v) and contact times of eq. 1, the force-displacement curve of eq. 4."""

from __future__ import annotations

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.impact_law import pair_impacts
from cradle_env.kernel_records import records


def restitution_curve(cradle: Cradle, speeds: np.ndarray) -> np.ndarray:
    """Coefficient of restitution of two bobs against impact speed: eq. 1, or the law that the cradle has instead.

    Parameters
    ----------
    cradle : Cradle
        Its first two bobs meet.
    speeds : array_like of float
        Normal approach speeds v > 0 [m/s].

    Returns
    -------
    ndarray
        e [1], of the shape of speeds.

    References
    ----------
    Lee & Hong, arXiv:2401.16693, eq. 1, Fig. 2c. Kuwabara & Kono, Jpn. J. Appl. Phys. 26, 1230 (1987).

    Examples
    --------
    >>> from cradle_env import Cradle
    >>> restitution_curve(Cradle(), [0.1, 1.0]).round(3).tolist()
    [0.977, 0.964]
    """
    return pair_impacts(*cradle.contact_records(), np.ravel(speeds))[:, 0].reshape(np.shape(speeds))


def contact_times(cradle: Cradle, speeds: np.ndarray) -> np.ndarray:
    """Duration of the contact of two bobs against impact speed (eq. 1).

    Parameters
    ----------
    cradle : Cradle
        Its first two bobs meet.
    speeds : array_like of float
        Normal approach speeds v > 0 [m/s].

    Returns
    -------
    ndarray
        Durations [s], of the shape of speeds.

    References
    ----------
    Lee & Hong, arXiv:2401.16693, eq. 1, Fig. 2b.

    Examples
    --------
    >>> from cradle_env import Cradle
    >>> (1e6 * contact_times(Cradle(), [0.1, 1.0])).round(-1).tolist()
    [200.0, 130.0]
    """
    return pair_impacts(*cradle.contact_records(), np.ravel(speeds))[:, 1].reshape(np.shape(speeds))


def string_tension(cradle: Cradle, stretches: np.ndarray) -> np.ndarray:
    """Tension of one new string along a path of stretches (eq. 4).

    Parameters
    ----------
    cradle : Cradle
        Of the string; without string_hysteresis the tension is κ s.
    stretches : array_like, shape (K,)
        s, the string's length less its unstretched length [m]: a path that begins at s = 0 and turns only at these
        points.

    Returns
    -------
    ndarray, shape (K,)
        Tension [N].

    Raises
    ------
    ValueError
        For a stretch below 0, where the string is slack.

    References
    ----------
    Lee & Hong, arXiv:2401.16693, eq. 4.

    Examples
    --------
    Loading along a line, unloading along a parabola:

    >>> from cradle_env import Cradle
    >>> string_tension(Cradle(kappa=100.0), [0.01, 0.02, 0.01]).round(6).tolist()
    [1.0, 2.0, 0.5]
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
