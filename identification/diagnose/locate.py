"""Where model and data part: places by run, bob, time and phase, the largest of them judged by refitted replicates.

At each place a statistic asks whether the residuals there are noise. Its surprise is −log10 of the tail of the χ² that
it would follow for white noise; what unknowns absorb, and how many places there are, enters by the replicates.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln
from scipy.stats import chi2

from cradle_env.simulation import simulate
from identification.diagnose.fitted import Fitted
from identification.likelihood import STEP_FACTOR

#: Width of a window, in small-angle periods, and the harmonics of the swing sought in it.
_WINDOW, _HARMONICS = 2.0, 3
#: Readings are near an impact within so many seconds of it.
_NEAR = 0.025
#: Sectors of the swing's phase.
_SECTORS = 8
_MOST_SHOWN = 12


@dataclass(frozen=True)
class Place:
    """Part of the residuals: rows (R',) among them, and what is sought there: orthonormal columns (R', k), or, with
    None, the sum of squares. bob −1: all bobs; phase: "all", "flight", "impact" or a sector of the swing."""

    run: int
    bob: int
    interval: tuple[float, float]
    phase: str
    rows: np.ndarray
    basis: np.ndarray | None

    def surprise(self, residuals: np.ndarray) -> np.ndarray:
        """−log10 p of residuals (R,) or (R, M), were they white."""
        here = residuals[self.rows]
        parts = here if self.basis is None else self.basis.T @ here
        return surprise(np.sum(parts**2, axis=0), len(parts))


@dataclass(frozen=True)
class Located:
    """Where model and data part: `where`, the most surprising first, each with its statistic (−log10 p of the place
    alone) and p among all places; p: that of the most surprising; replicas: the largest surprise in each replicate."""

    where: tuple[dict, ...]
    p: float
    largest: float
    replicas: np.ndarray
    statistic: np.ndarray
    places: tuple[Place, ...]


def surprise(statistic: np.ndarray | float, degrees: int) -> np.ndarray:
    """−log10 of the tail of χ² with so many degrees of freedom, also where the tail is no number any more."""
    return -log_tail(statistic, degrees) / np.log(10.0)


def log_tail(statistic: np.ndarray | float, degrees: int) -> np.ndarray:
    """ln of the tail of χ², (x/2)^(k/2 − 1) e^(−x/2)/Γ(k/2) · 1/(1 − (k − 2)/x) far out."""
    x = np.asarray(statistic, dtype=float)
    near = chi2.logsf(np.minimum(x, degrees + 600.0), degrees)
    far = np.maximum(x, degrees + 600.0)
    tail = (degrees / 2 - 1) * np.log(far / 2) - far / 2 - gammaln(degrees / 2) - np.log1p(-(degrees - 2) / far)
    return np.where(x < degrees + 600.0, near, tail)


def locate(fitted: Fitted, replicates: np.ndarray) -> Located:
    """Scans all places; replicates: (R + P, M), see `Fitted.replicates`."""
    places = all_places(fitted)
    found = np.array([float(place.surprise(fitted.residuals)) for place in places])
    replicas = np.max([place.surprise(replicates) for place in places], axis=0)
    by_size = np.argsort(-found)
    where = []
    for i in by_size[:_MOST_SHOWN]:
        p = share(replicas, float(found[i]))
        if p <= 0.05:
            where.append(_described(fitted, places[i], float(found[i]), p))
    largest = float(found[by_size[0]])
    return Located(tuple(where), share(replicas, largest), largest, replicas, found, tuple(places))


def share(replicas: np.ndarray, value: float) -> float:
    """p: how often replicates reach the value, counting the data as one of them."""
    return float((1 + np.sum(replicas >= value)) / (1 + len(replicas)))


def _described(fitted: Fitted, place: Place, statistic: float, p: float) -> dict:
    return {
        "run": fitted.experiment.runs[place.run].file,
        "bob": None if place.bob < 0 else place.bob + 1,
        "t": [round(t, 3) for t in place.interval],
        "phase": place.phase,
        "statistic": round(statistic, 2),
        "p": round(p, 4),
    }


def all_places(fitted: Fitted) -> list[Place]:
    """Every place that is scanned: each run as a whole; of each bob all, its sectors of phase, and windows of time,
    in flight by the harmonics of the swing and near impacts by the sum of squares."""
    at, places = fitted.readings, []
    omega = 2.0 * np.pi / fitted.cradle.period
    width = _WINDOW * fitted.cradle.period
    for k in np.unique(at.run):
        of_run = np.flatnonzero(at.run == k)
        whole = (float(at.time[of_run].min()), float(at.time[of_run].max()))
        places.append(Place(int(k), -1, whole, "all", of_run, None))
        near, phase = _phases(fitted, int(k))
        for bob in np.unique(at.bob[of_run]):
            rows = of_run[at.bob[of_run] == bob]
            close, sector, time = near[at.bob[of_run] == bob], phase[at.bob[of_run] == bob], at.time[rows]
            add = functools.partial(Place, int(k), int(bob))
            places.append(add(whole, "all", rows, None))
            for s in range(_SECTORS):
                inside = rows[sector == s]
                if len(inside) >= 20:
                    basis = np.full((len(inside), 1), len(inside) ** -0.5)
                    places.append(add(whole, f"{360 * s // _SECTORS}–{360 * (s + 1) // _SECTORS}°", inside, basis))
            edges = np.linspace(*whole, max(1, round((whole[1] - whole[0]) / width)) + 1)
            for low, high in itertools.pairwise(edges):
                window = (time >= low) & ((time < high) | (high == whole[1]))
                flight, impact = window & ~close, window & close
                if flight.sum() >= 4 * (2 * _HARMONICS + 1):
                    basis = _harmonics(omega * time[flight])
                    places.append(add((float(low), float(high)), "flight", rows[flight], basis))
                if impact.sum() >= 3:
                    places.append(add((float(low), float(high)), "impact", rows[impact], None))
    return places


def _harmonics(angle: np.ndarray) -> np.ndarray:
    """Orthonormal columns (R', 1 + 2 H) of a constant and the first harmonics."""
    columns = [np.ones_like(angle)]
    for h in range(1, _HARMONICS + 1):
        columns += [np.cos(h * angle), np.sin(h * angle)]
    return np.linalg.qr(np.column_stack(columns))[0]


def _phases(fitted: Fitted, index: int) -> tuple[np.ndarray, np.ndarray]:
    """(whether near an impact of its bob, sector of the phase atan2(−θ̇/ω, θ)) of the readings of a run, (R',) each."""
    likelihood, at = fitted.likelihood, fitted.readings
    mine = at.run == index
    beginning, zero = likelihood.beginning(fitted.values, index)
    cradle = likelihood.cradle(fitted.values, fitted.experiment.runs[index])
    instants = np.unique(np.maximum(at.time[mine] - zero, 0.0))
    motion = simulate(cradle, beginning, times=instants, ledger=False, step_factor=STEP_FACTOR)
    row = np.searchsorted(instants, np.maximum(at.time[mine] - zero, 0.0))
    bob = at.bob[mine]
    speed = motion.theta_dot[row, bob] * cradle.period / (2.0 * np.pi)
    angle = np.mod(np.arctan2(-speed, motion.theta[row, bob]), 2.0 * np.pi)
    near = np.zeros(len(row), bool)
    for i in range(cradle.bobs):
        hits = motion.impacts["time"][np.isin(motion.impacts["pair"], (i, i + 1))]
        if len(hits):
            after = np.searchsorted(hits, instants[row])
            distance = np.minimum(
                np.abs(instants[row] - hits[np.maximum(after - 1, 0)]),
                np.abs(instants[row] - hits[np.minimum(after, len(hits) - 1)]),
            )
            near |= (bob == i) & (distance < _NEAR)
    return near, np.minimum((angle * _SECTORS / (2.0 * np.pi)).astype(int), _SECTORS - 1)
