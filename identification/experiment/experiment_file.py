"""Read and write experiment.toml: text to cradle, runs and priors, and back."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.effects import MODELS, effect
from cradle_env.release import Release
from identification.experiment.constraint import KINDS, Constraint, parse_constraint, sound_table
from identification.experiment.csv_file import parse_recording
from identification.experiment.recording import Recording
from identification.experiment.run import Prior, ReleaseInfo, Run, Tracking, check_noise, check_prior, check_run
from identification.storage.files import ExperimentError
from identification.storage.toml_table import Table, toml_key, toml_text

FILE_NAME = "experiment.toml"
FORMAT = "cradle-experiment/1"
_CRADLE_KEYS = tuple(f.name for f in dataclasses.fields(Cradle) if f.name not in ("model", "effects"))
_RUN_KEYS = ("file", "quantity", "release", "delta", "noise", "tracking", "fit_from", "fit_to", "state", "rest")
#: A run of impacts that `cradle measure sound` has written; others are in [[run]] tables with a quantity.
SOUND = "sound"
_SOUND_KEYS = tuple(key for key in _RUN_KEYS if key not in ("quantity", "rest", "tracking"))
_PRIOR_KEYS = ("mean", "sd", "low", "high")
_PRIOR = "a prior, { mean = ..., sd = ... } or { low = ..., high = ... }"
_TRACKING_KEYS = tuple(f.name for f in dataclasses.fields(Tracking))
_RELEASE_KEYS = ("bobs", "angle", "angles", "angle_sd", "time_sd", "start")


def read_experiment(
    text: str, name: str, read: Callable[[str], tuple[str, bytes]]
) -> tuple[dict[str, Any], list[bytes]]:
    """Read an experiment.toml.

    Parameters
    ----------
    text : str
        Text of the file.
    name : str
        Name of the file, for errors.
    read : callable
        read(file) returns text and bytes of a file that the experiment names. It raises ValueError if the file may not
        be read.

    Returns
    -------
    fields : dict
        Of Experiment: cradle, runs, infer, unknown_effect_parameters and constraints.
    data : list of bytes
        Content of each file that was read.

    Raises
    ------
    ExperimentError
        If the text is unusable.
    """
    top = Table.parse(name, text)
    top.allow_only(("format", "cradle", "model", "run", SOUND, *KINDS, "infer"), "table")
    top.string("format", (FORMAT,))
    known = top.table("cradle") if "cradle" in top else Table(name, text, {})
    bobs = known.whole("bobs") if "bobs" in known else Cradle.bobs
    model, unknown = _read_model(top.table("model") if "model" in top else Table(name, text, {}), bobs)
    cradle = _read_cradle(known, model)
    infer = _read_priors(top.table("infer"), cradle) if "infer" in top else {}
    recordings: dict[tuple[str, bool], Recording] = {}
    runs: list[Run] = []

    def add_run(table: Table, file: str, impacts: bool) -> None:
        if (file, impacts) not in recordings:
            with table.entry("file"):
                recordings[file, impacts] = parse_recording(Path(file).name, *read(file), cradle.bobs, impacts=impacts)
        runs.append(_read_run(table, file, recordings[file, impacts], cradle))
        if not impacts:
            _check_magnitudes(recordings[file, impacts], cradle, infer.get("length"))

    if "run" in top or SOUND not in top:
        for table in top.tables("run"):
            table.allow_only(_RUN_KEYS)
            impacts = "quantity" in table and table.string("quantity", ("impacts",)) == "impacts"
            add_run(table, table.string("file"), impacts)
    measured: list[bytes] = []
    if SOUND in top:
        for table in top.tables(SOUND):
            table.allow_only(_SOUND_KEYS)
            file = table.string("file")
            with table.entry("file"):
                text_of, data = read(file)
                measured.append(data)
                clicks = Path(file).with_name(sound_table(text_of, file)).as_posix()
            add_run(table, clicks, True)
    constraints = tuple(_read_constraints(top, cradle, read, measured))
    fields = {
        "cradle": cradle,
        "runs": tuple(runs),
        "infer": infer,
        "unknown_effect_parameters": unknown,
        "constraints": constraints,
    }
    return fields, [*(recording.data for recording in recordings.values()), *measured]


def _read_constraints(
    top: Table, cradle: Cradle, read: Callable[[str], tuple[str, bytes]], measured: list[bytes]
) -> Iterator[Constraint]:
    """Read the instruments beside the runs; append the content of each file to `measured`."""
    for kind in KINDS:
        for table in top.tables(kind) if kind in top else ():
            table.allow_only(("file",))
            file = table.string("file")
            with table.entry("file"):
                text, data = read(file)
                measured.append(data)
                constraint = parse_constraint(text, kind, file)
                constraint.check(cradle)
                yield constraint


def _read_model(table: Table, bobs: int) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Read `model` and `effects` of Cradle, and the names of effect parameters without a value.

    A parameter without a value starts from its scale, or from 0 if there is one for each bob or gap. An effect whose
    parameters are stated belongs to the model, whether `effects` lists it or not.
    """
    table.allow_only(("base", "effects", "parameters"))
    base = table.string("base", tuple(MODELS)) if "base" in table else "nsp"
    names = table.strings("effects") if "effects" in table else []
    stated = table.table("parameters") if "parameters" in table else Table(table.name, table.text, {})
    with table.entry("effects"):
        changes = {name: effect(name.removeprefix("-")) for name in names}
        for name in changes:
            if f"-{name}" in changes:
                raise ValueError(f"{name} is both added and removed; leave out one of {name!r} and '-{name}'")
    for name in stated.values:
        with stated.entry(name):
            if f"-{name}" in changes:
                raise ValueError(f"has values, but effects removes it; delete '-{name}' there, or the values here")
            changes.setdefault(name, effect(name))
    effects, unknown = {}, []
    for name, declared in changes.items():
        values = {}
        if name in stated:
            given = stated.table(name)
            given.allow_only([p.key for p in declared.parameters], f"parameter of {name}")
            values = {key: given.number_or_numbers(key) for key in given.values}
        missing = [] if name.startswith("-") else [p for p in declared.parameters if p.key not in values]
        starts = {p.key: 0.0 if p.each else p.scale for p in missing}
        unknown += [f"{name}.{key}" for key in starts]
        with stated.entry(name):
            effects[name] = declared.check({**values, **starts}, bobs) if values or starts else {}
    return {"model": base, "effects": effects}, tuple(unknown)


