"""Representations of a posterior in a terminal and in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cradle_env import display
from identification.inference.posterior_plots import marginals_figure
from identification.inference.statistics import statistics
from identification.number_format import format_ratio, format_statistics, rounding_of, unit_plain

if TYPE_CHECKING:
    from identification.inference.posterior import Posterior


def line(posterior: Posterior) -> str:
    """Format a line: the unknowns of the cradle ± standard deviations, and whether the chains have converged."""
    parts = []
    for u in posterior.unknowns:
        if not u.nuisance:
            found = statistics(posterior.samples(u.name))
            text, exponent = format_statistics(found), rounding_of(found).exponent
            value = f"{text['median']} ± {text['sd']}"
            factor = f"({value})·" if exponent else f"{value} "
            parts.append(f"{u.name} = {factor}{unit_plain(u.unit, exponent)}".rstrip())
    return display.summary_line("Posterior", parts, "converged" if posterior.convergence.converged else "not converged")


def page(posterior: Posterior) -> str:
    """Format HTML: a table of all unknowns, and the marginal densities of those of the cradle."""
    known = [(u.name, u.unit, posterior.samples(u.name)) for u in posterior.unknowns]
    if posterior.newton_exponents is not None and posterior.synchronizes:
        known.append(("lambda", "1/s", posterior.newton_exponents.ravel()))
    rows = []
    for name, unit, samples in known:
        found = statistics(samples)
        text = format_statistics(found)
        rows.append((name, text["median"], text["sd"], text["ci95"], unit_plain(unit, rounding_of(found).exponent)))
    convergence, gap = posterior.convergence, posterior.gap
    state = "converged" if convergence.converged else f"not converged: {'; '.join(convergence.reasons)}"
    caption = (
        f"Posterior of {', '.join(run.file for run in posterior.experiment.runs)}; chains {state};"
        f" residuals over the noise {format_ratio(gap.train)} fitted, {format_ratio(gap.held_out)} held out"
    )
    header = ("unknown", "median", "sd", "95 % interval", "unit")
    picture = display.picture(marginals_figure(posterior), "Posterior density of each unknown of the cradle")
    return display.table(caption, rows, header) + picture
