"""What a diagnosis found, as an object, as JSON and as a model."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cradle_env import __version__
from cradle_env.cradle import Cradle
from cradle_env.effects import LEARNED
from cradle_env.effects.elements import element_of
from identification.diagnosis import diagnosis_display
from identification.diagnosis.learned_law.law import LearnedLaw
from identification.diagnosis.learned_law.law_shape import LawShape, describe_terms
from identification.diagnosis.next_experiment.expected_information import Advice
from identification.diagnosis.repair import RepairResult
from identification.diagnosis.report import FORMAT, render_report
from identification.diagnosis.residuals.residual_tests import describe_phase
from identification.diagnosis.selection.candidates import candidate_of_effect
from identification.diagnosis.selection.rigid_strings import ELASTIC_STRINGS, removed_effects
from identification.diagnosis.selection.search import PointCache, compute_uncached
from identification.diagnosis.uncertainty.detection_limits import DetectionLimit, compute_detection_limits
from identification.diagnosis.uncertainty.intervals import Interval, compute_intervals
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import Fitted
from identification.progress import Progress
from identification.storage.files import write
from identification.storage.toml_table import toml_key, toml_text

if TYPE_CHECKING:
    import pandas

VERDICTS = ("nothing_missing", "named", "equivalent", "unknown")


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The answer: `verdict`, and all that led to it.

    experiment: as given; repaired: the models examined and the steps between them, and the law learned of what they
    leave; final: the last model, the law in it, fitted to all that may be fitted; advice: the next experiment, None
    where nothing is open; warnings: what to know about the readings, and what was taken out of the model before
    anything was added; others: models that would do as well, fitted likewise; keep: of what is worked out for the
    report.
    """

    experiment: Experiment
    repaired: RepairResult
    final: Fitted
    advice: Advice | None
    seed: int
    warnings: tuple[str, ...] = ()
    others: tuple[Fitted, ...] = ()
    cache: PointCache = compute_uncached

    @property
    def base(self) -> Fitted:
        """The fit of the model as given, less what was taken out before anything was added."""
        return self.repaired.examined[0].fitted

    @property
    def base_name(self) -> str:
        """What that model is, in words."""
        rigid = self.experiment.cradle.has(ELASTIC_STRINGS) and not self.base.cradle.has(ELASTIC_STRINGS)
        return "with rigid strings" if rigid else "as given"

    @property
    def law(self) -> LearnedLaw | None:
        """What was learned of the remainder, None where there is none or it predicts nothing."""
        return self.repaired.law

    @property
    def last(self) -> Fitted:
        """The fit of the repaired model to the training part."""
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
        return "unknown" if self.repaired.last.significant else "nothing_missing"

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that are missing beyond doubt."""
        doubtful = {name for names in self.equivalent for name in names}
        return tuple(step.effect for step in self.repaired.steps if step.effect not in doubtful)

    @property
    def equivalent(self) -> tuple[tuple[str, ...], ...]:
        """Sets of effects, of which any one completes `effects`."""
        return tuple(tuple(candidate.name for candidate in several) for several in self.repaired.alternatives)

    @property
    def shared_effects(self) -> tuple[str, ...]:
        """Of all effects that it names, those of which every bob or gap has the same value."""
        several = (candidate for set_ in self.repaired.alternatives for candidate in set_)
        named = (candidate_of_effect(s.after.experiment, s.before.experiment, s.effect) for s in self.repaired.steps)
        return tuple(dict.fromkeys(candidate.name for candidate in (*named, *several) if candidate.shared))

    @functools.cached_property
    def gap_first(self) -> float:
        """Held-out gap of the model as given."""
        return self.base.held_out_gap()

    @functools.cached_property
    def gap_last(self) -> float:
        """Held-out gap of the repaired model, with the learned law where there is one."""
        return self.last.held_out_gap()

    @property
    def gap_allowed(self) -> float:
        """The held-out gap up to which the repaired model, if it is right, may well come."""
        return self.last.allowed_gap

    @functools.cached_property
    def parameters(self) -> dict[str, Interval]:
        """Unknowns of the repaired model, by name; of those of the cradle itself, an interval that holds whichever of
        several equivalent models is right."""
        found = compute_intervals(self.final, self.cache)
        for other in (compute_intervals(other, self.cache) for other in self.others):
            for name in (name for name in found if name in other and "." not in name and "@" not in name):
                low, high = zip(found[name].ci95, other[name].ci95, strict=True)
                found[name] = dataclasses.replace(found[name], ci95=(min(low), max(high)))
        return found

    @property
    def model(self) -> Cradle:
        """The repaired model."""
        return self.final.cradle

    @functools.cached_property
    def detection_limits(self) -> tuple[DetectionLimit, ...]:
        """What else these data may hide; nothing can be said where the model does not describe them."""
        last = self.repaired.last
        return () if last.significant else compute_detection_limits(last.fitted, last.score_test.scores, self.cache)

    def model_toml(self) -> str:
        """The repaired model as a [model] table with its parameters, and, as comments, the cradle's own."""
        cradle = self.model
        lines = ["# The repaired model of a diagnosis. Fitted along with it:"]
        lines += [
            f"#   {name} = {found.median:.6g} {found.unit}"
            for name, found in self.parameters.items() if "." not in name and "@" not in name
        ]  # fmt: skip
        lines += ["[model]", f"base = {toml_text(cradle.model)}", f"effects = {toml_text([*cradle.effects])}"]
        known = {name: _shortest_values(name, values) for name, values in cradle.effects.items() if values}
        if known:
            lines += ["", "[model.parameters]"]
            lines += [f"{toml_key(name)} = {toml_text(values)}" for name, values in known.items()]
        return "\n".join([*lines, ""])

    def content(self, progress: Progress | None = None) -> dict[str, Any]:
        """What diagnosis.json holds; worked out here is how far the unknowns and what else there may be are known."""
        progress = progress or (lambda *_: None)
        last = self.repaired.last
        progress("limits", 0.0, "how well the unknowns are known")
        parameters = self.parameters
        progress("limits", 0.5, "what the data may hide")
        limits = [one.content() for one in self.detection_limits]
        return {
            "format": FORMAT,
            "version": __version__,
            "seed": self.seed,
            "inputs": self.experiment.digest,
            "verdict": self.verdict,
            "warnings": list(self.warnings),
            "where": list(self.repaired.examined[0].residual_scan.where),
            "energy": [
                {"run": self.experiment.runs[e.run].file, "t": e.time, "excess": e.energy, "sd": e.sd}
                for e in self.repaired.examined[0].residual_scan.energy_excess
            ],
            "steps": self.steps,
            "equivalent": [list(names) for names in self.equivalent],
            "alike": list(self.shared_effects),
            "taken_out": removed_effects(self.base.cradle, self.experiment.cradle),
            "gap_first": self.gap_first,
            "gap_last": self.gap_last,
            "gap_allowed": self.gap_allowed,
            "remainder": {
                "significant": last.significant,
                "p": last.p,
                "described": describe_remainder(last.residual_scan.where) if last.significant else "",
                "law": self._law(),
            },
            "unseen": limits,
            "removed": list(self.repaired.removed),
            "candidates": self._candidates(),
            "parameters": {
                name: {"unit": found.unit, "median": found.median, "ci95": list(found.ci95)}
                for name, found in parameters.items()
            },
            "advice": None if self.advice is None else self.advice.content(),
        }

    @property
    def steps(self) -> list[dict[str, Any]]:
        """The steps of diagnosis.json: each effect that is missing beyond doubt, its parameters, what it improves.

        Their intervals take minutes where nothing has asked for them yet.
        """
        return [self._step(step) for step in self.repaired.steps if step.effect in self.effects]

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
        return write(Path(path), render_report(self, self.content()))

    def __repr__(self) -> str:
        return diagnosis_display.line(self)

    def _repr_html_(self) -> str:
        return diagnosis_display.page(self)

    def _law(self) -> dict[str, Any] | None:
        if self.law is None or self.shape is None:
            return None
        return {
            "terms": describe_terms(self.law, self.parameters),
            "words": self.shape.words(),
            "energy_taken": {"unit": "J", "value": self.shape.energy_taken()},
            "log_evidence": self.law.log_evidence,
            "gap_before": self.law.before.held_out_gap(),
            "gap_after": self.law.fitted.held_out_gap(),
            "inner_gap_before": self.law.inner_gap_before,
            "inner_gap_after": self.law.inner_gap_after,
        }

    def _step(self, step) -> dict[str, Any]:
        return {
            "effect": step.effect,
            "parameters": effect_parameters(self.parameters, step.effect),
            "probability": step.probability,
            "gap_before": step.before.held_out_gap(),
            "gap_after": step.after.held_out_gap(),
            "train_before": step.before.training_gap(),
            "train_after": step.after.training_gap(),
        }

    def _candidates(self) -> list[dict[str, Any]]:
        """Scores of every candidate against the base model, with what its refit gave where it was refitted."""
        first = self.repaired.examined[0]
        refits = self.repaired.decisions[0].refits if self.repaired.decisions else ()
        refitted = {refit.candidate: refit for refit in refits}
        rows = []
        for s in first.score_test.scores:
            refit = refitted.get(s.candidate)
            rows.append(
                {
                    "effect": s.candidate.name,
                    "alike": s.candidate.shared,
                    "predicted_delta_chi2": s.gain if s.directions else None,
                    "p": s.p if s.directions else None,
                    "parallel": [other.label for other in s.parallel],
                    "delta_chi2": None if refit is None else refit.gain,
                    "log_evidence": None if refit is None else refit.log_evidence,
                    "gap": None if refit is None else refit.gap,
                }
            )
        return rows


