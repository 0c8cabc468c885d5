"""Check whether readings can be in the unit that their file states."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from cradle_env.cradle import Cradle
from identification.experiment.recording import UNITS
from identification.experiment.run import Run

#: Largest factor between the readings and the stated release, if the first period was recorded.
_SEEN = 2.0
#: The same if it was not recorded, since the swing may have decayed before.
_DECAYED = 20.0


def check_unit(run: Run, cradle: Cradle) -> None:
    """Raise ValueError for angles that no bob can reach, or that are far from the stated release."""
    if run.of_impacts:
        return
    angles = np.abs(angles_from_rest(run, cradle))
    row, bob = map(int, np.unravel_index(np.nanargmax(angles), angles.shape))
    largest = float(angles[row, bob])
    limit, bobs = (0.5 * math.pi, "a bob on strings") if cradle.has("radial_elasticity") else (math.pi, "a pendulum")
    if run.quantity == "theta" and largest > limit:
        raise ValueError(
            f"{run.file}, {run.place(row, bob)}, bob {bob + 1}: {_format_angle(largest, run)} is more than {bobs}"
            f" swings to, {_format_angle(limit, run)}; {_remedy(run, largest, 0.0, limit)}"
        )
    if run.release is None:
        return
    released = run.release.release.angles_of(cradle)
    lifted = np.flatnonzero(np.isfinite(released) & (released != 0.0))
    first = (run.times >= 0.0) & (run.times <= cradle.period)
    for bob in lifted:
        stated = abs(float(released[bob]))
        seen = ~np.isnan(angles[:, bob])
        if not seen.any():
            continue
        early = bool((seen & first).any() and seen[first].mean() > 0.5)
        factor = _SEEN if early else _DECAYED
        found = float(angles[seen & first if early else seen, bob].max())
        if not stated / factor <= found <= stated * factor:
            raise ValueError(
                f"{run.file}, bob {bob + 1}: it swings to {_format_angle(found, run)}, and its release is stated as"
                f" {stated:.4g} rad; {_remedy(run, found, 0.5 * stated, 2.0 * stated)}"
            )


def readings_from_rest(run: Run, rows: np.ndarray) -> np.ndarray:
    """Readings (T, N) in the rows (T,), relative to each bob's rest position; nan in other rows.

    A rest position that is to be inferred is estimated by the median of these rows.
    """
    seen = np.where(rows[:, None], run.readings, np.nan)
    if run.rest == "free":
        known = np.flatnonzero(~np.isnan(seen).all(axis=0))
        seen[:, known] -= np.nanmedian(seen[:, known], axis=0)
    return seen


def angles_from_rest(run: Run, cradle: Cradle) -> np.ndarray:
    """`readings_from_rest` of all used rows as angles (T, N) [rad]."""
    return dataclasses.replace(run, readings=readings_from_rest(run, run.fitted | run.held_out)).angles(cradle)


def _format_angle(angle: float, run: Run) -> str:
    """Format an angle in the unit of the file; in rad if the file has displacements."""
    return f"{angle / run.scale:.4g} {run.unit}" if run.quantity == "theta" else f"{angle:.4g} rad"


def _remedy(run: Run, found: float, low: float, high: float) -> str:
    """Say what to do about an angle of this size; name a unit that would bring it between low and high [rad]."""
    for unit, scale in UNITS[run.quantity].items():
        if unit != run.unit and low < found * scale / run.scale < high:
            return f"it looks like {unit}: write [{unit}] in the header of {run.file}"
    return f"check the unit in the header of {run.file}, and the release, whose angles are in rad"
