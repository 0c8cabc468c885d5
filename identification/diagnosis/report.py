"""The files of a diagnosis: diagnosis.json, model.toml, and report.html, one page that opens offline."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cradle_env.effects import effect
from cradle_env.plot_style import png
from identification.diagnosis.criteria import exceeds_allowed_gap
from identification.diagnosis.diagnosis_content import FORMAT
from identification.diagnosis.figures import (
    candidates_figure,
    comparison_figure,
    energy_figure,
    law_figure,
    map_figure,
    window_tests,
)
from identification.diagnosis.residuals.residual_tests import describe_phase
from identification.number_format import (
    Rounding,
    format_estimate,
    format_number,
    format_ratio,
    markup,
    typographic_minus,
    unit_markup,
)
from identification.progress import Progress
from identification.reporting.html_page import render_experiment
from identification.storage.stamps import check_replaceable, write_results

if TYPE_CHECKING:
    from identification.diagnosis.result import Diagnosis

#: The file that is written last, and marks a folder as that of a diagnosis.
_STAMP = "diagnosis.json"
_FILES = ("report.html", "model.toml")
#: Plans in the table of what to measure next.
_MAX_PLANS = 6
#: Shift of an unknown [standard deviations] from which a hidden effect is listed.
_MIN_SHIFT_SD = 1.0
#: Shift of an unknown [standard deviations] above which the table says "or more": first order no longer holds.
_MAX_SHIFT_SD = 100.0


def check_folder(folder: Path) -> None:
    """Raises ExperimentError if a folder holds files that a diagnosis would replace but did not write."""
    check_replaceable(folder, (_STAMP, *_FILES), _STAMP, FORMAT)


def save(diagnosis: Diagnosis, folder: Path, progress: Progress | None = None) -> dict[str, Any]:
    """Writes report.html, model.toml and last diagnosis.json, and returns the content of the latter."""
    content = diagnosis.content(progress)
    if progress:
        progress("draw", 0.0, "the report")
    texts = (render_report(diagnosis, content), diagnosis.model_toml())
    return write_results(folder, dict(zip(_FILES, texts, strict=True)), _STAMP, content)


def render_report(diagnosis: Diagnosis, content: Mapping[str, Any]) -> str:
    """The report as HTML. content: of diagnosis.json."""
    first, advice = diagnosis.repaired.examined[0], diagnosis.advice
    pictures = {
        **({"map": map_figure(first)} if window_tests(first) else {}),
        **({"energy": energy_figure(diagnosis)} if content["energy"] else {}),
        "candidates": candidates_figure(diagnosis),
        "comparison": comparison_figure(diagnosis),
    }
    if diagnosis.shape is not None:
        pictures["law"] = law_figure(diagnosis.shape)
    named = [*diagnosis.effects, *(name for names in diagnosis.equivalent for name in names)]
    return render_experiment(
        "diagnosis.html",
        "Diagnosis",
        diagnosis.experiment,
        content=content,
        sentence=verdict_sentence(content),
        good=content["verdict"] in ("nothing_missing", "named")
        and not content["remainder"]["significant"]
        and not _fails_prediction(content),
        declared={name: effect(name) for name in dict.fromkeys(named)},
        base_name=diagnosis.base_name,
        base=_base_rows(diagnosis, diagnosis.base.values),
        last=_interval_rows(diagnosis),
        steps=[
            {
                **step,
                "probability": _format_probability(step["probability"]),
                **{k: format_ratio(step[k]) for k in _GAPS},
            }
            for step in content["steps"]
        ],
        gaps={key: format_ratio(content[key]) for key in ("gap_first", "gap_last", "gap_allowed")},
        scores=[
            {**row, **{key: _format_number(row[key]) for key in _SCORES}, "gap": format_ratio(row["gap"])}
            for row in content["candidates"]
        ],
        plans=[] if advice is None or advice.separates_none else advice.plans[:_MAX_PLANS],
        instead="" if advice is None else advice.alternative,
        released=diagnosis.experiment.runs[0].release is not None,
        pictures={name: base64.b64encode(png(figure)).decode() for name, figure in pictures.items()},
        model_toml=diagnosis.model_toml(),
        format_number=format_number,
        describe_phase=describe_phase,
        law=_law_context(content["remainder"]["law"]),
        detection_limits=_limits_context(diagnosis),
    )  # fmt: skip


def _law_context(law: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """A learned law for the page's template."""
    if law is None:
        return None
    terms = []
    for term in law["terms"]:
        median, interval, exponent = format_estimate(term["median"], term["ci95"])
        terms.append({**term, "median": median, "interval": interval, "unit": unit_markup(term["unit"], exponent)})
    gaps = {key: format_ratio(value) for key, value in law.items() if "gap" in key}
    return {**law, **gaps, "terms": terms, "energy": _energy_phrase(law["energy_taken"]["value"])}


