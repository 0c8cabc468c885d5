"""The cradle and the release that the options of a command line describe."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cradle_env.cradle import CRADLE_NUMBERS, STANDARD_BETA, Cradle
from cradle_env.effects import effect
from cradle_env.errors import one_line, unknown_key
from cradle_env.model_files import read_model
from cradle_env.parameter_name import ParameterName
from cradle_env.release import Release
from identification.experiment.experiment import Experiment
from identification.number_format import unit_plain
from identification.sweep.grid import EXCLUSIVE, release_for_bobs

#: The release of the paper, where none is stated.
_ANGLE = 0.228


def parse_cradle_options(
    source: Path | None,
    fields: Mapping[str, Any],
    delta: str | None,
    effects: Sequence[str],
    settings: Sequence[str],
    *,
    angle: float | None,
    lifted: int | None,
    start: str | None,
    over: Sequence[str] = (),
) -> tuple[Cradle, Release]:
    """Build the cradle and the release that a command line describes.

    None means: as in the source file, or the default. over: "name=values" of each swept parameter. A value that the
    source does not state takes its default, which is printed on stderr.
    """
    swept = {text.partition("=")[0] for text in over}
    cradle, release, unstated = Cradle(), Release(angle=_ANGLE), ()
    if source is not None:
        experiment = Experiment.load(source)
        run = experiment.runs[0]
        cradle, unstated = experiment.cradle_of(run), experiment.unknown_effect_parameters
        if run.release is not None:
            release = run.release.release
        elif angle is None and not swept & {"release_angle", "gamma"}:
            told = f"the first run of {source} states no release; {_ANGLE:g} rad is taken"
            print(f"cradle: {told}; --release-angle states another", file=sys.stderr)
    values = {name: value for name, value in fields.items() if value is not None}
    if delta is not None:
        gaps = tuple(_parse_number("delta", gap) for gap in delta.split(","))
        values["delta"] = gaps[0] if len(gaps) == 1 else gaps
    elif values.get("bobs", cradle.bobs) != cradle.bobs and isinstance(cradle.delta, tuple):
        raise ValueError(f"{source} has one delta per gap; give --delta for {values['bobs']} bobs")
    values |= dict(parse_setting(text, _OWN_OPTION) for text in settings)
    if str(values.get("model", "")).lower().endswith(".toml"):
        values["model"], values["effects"] = read_model(Path(values["model"]))
        unstated = ()
    if effects:
        values["effects"] = _with_effects(values.get("effects", cradle.effects), effects)
    beta = values.pop("beta", None)
    if beta is not None and "kappa" in values:
        raise ValueError("both beta and kappa are given; beta sets kappa, so give one of them")
    stated = {name for name, value in {**fields, "release_angle": angle}.items() if value is not None}
    for one, other in (ends for pair in EXCLUSIVE for ends in (pair, pair[::-1])):
        if one in stated and other in swept:
            raise ValueError(f"{one} is given and {other} is swept, which set the same; leave one out")
    if source is None and beta is None and "kappa" not in values:
        beta = STANDARD_BETA  # of the masses and lengths that are set here
    stated_of, cradle = cradle.bobs, cradle.replace(beta=beta, **values)
    chosen = swept | {text.partition("=")[0] for text in effects}
    for name in map(ParameterName.parse, unstated):
        if cradle.has(name.effect) and str(name) not in chosen:
            unit = unit_plain(next(p.unit for p in effect(name.effect).parameters if p.key == name.key))
            default = f"{cradle.effects[name.effect][name.key]} {unit}".rstrip()
            print(
                f"cradle: {source} states no {name}; {default} is taken; --effect {name}=VALUE states another",
                file=sys.stderr,
            )
    if lifted is not None:
        angle = release.lead(cradle)[1] if angle is None else angle
        release = Release(angle=angle, bobs=lifted, start=release.start)
    else:
        release = release_for_bobs(release, stated_of, cradle.bobs)
        release = release if angle is None else release.lifted_to(angle, cradle)
    return cradle, release if start is None else dataclasses.replace(release, start=start)


def _parse_number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{name} is {one_line(text)}, which is not a number") from None


#: Fields of a cradle that have an option of their own instead of --set.
_OWN_OPTION = ("bobs", "delta", "model", "beta", "kappa", "k_f", "b", "release_angle", "lifted", "start")


def parse_setting(text: str, own_option: Sequence[str] = ()) -> tuple[str, float]:
    """Parse "length=0.25" into ("length", 0.25); own_option: fields that the command sets by an option of their own."""
    name, equals, value = text.partition("=")
    if not equals:
        raise ValueError(f"--set {text}: expected NAME=VALUE, as length=0.25")
    if name in own_option:
        raise ValueError(f"--set {text}: {name} has an option of its own; give --{name.replace('_', '-')} {value}")
    known = [field for field in CRADLE_NUMBERS if field not in own_option]
    if name not in known:
        raise ValueError(f"--set {text}: {unknown_key('name', name, known)}")
    return name, _parse_number(f"--set {name}", value)


def _with_effects(known: Mapping[str, Mapping[str, Any]], texts: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Add the effects of "name.key=value", "name" or "-name" to the known ones."""
    effects = {name: dict(values) for name, values in known.items()}
    for text in texts:
        address, equals, value = text.partition("=")
        name = ParameterName.parse(address)
        if bool(equals) != bool(name.effect) or (name.element, name.run) != (None, None):
            raise ValueError(f"--effect {text}: expected NAME.KEY=VALUE, as quadratic_drag.c2=0.002, or -NAME")
        entry = effects.setdefault(name.effect or name.key, {})
        if equals:
            numbers = tuple(_parse_number(f"--effect {address}", part) for part in value.split(","))
            entry[name.key] = numbers[0] if len(numbers) == 1 else numbers
    return effects
