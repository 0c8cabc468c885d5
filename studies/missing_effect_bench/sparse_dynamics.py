"""The rival PySINDy: sparse dynamics of what the data hold beyond the model as stated.

The model is fitted. Of each flight between impacts, PySINDy differentiates the readings less the fitted model, and
regresses the acceleration that they have beyond the model on a library of terms (discrepancy models: Kaheman et al.,
arXiv:1909.08574). Sequential thresholds keep few terms; each fit of a bootstrap ensemble votes for the set of effects
that its terms are (Fasel et al., Proc. R. Soc. A 478, 20210904, 2022).
"""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from identification.diagnosis.residuals.windows import model_motions
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import FitResult
from studies.missing_effect_bench.candidates import COMMON_LENGTH, UNKNOWN, Names, merge
from studies.missing_effect_bench.regression import fit_as_stated

#: Terms of the angle θ, its rate v over the small-angle frequency, and the time t [s]: each with the candidate that it
#: is, None where no candidate is, "" where the fitted drag is.
TERMS: dict[str, tuple[str | None, Callable[..., np.ndarray]]] = {
    "v": ("", lambda theta, v, t: v),
    "1": ("angle_offset", lambda theta, v, t: np.ones_like(v)),
    "θ": (COMMON_LENGTH, lambda theta, v, t: theta),
    "θ ln(1 + t)": ("string_creep", lambda theta, v, t: theta * np.log1p(np.maximum(t, 0.0))),
    "|v| v": ("quadratic_drag", lambda theta, v, t: np.abs(v) * v),
    "tanh(v / 0.02 rad)": ("pivot_friction", lambda theta, v, t: np.tanh(v / 0.02)),
    "θ²": (None, lambda theta, v, t: theta**2),
    "θ³": (None, lambda theta, v, t: theta**3),
    "θ v": (None, lambda theta, v, t: theta * v),
    "θ² v": (None, lambda theta, v, t: theta**2 * v),
    "v³": (None, lambda theta, v, t: v**3),
}
#: Window of the smoothed derivative, in periods, and order of its polynomials. A flight lasts half a period where two
#: bobs meet.
SMOOTHED, ORDER = 0.25, 3
#: Thresholds, over the standard deviation of the accelerations; Schwarz's criterion chooses one.
THRESHOLDS = tuple(2.0**k for k in range(7))
#: Bootstrap fits.
FITS = 100


class Flight(NamedTuple):
    """Between two impacts of a bob: times (T,) [s], readings less the model (T,) [rad], θ and v (T,) of the model."""

    times: np.ndarray
    beyond: np.ndarray
    theta: np.ndarray
    v: np.ndarray


def vote(experiment: Experiment) -> dict[Names, float]:
    """The share of bootstrap fits whose terms are each set of effects."""
    fitted = fit_as_stated(experiment)
    votes = Counter(map(name_terms, learn(list(find_flights(fitted)), fitted.cradle.period)))
    return {names: count / votes.total() for names, count in votes.items()}


def name_terms(terms: frozenset[str]) -> Names:
    """The effects that these terms are; "unknown" where one of them is no effect."""
    names = {TERMS[term][0] for term in terms} - {""}
    return UNKNOWN if None in names else merge(name for name in names if name is not None)


def find_flights(fitted: FitResult) -> Iterator[Flight]:
    """The flights of all bobs."""
    for motion in model_motions(fitted):
        scale = fitted.likelihood.noise_model.weights[fitted.readings.run[motion.rows[0]]]
        for bob in range(fitted.cradle.bobs):
            own = motion.bob == bob
            beyond = -scale * fitted.residuals[motion.rows[own]]
            columns = (motion.time[own], beyond, motion.theta[own], motion.speed[own])
            ends = np.flatnonzero(np.diff(motion.near_impact[own].astype(int))) + 1
            for part in np.split(np.arange(len(beyond)), ends):
                if not motion.near_impact[own][part[0]]:
                    yield Flight(*(column[part] for column in columns))


def learn(flights: list[Flight], period: float) -> list[frozenset[str]]:
    """The terms of each bootstrap fit."""
    import pysindy

    width = round(SMOOTHED * period / float(np.median(np.diff(flights[0].times)))) // 2 * 2 + 1
    derivative = pysindy.SmoothedFiniteDifference(smoother_kws={"window_length": width, "polyorder": ORDER})
    library, accelerations = [], []
    for flight in flights:
        if len(flight.times) <= width:
            continue
        phase = 2.0 * np.pi / period * flight.times
        rate = np.asarray(derivative(flight.beyond, phase)).ravel()
        # The restoring force of what is beyond the model is no news.
        acceleration = np.asarray(derivative(rate, phase)).ravel() + flight.beyond * np.cos(flight.theta)
        # One of each window: smoothing makes the others its copies, which no bootstrap knows.
        accelerations.append(acceleration[width // 2 :: width])
        library.append(evaluate_terms(flight)[width // 2 :: width])
    if not library:
        raise ValueError(f"no flight has more than the {width} readings of a smoothed derivative; film faster")
    A, y = np.concatenate(library), np.concatenate(accelerations)[:, None]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Sparsity parameter is too big")  # no term is an answer, too
        chosen = _bootstrap(A, y)
    return [frozenset(np.array([*TERMS])[row].tolist()) for row in chosen]


def _bootstrap(A: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Which terms each bootstrap fit of y (R, 1) to A (R, K) has, bool (FITS, K)."""
    import pysindy

    def optimizer(threshold: float) -> pysindy.STLSQ:
        return pysindy.STLSQ(threshold * float(y.std()), normalize_columns=True)

    def criterion(threshold: float) -> float:
        """Schwarz's."""
        coefficients = optimizer(threshold).fit(A, y).coef_[0]
        left = float(np.mean((y[:, 0] - A @ coefficients) ** 2))
        return len(y) * math.log(left) + np.count_nonzero(coefficients) * math.log(len(y))

    np.random.seed(0)  # PySINDy draws its bootstrap samples from the global generator
    ensemble = pysindy.EnsembleOptimizer(optimizer(min(THRESHOLDS, key=criterion)), bagging=True, n_models=FITS)
    return np.array(ensemble.fit(A, y).coef_list)[:, 0] != 0.0


def evaluate_terms(flight: Flight) -> np.ndarray:
    """The terms in the order of TERMS, (T, K)."""
    return np.column_stack([term(flight.theta, flight.v, flight.times) for _, term in TERMS.values()])
