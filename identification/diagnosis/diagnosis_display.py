"""A diagnosis as one line, as HTML for a notebook, and its steps as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env import display
from cradle_env.effects import effect
from identification.diagnosis.figures import comparison_figure, map_figure, window_tests
from identification.number_format import format_ratio

if TYPE_CHECKING:
    import pandas

    from identification.diagnosis.result import Diagnosis

_HEADER = ("effect", "most probable value", "probability", "gap before", "gap after")
_COLUMNS = (
    "effect", "parameter", "unit", "median", "ci95_low", "ci95_high", "probability", "gap_before", "gap_after",
)  # fmt: skip


def line(diagnosis: Diagnosis) -> str:
    """The verdict, the missing effects, and the held-out gap before and after."""
    parts = [diagnosis.verdict, *diagnosis.effects]
    if diagnosis.equivalent:
        parts.append(f"one of {' | '.join(' + '.join(names) for names in diagnosis.equivalent)}")
    gaps = f"held-out gap {format_ratio(diagnosis.gap_first)} → {format_ratio(diagnosis.gap_last)}"
    return display.summary_line("Diagnosis", parts, gaps)


def page(diagnosis: Diagnosis) -> str:
    """The steps at their most probable values, and the tests of the residuals, as HTML.

    It has no intervals, for these take minutes to compute; `to_dataframe` has them.
    """
    files = ", ".join(run.file for run in diagnosis.experiment.runs)
    caption = f"Diagnosis of {files}: {line(diagnosis).removeprefix('Diagnosis(').removesuffix(')')}"
    rows = []
    for step in diagnosis.repaired.steps:
        declared, values = effect(step.effect), diagnosis.model.effects.get(step.effect, {})
        units = {parameter.key: parameter.unit for parameter in declared.parameters}
        known = (f"{key} = {display.value_text(value)} {units[key]}".rstrip() for key, value in values.items())
        gaps = format_ratio(step.before.held_out_gap()), format_ratio(step.after.held_out_gap())
        rows.append((step.effect, ", ".join(known), f"{step.probability:.3f}", *gaps))
    first = diagnosis.repaired.examined[0]
    if window_tests(first):
        figure, description = map_figure(first), "Tests of the residuals of the base model, by bob and time"
    else:
        figure, description = comparison_figure(diagnosis), "Readings and residuals, before and after"
    return display.table(caption, rows, _HEADER) + display.picture(figure, description)


def steps_table(diagnosis: Diagnosis) -> pandas.DataFrame:
    """The steps as a DataFrame, see `Diagnosis.to_dataframe`."""
    import pandas

    rows: list[dict[str, Any]] = []
    for step in diagnosis.steps:
        whole = {name: step[name] for name in ("effect", "probability", "gap_before", "gap_after")}
        units = {parameter.key: parameter.unit for parameter in effect(step["effect"]).parameters}
        for key, estimate in step["parameters"].items():
            medians, intervals = np.atleast_1d(estimate["median"]), np.reshape(estimate["ci95"], (-1, 2))
            several = isinstance(estimate["median"], list)
            for i, (median, (low, high)) in enumerate(zip(medians, intervals, strict=True), start=1):
                name = f"{key}[{i}]" if several else key
                known = {"unit": units[key], "median": median, "ci95_low": low, "ci95_high": high}
                rows.append({**whole, "parameter": name, **known})
        if not step["parameters"]:
            rows.append(whole)
    return pandas.DataFrame(rows, columns=pandas.Index(_COLUMNS))
