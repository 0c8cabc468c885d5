"""Periodic terms: a horizontal force with a frequency of its own, as in a room that shakes, and how to find it.

A force e^{iωs}, s counted from the middle of a window, changes the readings of the window by a smooth function of ω; it
varies over the inverse width of the window. So a few simulated frequencies and splines give it at any frequency.
Multiplied by e^{iωt}, t the middle of each window, it is the response to one force over the whole run.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from cradle_env.effects.learned_force import IN_TIME, learned_force
from cradle_env.threads import in_threads
from identification.diagnosis.learned_law.terms import (
    TARGET_SHIFT,
    LinearModel,
    Scales,
    Term,
    library,
    residual_derivative,
)
from identification.diagnosis.residuals.multiple_shooting import MultipleShootingFit
from identification.diagnosis.residuals.periodogram import frequency_grid
from identification.inference.fit_result import FitResult, orthonormal_basis

#: Simulated frequencies per inverse width of a window; splines interpolate between them.
_COARSE = 2.0
#: Frequencies whose waves are in memory at once.
_CHUNK = 32


def add_periodic_terms(
    linear: LinearModel, scales: Scales, subset: tuple[int, ...]
) -> tuple[LinearModel, Scales] | None:
    """The linear model of a fit in windows with periodic terms added, and scales with their frequency.

    The frequency is that of the force, equal on all bobs, that saves most χ² together with a subset of the other terms.
    linear: of a single run, because the phase of a shaking room is unrelated from run to run. Returns None for a run
    that is too short.
    """
    fitted = linear.fitted
    times, period = fitted.readings.time, fitted.cradle.period
    frequencies = frequency_grid(float(np.ptp(times)), period)
    assert isinstance(fitted, MultipleShootingFit)
    if len(fitted.origins) < 2 or len(frequencies) == 0:
        return None
    begin, width = _window_starts(fitted)
    coarse = np.arange(frequencies[0], frequencies[-1] + 1.0, 1.0 / (_COARSE * width))
    push = linear.columns[:, linear.terms.index(Term(learned_force.name, "push", 0))]
    step = TARGET_SHIFT / float(np.sqrt(np.mean(push**2)))

    def answer(f: float) -> np.ndarray:
        wave = _force_response(fitted, {**scales, "frequency": f}, 0, step * (1.0 + (f * period) ** 2))
        return wave * np.exp(-1j * np.pi * f * width)

    answers = in_threads(answer, list(coarse), fitted.likelihood.workers)
    between, middle = CubicSpline(coarse, np.array(answers)), begin + 0.5 * width
    others = [linear.visible[i - 1] for i in subset]
    b = fitted.jacobian[:, [fitted.likelihood.names.index("b")]]
    basis = orthonormal_basis(np.column_stack([linear.basis, b, linear.columns[:, others]]))
    saved = []
    for several in np.array_split(frequencies, -(-len(frequencies) // _CHUNK)):
        waves = between(several) * np.exp(2j * np.pi * np.outer(several, middle))
        saved += [*_wave_gains(waves, basis, fitted.residuals)]
    scales = {**scales, "frequency": float(frequencies[np.argmax(saved)])}
    terms, columns = [term for term in library(fitted.cradle) if term.in_time], []
    for element in dict.fromkeys(term.element for term in terms):
        wave = _force_response(fitted, scales, element, step) * np.exp(2j * np.pi * scales["frequency"] * begin)
        columns += [np.real(wave), np.imag(wave)]
    return linear.with_columns(terms, np.column_stack(columns)), scales


def _window_starts(fitted: FitResult) -> tuple[np.ndarray, float]:
    """(start of each residual's window, counted from that of the run [s], (R + P,); width of the windows [s])."""
    likelihood = fitted.likelihood
    starts = np.array([likelihood.initial_condition(fitted.values, k)[1] for k in range(len(likelihood.rows))])
    begin = np.append(starts - starts[0], 0.0)
    run = np.full(len(fitted.residuals), len(starts))  # residuals of priors do not change
    run[: fitted.count] = fitted.readings.run
    return begin[run], float(np.median(np.diff(starts)))


def _force_response(fitted: FitResult, scales: Scales, element: int, step: float) -> np.ndarray:
    """d residuals / d force e^{iωs}, s counted from the start of each window, (R + P,), complex."""
    cosine, sine = (
        residual_derivative(fitted, scales, Term(learned_force.name, key, element), step) for key in IN_TIME
    )
    return cosine + 1j * sine


def _wave_gains(waves: np.ndarray, basis: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """χ² (F,) that the real and imaginary part of each wave (F, R + P) save after projection off a basis (R + P, K)."""
    pairs = np.stack([np.real(waves), np.imag(waves)], axis=1)
    visible = pairs - (pairs @ basis) @ basis.T
    h = visible @ residuals
    G = visible @ np.swapaxes(visible, 1, 2)
    return np.einsum("fa,fab,fb->f", h, np.linalg.inv(G), h)
