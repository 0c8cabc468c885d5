"""The options of the inference that an expert may want to change."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from cradle_env.errors import check_range


@dataclass(frozen=True)
class SearchOptions:
    """How a calibration searches for the mode, samples the posterior, and checks predictions.

    The defaults are those with which the studies were made. Fewer draws are faster and miss the best mode more often.

    Parameters
    ----------
    draws : int
        Random points in the search box whose χ² on the early data is computed. 240 are 20 for each slice of κ.
    kappa_slices : int
        Slices of the search box in κ. The best draw of each is refined: modes of κ are narrow, and the other unknowns
        change χ² more than κ does.
    best_draws : int
        The best draws of all that are refined beside those of the slices.
    early_periods : float
        Length of the first early data [small-angle periods], over which the misfit has few minima.
    early_growth : float
        Each early data are this many times as long as the last, until all data. Between three bobs or more, small
        differences grow: a fit to n periods lies near its mode over 1.3 n periods, but often not over 2 n.
    early_modes : int
        Modes that go on from each early data to the next.
    mode_separation : float
        Modes whose κ differ by less than this fraction count as one.
    finished_modes : int
        Modes of the early data that are refined on all data.
    kappa_steps : tuple of float
        Relative steps of κ to its shallow modes, which lie 1 to 2 % apart.
    close_kappa_steps : tuple of float
        Relative steps of κ, to both sides, to modes that lie nearer, as those of three or more bobs do.
    close_kappa_modes : int
        Of the points at these steps, how many are refined.
    converged_gain : float
        Least squares ends when a step lowers χ² by less than this number per χ² of one reading.
    broyden_error : float
        Use a Broyden update while the last step's prediction error is below this fraction of the change in residuals;
        otherwise recompute the Jacobian.
    descent_rounds : int
        Steps at most of a descent over a nonsmooth misfit.
    descent_gain : float
        A descent ends when a step lowers χ² by less than this number, in units of the reduced χ² (at least 1).
    random_steps : int
        Random steps tried at a time where a nonsmooth misfit does not follow its derivatives.
    random_failures : int
        Such trials in a row that may fail before the descent ends.
    impact_order_draws : int
        Pairs of points from which the covariance of impact-order noise is estimated.
    impact_order_factor : float
        Multiplies the standard deviation of impact-order noise in the sampled density, for jumps that were not drawn.
        Intervals widen by less than a tenth; the density becomes far smoother.
    overdispersion : float
        Walkers start this many times as wide as the Laplace approximation, so that they converge from outside.
    move_weights : tuple of float
        Shares of the independence move, of differential evolution and of the snooker move. Sum 1.
    adaptation_steps : tuple of int
        Steps after which the independence move is adapted to the chains. Samples before the last one are burn-in.
    max_rhat : float
        R̂ below which chains count as converged.
    min_ess : float
        Effective sample size from which on they do.
    min_autocorrelation_times : float
        Length of the chains [autocorrelation times] from which on they do.
    predictive_chance : float
        Probability with which a correct model exceeds the predictive bound of the held-out gap.
    predictive_points : int
        Points drawn from the Laplace approximation for this bound.
    predictive_noises : int
        Draws of noise for each of these points.

    Raises
    ------
    ValueError
        For a number outside its range.

    Examples
    --------
    >>> SearchOptions(draws=480).draws
    480
    >>> SearchOptions(max_rhat=0.5)
    Traceback (most recent call last):
    ValueError: max_rhat is 0.5; it must be greater than 1
    """

    draws: int = 240
    kappa_slices: int = 12
    best_draws: int = 6
    early_periods: float = 2.0
    early_growth: float = 1.3
    early_modes: int = 6
    mode_separation: float = 2e-4
    finished_modes: int = 4
    kappa_steps: tuple[float, ...] = (-0.06, -0.045, -0.03, -0.02, -0.01, 0.01, 0.02, 0.03, 0.045, 0.06)
    close_kappa_steps: tuple[float, ...] = (0.0003, 0.0007, 0.0015, 0.003, 0.006)
    close_kappa_modes: int = 4
    converged_gain: float = 1e-3
    broyden_error: float = 0.3
    descent_rounds: int = 8
    descent_gain: float = 0.5
    random_steps: int = 48
    random_failures: int = 4
    impact_order_draws: int = 64
    impact_order_factor: float = 10.0
    overdispersion: float = 1.5
    move_weights: tuple[float, float, float] = (0.6, 0.3, 0.1)
    adaptation_steps: tuple[int, ...] = (40, 240)
    max_rhat: float = 1.01
    min_ess: float = 400.0
    min_autocorrelation_times: float = 50.0
    predictive_chance: float = 0.01
    predictive_points: int = 64
    predictive_noises: int = 200

    def __post_init__(self) -> None:
        check_range("max_rhat", self.max_rhat, "", 1.0, above=True)
        check_range("early_periods", self.early_periods, "", 0.0, above=True)
        check_range("early_growth", self.early_growth, "", 1.0, above=True)
        check_range("early_modes", self.early_modes, "", 1)
        check_range("finished_modes", self.finished_modes, "", 1)
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, int | float):
                check_range(field.name, value, "", 0.0)
        if not self.adaptation_steps:
            raise ValueError("adaptation_steps is empty; give one step or more, such as (40,)")
        if abs(sum(self.move_weights) - 1.0) > 1e-9:
            raise ValueError(f"move_weights sum to {sum(self.move_weights):g}; they must sum to 1")


#: The options of a search that states none.
DEFAULT = SearchOptions()
