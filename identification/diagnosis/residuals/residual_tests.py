"""Tests of the residuals by run, bob, time and phase, and the p-value of the largest of them.

Each test asks whether part of the residuals is noise. Its statistic is −log10 p of the χ² that white noise would give.
These p do not count what the fit absorbed nor how many tests there are. So the largest statistic is compared with the
largest in each of many replicates, refits to simulated data of the same model: a parametric bootstrap of the maximum
(Westfall and Young 1993, Resampling-Based Multiple Testing).
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.special import chdtrc, gammaln

from identification.diagnosis.residuals.periodogram import count_independent, frequency_grid, line_power
from identification.diagnosis.residuals.windows import Window, model_motions, start_state_windows, window_edges
from identification.inference.fit_result import FitResult, orthonormal_basis

#: Harmonics of the swing that a window is tested for.
_HARMONICS = 3
#: Readings of a window per column of its basis, at least.
_READINGS_PER_COLUMN = 4
#: Readings near impacts that a window is tested with, at least.
_MIN_IMPACT_READINGS = 3
#: Degree of the Legendre polynomials that describe slow changes over a run.
_DEGREE = 4
#: Sectors of the swing's phase.
_SECTORS = 8
#: Readings of a bob with which a sector or a spectral line is tested, at least.
_MIN_READINGS = 20
#: Tests reported at most.
_MAX_REPORTED = 12
#: p among all tests up to which a test is reported.
_REPORTED_P = 0.05
#: First parts of a run that the unknowns are inferred from alone.
_PARTS = (0.25, 0.5, 0.75)


#: What a test looks for, in words. `describe_phase` adds sectors of the swing and spectral lines.
PHASES = {
    "all": "all residuals",
    "flight": "in flight",
    "impact": "near impacts",
    "amplitude": "a wrong amplitude",
    "frequency": "a wrong frequency",
    "energy": "a wrong loss of energy",
    "unknowns": "other best-fit values than in the whole run",
    "within": "within the window, with its start state inferred",
}


def describe_phase(phase: str) -> str:
    """What a test looks for, in words: one of `PHASES`, a spectral line, or a sector of the swing."""
    return PHASES.get(phase, f"{phase} of the swing" if phase.endswith("°") else f"a {phase}")


@dataclass(frozen=True)
class ResidualTest:
    """A test of part of the residuals.

    run: from 0. bob: from 0; −1: all bobs. interval: its ends in the file [s]. phase: one of `PHASES`, "line", or a
    sector of the swing, of which 0° is where x is largest. rows (R',): among the residuals. basis (R', k): orthonormal
    columns, whose components of the residuals are squared and summed; None: all squared residuals are summed.
    """

    run: int
    bob: int
    interval: tuple[float, float]
    phase: str
    rows: np.ndarray
    basis: np.ndarray | None

    def neg_log10_p(self, residuals: np.ndarray) -> np.ndarray:
        """−log10 p of residuals (R,) or (R, M) if they were white noise."""
        here = residuals[self.rows]
        parts = here if self.basis is None else self.basis.T @ here
        return neg_log10_p(np.sum(parts**2, axis=0), len(parts))

    def label(self, residuals: np.ndarray) -> str:
        """The phase as reports show it."""
        return self.phase


@dataclass(frozen=True)
class LineTest(ResidualTest):
    """A test for a spectral line: a single frequency, in phase for all bobs or of one bob.

    times (R',): of its rows [s]. frequencies (F,): of which the best counts [Hz].
    """

    times: np.ndarray
    frequencies: np.ndarray

    def neg_log10_p(self, residuals: np.ndarray) -> np.ndarray:
        """−log10 p of the best frequency, corrected for the number of independent ones."""
        best = np.max(line_power(self.times, residuals[self.rows], self.frequencies), axis=0)
        return neg_log10_p(best, 2) - np.log10(count_independent(self.frequencies))

    def label(self, residuals: np.ndarray) -> str:
        """The phase with the best frequency."""
        best = np.argmax(line_power(self.times, residuals[self.rows], self.frequencies))
        return f"line at {self.frequencies[best]:.3g} Hz"


@dataclass(frozen=True)
class EnergyExcess:
    """Energy of all bobs of a run beyond the model [J], with its standard deviation, at a time in the file [s]."""

    run: int
    time: float
    energy: float
    sd: float


@dataclass(frozen=True)
class ResidualScan:
    """All tests of the residuals of a fit.

    where: the significant tests as diagnosis.json has them, the largest first. p: of the largest test among all.
    largest: its −log10 p alone. replicate_maxima (M,): the largest −log10 p in each replicate. neg_log10_p: of each of
    `tests`. energy_excess: energy of the data beyond the model, by window.
    """

    where: tuple[dict, ...]
    p: float
    largest: float
    replicate_maxima: np.ndarray
    neg_log10_p: np.ndarray
    tests: tuple[ResidualTest, ...]
    energy_excess: tuple[EnergyExcess, ...]


def neg_log10_p(statistic: np.ndarray | float, degrees: int) -> np.ndarray:
    """−log10 of the tail probability of χ²; finite even where the probability underflows."""
    return -chi2_log_tail(statistic, degrees) / np.log(10.0)


def chi2_log_tail(statistic: np.ndarray | float, degrees: int) -> np.ndarray:
    """ln of the tail probability of χ².

    Far out it is the asymptotic series' leading term, (x/2)^(k/2 − 1) e^(−x/2)/Γ(k/2) · 1/(1 − (k − 2)/x)
    (Abramowitz and Stegun, 6.5.32).
    """
    x = np.asarray(statistic, dtype=float)
    near = np.log(chdtrc(degrees, np.clip(x, 0.0, degrees + 600.0)))
    far = np.maximum(x, degrees + 600.0)
    tail = (degrees / 2 - 1) * np.log(far / 2) - far / 2 - gammaln(degrees / 2) - np.log1p(-(degrees - 2) / far)
    return np.where(x < degrees + 600.0, near, tail)


def scan_residuals(fitted: FitResult, replicates: np.ndarray) -> ResidualScan:
    """Runs all tests on a fit and on its replicates (R + P, M), see `FitResult.replicates`."""
    windows = start_state_windows(fitted)
    tests = list_residual_tests(fitted, windows)
    statistics = np.array([float(test.neg_log10_p(fitted.residuals)) for test in tests])
    replicate_maxima = np.max([test.neg_log10_p(replicates) for test in tests], axis=0)
    by_size = np.argsort(-statistics)
    where = []
    for i in by_size[:_MAX_REPORTED]:
        p = replicate_p_value(replicate_maxima, float(statistics[i]))
        if p <= _REPORTED_P:
            where.append(_describe_test(fitted, tests[i], float(statistics[i]), p))
    largest = float(statistics[by_size[0]])
    energy_excess = [
        EnergyExcess(window.run, window.interval[0], float(window.energy @ fitted.residuals[window.rows]), window.sd)
        for window in windows
    ]  # fmt: skip
    return ResidualScan(
        tuple(where),
        replicate_p_value(replicate_maxima, largest),
        largest,
        replicate_maxima,
        statistics,
        tuple(tests),
        tuple(energy_excess),
    )


def replicate_p_value(replicate_maxima: np.ndarray, value: float) -> float:
    """Share of replicates that reach the value; the data count as one of them, so it is never 0."""
    return float((1 + np.sum(replicate_maxima >= value)) / (1 + len(replicate_maxima)))


def _describe_test(fitted: FitResult, test: ResidualTest, statistic: float, p: float) -> dict:
    return {
        "run": fitted.experiment.runs[test.run].file,
        "bob": None if test.bob < 0 else test.bob + 1,
        "t": [round(t, 3) for t in test.interval],
        "phase": test.label(fitted.residuals),
        "statistic": round(statistic, 2),
        "p": round(p, 4),
    }


def list_residual_tests(fitted: FitResult, windows: list[Window]) -> list[ResidualTest]:
    """All tests.

    - Of each run: all residuals, a spectral line, and the energy of the windows.
    - Of each first part of a run: best-fit values other than those of the whole run.
    - Of each bob: all residuals, sectors of the swing's phase, slow changes of amplitude and of frequency, a line.
    - Of each bob in each window: in flight the harmonics of the swing, near impacts the sum of squares, and the
      harmonics again with the window's start state inferred.
    """
    tests = []
    omega = 2.0 * np.pi / fitted.cradle.period
    for motion in model_motions(fitted):
        run = int(fitted.readings.run[motion.rows[0]])
        ends = window_edges(fitted, run)
        whole = (float(ends[0]), float(ends[-1]))
        tests.append(ResidualTest(run, -1, whole, "all", motion.rows, None))
        frequencies = frequency_grid(whole[1] - whole[0], fitted.cradle.period)
        if len(frequencies):
            tests.append(LineTest(run, -1, whole, "line", motion.rows, None, motion.time, frequencies))
        angle = np.mod(np.arctan2(-motion.speed, motion.theta), 2.0 * np.pi)
        sector = np.minimum((angle * _SECTORS / (2.0 * np.pi)).astype(int), _SECTORS - 1)
        for bob in np.unique(motion.bob):
            mine = motion.bob == bob
            add = functools.partial(ResidualTest, run, int(bob))
            tests.append(add(whole, "all", motion.rows[mine], None))
            for s in range(_SECTORS):
                inside = mine & (sector == s)
                if inside.sum() >= _MIN_READINGS:
                    tests.append(
                        add(whole, f"{360 * s // _SECTORS}–{360 * (s + 1) // _SECTORS}°", motion.rows[inside],
                            np.full((int(inside.sum()), 1), inside.sum() ** -0.5))
                    )  # fmt: skip
            if len(frequencies) and fitted.cradle.bobs > 1 and mine.sum() >= _MIN_READINGS:
                rows, time = motion.rows[mine], motion.time[mine]
                tests.append(LineTest(run, int(bob), whole, "line", rows, None, time, frequencies))
            # A wrong amplitude leaves residuals along θ, a wrong frequency along θ̇.
            slow = _slow_basis(motion.time[mine], whole)
            for phase, shape in (("amplitude", motion.theta[mine]), ("frequency", motion.speed[mine])):
                tests.append(add(whole, phase, motion.rows[mine], orthonormal_basis(shape[:, None] * slow)))
            for low, high in itertools.pairwise(ends):
                window = mine & (motion.time >= low) & ((motion.time < high) | (high == whole[1]))
                flight, impact = window & ~motion.near_impact, window & motion.near_impact
                if flight.sum() >= _READINGS_PER_COLUMN * (2 * _HARMONICS + 1):
                    basis = _harmonic_basis(omega * motion.time[flight])
                    tests.append(add((float(low), float(high)), "flight", motion.rows[flight], basis))
                if impact.sum() >= _MIN_IMPACT_READINGS:
                    tests.append(add((float(low), float(high)), "impact", motion.rows[impact], None))
    tests += _early_part_tests(fitted)
    for run in sorted({window.run for window in windows}):
        tests.append(_energy_test([window for window in windows if window.run == run]))
    for window in windows:
        of_bob = fitted.readings.bob[window.rows]
        for bob in np.unique(of_bob):
            mine = of_bob == bob
            if mine.sum() < _READINGS_PER_COLUMN * (2 * _HARMONICS + 1):
                continue
            columns = np.zeros((len(of_bob), 2 * _HARMONICS + 1))
            columns[mine] = _harmonic_basis(omega * fitted.readings.time[window.rows][mine])
            left = columns - window.absorbed @ (window.absorbed.T @ columns)
            tests.append(
                ResidualTest(window.run, int(bob), window.interval, "within", window.rows, orthonormal_basis(left))
            )
    # A bob that the model leaves exactly at rest has no amplitude to be wrong.
    return [test for test in tests if test.basis is None or test.basis.shape[1]]


def _early_part_tests(fitted: FitResult) -> list[ResidualTest]:
    """Tests whether first parts of each run alone have other best-fit values than the whole run.

    A right model has the same values in both. A wrong one is biased differently, for the residuals change with time.
    """
    tests = []
    for run in np.unique(fitted.readings.run):
        first, last = (end(fitted.readings.time[fitted.readings.run == run]) for end in (np.min, np.max))
        for part in _PARTS:
            until = float(first + part * (last - first))
            rows = np.flatnonzero((fitted.readings.run == run) & (fitted.readings.time <= until))
            tests.append(
                ResidualTest(
                    int(run), -1, (float(first), until), "unknowns", rows, orthonormal_basis(fitted.jacobian[rows])
                )
            )
    return tests


def _slow_basis(time: np.ndarray, whole: tuple[float, float]) -> np.ndarray:
    """Slow changes over a run: Legendre polynomials in time, (T, K)."""
    return legvander(2.0 * (time - whole[0]) / (whole[1] - whole[0]) - 1.0, _DEGREE)


def _energy_test(windows: list[Window]) -> ResidualTest:
    """Tests for slow changes of the energy that the data of a run hold beyond the model."""
    whole = windows[0].interval[0], windows[-1].interval[1]
    slow = _slow_basis(np.array([window.interval[0] for window in windows]), whole)
    columns = np.concatenate([
        np.outer(window.energy / window.sd**2, own) for window, own in zip(windows, slow, strict=True)
    ])  # fmt: skip
    return ResidualTest(
        windows[0].run,
        -1,
        whole,
        "energy",
        np.concatenate([window.rows for window in windows]),
        orthonormal_basis(columns),
    )


def _harmonic_basis(angle: np.ndarray) -> np.ndarray:
    """Orthonormal basis (R', 1 + 2 H) of a constant and the first H harmonics."""
    columns = [np.ones_like(angle)]
    for h in range(1, _HARMONICS + 1):
        columns += [np.cos(h * angle), np.sin(h * angle)]
    return np.linalg.qr(np.column_stack(columns))[0]
