"""Assess the convergence of chains: R̂, effective sample size, autocorrelation time.

Sources: Gelman & Rubin, Stat. Sci. 7, 457 (1992); Goodman & Weare, Comm. App. Math. Comp. Sci. 5, 65 (2010).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from identification.inference.search_options import DEFAULT, SearchOptions

if TYPE_CHECKING:
    from identification.inference.checkpoint import Chains

#: Fewest steps after burn-in for which the halves of a chain are compared.
_LEAST_STEPS = 4


@dataclass(frozen=True)
class Convergence:
    """Verdict on the convergence of chains.

    Parameters
    ----------
    converged : bool
        Whether all criteria are met.
    rhat_max : float
        Largest R̂ of all unknowns and λ.
    ess_min : float
        Smallest effective sample size.
    tau_max : float
        Longest integrated autocorrelation time [steps].
    steps : int
        Steps of each walker.
    burn_in : int
        Steps at the beginning that are not used.
    reasons : tuple of str
        The criteria that are not met.
    """

    converged: bool
    rhat_max: float
    ess_min: float
    tau_max: float
    steps: int
    burn_in: int
    reasons: tuple[str, ...] = ()


def assess_convergence(chains: Chains, options: SearchOptions = DEFAULT) -> Convergence:
    """Compute R̂, effective sample size and autocorrelation time of the slowest unknown, λ included, and the verdict.

    Burn-in is the first fifth, at least two autocorrelation times, and everything before the last adaptation, since an
    adapted chain depends on its past. R̂ compares the halves of the separate ensembles. Walkers of one ensemble are no
    independent chains, since they move by each other's positions. ESS is the number of all samples over τ.
    """
    E, S, W, _ = chains.chain.shape
    series = np.concatenate([chains.chain, chains.newton_exponent[..., None]], axis=-1)
    varying = np.isfinite(series).all(axis=(0, 1, 2)) & (series.std(axis=(0, 1, 2)) > 0.0)
    series = series[..., varying]
    adapted = max((step for step in options.adaptation_steps if step < S), default=S)
    if S - adapted <= _LEAST_STEPS or series.shape[-1] == 0:
        return Convergence(False, math.nan, 0.0, math.nan, S, S // 2, ("too few steps",))
    tau = _autocorrelation_time(series[:, min(max(S // 5, adapted), S // 2) :])
    burn = max(adapted, min(S // 2, max(S // 5, math.ceil(2.0 * tau))))
    kept = series[:, burn:]
    tau = _autocorrelation_time(kept)
    n = kept.shape[1] // 2
    halves = np.concatenate([kept[:, :n], kept[:, -n:]]).reshape(2 * E, -1, kept.shape[-1])
    within, between = halves.var(axis=1, ddof=1).mean(axis=0), halves.mean(axis=1).var(axis=0, ddof=1)
    rhat = float(np.sqrt(1.0 + between / within).max())
    ess = E * W * kept.shape[1] / tau
    times, wanted = kept.shape[1] / tau, options.min_autocorrelation_times
    reasons = []
    if not rhat < options.max_rhat:
        reasons.append(f"R̂ = {rhat:.4f}, wanted below {options.max_rhat}")
    if not ess >= options.min_ess:
        reasons.append(f"ESS = {ess:.0f}, wanted at least {options.min_ess:.0f}")
    if not kept.shape[1] >= wanted * tau:
        reasons.append(f"{kept.shape[1]} steps are {times:.0f} τ, wanted {wanted:.0f} τ (τ = {tau:.0f})")
    return Convergence(not reasons, rhat, float(ess), float(tau), S, burn, tuple(reasons))


def _autocorrelation_time(series: np.ndarray) -> float:
    """Integrated autocorrelation time [steps] of the slowest column of (E, S, W, K), at least 1.

    For a walker that never moved, it is the length of the chain.
    """
    import emcee  # brings scipy.stats, too: most commands need not wait for it

    slowest = 1.0
    for ensemble in series:
        with np.errstate(invalid="ignore"):
            tau = emcee.autocorr.integrated_time(ensemble, c=5, tol=0, quiet=True)
        stuck = (ensemble.max(axis=0) == ensemble.min(axis=0)).any(axis=0)
        slowest = max(slowest, float(np.where(stuck, len(ensemble), tau).max()))
    return slowest
