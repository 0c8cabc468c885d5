"""The samples of a calibration, and what is known of their quality."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.experiment.experiment import Experiment
from identification.inference.convergence import Convergence
from identification.inference.gap import Gap
from identification.inference.likelihood import Likelihood
from identification.inference.unknowns import Unknown

#: What `summary.json` and `posterior.nc` are marked with.
FORMAT = "cradle-posterior/1"


@dataclass(frozen=True)
class Samples:
    """Samples of the unknowns of an experiment.

    chain: (E, S, W, D) sampled coordinates of E ensembles of W walkers over S steps after burn-in, D as `unknowns`;
    log_density: (E, S, W); newton_exponents: (E, S, W) λ of the first run's δ and release [1/s], nan for one bob, or
    None where the likelihood does not give it (`Posterior` then computes it on draws).
    """

    likelihood: Likelihood
    chain: np.ndarray
    log_density: np.ndarray
    newton_exponents: np.ndarray | None
    convergence: Convergence
    gap: Gap
    seed: int = 0

    @property
    def experiment(self) -> Experiment:
        """The experiment that was calibrated."""
        return self.likelihood.experiment

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """What was inferred, in the order of the chain's last axis."""
        return self.likelihood.unknowns