def _limits_context(diagnosis: Diagnosis) -> dict[str, Any]:
    """Detection limits for the page's template: symbols of the unknowns, and rows of effects that could bias them."""
    symbols = {u.name: markup(u.symbol) for u in diagnosis.final.likelihood.unknowns}
    names, rows = next((list(one.shifts_sd) for one in diagnosis.detection_limits if one.shifts_sd), []), []
    for one in diagnosis.detection_limits:
        name = one.effect + (", all alike" if one.shared else "")
        if one.limit is None:
            rows.append({"name": name, "limit": None, "shifts": ["–" for _ in names]})
        elif max(map(abs, one.shifts_sd.values())) >= _MIN_SHIFT_SD:
            least = math.isinf(one.parameter.absent)
            bar = "" if one.parameter.one_sided else "|"
            rounding = Rounding.of(one.limit, 0.1 * abs(one.limit))
            rows.append({
                "name": name, "symbol": bar + markup(one.parameter.symbol) + bar,
                "sign": "≥" if least else "≤", "limit": rounding.text(abs(one.limit)),
                "unit": unit_markup(one.parameter.unit, rounding.exponent),
                "shifts": [_format_shift(shift) for shift in one.shifts_sd.values()],
            })  # fmt: skip
    return {"symbols": [symbols[name] for name in names], "rows": rows}


def _format_shift(sd: float) -> str:
    """A shift of an unknown, in its standard deviations."""
    most = f"{math.copysign(_MAX_SHIFT_SD, sd):+.0f} or more"
    return typographic_minus(f"{sd:+.1f}" if abs(sd) < _MAX_SHIFT_SD else most)


def _energy_phrase(taken: float) -> str:
    return f"{'take' if taken >= 0.0 else 'give'} {1e3 * abs(taken):.3g} mJ"


_SCORES = ("predicted_delta_chi2", "p", "delta_chi2", "log_evidence")
_GAPS = ("gap_before", "gap_after", "train_before", "train_after")


def verdict_sentence(content: Mapping[str, Any]) -> str:
    """The verdict in words."""
    names = ", ".join(step["effect"] for step in content["steps"])
    gaps = f"the held-out gap goes from {format_ratio(content['gap_first'])} to {format_ratio(content['gap_last'])}"
    remainder = content["remainder"]
    fails = (
        f" But the held-out residual is {format_ratio(content['gap_last'])} × noise. A right model with these"
        f" uncertainties stays below {format_ratio(content['gap_allowed'])} in 99 of 100 experiments, so something"
        " else is missing."
        if _fails_prediction(content)
        else ""
    )
    rest = (
        f" The residuals still hold more than noise (p = {_format_number(remainder['p'])}): {remainder['described']}."
        if remainder["significant"]
        else ""
    )
    if content["verdict"] == "nothing_missing":
        gap = format_ratio(content["gap_last"])
        return f"No missing effect is found: the residuals are noise (held-out gap {gap}).{fails}{_hidden(content)}"
    if content["verdict"] == "named":
        them = "it" if len(content["steps"]) == 1 else "them"
        return f"Missing from the model: {names}; with {them}, {gaps}.{rest}{fails}"
    if content["verdict"] == "equivalent":
        sets = " or ".join(" with ".join(members) for members in content["equivalent"])
        certain = f"Missing from the model: {names}, and one of" if names else "Missing from the model: one of"
        return f"{certain} {sets}, which these data do not tell apart; {gaps}.{rest}{fails}"
    law = "" if remainder["law"] is None else f" With a law learned from the data, {gaps}."
    return f"Something is missing that no set of effects explains, or a stated value is wrong.{law}{rest}"


def _hidden(content: Mapping[str, Any]) -> str:
    """The absent effect that could bias an unknown most without being noticed, if that is by a standard deviation."""
    limits = [one for one in content["unseen"] if one["moves_sd"]]
    if not limits:
        return ""
    one = limits[0]
    name, sd = max(one["moves_sd"].items(), key=lambda pair: abs(pair[1]))
    if abs(sd) < 1.0:
        return ""
    which = "most" if "most" in one else "least"
    return (
        f" These data can hide {one['effect']} with {one['parameter']} of at {which}"
        f" {format_number(abs(one[which]), 2)} {one['unit']}. It would move {name} by {abs(sd):.0f} standard"
        " deviations."
    )


def _fails_prediction(content: Mapping[str, Any]) -> bool:
    """Whether the repaired model fails on the held-out data.

    It tests misspecified models, too, unlike `criteria.fails_prediction`: the reader wants to know.
    """
    return exceeds_allowed_gap(content["gap_last"], content["gap_allowed"])


def _format_number(value: float | None) -> str:
    return "–" if value is None else "< 0.001" if 0.0 <= value < 1e-3 else format_number(value)


def _format_probability(value: float) -> str:
    return "> 0.999" if value > 0.999 else f"{value:.3f}"


def _base_rows(diagnosis: Diagnosis, values: Mapping[str, float]) -> list[tuple[str, str, str]]:
    """(symbol, value, unit) of the cradle's unknowns in the base model."""
    unknowns = [u for u in diagnosis.base.likelihood.unknowns if not u.nuisance]
    rows = []
    for u in unknowns:
        rounding = Rounding.of(values[u.name], abs(values[u.name]) * 1e-2)
        rows.append((markup(u.symbol), rounding.text(values[u.name]), unit_markup(u.unit, rounding.exponent)))
    return rows


def _interval_rows(diagnosis: Diagnosis) -> list[tuple[str, str, str, str, str]]:
    """(symbol, name, median, 95 % interval, unit) of the cradle's unknowns in the repaired model."""
    rows = []
    for u in diagnosis.final.likelihood.unknowns:
        if not u.nuisance:
            own = diagnosis.parameters[u.name]
            median, interval, exponent = format_estimate(own.median, own.ci95)
            rows.append((markup(u.symbol), u.name, median, interval, unit_markup(u.unit, exponent)))
    return rows
