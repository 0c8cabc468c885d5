"""The samples of a calibration, with their convergence and gap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.experiment.experiment import Experiment
from identification.inference.contributions import Contributions
from identification.inference.convergence import Convergence
from identification.inference.gap import Gap
from identification.inference.likelihood import Likelihood
from identification.inference.unknowns import Unknown

#: Format of `summary.json` and `posterior.nc`.
FORMAT = "cradle-posterior/1"


@dataclass(frozen=True)
class Samples:
    """Samples of the unknowns of an experiment.

    Parameters
    ----------
    likelihood : Likelihood
        The density that was sampled, with the experiment and its unknowns.
    chain : ndarray of shape (E, S, W, D)
        Sampled coordinates of E ensembles of W walkers over S steps after burn-in; D as `unknowns`.
    log_density : ndarray of shape (E, S, W)
        Log posterior density, up to a constant.
    newton_exponents : ndarray of shape (E, S, W), optional
        λ of the first run's δ and release [1/s]; nan for one bob; None if the likelihood does not give it. `Posterior`
        then simulates it for draws.
    convergence : Convergence
        Whether the chains have converged.
    gap : Gap
        RMS residuals over the noise, of a fit to the training part.
    seed : int
        Seed of all random numbers.
    contributions : Contributions, optional
        What each source contributes; None if there is one source alone.
    """

    likelihood: Likelihood
    chain: np.ndarray
    log_density: np.ndarray
    newton_exponents: np.ndarray | None
    convergence: Convergence
    gap: Gap
    seed: int = 0
    contributions: Contributions | None = None

    @property
    def experiment(self) -> Experiment:
        """The experiment that was calibrated."""
        return self.likelihood.experiment

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The unknowns, in the order of the chain's last axis."""
        return self.likelihood.unknowns
