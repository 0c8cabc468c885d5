"""The numbers by which a diagnosis decides, and the decisions that several of its steps share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

from scipy.special import ndtri

from cradle_env.errors import check_range
from identification.inference import nonsmooth
from identification.inference.fit_result import FitResult
from identification.inference.search_options import DEFAULT

#: Training gap [noise] from which a model is misspecified: its residuals are systematic, so χ² and the evidence say
#: little about which effect is missing, and predictions decide instead. The nonsmooth optimizer counts the same χ² per
#: reading, the square of this, as far from a mode.
MISSPECIFIED_GAP = math.sqrt(nonsmooth.MISSPECIFIED_CHI2_SCALE)

# Continuation in the horizon (selection/continuation.py).

#: Small-angle periods of the first horizon. Over two the misfit has few minima.
FIRST_PERIODS = 2.0
#: Factor by which each horizon is longer than the last. With three bobs or more it is that of the search for modes, see
#: `SearchOptions.early_growth`.
HORIZON_GROWTH = 2.0
#: Share of the run from which on a horizon is replaced by all data: refining twice over nearly the same data is waste.
LAST_SHARE = 0.75
#: Modes followed at most: bounds the cost of a horizon.
MAX_BASINS = 3
#: Distance from the best within which modes are followed and models are finished [units of χ²]: early data, and fits
#: that are not finished, rank by chance.
MAX_DISTANCE = 60.0
#: Evaluations of least squares over each horizon, and over all data to see where a start leads.
EVALUATIONS = 6
#: The same over each horizon with three bobs or more. There 6 end far from the modes of values per gap.
NONSMOOTH_EVALUATIONS = 10
#: Evaluations over all data to the end.
FINAL_EVALUATIONS = 30
#: Standard deviations of ln k_f, ln κ and ln b about their stated values while the data are short. Short data hardly
#: constrain one of them, and least squares would drift along that ridge. The evidence has the same priors.
EARLY_PRIORS = {"k_f": 0.3, "kappa": 0.2, "b": 0.7}
#: Factor to which χ² must be what the parabola about a mode predicts for a point to be of the same basin.
SAME_BASIN = 2.0
#: Standard deviations of ln κ that must reach half way to the next mode for it to be tried: 2 are 95 %.
OPEN_SD = 2.0

# The search over models (selection/model.py, selection/model_search.py).

#: Strengths from which a candidate starts on early data [declared scales]: basins exist in strengths, too.
EARLY_STRENGTHS = (0.1, 1.0, 3.0, 10.0)
#: Strengths from which it starts at the mode of the model without it, over all data.
LATE_STRENGTHS = (0.01, 0.1, 1.0)
#: Of each, the starts with the least misfit that are refined: basins in strengths are two, weak and strong.
STARTS = 2
#: Modes kept of each model.
MODES_KEPT = 5
#: Distance from the best model of a size within which others are compared [units of χ²]: 20 is e⁻¹⁰ in likelihood.
COMPARED_WITHIN = 20.0
#: Models whose modes are tried in all others, and models of a size that are extended: the best.
BEAM = 3
#: Effects added at most. More were right in no case of the studies.
MAX_EFFECTS = 4
#: p of the residual scan from which on first order shows what a model lacks, and no law competes with a single effect.
#: Where one effect imitated a force of no catalogue it left 0.045 and 0.012; right effects left 0.02 to 1.
SETTLED = 0.1
#: Gain in χ² to first order below which a candidate of such a model is not fitted: half of it cannot pay for the prior
#: of an effect, ln 30, and its strength.
WORTH_A_FIT = 4.0

# The evidence (selection/evidence.py).

#: Prior probability of each further effect over that of none further, shared by all candidates.
ANOTHER = 0.5
#: Standard deviation of the log-normal prior of a shape about its declared scale: a factor of three.
SHAPE_SD = math.log(3.0)

#: Replicates of the residual scan: at 1 % of 400, four are above.
REPLICATES = 400

#: Standard deviations of a normal distribution up to the bound of the held-out gap.
_BOUND_SD = -float(ndtri(DEFAULT.predictive_chance))


@dataclass(frozen=True)
class Criteria:
    """The thresholds of a diagnosis that an expert may change.

    Each default was chosen for few false names: a diagnosis rather says "nothing missing" or "equivalent" than names
    an effect that is not there (docs/study.md counts both).

    Parameters
    ----------
    significance_level : float
        p-value below which a model leaves more than noise. It is that of the largest of many statistics, so a right
        model is refuted at this rate. A smaller level refutes fewer names. Names are chosen by evidence alone.
    equivalent_log_odds : float
        Difference in log evidence below which data do not tell two models apart. 3 is odds of 20 to 1.
    noise_excess_sd : float
        Excess of χ² over the number of readings, in its standard deviations, up to which χ² alone says "only noise".
    fault_excess_sd : float
        The same excess from which instrument faults and runs of different cradles are looked for. It is larger, for a
        fault is reported as an error.
    fault_explained_share : float
        Share of that excess which an instrument fault must explain to be reported. A missing effect leaves residuals
        all over the run, of which one fault explains less.
    run_difference_sd : float
        Difference of an unknown between two runs, in its standard deviations, that different cradles must show.
    min_length_difference, min_k_f_difference : float
        Relative difference in length or k_f that different cradles must show besides. Smaller ones can come from a
        missing effect.
    min_readings_per_unknown : int
        Readings per unknown that the training part must hold.
    min_periods : float
        Small-angle periods that each run must last.
    min_readings_per_period : float
        Readings that each small-angle period must hold.

    Raises
    ------
    ValueError
        If a number is outside its range.

    Examples
    --------
    >>> from identification.diagnosis.criteria import Criteria
    >>> Criteria(significance_level=0.001).changes()
    ('significance_level = 0.001 instead of 0.01',)
    """

    significance_level: float = 0.01
    equivalent_log_odds: float = 3.0
    noise_excess_sd: float = 1.0
    fault_excess_sd: float = 6.0
    fault_explained_share: float = 0.9
    run_difference_sd: float = 10.0
    min_length_difference: float = 0.004
    min_k_f_difference: float = 0.1
    min_readings_per_unknown: int = 5
    min_periods: float = 2.0
    min_readings_per_period: float = 6.0

    def __post_init__(self) -> None:
        shares = ("significance_level", "fault_explained_share")
        for field in fields(self):
            high = 1.0 if field.name in shares else math.inf
            check_range(field.name, getattr(self, field.name), "", 0.0, high, above=True)

    def changes(self) -> tuple[str, ...]:
        """What differs from the defaults, one line each."""
        own = ((field.name, getattr(self, field.name), field.default) for field in fields(self))
        return tuple(f"{name} = {value:g} instead of {default:g}" for name, value, default in own if value != default)


#: The criteria of a diagnosis that is given none.
DEFAULT_CRITERIA = Criteria()


def chi2_excess_sd(fitted: FitResult) -> float:
    """Excess of χ² over the number of readings R, in the standard deviation √(2R) that white noise gives it."""
    return (fitted.chi2 - fitted.count) / math.sqrt(2.0 * fitted.count)


def only_noise(fitted: FitResult, criteria: Criteria) -> bool:
    """Whether χ² on the training part is no larger than noise alone makes it.

    Searches use this quick test to stop. It differs on purpose from `ExaminedModel.significant`, which decides the
    verdict: that one looks for structure in the residuals, which can be significant while χ² is not.
    """
    return chi2_excess_sd(fitted) < criteria.noise_excess_sd


def may_hold_faults(fitted: FitResult, criteria: Criteria) -> bool:
    """Whether χ² is so far above the number of readings that the data themselves are checked for faults."""
    return chi2_excess_sd(fitted) >= criteria.fault_excess_sd


def is_misspecified(fitted: FitResult) -> bool:
    """Whether the training gap of a model is above MISSPECIFIED_GAP."""
    return fitted.training_gap() > MISSPECIFIED_GAP


def exceeds_allowed_gap(gap: float, allowed: float) -> bool:
    """Whether a held-out gap is larger than a right model leaves in 99 of 100 experiments, see `predictive_check`."""
    return gap > allowed


def allowed_gap(fitted: FitResult, estimated: Sequence[bool]) -> float:
    """The held-out gap that a right model stays below in 99 of 100 experiments; see `predictive_check`.

    estimated: of each run, whether its noise was. An estimate without a model errs by some per cent, as much as the
    bound allows. The residuals of the training part tell the noise better, so the bound is taken relative to them, and
    widened by their own scatter.
    """
    if not any(estimated):
        return fitted.predictive_bound
    scatter = _BOUND_SD * math.sqrt(fitted.effective_sample.inflation / (2.0 * fitted.count))
    return fitted.training_gap() * (1.0 + math.hypot(fitted.predictive_bound - 1.0, scatter))


def fails_prediction(fitted: FitResult, estimated: Sequence[bool]) -> bool:
    """Whether a model that fits the training part fails on the held-out data. estimated: see `allowed_gap`.

    A misspecified model never counts: near no mode of its own, it has no predictive distribution to compare with.
    """
    return not is_misspecified(fitted) and exceeds_allowed_gap(fitted.held_out_gap(), allowed_gap(fitted, estimated))
