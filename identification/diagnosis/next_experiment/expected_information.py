"""The next experiment: the most informative run with the cradle, or with fewer of its bobs.

If models are in question, the information of a run is the expected log Bayes factor between two of them, the smaller
one of either being true. A grid of runs gives it to first order. The best runs are then simulated: data are drawn, and
each model is refitted to them.

Otherwise the information is the gain for λ, ½ ln(gᵀ C g / gᵀ (C⁻¹ + SᵀS)⁻¹ g) with g = dλ/dx: the logarithm of the
factor by which the run reduces the standard deviation of λ (Bayesian c-optimal design; Chaloner and Verdinelli 1995,
Statistical Science 10, 273).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cradle_env.release import Release
from cradle_env.simulation import simulate
from identification.diagnosis.criteria import DEFAULT_CRITERIA, Criteria
from identification.diagnosis.next_experiment.planned_run import Instrument, PlannedRun, Setting, expected_log_bayes
from identification.diagnosis.next_experiment.run_grid import describe_run, rank_settings, search_grid
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.least_squares import bounds
from identification.progress import Progress

#: Settings that are simulated once.
_POOL = 6
#: The best of these, which are simulated again.
_SIMULATED = 2
#: Draws of data in each of them: their scatter gives the standard error.
_DRAWS = 4
#: Standard errors that the simulated log Bayes factor must be above what separates two models.
_LUCK_SE = 2.0
#: How to measure an effect directly, if no run separates it from another.
DIRECT_MEASUREMENTS = {
    "added_mass": "weigh the bobs and work out the air that their volume drags along",
    "angle_offset": "film a plumb line",
    "angle_scale": "film a protractor in the plane of the swing",
    "clock_scale": "film a clock to know the frame rate",
    "exposure_blur": "look up the camera's exposure",
    "length_mismatch": "measure the length of each pendulum",
    "mass_mismatch": "weigh each bob",
    "spacer_offset": "measure each gap with a feeler gauge",
}


@dataclass(frozen=True)
class Plan:
    """A possible run and its expected information.

    duration [s]. predicted: information to first order, a log Bayes factor or the logarithm of the gain for λ.
    simulated, standard_error: the same from simulated data; the error is nan for a single draw, both are nan if the run
    was not simulated.
    """

    setting: Setting
    release: Release
    duration: float
    predicted: float
    simulated: float = math.nan
    standard_error: float = math.nan

    @property
    def expected_log_bayes(self) -> float:
        """The simulated information if there is one, else the predicted one."""
        return self.predicted if math.isnan(self.simulated) else self.simulated

    @property
    def bobs(self) -> int:
        """Number of bobs on the cradle."""
        return self.setting.bobs

    @property
    def delta(self) -> float | tuple[float, ...]:
        """δ, one number or one per gap."""
        return self.setting.delta


@dataclass(frozen=True)
class Advice:
    """The possible runs.

    plans: the most informative first. separates: sets of effects that they tell apart; () for λ. inseparable: pairs of
    sets that no run tells apart. best: largest expected log Bayes factor between such a pair. criteria: those of the
    diagnosis.
    """

    plans: tuple[Plan, ...]
    separates: tuple[tuple[str, ...], ...]
    inseparable: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = ()
    best: float = math.nan
    criteria: Criteria = DEFAULT_CRITERIA

    @property
    def separates_none(self) -> bool:
        """Whether no run tells any of the models apart."""
        return bool(self.inseparable) and not self.separates

    @property
    def alternative(self) -> str:
        """What to do about the pairs that no run tells apart, in words; "" if there are none."""
        if not self.inseparable:
            return ""
        pairs = "; ".join(" and ".join(" with ".join(names) for names in pair) for pair in self.inseparable)
        members = dict.fromkeys(name for pair in self.inseparable for names in pair for name in names)
        ways = [DIRECT_MEASUREMENTS[name] for name in members if name in DIRECT_MEASUREMENTS]
        measure = f": measure mass, length or clock directly ({', or '.join(ways)})." if ways else "."
        if self.best >= self.criteria.equivalent_log_odds:
            return (
                f"An experiment of this kind may or may not separate {pairs} (the best has an expected log Bayes factor"
                f" of {self.best:.2g}, less than two standard errors above the threshold){measure}"
            )
        return (
            f"No experiment of this kind separates {pairs} (the best has an expected log Bayes factor of"
            f" {self.best:.2g}){measure}"
        )

    def content(self) -> dict[str, Any]:
        """The entry of diagnosis.json; its release is None if no run tells the models apart."""
        plan = None if self.separates_none else self.plans[0]
        release = None if plan is None else {"bobs": plan.setting.lifted, "angle": plan.setting.angle}
        return {
            "release": release,
            "delta": None if plan is None else plan.delta,
            "bobs": None if plan is None else plan.bobs,
            "duration": None if plan is None else plan.duration,
            "separates": [list(names) for names in self.separates],
            "expected_log_bayes": self.best if plan is None else plan.expected_log_bayes,
            "standard_error": None if plan is None else plan.standard_error,
            "inseparable": [[list(names) for names in pair] for pair in self.inseparable],
            "instead": self.alternative,
        }


def advise(
    models: Sequence[FitResult],
    sets: Sequence[tuple[str, ...]],
    seed: int = 0,
    progress: Progress | None = None,
    criteria: Criteria = DEFAULT_CRITERIA,
) -> Advice | None:
    """The runs that tell models apart, each model named by its set of effects; None if no run can be simulated."""
    progress = progress or (lambda *_: None)
    instrument = Instrument.of(models[0])
    pairs = list(itertools.combinations(range(len(models)), 2))

    def least_log_bayes(planned: list[PlannedRun], duration: float) -> np.ndarray:
        ways = [((planned[i], planned[j]), (planned[j], planned[i])) for i, j in pairs]
        return np.min([[expected_log_bayes(true, other, duration) for true, other in both] for both in ways], axis=1)

    settings = search_grid(models, instrument, least_log_bayes, progress, criteria)
    if not settings:
        return None
    simulated: dict[Setting, tuple[np.ndarray, np.ndarray]] = {}

    def simulate_each(chosen: Sequence[Setting], draws: int) -> None:
        for k, setting in enumerate(chosen):
            duration = settings[setting][0]
            progress(f"simulate, {draws} each", k / len(chosen), describe_run(setting, duration))
            factors = simulate_log_bayes(models, instrument.run(setting, duration), seed, draws)
            if factors is not None:
                simulated[setting] = _lesser_of_pairs(*factors, pairs)

    # First order fails where unknowns absorb much over long steps. One draw at each of the best angles chooses the
    # settings that are simulated again.
    pool: dict[tuple[int, int, float], Setting] = {}
    for setting in settings:
        pool.setdefault((setting.bobs, setting.lifted, setting.angle), setting)
    simulate_each(list(pool.values())[:_POOL], 1)
    chosen = rank_settings({setting: (0.0, mean) for setting, (mean, _) in simulated.items()}, criteria)[:_SIMULATED]
    simulate_each(chosen, _DRAWS)
    if not simulated:
        return None
    lower_bounds = [simulated[s][0] - _LUCK_SE * simulated[s][1] for s in chosen]
    separable = np.nanmax(lower_bounds, axis=0) >= criteria.equivalent_log_odds
    most = np.max([simulated[s][0] for s in chosen], axis=0)
    ranked = separable if separable.any() else np.ones(len(pairs), bool)
    plans = []
    for setting, (duration, predicted) in settings.items():
        mean, error = simulated.get(setting, (np.full(len(pairs), math.nan),) * 2)
        least = int(np.argmin(np.where(ranked, mean, math.inf)))
        plans.append(_plan(setting, instrument, duration, float(predicted[ranked].min()), mean[least], error[least]))
    plans.sort(key=lambda plan: (math.isnan(plan.standard_error), math.isnan(plan.simulated), -plan.expected_log_bayes))
    separated = dict.fromkeys(k for pair, yes in zip(pairs, separable, strict=True) if yes for k in pair)
    return Advice(
        tuple(plans),
        tuple(sets[k] for k in sorted(separated)),
        tuple((sets[i], sets[j]) for (i, j), yes in zip(pairs, separable, strict=True) if not yes),
        float(most[~separable].max(initial=-math.inf)) if not separable.all() else math.nan,
        criteria,
    )


def advise_on_lambda(fitted: FitResult, progress: Progress | None = None) -> Advice | None:
    """The runs that constrain λ of the first run's setting; None if λ is not defined."""
    gradient = _lambda_gradient(fitted)
    if gradient is None:
        return None
    instrument = Instrument.of(fitted)
    names = [u.name for u in fitted.likelihood.unknowns if not u.nuisance]
    own = [fitted.likelihood.names.index(name) for name in names]
    before = fitted.covariance[np.ix_(own, own)]
    g = np.array([gradient[name] for name in names])

    def gain(planned: list[PlannedRun], duration: float) -> np.ndarray:
        """Unknowns that the run does not have, such as k_f with one bob, keep their uncertainty."""
        view = planned[0].linearized.until(duration)
        shared = [i for i, name in enumerate(view.names) if name in names]
        rest = [i for i, name in enumerate(view.names) if name not in names]
        G = view.S.T @ view.S
        learned = G[np.ix_(shared, shared)]
        if rest:
            known = G[np.ix_(rest, rest)] + view.precision[np.ix_(rest, rest)]
            learned = learned - G[np.ix_(shared, rest)] @ np.linalg.solve(known, G[np.ix_(rest, shared)])
        at = [names.index(view.names[i]) for i in shared]
        after = np.linalg.inv(before)
        after[np.ix_(at, at)] += learned
        return np.array([0.5 * math.log((g @ before @ g) / (g @ np.linalg.solve(after, g)))])

    settings = search_grid([fitted], instrument, gain, progress or (lambda *_: None), DEFAULT_CRITERIA)
    plans = [_plan(s, instrument, duration, float(value[0])) for s, (duration, value) in settings.items()]
    return Advice(tuple(plans), ()) if plans else None


