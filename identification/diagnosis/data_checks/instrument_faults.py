"""Faults of the instrument: readings of one bob that are shifted or wrong for a while, and lost frames.

No force makes a bob jump. Where the fitted model leaves far more than noise, the check looks for a fault that explains
it:

1. To first order: how much χ² would one fault save after a refit of the unknowns?
2. By a refit to the data with the best fault corrected.

The check reports a fault only if the refit leaves nearly nothing. A missing effect leaves residuals all over the run,
which no single fault explains.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.criteria import DEFAULT_CRITERIA, Criteria, may_hold_faults
from identification.experiment.experiment import Experiment
from identification.experiment.run import Run
from identification.inference.fit_result import FitResult, orthonormal_basis
from identification.inference.least_squares import refine
from identification.inference.likelihood import Likelihood

#: Share of the excess χ² that a fault must explain to first order to be worth refits.
_MIN_LINEAR_SHARE = 0.3
#: Points in time between which shifts are first looked for.
_COARSE_EDGES = 250
#: Best faults that are refitted.
_MAX_REFITS = 3
#: Rounds of refits in which the size of a fault converges.
_ROUNDS = 4
#: Evaluations in each of these refits.
_EVALUATIONS = 12
#: Residuals [standard deviations] beyond which readings are outliers.
_OUTLIER_SD = 4.0
#: Longest stretch of outliers, as a share of the run's readings.
_MAX_OUTLIER_SHARE = 0.05


@dataclass(frozen=True)
class InstrumentFault:
    """Readings that are wrong in rows [first, last) of a run.

    run, bob: from 0; bob −1: the times are too early by `size` [s] from row `first` on. size: shift of the bob's
    readings [rad or m]; nan: they are outliers. gain: χ² that the fault explains to first order. of: excess of χ² over
    the number of readings, after the unknowns and slow changes have absorbed their part.
    """

    run: int
    bob: int
    first: int
    last: int
    size: float
    gain: float
    of: float

    def undo(self, experiment: Experiment) -> Experiment:
        """The experiment with the fault corrected."""
        run = experiment.runs[self.run]
        times, readings = run.times.copy(), run.readings.copy()
        if self.bob < 0:
            times[self.first :] += self.size
        else:
            readings[self.first : self.last, self.bob] -= self.size
        corrected = dataclasses.replace(run, times=times, readings=readings)
        runs = tuple(corrected if k == self.run else other for k, other in enumerate(experiment.runs))
        return dataclasses.replace(experiment, runs=runs)


def check_instrument_faults(fitted: FitResult, criteria: Criteria = DEFAULT_CRITERIA) -> None:
    """Raises ValueError, naming file, row, bob and remedy, if one fault explains the residuals of a fit to all
    readings."""
    if not may_hold_faults(fitted, criteria):
        return
    for fault in sorted(_find_faults(fitted), key=lambda fault: -fault.gain)[:_MAX_REFITS]:
        if fault.gain < _MIN_LINEAR_SHARE * fault.of:
            continue
        fault, remaining = _refit_fault(fitted, fault)
        if remaining < (1.0 - criteria.fault_explained_share) * (fitted.chi2 - fitted.count):
            raise ValueError(_message(fault, fitted.experiment.runs[fault.run]))


def _find_faults(fitted: FitResult, same_kind: InstrumentFault | None = None) -> list[InstrumentFault]:
    """The best fault of each kind in each run and bob; same_kind: only of the kind, run and bob of this one."""
    faults = []
    for k in np.unique(fitted.readings.run):
        if same_kind is None or same_kind.run == k:
            scan = _RunScan.of(fitted, int(k))
            bobs = range(scan.seen.shape[1]) if same_kind is None else [same_kind.bob]
            if same_kind is None or same_kind.bob < 0:
                faults += scan.find_lost_frames()
            for bob in bobs:
                if bob >= 0 and scan.seen[:, bob].any():
                    if same_kind is None or not math.isnan(same_kind.size):
                        faults += scan.find_shift(bob)
                    if same_kind is None or math.isnan(same_kind.size):
                        faults += scan.find_stray_stretch(bob)
    return faults


@dataclass(frozen=True, eq=False)
class _RunScan:
    """The T fitted rows of one run.

    rows (T,): their indices in the run. seen (T, N): whether there is a reading. residuals (T, N): 0 where there is
    none, without their part in the basis. basis (T, N, K): orthonormal; what the unknowns absorb, a constant shift of
    each bob, a late start and a slow clock. rate (T, N): change of the residuals by a delay of 1 s. noise: of a reading
    [rad or m]. spacing: of the times [s].
    """

    run: int
    rows: np.ndarray
    residuals: np.ndarray
    seen: np.ndarray
    basis: np.ndarray
    rate: np.ndarray
    noise: float
    spacing: float

    @classmethod
    def of(cls, fitted: FitResult, k: int) -> _RunScan:
        likelihood, at = fitted.likelihood, fitted.readings
        run, rows, noise = (
            fitted.experiment.runs[k],
            np.flatnonzero(likelihood.rows[k]),
            likelihood.noise_model.scales[k],
        )
        seen = ~np.isnan(run.readings[rows])
        here = np.flatnonzero(at.run == k)
        rate = _reading_rate(fitted, k) / noise
        smooth = np.zeros((len(fitted.residuals), run.readings.shape[1] + 2))
        smooth[here, at.bob[here]] = 1.0
        smooth[here, -2] = rate[seen]
        smooth[here, -1] = rate[seen] * (at.time[here] - at.time[here].mean())
        absorbed = np.column_stack([fitted.tangent_basis, orthonormal_basis(fitted.project(smooth))])
        remaining = fitted.residuals - absorbed @ (absorbed.T @ fitted.residuals)
        residuals, basis = np.zeros(seen.shape), np.zeros((*seen.shape, absorbed.shape[1]))
        residuals[seen], basis[seen] = remaining[here], absorbed[here]
        spacing = float(np.median(np.diff(run.times)))
        return cls(k, rows, residuals, seen, basis, np.where(seen, rate, 0.0), noise, spacing)

    @property
    def excess(self) -> float:
        """Excess of χ² over the number of readings."""
        return float(np.sum(self.residuals**2) - self.seen.sum())

    def find_lost_frames(self) -> list[InstrumentFault]:
        """The best row from which on times are too early by a whole number of frames."""
        along = np.cumsum((self.rate * self.residuals).sum(axis=1)[::-1])[::-1]
        absorbed = np.cumsum(np.einsum("tb,tbk->tk", self.rate, self.basis)[::-1], axis=0)[::-1]
        square = np.cumsum((self.rate**2).sum(axis=1)[::-1])[::-1] - np.sum(absorbed**2, axis=1)
        gain = np.where(square > 1e-6 * square.max(), along**2 / np.maximum(square, 1e-300), 0.0)
        gain[along > 0.0] = 0.0  # a lost frame makes times too early, so the data run ahead of the model
        i = int(np.argmax(gain))
        frames = round(-along[i] / square[i] / self.spacing) if gain[i] > 0.0 else 0
        if frames < 1:
            return []
        return [
            InstrumentFault(
                self.run,
                -1,
                int(self.rows[i]),
                int(self.rows[-1]) + 1,
                frames * self.spacing,
                float(gain[i]),
                self.excess,
            )
        ]

    def find_shift(self, bob: int) -> list[InstrumentFault]:
        """The best shift of one bob's readings: on a coarse grid of rows, then row by row about its two ends."""
        count = len(self.rows)
        coarse = np.unique(np.linspace(0, count, _COARSE_EDGES + 1).astype(int))
        first, last, _, _ = self._best_shift(bob, coarse, coarse)
        near = 2 * math.ceil(count / _COARSE_EDGES)
        firsts, lasts = (np.arange(max(0, i - near), min(count, i + near) + 1) for i in (first, last))
        first, last, size, gain = self._best_shift(bob, firsts, lasts)
        if gain <= 0.0:
            return []
        if first == 0:  # the basis holds a constant: the opposite shift of the rest is the same
            first, last, size = last, count, -size
        return [
            InstrumentFault(self.run, bob, int(self.rows[first]), int(self.rows[last - 1]) + 1, size, gain, self.excess)
        ]

    def _best_shift(self, bob: int, firsts: np.ndarray, lasts: np.ndarray) -> tuple[int, int, float, float]:
        """(first, last, size, gain) of the best shift that begins and ends at given rows."""
        zero = np.zeros((1, 1))
        along = np.concatenate([zero[0], np.cumsum(self.residuals[:, bob])])
        number = np.concatenate([zero[0], np.cumsum(self.seen[:, bob])])
        absorbed = np.concatenate([np.zeros((1, self.basis.shape[2])), np.cumsum(self.basis[:, bob], axis=0)])
        sums = along[lasts] - along[firsts][:, None]
        square = number[lasts] - number[firsts][:, None]
        square = square - np.sum((absorbed[lasts] - absorbed[firsts][:, None]) ** 2, axis=2)
        usable = (lasts > firsts[:, None]) & (square > 0.5)
        gain = np.where(usable, sums**2 / np.where(usable, square, 1.0), 0.0)
        i, j = np.unravel_index(np.argmax(gain), gain.shape)
        size = -self.noise * sums[i, j] / max(square[i, j], 0.5)
        return int(firsts[i]), int(lasts[j]), float(size), float(gain[i, j])

    def find_stray_stretch(self, bob: int) -> list[InstrumentFault]:
        """The short stretch of one bob's readings whose squared residuals exceed the threshold of outliers most."""
        own = self.residuals[:, bob]
        scale = max(1.0, 1.4826 * float(np.median(np.abs(own[self.seen[:, bob]]))))
        sums = np.concatenate([[0.0], np.cumsum(np.where(self.seen[:, bob], (own / scale) ** 2 - _OUTLIER_SD**2, 0.0))])
        lowest = np.minimum.accumulate(sums)
        last = int(np.argmax(sums - lowest))
        first = int(np.argmin(sums[: last + 1]))
        gain = float(np.sum(own[first:last] ** 2)) - (last - first)
        if not 0 < last - first <= _MAX_OUTLIER_SHARE * len(own):
            return []
        return [
            InstrumentFault(
                self.run, bob, int(self.rows[first]), int(self.rows[last - 1]) + 1, math.nan, gain, self.excess
            )
        ]


