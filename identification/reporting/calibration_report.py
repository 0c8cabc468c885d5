"""The report of a calibration: one HTML file that opens offline and prints well."""

from __future__ import annotations

import base64
import platform
from collections.abc import Mapping
from importlib import metadata
from typing import Any

import numpy as np

from cradle_env.effects import CATALOGUE
from cradle_env.parameter_name import ParameterName
from identification.inference.posterior import Posterior
from identification.number_format import (
    format_number,
    format_ratio,
    format_statistics,
    markup,
    rounding_of,
    unit_markup,
)
from identification.reporting.html_page import render_experiment
from identification.reporting.verdicts import convergence_verdict, disagreement_warnings, model_verdict

_MEANINGS = {
    "k_f": "viscoelastic dissipation in impacts",
    "kappa": "loading stiffness of one string",
    "b": "linear drag of one bob",
    "length": "pendulum length",
    "pivot_half_spacing": "half the distance between a bob's two pivots",
    "mass": "mass of a bob",
    "radius": "radius of a bob",
    "youngs_modulus": "Young's modulus of the bobs",
    "poisson_ratio": "Poisson's ratio of the bobs",
    "delta": "gap between pivots over the diameter, less 1",
    "gravity": "acceleration of gravity",
    "restitution": "coefficient of restitution",
    "lambda": "Newton exponent: σ falls about as exp(−λt)",
}
_CAPTIONS = {
    "lambda.png": (
        "The Newton exponent λ and the fall of σ(t)",
        "Left: posterior density of λ with its 68 and 95 % intervals. Right: σ(t) over draws of the posterior, and"
        " exp(−λt) at the median λ.",
    ),
    "contributions.png": (
        "What each measurement contributes",
        "68 and 95 % intervals of each parameter from each source alone, from all of them, and from all without each;"
        " – where they do not tell it. The intervals from all are those of the sampled posterior, and the bands repeat"
        " them; the others are those of a normal approximation. Sources that disagree have red names.",
    ),
    "fit.png": (
        "The data and the model",
        "For each bob, the readings and the 95 % bands of the posterior, without and with the noise of one reading."
        " Right: the last swings, as measured and with the model's mean subtracted, which makes the bands visible.",
    ),
    "residuals.png": (
        "Residuals",
        "Readings minus the most probable model, in units of the noise, by bob and time. A complete model leaves only"
        " random scatter. Any structure shows an effect that the model of cradle or measurement lacks.",
    ),
    "corner.png": (
        "The joint posterior",
        "Contours hold 68 and 95 % of the probability; lines mark the median and the central 68 %.",
    ),
}
_PACKAGES = ("newtons-cradle", "numpy", "scipy", "numba", "emcee", "arviz")


def calibration_html(posterior: Posterior, summary: Mapping[str, Any], pictures: Mapping[str, bytes]) -> str:
    """Write the report as HTML. summary: of the posterior; pictures: PNG files by name, shown if in `_CAPTIONS`."""
    entries = {name: _row(posterior, name, found) for name, found in summary["parameters"].items()}
    if summary["lambda"]:
        entries["lambda"] = _row(posterior, "lambda", summary["lambda"])
    return render_experiment(
        "calibration.html",
        "Calibration",
        posterior.experiment,
        summary=summary,
        convergence=convergence_verdict(summary),
        model=model_verdict(summary),
        disagreements=disagreement_warnings(summary),
        rows=list(entries.values()),
        nuisance=[_row(posterior, name, found) for name, found in summary["nuisance"].items()],
        window=summary["lambda"]["window_s"] if summary["lambda"] else None,
        gap=[
            (name, format_ratio(summary["gap"][key])) for name, key in (("fitted", "train"), ("held out", "held_out"))
        ],
        rms=_rms_rows(posterior),
        pictures=[
            (*_CAPTIONS[name], base64.b64encode(pictures[name]).decode()) for name in _CAPTIONS if name in pictures
        ],
        experiment_text=posterior.experiment.text,
        versions=[("Python", platform.python_version()), *((name, metadata.version(name)) for name in _PACKAGES)],
    )


def _row(posterior: Posterior, name: str, found: Mapping[str, Any]) -> dict[str, str]:
    """A row of a table of parameters: name, meaning, symbol and unit as HTML, and rounded numbers."""
    symbol = "λ" if name == "lambda" else next(u.symbol for u in posterior.unknowns if u.name == name)
    return {
        "name": name,
        "symbol": markup(symbol),
        "unit": unit_markup(found["unit"], rounding_of(found).exponent),
        "meaning": _meaning(name),
        **format_statistics(found),
    }


def _meaning(text: str) -> str:
    """What an unknown is, in a few words."""
    name = ParameterName.parse(text)
    for declared in CATALOGUE:
        for parameter in declared.parameters:
            if (declared.name, parameter.key) == (name.effect, name.key):
                return parameter.meaning
    return _MEANINGS.get(text, "")


def _rms_rows(posterior: Posterior) -> list[tuple[str, str, str, str]]:
    """(where, bob, RMS in mrad, RMS in mm) of the residuals of the fit that measures the gap."""
    if posterior.experiment.runs[0].of_impacts:  # neither an angle nor a distance
        return []
    length = posterior.experiment.cradle.length
    per_radian = 1.0 if posterior.experiment.runs[0].quantity == "theta" else 1.0 / length
    rows = []
    for part, values in posterior.gap.rms.items():
        for bob, value in enumerate(np.asarray(values)):
            if np.isfinite(value):
                angle = value * per_radian
                where = part.replace("_", " ").replace("train", "fitted")
                rows.append(
                    (where, str(bob) if bob else "all", format_number(1e3 * angle), format_number(1e3 * angle * length))
                )
    return rows
