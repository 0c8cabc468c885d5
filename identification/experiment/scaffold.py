"""A first experiment.toml for a data file: guesses from the data, each with what to check."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from cradle_env.cradle import Cradle
from identification.experiment.csv_file import read_recording
from identification.experiment.experiment import Experiment
from identification.experiment.experiment_file import FILE_NAME, FORMAT
from identification.experiment.recording import Recording
from identification.storage.files import ExperimentError, write_together
from identification.storage.toml_table import toml_text

#: How well the first rows tell an angle [rad], and the share of itself by which a guessed length is off; 1 sigma.
_ANGLE_SD, _LENGTH_SD = 0.002, 0.5
#: Parts of its way to rest that a bob has gone while it still counts as held, and once it surely swings; and how many
#: times as long as from one to the other it may take to the first if it is let go at once: on a cosine 0.76.
_STILL, _SWINGS, _AT_ONCE = 0.1, 0.5, 1.5
#: Times [s] nearer 0 than this are those of the release.
_NOW = 0.05


def scaffold(data_csv: Path, out: Path | None = None, *, overwrite: bool = False) -> Path:
    """Writes an experiment.toml for a data file, beside it or at `out`, that loads at once; its path.

    In another folder the data go along, for an experiment names no file outside its own folder.

    Raises ExperimentError if the data are unusable, or if the file exists and overwrite is not set.
    """
    data_csv = Path(data_csv)
    out = data_csv.parent / FILE_NAME if out is None else Path(out)
    if out.is_dir():
        out = out / FILE_NAME
    if out.resolve() == data_csv.resolve():
        raise ExperimentError(f"{out}: these are the data; name another file for what describes them")
    recording = read_recording(data_csv)
    if out.exists() and not overwrite:
        raise ExperimentError(f"{out}: exists already; name another file, or say that it may be overwritten")
    if np.isnan(recording.readings).all():
        raise ExperimentError(f"{data_csv}: holds no reading at all; each row needs a value or more")
    name, copied = data_csv.name, out.parent / data_csv.name
    beside_data = copied.resolve() == data_csv.resolve()
    if not beside_data and copied.exists() and copied.read_bytes() != recording.data:
        raise ExperimentError(f"{copied}: exists already, and is not a copy of the data; name another folder")
    if not name.isprintable():
        raise ExperimentError(f"{name!r}: this name cannot be written into a file; rename the data")
    text = scaffold_text(recording, name)
    try:
        Experiment.parse(text, data_csv.parent / out.name)
    except ExperimentError as problem:  # with what is guessed from the data, in a file that is not written
        what = str(problem).partition(": run[1]: ")[2]
        raise ExperimentError(f"{data_csv}: {what}") if what else problem from None
    write_together(out.parent, {**({} if beside_data else {name: recording.data}), out.name: text})
    return out


def scaffold_text(recording: Recording, file: str) -> str:
    """The experiment.toml for a recording in a file of that name."""
    bobs = recording.readings.shape[1]
    default = Cradle(bobs=bobs)
    moved = recording.displacements()
    widest = float(np.max(np.abs(moved), initial=0.0, where=~np.isnan(moved)))
    length = default.length
    if recording.quantity == "x" and widest < 2.0:  # beyond, the unit is wrong, and is refused
        length = max(length, math.ceil(150.0 * widest) / 100.0)
    lifted, before = _lifted(recording, moved, widest), recording.times < -_NOW
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
    held = _held(recording, moved, lifted) if steepest <= 1.5 else None
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
        f"length = {length:g}  # m, from the pivot to the centre of a bob; measure it",
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
        *_release_lines(angles, bobs, *_angle_sd(recording, lifted, length), held),
        "delta = 0.0  # gap between pivots over the diameter of a bob, less 1: 0 where bobs just touch at rest",
        f"# noise = {0.001 / recording.scale:.3g}  # {unit}, 1 sigma of one reading; inferred where omitted",
        fit_from,
        f"# fit_to = {recording.times[-1]:g}  # s; later data are held out, to test predictions on",
        f'rest = "{rest}"  # "free" if the rest position of each bob in the file is uncertain',
        "",
        "# Unknowns beside k_f, kappa and b; take out the # of what was not measured well.",
        "[infer]",
        f"# length = {{ mean = {length:g}, sd = {0.01 * length:.2g} }}",
        "# delta = { low = -0.01, high = 0.01 }",
        "",
    ]
    return "\n".join(lines)


def _lifted(recording: Recording, moved: np.ndarray, widest: float) -> dict[int, float]:
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


def _held(recording: Recording, moved: np.ndarray, lifted: Iterable[int]) -> tuple[float, float] | None:
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


def _angle_sd(recording: Recording, lifted: Mapping[int, float], length: float) -> tuple[float, str]:
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
    return math.hypot(then, _LENGTH_SD * x * slope), told


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