def _reading_rate(fitted: FitResult, k: int) -> np.ndarray:
    """Rate at which the model's readings change at the fitted rows of a run, (T, N) [rad/s or m/s]."""
    h = 1e-3
    sides = []
    for step in (-h, h):
        runs = list(fitted.experiment.runs)
        runs[k] = dataclasses.replace(runs[k], times=runs[k].times + step)
        moved = Likelihood(dataclasses.replace(fitted.experiment, runs=tuple(runs)), None, fitted.likelihood.workers)
        sides.append(moved.predict(fitted.point, k, fitted.likelihood.rows[k])[0])
    return (sides[1] - sides[0]) / (2.0 * h)


def _refit_fault(fitted: FitResult, fault: InstrumentFault) -> tuple[InstrumentFault, float]:
    """(fault, excess of χ² that remains) after alternating refits of the fault and of the unknowns converged."""
    likelihood, point = fitted.likelihood, fitted.point
    remaining = math.inf
    for _ in range(_ROUNDS):
        corrected = Likelihood(fault.undo(fitted.experiment), likelihood.rows, likelihood.workers)
        point, cost = refine(corrected, point, _EVALUATIONS)
        remaining = cost - FitResult(corrected, point).count
        again = _find_faults(FitResult(likelihood, point), fault)
        if not again or again[0] == fault:
            break
        fault = again[0]
    return fault, remaining


