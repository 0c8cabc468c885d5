"""A first experiment.toml for a data file: guesses from the data, each with what to check."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from cradle_env.cradle import Cradle
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

#: How a data file begins that was written here, and may be overwritten.
_MARK = "# Written by cradle new"
#: How well the first rows tell an angle [rad], and the part of itself by which a guessed length is off, without and
#: with a period that was seen; 1 sigma.
_ANGLE_SD, _LENGTH_SD, _PERIOD_SD = 0.002, 0.5, 0.03
#: Parts of its way to rest that a bob has gone while it still counts as held, and once it surely swings; and how many
#: times as long as from one to the other it may take to the first if it is let go at once: on a cosine 0.76.
_STILL, _SWINGS, _AT_ONCE = 0.1, 0.5, 1.5
#: Times [s] nearer 0 than this are those of the release.
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
    """Writes an experiment.toml for a data file, beside it or at `out`, that loads at once; its path.

    out: a folder, made if need be, or a file that ends in .toml. In another folder the data go along, for an
    experiment names no file outside its own folder. Data that are not in the strict form go into a new file in that
    form, in SI units; theirs stays as it is. columns: what is known of the columns; mirror: turns the sign of all
    readings; report: called with each line of what was understood.

    Raises ExperimentError if the data are unusable, or if a file exists and overwrite is not set.
    """
    data_csv = Path(data_csv)
    path = data_csv.parent / FILE_NAME if out is None else Path(out)
    if path.resolve() == data_csv.resolve():
        raise ExperimentError(f"{path}: these are the data; name another file for what describes them")
    if path.suffix != ".toml":
        check_folder(path)
        path = path / FILE_NAME
    table = read_table(data_csv, columns)
    if path.exists() and not overwrite:
        raise ExperimentError(f"{path}: exists already; name another file, or have it replaced (--overwrite)")
    if np.isnan(table.recording.readings).all():
        raise ExperimentError(f"{data_csv}: holds no reading at all; each row needs a value or more")
    if not data_csv.name.isprintable():
        raise ExperimentError(f"{data_csv.name!r}: this name cannot be written into a file; rename the data")
    for line in (*table.understood, *(["the signs of all readings are turned (--mirror)"] if mirror else [])):
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
    """The experiment.toml, and the name and content of the data beside it."""
    if strict:
        return scaffold_text(recording, data_csv.name), data_csv.name, recording.data
    name = f"{data_csv.stem}-si.csv"
    notes = "".join(f"# {line}\n" for line in (f"{_MARK[2:]} from {toml_text(data_csv.name)}", *understood))
    csv = notes + csv_text(recording.times, recording.displacements(), recording.quantity)
    return scaffold_text(recording, name), name, csv.encode()


def _check_target(target: Path, data: bytes, overwrite: bool) -> bool:
    """Whether a file holds these data already; refuses to write over any other, but for one that was written here."""
    if not target.exists():
        return False
    content = target.read_bytes()
    if content != data and not (overwrite and content.startswith(_MARK.encode())):
        raise ExperimentError(f"{target}: exists already, and is not a copy of the data; name another folder")
    return content == data


def _check_experiment(data_csv: Path, recording: Recording, text: str, name: str, data: bytes, mirror: bool) -> None:
    """Refuses what would not load; signs that are the other way round with the option that turns them."""
    turned = mirror_signs(recording)
    turned_csv = csv_text(turned.times, turned.displacements(), turned.quantity)
    remedy = "leave out --mirror" if mirror else "add --mirror, which turns all signs"
    other_way = ExperimentError(
        f"{data_csv}: the readings are mirrored: bobs would pass through each other where positive is towards the last"
        f" bob; {remedy}"
    )
    try:
        Experiment.from_texts({FILE_NAME: text, name: decode(name, data)[0]})
    except ExperimentError as problem:  # with what is guessed from the data, in a file that is not written
        try:
            Experiment.from_texts({FILE_NAME: scaffold_text(turned, name), name: turned_csv})
        except ExperimentError:
            what = str(problem).partition(": run[1]: ")[2]
            raise ExperimentError(f"{data_csv}: {what}") if what else problem from None
        raise other_way from None
    if is_mirrored(recording) and not is_mirrored(turned):
        raise other_way


def scaffold_text(recording: Recording, file: str) -> str:
    """The experiment.toml for a recording in a file of that name."""
    bobs = recording.readings.shape[1]
    default = Cradle(bobs=bobs)
    moved = recording.displacements()
    widest = float(np.max(np.abs(moved), initial=0.0, where=~np.isnan(moved)))
    length, length_sd, known_by = _guess_length(recording, widest, default.length)
    lifted, before = _find_lifted_bobs(recording, moved, widest), recording.times < -_NOW
    if lifted and before.any():  # what follows is of the motion
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
    fit_from = f"# fit_from = {first:g}  # s; earlier data are not used: a messy release, say"
    if held is not None or (angles and before.any()):
        fit_from = f"fit_from = {0.0 if held is None else held[1]:g}  # s; earlier data are not used: the bobs are held"
    lines = [
        f"format = {toml_text(FORMAT)}",
        "",
        "# What is known of the cradle, in SI units. Every entry is a guess: check it.",
        "[cradle]",
        f"bobs = {bobs}  # the highest bob in the data; count those that were not seen too",
        f"length = {length:g}  # m, from the pivot to the centre of a bob; {known_by}measure it",
        f"pivot_half_spacing = {default.pivot_half_spacing:g}  # m, half the distance between a bob's two pivots",
        f"mass = {default.mass:g}  # kg, of one bob; weigh it",
        f"radius = {default.radius:g}  # m, of a bob",
        f"k_f = {default.k_f:g}  # N s m^-3/2, dissipation in impacts: where the inference starts",
        f"# kappa = {default.kappa:.4g}  # N/m, stiffness of one string; from beta = 0.114 where omitted",
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
        f"# noise = {0.001 / recording.scale:.3g}  # {unit}, 1 sigma of one reading; inferred where omitted",
        fit_from,
        f"# fit_to = {recording.times[-1]:g}  # s; later data are held out, to test predictions on",
        f'rest = "{rest}"  # "free" if the rest position of each bob in the file is uncertain',
        "",
        "# Unknowns beside k_f, kappa and b; take out the # of what was not measured well.",
        "[infer]",
        f"# length = {{ mean = {length:g}, sd = {(length_sd if known_by else 0.01) * length:.2g} }}",
        "# delta = { low = -0.01, high = 0.01 }",
        "",
    ]
    return "\n".join(lines)


def _guess_length(recording: Recording, widest: float, default: float) -> tuple[float, float, str]:
    """A length [m], the part of it by which it may be off, and what tells it: the period, if a swing is seen."""
    period = swing_period(recording)
    if period is not None:
        length = float(f"{pendulum_length(period):.3g}")
        steepest = widest if recording.quantity == "theta" else widest / length
        if steepest < 2.0:  # else the period says little of the length
            off = _PERIOD_SD + 0.2 * period / float(np.ptp(recording.times)) + steepest**2 / 16.0
            return length, off, f"by the period, {period:.3g} s; "
    return max(default, math.ceil(150.0 * widest) / 100.0 if recording.quantity == "x" else 0.0), _LENGTH_SD, ""


def _find_lifted_bobs(recording: Recording, moved: np.ndarray, widest: float) -> dict[int, float]:
    """{bob: first reading} of those at rest far out when the run begins, at t = 0, and held there before; empty if it
    was not seen to begin."""
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
    """When bobs that are held at first begin to move, and the first row in which they all do [s]; None if they are let
    go at once, or not at all. The time scale is that of the fall itself: the length is a guess."""
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
    """How well the release angle is known [rad], and what to tell of it."""
    if recording.quantity != "x" or not lifted:
        return _ANGLE_SD, "from the first rows; check"
    bob, x = max(lifted.items(), key=lambda item: abs(item[1]))
    column, off, of_rest = recording.readings[:, bob - 1], 0.0, ""
    if recording.absolute:  # the rest lies between the median and the middle, that of bobs that swing alone
        off = abs(0.5 * float(np.nanmin(column) + np.nanmax(column)) - float(np.nanmedian(column)))
        of_rest = ", x is counted from the median, which is not quite its rest"
    slope = 1.0 / math.sqrt(max(1.0 - (x / length) ** 2, 0.01)) / length
    then = math.hypot(_ANGLE_SD, off * slope)
    told = (
        f"from the first rows: asin({x:.4g} m / length), as uncertain as length is while it is a guess;"
        f" state both anew once it is measured, angle_sd = {then:.1g} then{of_rest}"
    )
    return math.hypot(then, length_sd * x * slope), told


def _release_lines(
    angles: Mapping[int, float], bobs: int, angle_sd: float, told: str, held: tuple[float, float] | None
) -> list[str]:
    """The release and the state from which a run starts."""
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
    release = f'release = {{ {which}, angle_sd = {angle_sd:.2g}, start = "unstretched" }}  # rad, {told}'
    states = '"free": the initial state is inferred, at fit_from; "release": starts at t = 0, at rest, as stated'
    if held is None:
        return [release, f'state = "release"  # {states}']
    return [
        f"# {release}",
        f"# The bobs are held until {held[0]:.2f} s, the time of the release. With that subtracted from t in the data,"
        ' write state = "release", and neither fit_from nor the # before release.',
        f'state = "free"  # {states}',
    ]
