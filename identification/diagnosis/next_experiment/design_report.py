"""The files of a design: design.json, design.png, experiment.toml, and report.html, one page that opens offline."""

from __future__ import annotations

import base64
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env.effects import effect
from cradle_env.plot_style import BLACK, bob_styles, png, quiet_grid, styled
from identification.diagnosis.next_experiment.design import FORMAT, Design
from identification.diagnosis.next_experiment.expected_information import Plan
from identification.diagnosis.next_experiment.planned_run import Instrument, PlannedRun
from identification.diagnosis.next_experiment.run_grid import describe_run
from identification.experiment.experiment_file import FILE_NAME
from identification.number_format import Rounding, format_number, unit_plain
from identification.reporting.html_page import render_experiment
from identification.storage.stamps import check_replaceable, write_results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: The file that is written last, and marks a folder as that of a design.
_STAMP = "design.json"
_PICTURE = "design.png"
_REPORT = "report.html"
#: Plans in the table.
_MAX_PLANS = 12


def check_folder(folder: Path) -> None:
    """Raises ExperimentError if a file in the folder is not as an earlier design wrote it.

    experiment.toml, for example, may describe the data, or the user may have corrected it.
    """
    check_replaceable(folder, (_STAMP, _PICTURE, _REPORT, FILE_NAME), _STAMP, FORMAT)


def save(design: Design, folder: Path) -> dict[str, Any]:
    """Writes all files, design.json last, and returns its content. If no run helps, there is no experiment.toml."""
    content = design.content()
    picture = png(design_figure(design))
    files: dict[str, str | bytes] = {_PICTURE: picture, _REPORT: render_report(design, content, picture)}
    check_folder(folder)
    planned = {} if design.advice.separates_none else {FILE_NAME: design.experiment_toml()}
    return write_results(folder, {**files, **planned}, _STAMP, content)


def advice_sentence(design: Design) -> str:
    """The advice in words."""
    advice, plan = design.advice, design.advice.plans[0]
    run = describe_run(plan.setting, plan.duration)
    if not design.sets:
        gain = math.exp(plan.predicted)
        return f"Do next: {run}. It should reduce the standard deviation of λ by a factor of {format_number(gain)}."
    if advice.separates_none:
        return advice.alternative
    sets = " from ".join(
        (" with ".join(advice.separates[0]), " and ".join(" with ".join(s) for s in advice.separates[1:]))
    )
    factor = format_information(plan)
    return f"Do next: {run}. It should tell {sets} with a log Bayes factor of {factor}. {advice.alternative}".strip()


def format_information(plan: Plan) -> str:
    """The simulated information of a run with its standard error; "–" if it was not simulated."""
    if math.isnan(plan.simulated):
        return "–"
    if math.isnan(plan.standard_error):
        return f"{format_number(plan.simulated)} (one draw)"
    rounding = Rounding.of(plan.simulated, max(plan.standard_error, 0.01))
    power = f" · {unit_plain('1', rounding.exponent)}" if rounding.exponent > 0 else ""
    if rounding.exponent < 0:
        return f"{plan.simulated:.2f} ± {plan.standard_error:.2f}"
    return f"{rounding.text(plan.simulated)} ± {rounding.text(plan.standard_error)}{power}"


def render_report(design: Design, content: dict[str, Any], picture: bytes) -> str:
    """The report. content: that of design.json."""
    named = dict.fromkeys(name for names in (design.certain, *design.sets) for name in names)
    return render_experiment(
        "design.html",
        "Design",
        design.experiment,
        content=content,
        sentence=advice_sentence(design),
        good=not design.advice.inseparable,
        sets=design.sets,
        declared={name: effect(name) for name in named},
        plans=[
            (plan, describe_run(plan.setting, plan.duration), format_information(plan))
            for plan in design.advice.plans[:_MAX_PLANS]
        ],
        picture=base64.b64encode(picture).decode(),
        experiment_toml="" if design.advice.separates_none else design.experiment_toml(),
        format_number=format_number,
    )


