"""Where model and data part: places by run, bob, time and phase, the largest of them judged by refitted replicates.

At each place a statistic asks whether the residuals there are noise. Its surprise is −log10 of the tail of the χ² that
it would follow for white noise; what unknowns absorb, and how many places there are, enters by the replicates.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.special import gammaln
from scipy.stats import chi2

from identification.diagnosis.residuals.periodogram import count_independent, frequency_grid, line_power
from identification.diagnosis.residuals.windows import Window, model_motions, start_state_windows, window_edges
from identification.inference.fit_result import Fitted, span

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
    "amplitude": "an amplitude that is off",
    "frequency": "a frequency that is off",
    "energy": "energy lost otherwise",
    "unknowns": "unknowns other than those of the whole",
    "within": "within the window, its start inferred",
}


def describe_phase(phase: str) -> str:
    """What was sought in a place: one of `PHASES`, a line, or a sector of the swing."""
    return PHASES.get(phase, f"{phase} of the swing" if phase.endswith("°") else f"a {phase}")


@dataclass(frozen=True)
class ResidualTest:
    """Part of the residuals: rows (R',) among them, and what is sought there: orthonormal columns (R', k), or, with
    None, the sum of squares. bob −1: all bobs; phase: one of `PHASES`, "line", or a sector of the swing, of which 0° is
    where x is largest."""

    run: int
    bob: int
    interval: tuple[float, float]
    phase: str
    rows: np.ndarray
    basis: np.ndarray | None

    def neg_log10_p(self, residuals: np.ndarray) -> np.ndarray:
        """−log10 p of residuals (R,) or (R, M), were they white."""
        here = residuals[self.rows]
        parts = here if self.basis is None else self.basis.T @ here
        return neg_log10_p(np.sum(parts**2, axis=0), len(parts))

    def label(self, residuals: np.ndarray) -> str:
        """The phase, as reports have it."""
        return self.phase


@dataclass(frozen=True)
class LineTest(ResidualTest):
    """A place where a single frequency is sought, the same force on all bobs or on one: times (R',) [s] of its rows,
    and frequencies (F,) [Hz], of which the best counts."""

    times: np.ndarray
    frequencies: np.ndarray

    def neg_log10_p(self, residuals: np.ndarray) -> np.ndarray:
        """−log10 p of the best frequency, for as many as can be told apart."""
        best = np.max(line_power(self.times, residuals[self.rows], self.frequencies), axis=0)
        return neg_log10_p(best, 2) - np.log10(count_independent(self.frequencies))

    def label(self, residuals: np.ndarray) -> str:
        """The phase, with the best frequency."""
        best = np.argmax(line_power(self.times, residuals[self.rows], self.frequencies))
        return f"line at {self.frequencies[best]:.3g} Hz"


@dataclass(frozen=True)
class EnergyExcess:
    """Energy [J] that the bobs of a run hold beyond the model at a time [s] of its file, and its sd; all bobs."""

    run: int
    time: float
    energy: float
    sd: float


@dataclass(frozen=True)
class ResidualScan:
    """Where model and data part: `where`, the most surprising first, each with its statistic (−log10 p of the place
    alone) and p among all places; p: that of the most surprising; replicas: the largest surprise in each replicate;
    ledger: where the data hold more or less energy than the model."""

    where: tuple[dict, ...]
    p: float
    largest: float
    replicate_maxima: np.ndarray
    neg_log10_p: np.ndarray
    tests: tuple[ResidualTest, ...]
    energy_excess: tuple[EnergyExcess, ...]


def neg_log10_p(statistic: np.ndarray | float, degrees: int) -> np.ndarray:
    """−log10 of the tail of χ² with so many degrees of freedom, also where the tail is no number any more."""
    return -chi2_log_tail(statistic, degrees) / np.log(10.0)


def chi2_log_tail(statistic: np.ndarray | float, degrees: int) -> np.ndarray:
    """ln of the tail of χ², (x/2)^(k/2 − 1) e^(−x/2)/Γ(k/2) · 1/(1 − (k − 2)/x) far out."""
    x = np.asarray(statistic, dtype=float)
    near = chi2.logsf(np.minimum(x, degrees + 600.0), degrees)
    far = np.maximum(x, degrees + 600.0)
    tail = (degrees / 2 - 1) * np.log(far / 2) - far / 2 - gammaln(degrees / 2) - np.log1p(-(degrees - 2) / far)
    return np.where(x < degrees + 600.0, near, tail)


def scan_residuals(fitted: Fitted, replicates: np.ndarray) -> ResidualScan:
    """Scans all places; replicates: (R + P, M), see `Fitted.replicates`."""
    in_windows = start_state_windows(fitted)
    tests = list_residual_tests(fitted, in_windows)
    found = np.array([float(test.neg_log10_p(fitted.residuals)) for test in tests])
    replicate_maxima = np.max([test.neg_log10_p(replicates) for test in tests], axis=0)
    by_size = np.argsort(-found)
    where = []
    for i in by_size[:_MAX_REPORTED]:
        p = replicate_p_value(replicate_maxima, float(found[i]))
        if p <= _REPORTED_P:
            where.append(_describe_test(fitted, tests[i], float(found[i]), p))
    largest = float(found[by_size[0]])
    ledger = [
        EnergyExcess(window.run, window.interval[0], float(window.energy @ fitted.residuals[window.rows]), window.sd)
        for window in in_windows
    ]  # fmt: skip
    return ResidualScan(
        tuple(where),
        replicate_p_value(replicate_maxima, largest),
        largest,
        replicate_maxima,
        found,
        tuple(tests),
        tuple(ledger),
    )


def replicate_p_value(replicate_maxima: np.ndarray, value: float) -> float:
    """p: how often replicates reach the value, counting the data as one of them."""
    return float((1 + np.sum(replicate_maxima >= value)) / (1 + len(replicate_maxima)))


def _describe_test(fitted: Fitted, test: ResidualTest, statistic: float, p: float) -> dict:
    return {
        "run": fitted.experiment.runs[test.run].file,
        "bob": None if test.bob < 0 else test.bob + 1,
        "t": [round(t, 3) for t in test.interval],
        "phase": test.label(fitted.residuals),
        "statistic": round(statistic, 2),
        "p": round(p, 4),
    }


def list_residual_tests(fitted: Fitted, found: list[Window]) -> list[ResidualTest]:
    """Every place that is scanned: each run as a whole, and a line in it; of each bob all, its sectors of phase, its
    amplitude, its timing and a line; and windows of time: in flight by the harmonics of the swing, near impacts by the
    sum of squares, and, with the state at the start of the window inferred, by the harmonics again."""
    tests = []
    omega = 2.0 * np.pi / fitted.cradle.period
    for motion in model_motions(fitted):
        run = int(fitted.readings.run[motion.rows[0]])
        ends = window_edges(fitted, run)
        whole = (float(ends[0]), float(ends[-1]))
        tests.append(ResidualTest(run, -1, whole, "all", motion.rows, None))
        sought = frequency_grid(whole[1] - whole[0], fitted.cradle.period)
        if len(sought):
            tests.append(LineTest(run, -1, whole, "line", motion.rows, None, motion.time, sought))
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
            if len(sought) and fitted.cradle.bobs > 1 and mine.sum() >= _MIN_READINGS:
                rows, time = motion.rows[mine], motion.time[mine]
                tests.append(LineTest(run, int(bob), whole, "line", rows, None, time, sought))
            # Residuals along θ are an amplitude that is off, along θ̇ a frequency.
            course = _slow_basis(motion.time[mine], whole)
            for phase, shape in (("amplitude", motion.theta[mine]), ("frequency", motion.speed[mine])):
                tests.append(add(whole, phase, motion.rows[mine], span(shape[:, None] * course)))
            for low, high in itertools.pairwise(ends):
                window = mine & (motion.time >= low) & ((motion.time < high) | (high == whole[1]))
                flight, impact = window & ~motion.near_impact, window & motion.near_impact
                if flight.sum() >= _READINGS_PER_COLUMN * (2 * _HARMONICS + 1):
                    basis = _harmonic_basis(omega * motion.time[flight])
                    tests.append(add((float(low), float(high)), "flight", motion.rows[flight], basis))
                if impact.sum() >= _MIN_IMPACT_READINGS:
                    tests.append(add((float(low), float(high)), "impact", motion.rows[impact], None))
    tests += _early_part_tests(fitted)
    for run in sorted({window.run for window in found}):
        tests.append(_energy_test([window for window in found if window.run == run]))
    for window in found:
        of_bob = fitted.readings.bob[window.rows]
        for bob in np.unique(of_bob):
            mine = of_bob == bob
            if mine.sum() < _READINGS_PER_COLUMN * (2 * _HARMONICS + 1):
                continue
            columns = np.zeros((len(of_bob), 2 * _HARMONICS + 1))
            columns[mine] = _harmonic_basis(omega * fitted.readings.time[window.rows][mine])
            left = columns - window.absorbed @ (window.absorbed.T @ columns)
            tests.append(ResidualTest(window.run, int(bob), window.interval, "within", window.rows, span(left)))
    # Of a bob that the model leaves exactly at rest there is no amplitude that could be off.
    return [test for test in tests if test.basis is None or test.basis.shape[1]]


def _early_part_tests(fitted: Fitted) -> list[ResidualTest]:
    """The first parts of each run by what the unknowns would be from them alone: of a model that only bends towards
    the data, they differ from what they are over all."""
    tests = []
    for run in np.unique(fitted.readings.run):
        first, last = (end(fitted.readings.time[fitted.readings.run == run]) for end in (np.min, np.max))
        for part in _PARTS:
            until = float(first + part * (last - first))
            rows = np.flatnonzero((fitted.readings.run == run) & (fitted.readings.time <= until))
            tests.append(
                ResidualTest(int(run), -1, (float(first), until), "unknowns", rows, span(fitted.jacobian[rows]))
            )
    return tests


def _slow_basis(time: np.ndarray, whole: tuple[float, float]) -> np.ndarray:
    """Slow courses over a run: Legendre polynomials in time, (T, K)."""
    return legvander(2.0 * (time - whole[0]) / (whole[1] - whole[0]) - 1.0, _DEGREE)


def _energy_test(found: list[Window]) -> ResidualTest:
    """A run by the energy that the data hold beyond the model, window by window, in slow courses."""
    whole = found[0].interval[0], found[-1].interval[1]
    course = _slow_basis(np.array([window.interval[0] for window in found]), whole)
    columns = np.concatenate([
        np.outer(window.energy / window.sd**2, own) for window, own in zip(found, course, strict=True)
    ])  # fmt: skip
    return ResidualTest(
        found[0].run, -1, whole, "energy", np.concatenate([window.rows for window in found]), span(columns)
    )


def _harmonic_basis(angle: np.ndarray) -> np.ndarray:
    """Orthonormal columns (R', 1 + 2 H) of a constant and the first harmonics."""
    columns = [np.ones_like(angle)]
    for h in range(1, _HARMONICS + 1):
        columns += [np.cos(h * angle), np.sin(h * angle)]
    return np.linalg.qr(np.column_stack(columns))[0]
