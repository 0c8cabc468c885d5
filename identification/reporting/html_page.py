"""Reports as one HTML page that opens offline and prints well."""

from __future__ import annotations

from typing import Any

from identification.experiment.experiment import Experiment
from identification.number_format import typographic_minus


def render_experiment(template: str, work: str, experiment: Experiment, **content: Any) -> str:
    """Fill a template whose heading names the work ("Calibration") and the experiment."""
    path = experiment.path
    return render(
        template,
        title=f"{work} of {'a cradle' if path is None else f'{path.resolve().parent.name}/{path.name}'}",
        cradle=experiment.cradle,
        runs=experiment.runs,
        effects=[effect.name for effect in experiment.cradle.composition],
        **content,
    )


def _format_floats(value: Any) -> Any:
    """Format a float, or a list of floats, with a typographic minus."""
    several = value if isinstance(value, list | tuple) else [value]
    return typographic_minus(str(value)) if several and all(isinstance(one, float) for one in several) else value


def render(template: str, **content: Any) -> str:
    """Fill a template that needs no experiment."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("identification.reporting")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, finalize=_format_floats)
    return environment.get_template(template).render(**content)