@styled
def design_figure(design: Design) -> Figure:
    """Expected information of each setting over the release angle, and the best run as predicted."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 6.4), layout="constrained")
    above, below = figure.subplots(2, 1)
    _plot_information(above, design)
    _plot_prediction(below, design)
    return figure


def _plot_information(axes: Axes, design: Design) -> None:
    plans = design.advice.plans
    lines = dict.fromkeys((p.setting.bobs, p.setting.lifted, p.setting.delta) for p in plans)
    for (bobs, lifted, delta), look in zip(lines, bob_styles(len(lines)), strict=True):
        own = sorted((p for p in plans if (p.setting.bobs, p.setting.lifted, p.setting.delta) == (bobs, lifted, delta)),
                     key=lambda p: p.setting.angle)  # fmt: skip
        label = f"{bobs} bob{'s' if bobs > 1 else ''}" + (f", {lifted} lifted, δ = {delta}" if bobs > 1 else "")
        axes.plot([p.setting.angle for p in own], [p.predicted for p in own], marker=".", label=label, **look)
    tried = [p for p in plans if not math.isnan(p.standard_error)]
    if tried:
        axes.errorbar(
            [p.setting.angle for p in tried], [p.simulated for p in tried], [p.standard_error for p in tried],
            color=BLACK, marker="s", markersize=4.0, linestyle="", capsize=3.0, label="simulated, ± standard error",
        )  # fmt: skip
    axes.set_xscale("log")
    angles = sorted({p.setting.angle for p in plans})
    axes.set_xticks(angles, [f"{angle:g}" for angle in angles])
    axes.minorticks_off()
    if design.sets:
        axes.set_yscale("symlog", linthresh=1.0)
        axes.set_ylim(bottom=min(0.0, *(p.predicted for p in plans), *(p.simulated for p in tried)))
        axes.set_ylabel("expected log Bayes factor")
    else:
        axes.set_ylabel("ln of the gain for λ")
    axes.set_xlabel("release angle [rad]")
    axes.set_title("Expected information of each run, to first order; runs that the models cannot predict are left out")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))
    quiet_grid(axes)


def _plot_prediction(axes: Axes, design: Design) -> None:
    """The best run as predicted.

    Between models: the residuals of the second, refitted to readings of the first. For λ: the standard deviation of the
    predicted readings over their noise.
    """
    plan = design.advice.plans[0]
    instrument = Instrument.of(design.models[0])
    run = instrument.run(plan.setting, plan.duration)
    planned = [PlannedRun(model, run) for model in design.models[:2]]
    view = planned[0].linearized
    shape = (len(run.times), plan.bobs)
    if design.sets:
        other = planned[1].with_readings(planned[0].predict(planned[0].prior_mean, 0, planned[0].rows[0])[0])
        point = other.find_mode()[0]
        curves = other.residuals(point)[: shape[0] * shape[1]].reshape(shape)
        first, second = (" with ".join(names) for names in design.sets[:2])
        title = f"Residuals of {second} if {first} is true, in this run: {describe_run(plan.setting, plan.duration)}"
        axes.set_ylabel("model − model\n[noise of a reading]")
        axes.axhspan(-1.0, 1.0, color="#E3E3E3", linewidth=0, label="noise, ± 1 sd")
    else:
        C = np.linalg.inv(view.precision)
        curves = np.sqrt(np.einsum("rd,de,re->r", view.S, C, view.S)).reshape(shape)
        title = f"Uncertainty of the predicted readings of this run: {describe_run(plan.setting, plan.duration)}"
        axes.set_ylabel("sd of the prediction\n[noise of a reading]")
    for bob, look in enumerate(bob_styles(plan.bobs)):
        axes.plot(run.times, curves[:, bob], linewidth=0.7, label=f"bob {bob + 1}", **{**look, "linestyle": "-"})
    axes.set_xlabel("time [s]")
    axes.set_title(title)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))
    quiet_grid(axes)