def _read_cradle(table: Table, model: dict[str, Any]) -> Cradle:
    for key in ("model", "base", "effects"):
        if key in table:
            raise table.refuse("belongs under [model], as base or effects; move it there", key)
    table.allow_only(_CRADLE_KEYS)
    values: dict[str, Any] = {}
    for key in table.values:
        if key == "bobs":
            values[key] = table.whole(key)
        elif key == "power_law":
            values[key] = table.numbers(key)
            if len(values[key]) != 2:
                raise table.refuse("expected two numbers, [alpha, n] of e = 1 - alpha v^n", key)
        else:
            values[key] = table.number_or_numbers(key) if key == "delta" else table.number(key)
    with table.entry():
        return Cradle(**values, **model)


def _read_priors(table: Table, cradle: Cradle) -> dict[str, Prior]:
    """Read priors by name. That of an effect's parameter is written "effect.key", or as a table within a table."""
    priors: dict[str, Prior] = {}
    for key, value in table.values.items():
        if isinstance(value, dict) and value and not value.keys() & set(_PRIOR_KEYS):
            entries = {f"{key}.{inner}": table.table(key).table(inner, _PRIOR) for inner in value}
        else:
            entries = {key: table.table(key, _PRIOR)}
        for name, entry in entries.items():
            entry.allow_only(_PRIOR_KEYS)
            with table.entry(*entry.address[len(table.address) :]):
                priors[name] = Prior(**{k: entry.number(k) for k in entry.values})
                check_prior(cradle, name, priors[name])
    return priors


def _read_run(table: Table, file: str, recording: Recording, cradle: Cradle) -> Run:
    values: dict[str, Any] = {}
    for key in ("fit_from", "fit_to"):
        if key in table:
            values[key] = table.number(key)
    if "delta" in table:
        values["delta"] = table.number_or_numbers("delta")
    if "noise" in table:
        with table.entry("noise"):
            noise = check_noise(table.number("noise"), recording.unit, recording.scale)
            values["noise"] = noise * recording.scale
    if "tracking" in table:
        values["tracking"] = _read_tracking(table.table("tracking"), recording)
    for key, choices in (("state", ("release", "free")), ("rest", ("known", "free"))):
        if key in table:
            values[key] = table.string(key, choices)
    if "release" in table:
        values["release"] = _read_release(table.table("release"))
    if recording.absolute:  # then only the readings show where each bob rests
        if values.setdefault("rest", "free") == "known" and cradle.bobs > 1:
            raise table.refuse(
                f'is "known", but x in {file} is counted from one origin for all bobs; write rest = "free"', "rest"
            )
    # If the rest position is inferred, the median is a sufficient first estimate of it.
    from_rest = recording.displacements() if values.get("rest") == "free" else recording.readings
    with table.entry():
        run = Run(
            recording.times,
            from_rest,
            quantity=recording.quantity,
            file=file,
            unit=recording.unit,
            scale=recording.scale,
            lines=recording.lines,
            **values,
        )
        return check_run(cradle, run)


def _read_tracking(table: Table, recording: Recording) -> Tracking:
    table.allow_only(_TRACKING_KEYS)
    ratio, place, speed = (table.number(key) for key in _TRACKING_KEYS)
    with table.entry():
        return Tracking(ratio, place * recording.scale, speed * recording.scale)


