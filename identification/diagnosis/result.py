"""The result of a diagnosis: an object, a model, and the way to its JSON and its report."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cradle_env.cradle import Cradle
from cradle_env.effects import LEARNED
from cradle_env.parameter_name import ParameterName
from identification.diagnosis import diagnosis_display
from identification.diagnosis.criteria import allowed_gap
from identification.diagnosis.diagnosis_content import diagnosis_content, step_content
from identification.diagnosis.learned_law.law import LearnedLaw
from identification.diagnosis.learned_law.law_shape import LawShape
from identification.diagnosis.next_experiment.expected_information import Advice
from identification.diagnosis.repair import RepairResult
from identification.diagnosis.report import render_report
from identification.diagnosis.selection.candidates import candidate_of_effect
from identification.diagnosis.selection.fit_cache import PointCache, compute_uncached
from identification.diagnosis.selection.rigid_strings import ELASTIC_STRINGS
from identification.diagnosis.uncertainty.detection_limits import DetectionLimit, compute_detection_limits
from identification.diagnosis.uncertainty.intervals import Interval, compute_intervals
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import FitResult, noise_is_estimated
from identification.progress import Progress
from identification.storage.files import write_file
from identification.storage.toml_table import toml_key, toml_text

if TYPE_CHECKING:
    import pandas

VERDICTS = ("nothing_missing", "named", "equivalent", "unknown")


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What `diagnose` found.

    Parameters
    ----------
    experiment : Experiment
        As given.
    repaired : RepairResult
        The models examined, the steps between them, and the law learned from the residuals of the last one.
    final : FitResult
        The last model, with its law, fitted to all readings that may be fitted.
    advice : Advice or None
        The next experiment; None if no run can be planned.
    seed : int
        Of the random numbers.
    warnings : tuple of str
        About the readings, about effects taken out of the model, and about criteria that are not the defaults.
    others : tuple of FitResult
        Models that fit as well as the repaired one, fitted to all readings.
    modes : tuple of FitResult
        Other modes of the last model, fitted to all readings.
    cache : callable
        Keeps computed limits, so that an interrupted report goes on.

    Examples
    --------
    >>> diagnosis = diagnose(Experiment.load("experiment.toml"))  # doctest: +SKIP
    >>> diagnosis.verdict, diagnosis.effects  # doctest: +SKIP
    ('named', ('quadratic_drag',))
    >>> diagnosis.model  # the repaired cradle, ready to simulate  # doctest: +SKIP
    >>> diagnosis.report("report.html")  # doctest: +SKIP
    """

    experiment: Experiment
    repaired: RepairResult
    final: FitResult
    advice: Advice | None
    seed: int
    warnings: tuple[str, ...] = ()
    others: tuple[FitResult, ...] = ()
    modes: tuple[FitResult, ...] = ()
    cache: PointCache = compute_uncached

    @property
    def base(self) -> FitResult:
        """The fit of the base model: the one given, or with rigid strings."""
        return self.repaired.examined[0].fitted

    @property
    def base_name(self) -> str:
        """The base model in words: "as given" or "with rigid strings"."""
        rigid = self.experiment.cradle.has(ELASTIC_STRINGS) and not self.base.cradle.has(ELASTIC_STRINGS)
        return "with rigid strings" if rigid else "as given"

    @property
    def law(self) -> LearnedLaw | None:
        """The law learned from the residuals of the last model; None if there is none that predicts."""
        return self.repaired.law

    @property
    def last(self) -> FitResult:
        """The fit of the repaired model, with its law, to the training part."""
        return self.repaired.last.fitted if self.law is None else self.law.fitted

    @functools.cached_property
    def shape(self) -> LawShape | None:
        """The learned law as functions."""
        return None if self.law is None else LawShape(self.law, self.final)

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`."""
        if self.repaired.alternatives:
            return "equivalent"
        if self.repaired.steps:
            return "named"
        return "unknown" if self.repaired.lacks_a_name else "nothing_missing"

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the missing effects that have no equivalent."""
        doubtful = {name for names in self.equivalent for name in names}
        return tuple(step.effect for step in self.repaired.steps if step.effect not in doubtful)

    @property
    def equivalent(self) -> tuple[tuple[str, ...], ...]:
        """Sets of effects, any one of which completes `effects`."""
        return tuple(tuple(candidate.name for candidate in several) for several in self.repaired.alternatives)

    @property
    def shared_effects(self) -> tuple[str, ...]:
        """Names among `effects` and `equivalent` that have one value for all bobs or gaps."""
        several = (candidate for set_ in self.repaired.alternatives for candidate in set_)
        named = (candidate_of_effect(s.after.experiment, s.before.experiment, s.effect) for s in self.repaired.steps)
        return tuple(dict.fromkeys(candidate.name for candidate in (*named, *several) if candidate.shared))

    @functools.cached_property
    def gap_first(self) -> float:
        """Held-out gap of the base model: RMS residual over the noise."""
        return self.base.held_out_gap()

    @functools.cached_property
    def gap_last(self) -> float:
        """Held-out gap of the repaired model, with its law."""
        return self.last.held_out_gap()

    @property
    def gap_allowed(self) -> float:
        """The held-out gap that a right model with these uncertainties stays below in 99 of 100 experiments."""
        return allowed_gap(self.last, noise_is_estimated(self.experiment))

    @functools.cached_property
    def parameters(self) -> dict[str, Interval]:
        """Median and 95 % interval of each unknown of the repaired model, by name.

        Those of the cradle's own unknowns cover all equivalent models.
        """
        result = compute_intervals(self.final, self.cache, self.modes)
        for other in (compute_intervals(other, self.cache) for other in self.others):
            for name in (name for name in result if name in other and ParameterName.parse(name).is_of_cradle):
                low, high = zip(result[name].ci95, other[name].ci95, strict=True)
                result[name] = dataclasses.replace(result[name], ci95=(min(low), max(high)))
        return result

    @property
    def model(self) -> Cradle:
        """The repaired model."""
        return self.final.cradle

    @functools.cached_property
    def detection_limits(self) -> tuple[DetectionLimit, ...]:
        """How strong each absent effect can be unnoticed; () if the model does not describe the data."""
        if self.repaired.lacks_a_name:
            return ()
        last = self.repaired.last
        return compute_detection_limits(last.fitted, last.score_test.scores, self.cache)

    def model_toml(self) -> str:
        """The repaired model as a [model] table with its parameters, and the cradle's own unknowns as comments."""
        cradle = self.model
        lines = ["# The repaired model of a diagnosis. Fitted along with it:"]
        lines += [
            f"#   {name} = {interval.median:.6g} {interval.unit}"
            for name, interval in self.parameters.items() if ParameterName.parse(name).is_of_cradle
        ]  # fmt: skip
        lines += ["[model]", f"base = {toml_text(cradle.model)}", f"effects = {toml_text([*cradle.effects])}"]
        known = {name: _shortest_values(name, values) for name, values in cradle.effects.items() if values}
        if known:
            lines += ["", "[model.parameters]"]
            lines += [f"{toml_key(name)} = {toml_text(values)}" for name, values in known.items()]
        return "\n".join([*lines, ""])

    def content(self, progress: Progress | None = None) -> dict[str, Any]:
        """The content of diagnosis.json. The intervals and detection limits take minutes if not yet computed."""
        return diagnosis_content(self, progress or (lambda *_: None))

    @property
    def steps(self) -> list[dict[str, Any]]:
        """The steps of diagnosis.json: each of `effects`, its parameters, and the gaps before and after.

        The intervals of the parameters take minutes if not yet computed.
        """
        return [step_content(self, step) for step in self.repaired.steps if step.effect in self.effects]

    def to_dataframe(self) -> pandas.DataFrame:
        """`steps` as a pandas DataFrame: one row per parameter, "key[i]" of bob or gap i.

        Columns: effect; parameter, unit, median, ci95_low and ci95_high in that unit; probability; gap_before,
        gap_after.
        """
        return diagnosis_display.steps_table(self)

    def report(self, path: str | Path) -> Path:
        """Writes the report, one HTML page that opens offline, and returns its path.

        >>> diagnosis.report("report.html")  # doctest: +SKIP
        """
        return write_file(Path(path), render_report(self, self.content()))

    def __repr__(self) -> str:
        return diagnosis_display.line(self)

    def _repr_html_(self) -> str:
        return diagnosis_display.page(self)


def _shortest_values(name: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """The values of an effect. A learned law has one number where all bobs or pairs agree, so it fits any cradle."""
    if all(name != learned.name for learned in LEARNED):
        return dict(values)
    return {key: v[0] if isinstance(v, tuple) and len(set(v)) == 1 else v for key, v in values.items()}