def _message(fault: InstrumentFault, run: Run) -> str:
    """The fault and its remedy, in one line."""
    begin = f"{run.file}, {run.place(fault.first, max(fault.bob, 0))}, t = {run.times[fault.first]:.6g} s"
    if fault.bob < 0:
        spacing = float(np.median(np.diff(run.times)))
        frames = round(fault.size / spacing)
        return (
            f"{begin}: from here on all bobs are ahead by {1e3 * fault.size:.3g} ms,"
            f" {frames} frame{'s' if frames > 1 else ''} of {1e3 * spacing:.3g} ms, as if the camera dropped"
            f" {'them' if frames > 1 else 'one'}; add that to the times from this row on, or set fit_to before it"
        )
    where = f"{begin}, bob {fault.bob + 1}:"
    if fault.last == fault.first + 1:
        off = "where no motion leads" if math.isnan(fault.size) else f"off by {_size(fault, run)}"
        return f"{where} this reading is {off}, as if the tracker slipped; leave it empty"
    end = f"{run.place(fault.last - 1, fault.bob)}, t = {run.times[fault.last - 1]:.6g} s"
    own = np.flatnonzero(run.fitted & ~np.isnan(run.readings[:, fault.bob]))
    which = f"the readings {'from here on' if fault.last > own[-1] else f'up to {end},'}"
    if math.isnan(fault.size):
        return f"{where} {which} are where no motion leads, as if the tracker lost the bob; leave them empty"
    return (
        f"{where} {which} are shifted by {_size(fault, run)}, as if the tracker slipped;"
        f" subtract that from them, or leave them empty"
    )


def _size(fault: InstrumentFault, run: Run) -> str:
    return f"{fault.size / run.scale:+.3g} {run.unit}"