def _read_release(table: Table) -> ReleaseInfo:
    table.allow_only(_RELEASE_KEYS)
    values: dict[str, Any] = {}
    if "bobs" in table:
        if "angles" in table:
            raise table.refuse("goes with angle; angles names its bobs itself, so leave bobs out", "bobs")
        values["bobs"] = table.whole("bobs")
    if "angle" in table:
        values["angle"] = table.number("angle")
    if "angles" in table:
        angles = table.table("angles")
        for key in angles.values:
            if not (key.isascii() and key.isdigit() and len(key) < 10):
                raise angles.refuse("is not the number of a bob; write angles = { 5 = 0.2, 1 = -0.2 }", key)
        values["angles"] = {int(key): angles.number(key) for key in angles.values}
    if "start" in table:
        values["start"] = table.string("start", ("unstretched", "hanging"))
    sds = {key: table.number(key) for key in ("angle_sd", "time_sd") if key in table}
    with table.entry():
        for angle in (values.get("angle", 0.0), *values.get("angles", {}).values()):
            if abs(angle) > np.pi:
                raise ValueError(
                    f"release angle is {angle:g} rad; it looks like degrees: write {np.radians(angle):.4g} rad"
                )
        return ReleaseInfo(Release(**values), **sds)


def _check_magnitudes(recording: Recording, cradle: Cradle, length: Prior | None) -> None:
    """Raise ExperimentError for a reading that no bob can reach: its unit is wrong."""
    reach = np.nan_to_num(np.abs(recording.displacements()))
    row, bob = np.unravel_index(np.argmax(reach), reach.shape)
    if recording.quantity == "theta":
        limit, known, likely, scale = 2.0 * np.pi, "a full turn, 6.28 rad", "deg", np.pi / 180.0
    else:
        longest = 0.0 if length is None else max(length.high or 0.0, (length.mean or 0.0) + 5.0 * (length.sd or 0.0))
        limit, known = 1.2 * max(cradle.length, longest), f"the length of the strings, {cradle.length:g} m"
        likely, scale = "mm", 1e-3
    if reach[row, bob] <= limit:
        return
    in_file, label = reach[row, bob] / recording.scale, recording.labels[bob]
    remedy = "check its unit, and length under [cradle]"
    if recording.unit != likely and in_file * scale <= limit:
        remedy = f"it looks like {likely}: write {label.split()[0].partition('[')[0]} [{likely}] in the header"
    raise ExperimentError(
        f"{recording.name}, line {recording.lines[row, bob]}, column {label}:"
        f" {in_file:g} {recording.unit} is beyond {known}; {remedy}"
    )


def experiment_text(
    cradle: Cradle,
    runs: Sequence[Run],
    infer: Mapping[str, Prior],
    unknown_effect_parameters: Sequence[str],
    constraints: Sequence[Constraint] = (),
) -> str:
    """Format an experiment.toml in SI units; its data files are in the same folder."""
    lines = [f"format = {toml_text(FORMAT)}", "", "[cradle]"]
    lines += _entries({key: getattr(cradle, key) for key in _CRADLE_KEYS})
    lines += ["", *model_lines(cradle, unknown_effect_parameters)]
    for run in runs:
        entries = {key: getattr(run, key) for key in _RUN_KEYS} | {"file": Path(run.file).name}
        if not run.of_impacts:  # the header of the file says which of the others it is
            del entries["quantity"]
        if run.release is not None:
            release = {key: value for key, value in vars(run.release.release).items() if value is not None}
            if "angles" in release:
                del release["bobs"]
            entries["release"] = release | {"angle_sd": run.release.angle_sd, "time_sd": run.release.time_sd}
        if run.tracking is not None:
            entries["tracking"] = dataclasses.asdict(run.tracking)
        lines += ["", "[[run]]", *_entries(entries)]
    for constraint in constraints:
        lines += ["", f"[[{constraint.kind}]]", *_entries({"file": Path(constraint.file).name})]
    return "\n".join([*lines, *infer_lines(infer), ""])


def model_lines(cradle: Cradle, unknown: Sequence[str], more: Sequence[str] = ()) -> list[str]:
    """Format the tables [model] and [model.parameters].

    unknown: effect parameters to leave out, as "effect.key"; more: further effects, with all parameters unknown.
    """
    known = {
        name: {k: v for k, v in values.items() if f"{name}.{k}" not in unknown}
        for name, values in cradle.effects.items()
    }
    stated = _entries({name: values for name, values in known.items() if values})
    lines = ["[model]", f"base = {toml_text(cradle.model)}", f"effects = {toml_text([*cradle.effects, *more])}"]
    return [*lines, "", "[model.parameters]", *stated]


def infer_lines(infer: Mapping[str, Prior]) -> list[str]:
    """Format the table [infer]; no lines if there are no priors."""
    priors = {k: {n: v for n, v in vars(p).items() if v is not None} for k, p in infer.items()}
    return ["", "[infer]", *_entries(priors)] if infer else []


def _entries(values: Mapping[str, object]) -> list[str]:
    return [f"{toml_key(key)} = {toml_text(value)}" for key, value in values.items() if value is not None]