def _shortest_values(name: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """The values of an effect; of a learned law one number where all bobs or pairs have the same, for any cradle."""
    if all(name != learned.name for learned in LEARNED):
        return dict(values)
    return {key: v[0] if isinstance(v, tuple) and len(set(v)) == 1 else v for key, v in values.items()}


def effect_parameters(parameters: Mapping[str, Interval], name: str) -> dict[str, Any]:
    """Those of one effect by key: median and ci95; lists of them where there is a value per bob or gap."""
    found: dict[str, Any] = {}
    for address, interval in parameters.items():
        owner, _, key = address.partition(".")
        if owner != name:
            continue
        key, element = element_of(key)
        if element is None:
            found[key] = {"median": interval.median, "ci95": list(interval.ci95)}
        else:
            entry = found.setdefault(key, {"median": [], "ci95": []})
            entry["median"].append(interval.median)
            entry["ci95"].append(list(interval.ci95))
    return found


def describe_remainder(where: tuple[dict, ...]) -> str:
    """What is left, in words."""
    if not where:
        return "no single place stands out; all of them together hold more than noise"
    worst = where[0]
    bob = "all bobs" if worst["bob"] is None else f"bob {worst['bob']}"
    begin, end = worst["t"]
    return f"most of all in {worst['run']} at {bob}, {begin:.3g} to {end:.3g} s: {describe_phase(worst['phase'])}"
