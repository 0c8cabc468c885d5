"""The normal approximation of a posterior about its best mode, with everything that widens it."""

from __future__ import annotations

import dataclasses

from identification.inference.impact_order_noise import estimate_impact_order_noise
from identification.inference.laplace import Mode
from identification.inference.likelihood import Likelihood
from identification.inference.mode_search import find_mode
from identification.inference.search_options import DEFAULT, SearchOptions
from identification.progress import Progress


def normal_approximation(
    likelihood: Likelihood, seed: int = 0, progress: Progress | None = None, options: SearchOptions = DEFAULT
) -> tuple[Likelihood, Mode]:
    """Find the best mode, and the covariance about it.

    Returns (the likelihood with its noise as known at the mode, with impact-order noise and inflations; the mode, whose
    covariance counts both). Raises ImpossibleModelError if no point can be simulated.
    """
    report = progress or (lambda *_: None)
    weighted, mode = find_mode(likelihood, seed, report, options)
    report("search", 0.95, "impact-order noise about the mode")
    known, mode = estimate_impact_order_noise(weighted, mode, options)
    inflations = weighted.noise_inflations(mode.point)
    known = known.with_noise(known.noise_model.with_inflations(inflations))
    return known, dataclasses.replace(mode, covariance=max(inflations) * mode.covariance)
