"""The next experiment on its own: between models that the user names, between those that a diagnosis left open, or for
what is least known of λ; and its files."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cradle_env import __version__
from cradle_env.cradle import FIELDS, Cradle
from cradle_env.effects import effect
from identification.diagnosis.data_checks.readings import check_readings
from identification.diagnosis.next_experiment.expected_information import Advice, advise, advise_on_lambda
from identification.diagnosis.selection.candidates import EffectNames, list_candidates, without_effect
from identification.diagnosis.selection.search import FitCache, Searcher
from identification.experiment.experiment import Experiment
from identification.experiment.experiment_file import infer_lines, model_lines
from identification.inference.fit_result import Fitted, with_known_noise
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.linear_algebra import on_one_thread
from identification.progress import Progress
from identification.storage.lock import holds_out
from identification.storage.schema import read_json
from identification.storage.stamps import check_report
from identification.storage.toml_table import toml_text

#: Of design.json.
FORMAT = "cradle-design/1"


@dataclass(frozen=True, eq=False)
class Design:
    """The models in question, fitted to all data, the sets of effects that each adds to what is `certain`, and the
    advice. One model and no sets: λ is in question."""

    experiment: Experiment
    models: tuple[Fitted, ...]
    certain: EffectNames
    sets: tuple[EffectNames, ...]
    advice: Advice
    seed: int

    def content(self) -> dict[str, Any]:
        """What design.json holds."""
        return {
            "format": FORMAT,
            "version": __version__,
            "seed": self.seed,
            "inputs": self.experiment.digest,
            "between": [list(names) for names in self.sets],
            "certain": list(self.certain),
            **self.advice.content(),
            "plans": [
                {
                    "release": {"bobs": plan.setting.lifted, "angle": plan.setting.angle},
                    "delta": plan.delta,
                    "bobs": plan.bobs,
                    "duration": plan.duration,
                    "predicted": plan.predicted,
                    "simulated": plan.simulated,
                    "standard_error": plan.standard_error,
                }
                for plan in self.advice.plans
            ],
        }

    def experiment_toml(self) -> str:
        """An experiment.toml for the recommended run, to which its data are still to be recorded."""
        plan, model = self.advice.plans[0], self.models[0]
        cradle, old, run = model.cradle, self.experiment, self.experiment.runs[0]
        fields = {
            name: getattr(cradle, name) for name in (*FIELDS, "power_law") if name not in ("delta", "restitution")
        }
        if not cradle.has("velocity_dependent_restitution"):
            fields["restitution"] = cradle.restitution
        release = {"bobs": plan.setting.lifted, "angle": plan.setting.angle}
        known = run.release
        release |= {"angle_sd": known.angle_sd, "time_sd": known.time_sd} if known else {"angle_sd": 0.01}
        release["start"] = plan.release.start
        lines = [
            "# The recommended run, to be recorded: put its data into run1.csv, and correct what turns out otherwise.",
            'format = "cradle-experiment/1"',
            "",
            "[cradle]  # as fitted to the earlier runs",
            f"bobs = {plan.bobs}",
            *(f"{name} = {toml_text(value)}" for name, value in fields.items() if value is not None),
            "",
            *model_lines(old.cradle, old.unknown_effect_parameters, self.certain),
            "",
            "[[run]]",
            'file = "run1.csv"',
            f"release = {toml_text(release)}",
            f"delta = {toml_text(plan.delta)}",
            f"noise = {toml_text(float(model.likelihood.noise_model.scales[0]) / run.scale)}  # {run.unit}",
            f"rest = {toml_text(run.rest)}",
            f"# recorded for {plan.duration:g} s",
            *infer_lines(old.infer),
        ]
        return "\n".join([*lines, ""])


@holds_out
@on_one_thread
def design(
    experiment: Experiment,
    *,
    between: Sequence[str] = (),
    diagnosis: str | Path | None = None,
    out: str | Path | None = None,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Design:
    """The run that tells most beside the runs there are.

    between: two models or more, each an effect or several joined by "+", as "added_mass"; diagnosis: the folder of a
    diagnosis of the same experiment, whose model with its named effects is taken over, and whose `equivalent` sets are
    in question where `between` names none; otherwise λ is. What has a value per bob or gap has one for all of them,
    unless the diagnosis found it otherwise. out: folder in which finished fits are kept. Raises ValueError for
    what cannot be planned.
    """
    progress = progress or (lambda *_: None)
    if out is not None:
        check_report(Path(out), "design")
    asked = _read_request(experiment, between, diagnosis)
    known = with_known_noise(asked.model)
    check_readings(known)
    store = FitCache.of(out, experiment, seed)
    searcher = Searcher(store, seed, workers)
    progress("search", 0.0, "the model as given")
    base = _fit_with_effects(searcher.fit_global(known, progress), asked.certain, asked.each, searcher, progress)
    several = [_fit_with_effects(base, names, asked.each, searcher, progress) for names in asked.sets or ((),)]
    models = tuple(map(searcher.fit_all_data, several))
    advice = advise(models, asked.sets, seed, progress) if asked.sets else advise_on_lambda(models[0], progress)
    if advice is None:
        raise ValueError(
            "no experiment can be advised: "
            + (
                "none of the planned ones can be simulated, or followed for long enough, with all of the models"
                if asked.sets
                else "λ is not defined for one bob, or without a release, or no planned run can be followed for long"
                " enough; name models to tell apart by --between"
            )
        )
    return Design(asked.model, models, asked.certain, asked.sets, advice, seed)


@dataclass(frozen=True, eq=False)
class _Request:
    """model: the experiment as given, or with what a diagnosis took out of its model taken out; effects that are
    certain; sets in question; each: effects that have a value per bob or gap, not one for all."""

    model: Experiment
    certain: EffectNames
    sets: tuple[EffectNames, ...]
    each: frozenset[str]


def _read_request(experiment: Experiment, between: Sequence[str], diagnosis: str | Path | None) -> _Request:
    certain, each, model = (), frozenset(), experiment
    sets = tuple(dict.fromkeys(tuple(sorted({*text.split("+")})) for text in between))
    if diagnosis is not None:
        path = Path(diagnosis) / "diagnosis.json"
        remedy = "not a diagnosis by this version; name the folder that cradle diagnose wrote, or run it again"
        found = read_json(path, "diagnosis", remedy)
        certain = tuple(step["effect"] for step in found["steps"])
        equivalent = tuple(tuple(names) for names in found["equivalent"])
        each = frozenset(itertools.chain(certain, *equivalent)) - {*found["alike"]}
        gone, inputs = [*found["taken_out"]], found["inputs"]
        if inputs != experiment.digest:
            raise ValueError(f"{path}: of another experiment, or of other data; diagnose this one first")
        for name in reversed(gone):  # what requires another comes after it
            effect(name)
            model = without_effect(model, name)
        model, sets = model.read_from(inputs), sets or equivalent
    if len(sets) == 1:
        raise ValueError(f"between is {'+'.join(sets[0])} alone; name two models or more to tell apart")
    for name in itertools.chain(certain, *sets):
        effect(name)
        _check_absent(model.cradle, name)
    return _Request(model, certain, sets, each)


def _check_absent(cradle: Cradle, name: str) -> None:
    if cradle.has(name):
        raise ValueError(f"{name} is in the model already; name effects that it may lack")
    if name not in (c.name for c in list_candidates(cradle)):
        raise ValueError(f"{name} cannot matter to {cradle.bobs} bob{'s' if cradle.bobs > 1 else ''}; name another")


def _fit_with_effects(
    fitted: Fitted, names: EffectNames, each: frozenset[str], searcher: Searcher, progress: Progress
) -> Fitted:
    """The fit with effects added, one after the other; each: as `_Asked` has it."""
    for name in names:
        progress("refit", 0.0, name)
        if fitted.cradle.has(name):  # brought along by an earlier one
            continue
        several = [c for c in list_candidates(fitted.cradle) if c.name == name]
        candidate = several[-1 if name in each else 0]
        try:
            fitted = searcher.fit_with_candidate(fitted, candidate)
        except ImpossibleModelError as problem:
            raise ValueError(f"{name} cannot be in this cradle: {problem}") from None
    return fitted
