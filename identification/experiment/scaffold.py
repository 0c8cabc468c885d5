"""Write a first experiment.toml for a data file: each entry is a guess from the data, with a comment what to check."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from cradle_env.cradle import Cradle
from identification.experiment.click_scaffold import click_scaffold_text, read_clicks
from identification.experiment.csv_file import csv_text
from identification.experiment.experiment import Experiment
from identification.experiment.experiment_file import FILE_NAME, FORMAT
from identification.experiment.plausibility import is_mirrored, pendulum_length, swing_period
from identification.experiment.recording import Recording
from identification.experiment.table_columns import Columns
from identification.experiment.table_reader import mirror_signs, read_table
from identification.experiment.text_encoding import decode
from identification.storage.files import ExperimentError, write_together
from identification.storage.lock import check_folder
from identification.storage.toml_table import toml_text

#: First characters of a data file that this module wrote and may overwrite.
_MARK = "# Written by cradle new"
#: Standard deviation of a release angle read from the first rows [rad].
_ANGLE_SD = 0.002
#: Standard deviation of a guessed length, as a part of it.
_LENGTH_SD = 0.5
#: Standard deviation of a length computed from the period, as a part of it.
_PERIOD_SD = 0.03
#: Part of the way to its rest position up to which a bob counts as held.
_STILL = 0.1
#: Part of the way to its rest position from which on a bob certainly swings.
_SWINGS = 0.5
#: A bob was held first if it took more than this many times as long to `_STILL` as from there to `_SWINGS`. A bob
#: released at t = 0 takes 0.76 times as long, on a cosine.
_AT_ONCE = 1.5
#: Times within this of 0 [s] are those of the release.
_NOW = 0.05


def scaffold(
    data_csv: Path,
    out: Path | None = None,
    *,
    overwrite: bool = False,
    columns: Columns | None = None,
    mirror: bool = False,
    report: Callable[[str], None] = lambda line: None,
) -> Path:
    """Write an experiment.toml for a data file. It can be loaded at once, but each entry should be checked.

    Parameters
    ----------
    data_csv : Path
        The data. If they are not in the strict form of `csv_file`, they are written into a new file in that form, in
        SI units; the given file is not changed.
    out : Path, optional
        A folder, created if missing, or a file that ends in .toml; the folder of the data if omitted. The data are
        copied into another folder, since an experiment may only name files in its own folder.
    overwrite : bool
        Whether to replace existing files.
    columns : Columns, optional
        Which columns to read, and their units; determined from the labels if omitted.
    mirror : bool
        Whether to change the sign of all readings.
    report : callable
        Called with each line about how the data were read.

    Returns
    -------
    Path
        That of the experiment.toml.

    Raises
    ------
    ExperimentError
        If the data are unusable, or if a file exists and `overwrite` is not set.
    """
    data_csv = Path(data_csv)
    path = data_csv.parent / FILE_NAME if out is None else Path(out)
    if path.resolve() == data_csv.resolve():
        raise ExperimentError(f"{path}: this is the data file; name another file for the experiment.toml")
    if path.suffix != ".toml":
        check_folder(path)
        path = path / FILE_NAME
    clicks = None if columns is not None and columns.any else read_clicks(data_csv)
    table = read_table(data_csv, columns) if clicks is None else None
    if path.exists() and not overwrite:
        raise ExperimentError(f"{path}: exists already; name another file, or have it replaced (--overwrite)")
    if table is None:
        assert clicks is not None
        recording, noise = clicks
        report(f"{len(recording.times)} clicks, as `cradle measure sound` writes them")
        same = _check_target(path.parent / data_csv.name, recording.data, overwrite)
        text = click_scaffold_text(recording, noise, data_csv.name)
        write_together(path.parent, {**({} if same else {data_csv.name: recording.data}), path.name: text})
        return path
    if np.isnan(table.recording.readings).all():
        raise ExperimentError(f"{data_csv}: holds no reading at all; each row needs a value or more")
    if not data_csv.name.isprintable():
        raise ExperimentError(f"{data_csv.name!r}: this name cannot be written into a file; rename the data")
    for line in (*table.understood, *(["the signs of all readings are changed (--mirror)"] if mirror else [])):
        report(line)
    recording = mirror_signs(table.recording) if mirror else table.recording
    strict = table.strict and not mirror
    text, name, data = _files(recording, data_csv, strict, table.understood)
    _check_experiment(data_csv, recording, text, name, data, mirror)
    target = path.parent / name
    same = _check_target(target, data, overwrite)
    write_together(path.parent, {**({} if same else {name: data}), path.name: text})
    if not strict:
        report(f"wrote {target}: the same data in the strict form; {data_csv.name} stays as it is")
    return path


def _files(recording: Recording, data_csv: Path, strict: bool, understood: Sequence[str]) -> tuple[str, str, bytes]:
    """Format the experiment.toml; return it with name and content of its data file."""
    if strict:
        return scaffold_text(recording, data_csv.name), data_csv.name, recording.data
    name = f"{data_csv.stem}-si.csv"
    notes = "".join(f"# {line}\n" for line in (f"{_MARK[2:]} from {toml_text(data_csv.name)}", *understood))
    csv = notes + csv_text(recording.times, recording.displacements(), recording.quantity)
    return scaffold_text(recording, name), name, csv.encode()


def _check_target(target: Path, data: bytes, overwrite: bool) -> bool:
    """Return whether a file already holds these data.

    Raises ExperimentError if it holds others, unless this module wrote it and `overwrite` is set.
    """
    if not target.exists():
        return False
    content = target.read_bytes()
    if content != data and not (overwrite and content.startswith(_MARK.encode())):
        raise ExperimentError(f"{target}: exists already, and is not a copy of the data; name another folder")
    return content == data


def _check_experiment(data_csv: Path, recording: Recording, text: str, name: str, data: bytes, mirror: bool) -> None:
    """Raise ExperimentError if the experiment cannot be loaded, or if the readings are mirrored.

    The message about mirrored readings names the option that changes their signs.
    """
    turned = mirror_signs(recording)
    turned_csv = csv_text(turned.times, turned.displacements(), turned.quantity)
    remedy = "leave out --mirror" if mirror else "add --mirror, which changes all signs"
    other_way = ExperimentError(
        f"{data_csv}: the readings are mirrored: bobs would pass through each other where positive is towards the last"
        f" bob; {remedy}"
    )
    try:
        Experiment.from_texts({FILE_NAME: text, name: decode(name, data)[0]})
    except ExperimentError as problem:  # its place is in a file that is not yet written
        try:
            Experiment.from_texts({FILE_NAME: scaffold_text(turned, name), name: turned_csv})
        except ExperimentError:
            what = str(problem).partition(": run[1]: ")[2]
            raise ExperimentError(f"{data_csv}: {what}") if what else problem from None
        raise other_way from None
    if is_mirrored(recording) and not is_mirrored(turned):
        raise other_way


def scaffold_text(recording: Recording, file: str) -> str:
    """Format an experiment.toml for a recording in a file of that name."""
    bobs = recording.readings.shape[1]
    default = Cradle(bobs=bobs)
    moved = recording.displacements()
    widest = float(np.max(np.abs(moved), initial=0.0, where=~np.isnan(moved)))
    length, length_sd, known_by = _guess_length(recording, widest, default.length)
    lifted, before = _find_lifted_bobs(recording, moved, widest), recording.times < -_NOW
    if lifted and before.any():  # keep only the motion
        recording, moved = dataclasses.replace(
            recording, times=recording.times[~before], readings=recording.readings[~before],
            lines=recording.lines[~before],
        ), moved[~before]  # fmt: skip
    angles = {
        bob: math.asin(min(max(x / length, -1.0), 1.0)) if recording.quantity == "x" else x for bob, x in lifted.items()
    }
    steepest = max(map(abs, angles.values()), default=0.0)
    if steepest > math.pi:
        angles = {}
    base = "nsp" if bobs > 1 and steepest <= 1.5 else "pendulum"
    held = _find_release(recording, moved, lifted) if steepest <= 1.5 else None
    rest = "free" if recording.absolute else "known"
    unit = recording.unit
    first = max(0.0, recording.times[0]) if angles else recording.times[0]
    fit_from = f"# fit_from = {first:g}  # s; earlier data are not used, for example a messy release"
    if held is not None or (angles and before.any()):
        fit_from = f"fit_from = {0.0 if held is None else held[1]:g}  # s; earlier data are not used: the bobs are held"
    lines = [
        f"format = {toml_text(FORMAT)}",
        "",
        "# What is known of the cradle, in SI units. Every entry is a guess: check it.",
        "[cradle]",
        f"bobs = {bobs}  # the highest bob in the data; count also bobs that were not seen",
        f"length = {length:g}  # m, from the pivot to the centre of a bob; {known_by}measure it",
        f"pivot_half_spacing = {default.pivot_half_spacing:g}  # m, half the distance between a bob's two pivots",
        f"mass = {default.mass:g}  # kg, of one bob; weigh it",
        f"radius = {default.radius:g}  # m, of a bob",
        f"k_f = {default.k_f:g}  # N s m^-3/2, dissipation in impacts: where the inference starts",
        f"# kappa = {default.kappa:.4g}  # N/m, stiffness of one string; from beta = 0.114 if omitted",
        f"b = {default.b:g}  # kg/s, linear drag: where the inference starts",
        "",
        "[model]",
        f'base = "{base}"  # "nsp": on strings; "pendulum": on rigid rods; "ho": small swings on rigid rods',
        "effects = []  # more of the catalogue, such as exposure_blur for a camera with an open shutter",
        "",
        "[[run]]",
        f"file = {toml_text(file)}",
        *_release_lines(angles, bobs, *_angle_uncertainty(recording, lifted, length, length_sd), held),
        "delta = 0.0  # gap between pivots over the diameter of a bob, less 1: 0 where bobs just touch at rest",
        f"# noise = {0.001 / recording.scale:.3g}  # {unit}, 1 sigma of one reading; inferred if omitted",
        fit_from,
        f"# fit_to = {recording.times[-1]:g}  # s; later data are held out, to test predictions on",
        f'rest = "{rest}"  # "free" if the rest position of each bob in the file is uncertain',
        "",
        "# Unknowns beside k_f, kappa and b; remove the # of those that were not measured well.",
        "[infer]",
        f"# length = {{ mean = {length:g}, sd = {(length_sd if known_by else 0.01) * length:.2g} }}",
        "# delta = { low = -0.01, high = 0.01 }",
        "",
    ]
    return "\n".join(lines)


def _guess_length(recording: Recording, widest: float, default: float) -> tuple[float, float, str]:
    """Guess the length [m], its relative standard deviation, and a note on its source: the period, if it is known."""
    period = swing_period(recording)
    if period is not None:
        length = float(f"{pendulum_length(period):.3g}")
        steepest = widest if recording.quantity == "theta" else widest / length
        if steepest < 2.0:  # beyond, the period depends too much on the amplitude
            off = _PERIOD_SD + 0.2 * period / float(np.ptp(recording.times)) + steepest**2 / 16.0
            return length, off, f"by the period, {period:.3g} s; "
    return max(default, math.ceil(150.0 * widest) / 100.0 if recording.quantity == "x" else 0.0), _LENGTH_SD, ""


def _find_lifted_bobs(recording: Recording, moved: np.ndarray, widest: float) -> dict[int, float]:
    """Find the bobs that are released at t = 0, with their first readings: {bob: reading}.

    A lifted bob starts at the widest swing and was at the same place before. Empty if the recording does not contain
    the release.
    """
    since = int(np.searchsorted(recording.times, -_NOW))
    if widest == 0.0 or since == len(recording.times) or recording.times[since] > _NOW:
        return {}
    first = {}
    for bob, column in enumerate(moved[since : since + 5].T, 1):
        seen = column[~np.isnan(column)]
        if len(seen):
            first[bob] = float(seen[0])
    largest = max(map(abs, first.values()), default=0.0)
    if largest < 0.9 * widest:
        return {}
    lifted = {bob: x for bob, x in first.items() if abs(x) > 0.5 * largest}
    gone = np.abs(moved[:since, [bob - 1 for bob in lifted]] / np.array([*lifted.values()]) - 1.0)
    return lifted if np.max(gone, initial=0.0, where=~np.isnan(gone)) < _STILL else {}


def _find_release(recording: Recording, moved: np.ndarray, lifted: Iterable[int]) -> tuple[float, float] | None:
    """Find when bobs that are held at first begin to move, and the first row in which they all move [s].

    The time scale is taken from the fall itself, since the length is a guess. None if the bobs are released at t = 0,
    or not at all.
    """
    found = []
    for bob in lifted:
        seen = ~np.isnan(moved[:, bob - 1])
        t, x = recording.times[seen], moved[seen, bob - 1]
        gone = 1.0 - x / x[0]
        if (gone > _SWINGS).any():
            swings = int(np.argmax(gone > _SWINGS))
            still = int(np.flatnonzero(gone[:swings] < _STILL)[-1])
            if t[still] > _AT_ONCE * (t[swings] - t[still]):
                passed = ((_STILL, still + 1), (_SWINGS, swings))
                early, late = (np.interp(part, gone[i - 1 : i + 1], t[i - 1 : i + 1]) for part, i in passed)
                phases = math.acos(1.0 - _STILL), math.acos(1.0 - _SWINGS)  # of a cosine
                begin = early - (late - early) * phases[0] / (phases[1] - phases[0])
                found.append((float(begin), float(t[still + 1])))
    return max(found, default=None)


def _angle_uncertainty(
    recording: Recording, lifted: Mapping[int, float], length: float, length_sd: float
) -> tuple[float, str]:
    """Standard deviation of the release angle [rad], and a comment on it."""
    if recording.quantity != "x" or not lifted:
        return _ANGLE_SD, "from the first rows; check"
    bob, x = max(lifted.items(), key=lambda item: abs(item[1]))
    column, off, of_rest = recording.readings[:, bob - 1], 0.0, ""
    if recording.absolute:  # the rest position is between the median and, of a bob that swings alone, the middle
        off = abs(0.5 * float(np.nanmin(column) + np.nanmax(column)) - float(np.nanmedian(column)))
        of_rest = ", x is relative to the median, which differs from the rest position"
    slope = 1.0 / math.sqrt(max(1.0 - (x / length) ** 2, 0.01)) / length
    then = math.hypot(_ANGLE_SD, off * slope)
    comment = (
        f"from the first rows: asin({x:.4g} m / length), as uncertain as the guessed length;"
        f" once length is measured, correct angle and write angle_sd = {then:.1g}{of_rest}"
    )
    return math.hypot(then, length_sd * x * slope), comment


def _release_lines(
    angles: Mapping[int, float], bobs: int, angle_sd: float, comment: str, held: tuple[float, float] | None
) -> list[str]:
    """Format the release and the state from which a run starts."""
    if not angles:
        return [
            "# release = { bobs = 1, angle = 0.2, angle_sd = 0.001 }  # rad; the data do not begin with a release",
            'state = "free"  # the initial state is inferred; "release": starts at t = 0, at rest, as stated',
        ]
    values = list(angles.values())
    together = sorted(angles) == list(range(bobs - len(angles) + 1, bobs + 1)) and np.ptp(values) < 0.02
    if together:
        which = f"bobs = {len(angles)}, angle = {np.mean(values):.4g}"
    else:
        which = "angles = { " + ", ".join(f"{bob} = {angle:.4g}" for bob, angle in angles.items()) + " }"
    release = f'release = {{ {which}, angle_sd = {angle_sd:.2g}, start = "unstretched" }}  # rad, {comment}'
    states = '"free": the initial state is inferred, at fit_from; "release": starts at t = 0, at rest, as stated'
    if held is None:
        return [release, f'state = "release"  # {states}']
    return [
        f"# {release}",
        f"# The bobs are held until {held[0]:.2f} s, the time of the release. With that subtracted from t in the data,"
        ' write state = "release", and neither fit_from nor the # before release.',
        f'state = "free"  # {states}',
    ]
