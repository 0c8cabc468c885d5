"""What may be missing: every effect of the catalogue that the model does not have, read from its declaration."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from cradle_env.cradle import Cradle
from cradle_env.effects import MODELS, Effect, Parameter, effect, known_effects
from cradle_env.parameter_name import ParameterName
from identification.experiment.experiment import Experiment
from identification.inference.impossible_model import raises_impossible

Values = Mapping[str, Any]
#: Effects that are in question together.
EffectNames = tuple[str, ...]

#: Factors of the scale at which the parameters that mean nothing at zero strength are tried.
_GRID = (1.0, 1.0 / 3.0, 3.0)


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing: its name, and before it the names of what it requires and the model has not.

    unknown: "effect.parameter" of what would be inferred, "effect.parameter[i]" of what has a value per bob or gap;
    alike: those values are one and the same, "effect.parameter[*]".
    """

    name: str
    effects: tuple[str, ...]
    unknown: tuple[str, ...]
    shared: bool = False

    @property
    def label(self) -> str:
        """Its name, as reports and figures have it."""
        return f"{self.name}, all alike" if self.shared else self.name

    @property
    def declaration(self) -> Effect:
        """The effect's own."""
        return effect(self.name)


def list_candidates(cradle: Cradle) -> list[Candidate]:
    """All known effects that the cradle does not have, and that can matter to it; one with a value per bob or gap
    also with all of them alike, which comes first."""
    found = []
    for declared in known_effects():
        if cradle.has(declared.name) or (cradle.bobs == 1 and not _matters_alone(declared)):
            continue
        chain = tuple(name for name in _chain(declared) if not cradle.has(name))
        if any(p.each and not p.balanced and p.count(cradle.bobs) > 1 for p in declared.parameters):
            same = tuple(f"{declared.name}.{p.key}" + ("[*]" if p.each else "") for p in declared.parameters)
            found.append(Candidate(declared.name, chain, same, shared=True))
        unknown = (name for e in map(effect, chain) for name in e.element_names(cradle.bobs))
        found.append(Candidate(declared.name, chain, tuple(unknown)))
    return found


def candidate_of_effect(experiment: Experiment, without: Experiment, name: str) -> Candidate:
    """The candidate that an effect of this name is, in the form it has in an experiment, to one without it."""
    unknown = {*experiment.unknown_effect_parameters}
    return next(c for c in list_candidates(without.cradle) if c.name == name and unknown.issuperset(c.unknown))


def matching_candidate(cradle: Cradle, candidate: Candidate) -> Candidate:
    """A candidate of one cradle as that of another, which may have some of what it requires."""
    return next(c for c in list_candidates(cradle) if c.label == candidate.label)


def _matters_alone(declared: Effect) -> bool:
    return (
        declared.acts_on != "contact"
        and not declared.between
        and all(p.count(1) > p.balanced for p in declared.parameters)
    )


def _chain(declared: Effect) -> list[str]:
    """What an effect requires, what that requires first, then its own name."""
    names: list[str] = []
    for needed in declared.requires:
        names += [name for name in _chain(effect(needed)) if name not in names]
    return [*names, declared.name]


def parameter_of(name: str) -> Parameter:
    """The parameter of which an unknown is a value: "effect.parameter", with "[i]" where there are several."""
    stated = ParameterName.parse(name)
    return next(p for p in effect(stated.effect).parameters if p.key == stated.key)


def shapes(declared: Effect, bobs: int) -> Iterator[dict[str, Any]]:
    """Values of the parameters that mean nothing at zero strength: their scales, then a grid of one factor each."""
    free = [p for p in declared.parameters if not p.is_strength]
    seen = []
    for factors in itertools.product(_GRID, repeat=len(free)):
        if sum(factor != 1.0 for factor in factors) <= 1:
            values = {p.key: p.repeat(p.scale * factor, bobs) for p, factor in zip(free, factors, strict=True)}
            if values not in seen:
                seen.append(values)
                yield values


def starts(declared: Effect, bobs: int, factors: tuple[float, ...]) -> Iterator[dict[str, Any]]:
    """Where to start a search: each shape with the strength at these factors of its scale, on both sides if it has."""
    if not declared.parameters:
        yield {}
        return
    sides = (1.0,) if all(p.one_sided for p in declared.strengths) else (1.0, -1.0)
    for shape in shapes(declared, bobs):
        for side, factor in itertools.product(sides, factors):
            yield shape | {p.key: p.repeat(p.at_strength(side * factor), bobs) for p in declared.strengths}


@raises_impossible
def with_effects(
    experiment: Experiment, added: Mapping[str, Values], unknown: tuple[str, ...] | None = None
) -> Experiment:
    """The experiment with more effects in its model, their parameters to be inferred (`unknown`: which) from there."""
    cradle = experiment.cradle
    kept = {name: values for name, values in cradle.effects.items() if name.removeprefix("-") not in added}
    new = cradle.replace(effects={**kept, **added})
    if unknown is None:
        unknown = tuple(name for e in map(effect, added) for name in e.element_names(cradle.bobs))
    more = tuple(name for name in unknown if name not in experiment.unknown_effect_parameters)
    return dataclasses.replace(
        experiment, cradle=new, unknown_effect_parameters=(*experiment.unknown_effect_parameters, *more)
    )


@raises_impossible
def without_effect(experiment: Experiment, name: str) -> Experiment:
    """The experiment with one effect taken out of its model: one that was added to its base, or one of the base's."""
    effects = {key: values for key, values in experiment.cradle.effects.items() if key != name}
    if name in MODELS[experiment.cradle.model]:
        effects[f"-{name}"] = {}
    unknown = tuple(key for key in experiment.unknown_effect_parameters if ParameterName.parse(key).effect != name)
    return dataclasses.replace(
        experiment, cradle=experiment.cradle.replace(effects=effects), unknown_effect_parameters=unknown
    )
