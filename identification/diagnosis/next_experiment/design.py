"""Design of the next experiment: between models that the user names, between equivalent models of a diagnosis, or for
λ."""

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
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.model_search import ModelSearch
from identification.diagnosis.selection.searcher import Searcher
from identification.experiment.experiment import Experiment
from identification.experiment.experiment_file import infer_lines, model_lines
from identification.inference.fit_result import FitResult, with_known_noise
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.linear_algebra import on_one_thread
from identification.progress import Progress
from identification.storage.lock import locks_output
from identification.storage.schema import read_json
from identification.storage.stamps import check_report
from identification.storage.toml_table import toml_text

#: The format that design.json states.
FORMAT = "cradle-design/1"


@dataclass(frozen=True, eq=False)
class Design:
    """What `design` found.

    Parameters
    ----------
    experiment : Experiment
        As given, without effects that the diagnosis took out of the model.
    models : tuple of FitResult
        The models in question, fitted to all data.
    certain : tuple of str
        Effects that all models have.
    sets : tuple of tuple of str
        Effects that each model adds to them; () if λ is in question.
    advice : Advice
        The possible runs, the most informative first.
    seed : int
        Of the random numbers.
    """

    experiment: Experiment
    models: tuple[FitResult, ...]
    certain: EffectNames
    sets: tuple[EffectNames, ...]
    advice: Advice
    seed: int

    def content(self) -> dict[str, Any]:
        """The content of design.json."""
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
        """An experiment.toml for the recommended run, whose data are still to be recorded."""
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


@locks_output
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
    """The most informative next run.

    Parameters
    ----------
    experiment : Experiment
        The present runs.
    between : sequence of str
        Two models or more, each an effect or several joined by "+".
    diagnosis : path, optional
        Folder of a diagnosis of the same experiment. Its model with the named effects is the base. Its `equivalent`
        sets are in question if `between` is empty.
    out : path, optional
        Folder that keeps finished fits, so that an interrupted call goes on.
    seed : int
        Of the random numbers.
    workers : int, optional
        Threads; all cores if omitted.
    progress : callable, optional
        Called with a stage, a fraction done, and a text.

    Returns
    -------
    Design
        Its runs separate the models in question, or constrain λ if there are none. An effect with values per bob or gap
        has one value for all, unless the diagnosis found different ones.

    Raises
    ------
    ValueError
        If the models are unknown, or no run can be planned.

    Examples
    --------
    >>> plan = design(experiment, between=("added_mass", "clock_scale")).advice.plans[0]  # doctest: +SKIP
    >>> plan.release, plan.delta, plan.duration  # doctest: +SKIP
    """
    progress = progress or (lambda *_: None)
    if out is not None:
        check_report(Path(out), "design")
    request = _read_request(experiment, between, diagnosis)
    known = with_known_noise(request.model)
    check_readings(known)
    store = FitCache.of(out, experiment, seed)
    searcher = Searcher(store, seed, workers)
    progress("search", 0.0, "the model as given")
    base = _fit_with_effects(searcher.fit_global(known, progress), request.certain, request.each, searcher, progress)
    several = [_fit_with_effects(base, names, request.each, searcher, progress) for names in request.sets or ((),)]
    models = tuple(map(searcher.fit_all_data, several))
    advice = advise(models, request.sets, seed, progress) if request.sets else advise_on_lambda(models[0], progress)
    if advice is None:
        raise ValueError(
            "no experiment can be advised: "
            + (
                "no run can be simulated, and predicted for long enough, by all of the models"
                if request.sets
                else "λ is not defined for one bob or without a release, or no run can be predicted for long enough;"
                " name models to tell apart by --between"
            )
        )
    return Design(request.model, models, request.certain, request.sets, advice, seed)


@dataclass(frozen=True, eq=False)
class _Request:
    """What the caller asks for.

    model: the experiment, without effects that the diagnosis took out. certain: named effects. sets: of effects in
    question. each: effects that have a value per bob or gap.
    """

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
        content = read_json(path, "diagnosis", remedy)
        certain = tuple(step["effect"] for step in content["steps"])
        equivalent = tuple(tuple(names) for names in content["equivalent"])
        each = frozenset(itertools.chain(certain, *equivalent)) - {*content["alike"]}
        removed, inputs = [*content["taken_out"]], content["inputs"]
        if inputs != experiment.digest:
            raise ValueError(f"{path}: of another experiment, or of other data; diagnose this one first")
        for name in reversed(removed):  # an effect comes after those that it requires
            effect(name)
            model = without_effect(model, name)
        model, sets = model.with_source(inputs), sets or equivalent
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
    fitted: FitResult, names: EffectNames, each: frozenset[str], searcher: Searcher, progress: Progress
) -> FitResult:
    """The fit with effects added one after the other; each: see `_Request`."""
    search = ModelSearch(fitted.experiment, searcher.store, searcher.workers)
    model = search.fit_base([fitted.point])
    for name in names:
        progress("refit", 0.0, name)
        if name in model.effects:  # an earlier effect requires it
            continue
        several = [c for c in search.candidates if c.name == name]
        try:
            model = search.extended(model, several[-1 if name in each else 0].label)
        except ImpossibleModelError as problem:
            raise ValueError(f"{name} cannot be in this cradle: {problem}") from None
    return model.fitted