def _plan(setting: Setting, instrument: Instrument, duration: float, *information: float) -> Plan:
    release = Release(angle=setting.angle, bobs=setting.lifted, start=instrument.start)
    return Plan(setting, release, duration, *map(float, information))


def simulate_log_bayes(
    models: Sequence[FitResult], run: Any, seed: int, draws: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """(mean, standard error) of the log Bayes factor of model i over model j for data of model i, (M, M) each.

    The error is nan for one draw. Returns None if the run cannot be simulated.
    """
    planned = [PlannedRun(model, run) for model in models]
    factors = np.zeros((draws, len(models), len(models)))
    try:
        for draw, true in itertools.product(range(draws), range(len(models))):
            # The same random numbers in every setting, so that settings can be compared.
            readings, behind = planned[true].draw_readings(np.random.default_rng([seed, draw, true]))
            evidence = np.array([model.with_readings(readings).log_evidence(behind) for model in planned])
            factors[draw, true] = evidence[true] - evidence
    except (ImpossibleModelError, np.linalg.LinAlgError):
        return None
    error = factors.std(axis=0, ddof=1) / math.sqrt(draws) if draws > 1 else np.full(factors.shape[1:], math.nan)
    return factors.mean(axis=0), error


def _lesser_of_pairs(
    mean: np.ndarray, error: np.ndarray, pairs: Sequence[tuple[int, int]]
) -> tuple[np.ndarray, np.ndarray]:
    """The smaller one of the two log Bayes factors of each pair, and its standard error."""
    lesser = [(i, j) if mean[i, j] <= mean[j, i] else (j, i) for i, j in pairs]
    return np.array([mean[at] for at in lesser]), np.array([error[at] for at in lesser])


def _lambda_gradient(fitted: FitResult) -> dict[str, float] | None:
    """dλ/dx for the cradle's unknowns, by central differences of one standard deviation; None if λ is not defined."""
    likelihood = fitted.likelihood
    run = fitted.experiment.runs[0]
    deviations = np.sqrt(np.diag(fitted.covariance))
    if run.release is None or fitted.cradle.bobs == 1:
        return None
    release = run.release.release

    def rate(point: np.ndarray) -> float:
        return simulate(likelihood.cradle(likelihood.values(point)), release, ledger=False).newton_exponent()

    gradient = {}
    for i, u in enumerate(likelihood.unknowns):
        if not u.nuisance:
            step = np.zeros_like(fitted.point)
            step[i] = deviations[i]
            low, high = (np.clip(fitted.point + side * step, *bounds(likelihood)) for side in (-1.0, 1.0))
            try:
                gradient[u.name] = (rate(high) - rate(low)) / (high[i] - low[i])
            except (ImpossibleModelError, np.linalg.LinAlgError):
                return None
    usable = gradient and all(map(np.isfinite, gradient.values())) and any(gradient.values())
    return gradient if usable else None
