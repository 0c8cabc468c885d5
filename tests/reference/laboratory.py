"""From a run of the soft-contact reference to the files of an experiment: an instrument, its faults, TOML and CSV.

Nothing of the package is used. The truth of a recording is its SoftCradle with all effects; what the files state is
the nominal cradle and release, unless `stated` says otherwise.

    recording = record(SoftCradle(3, effects={"quadratic_drag": {"c2": 2e-3}}), {3: 0.228}, seed=1)
    write_experiment(folder, [recording], stated={"b": 0.003})
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from .soft_contact import SoftCradle, SoftRun, initial_state, simulate_soft
from .soft_kernel import THETA, R

BLUR_STEP = 2.5e-4  # s between the instants that an exposure averages: a kink of 2 rad/s in 5 ms errs by 3e-6 rad
UNITS = {"rad": 1.0, "deg": np.pi / 180, "m": 1.0, "cm": 1e-2, "mm": 1e-3}


@dataclass(frozen=True)
class Recording:
    """What the file of one run holds: times (T,) by the file's clock and readings (T, N), in rad or m, nan if missing.

    angles, start: the release; noise: its standard deviation (rad or m); run: the motion behind, for checks.
    """

    cradle: SoftCradle
    times: np.ndarray
    readings: np.ndarray
    quantity: str
    angles: dict[int, float]
    start: str
    noise: float
    run: SoftRun


def record(
    cradle: SoftCradle,
    angles: dict[int, float],
    start: str = "unstretched",
    *,
    duration: float = 45.0,
    rate: float = 60.0,
    quantity: str = "theta",
    noise: float = 1e-3,
    correlation_time: float = 0.0,
    seed: int = 0,
    **steps: float,
) -> Recording:
    """Release the bobs in `angles` and film them: `rate` frames per second of the file's clock over `duration`.

    theta_file = (1 + scale) theta + offset; t_file = (1 + scale) t; both of the centred average over the exposure, in
    which bobs are still held before t = 0. quantity "x": X + r sin(theta_file), from where each bob rests. `noise` is
    Gaussian, with correlation exp(-|t|/correlation_time). `steps`: tolerance and max_step of simulate_soft.
    """
    times = np.arange(int(np.floor(duration * rate * (1 + 1e-12))) + 1) / rate
    exposure = cradle.effect("exposure_blur", "duration")
    parts = max(1, int(np.ceil(exposure / BLUR_STEP)))
    offsets = exposure * ((np.arange(parts) + 0.5) / parts - 0.5)
    true_times = times / (1 + cradle.effect("clock_scale", "scale"))
    instants, where = np.unique(np.maximum(true_times[:, None] + offsets, 0.0), return_inverse=True)
    run = simulate_soft(cradle, angles, start, times=instants, **steps)

    def shown(theta: np.ndarray) -> np.ndarray:
        return (1 + cradle.effect("angle_scale", "scale")) * theta + cradle.effect("angle_offset", "offset")

    seen = shown(run.theta)
    if quantity == "x":
        rest = initial_state(cradle.constants(), {})
        still = rest[R, -1] + rest[R, :-1] * np.sin(shown(rest[THETA, :-1]))
        seen = run.frame[:, :1] + run.r * np.sin(seen) - still
    readings = seen[where.reshape(len(times), parts)].mean(axis=1)
    readings += noise * correlated_noise(readings.shape, correlation_time * rate, np.random.default_rng(seed))
    return Recording(cradle, times, readings, quantity, dict(angles), start, noise, run)


def correlated_noise(shape: tuple[int, int], frames: float, rng: np.random.Generator) -> np.ndarray:
    """Gaussian noise of unit variance, each column of correlation exp(-lag/frames): AR(1); white for frames = 0."""
    memory = np.exp(-1 / frames) if frames > 0 else 0.0
    shocks = rng.standard_normal(shape)
    shocks[1:] *= np.sqrt(1 - memory**2)
    return lfilter([1.0], [1.0, -memory], shocks, axis=0)


def drop_frames(recording: Recording, share: float, seed: int = 0) -> Recording:
    """Without this share of the frames, at random; the first stays."""
    kept = np.random.default_rng(seed).random(len(recording.times)) >= share
    kept[0] = True
    return replace(recording, times=recording.times[kept], readings=recording.readings[kept])


def lose_track(recording: Recording, bob: int, begin: float, end: float) -> Recording:
    """Without the readings of one bob from `begin` to `end`."""
    readings = recording.readings.copy()
    readings[(recording.times >= begin) & (recording.times <= end), bob - 1] = np.nan
    return replace(recording, readings=readings)


def tracking_jump(recording: Recording, bob: int, size: float, begin: float, end: float = np.inf) -> Recording:
    """With the readings of one bob shifted by `size` (rad or m) from `begin` to `end`: the tracker slipped."""
    readings = recording.readings.copy()
    readings[(recording.times >= begin) & (recording.times <= end), bob - 1] += size
    return replace(recording, readings=readings)


def write_experiment(
    folder: str | Path,
    recordings: Sequence[Recording],
    *,
    unit: str | None = None,
    stated: dict[str, float] | None = None,
    base: str = "nsp",
    effects: Sequence[str] = (),
    parameters: dict[str, dict[str, float]] | None = None,
    infer: dict[str, dict[str, float]] | None = None,
    release: dict[str, float] | None = None,
    run: dict[str, float | str | None] | None = None,
) -> Path:
    """Write experiment.toml, and run1.csv and so on beside it, one per recording of one cradle; the path of the first.

    stated: entries of [cradle] other than the truth; base, effects, parameters: [model]; infer: [infer], by name;
    release: more entries of each release, angle_sd 1e-3 unless said; run: entries of each [[run]] other than the
    truth, None to leave one out (noise=None: to be inferred). unit: of the readings, rad or m by default.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    cradle = recordings[0].cradle
    known = {
        "bobs": cradle.bobs,
        "length": float(np.mean(cradle.length)),
        "pivot_half_spacing": cradle.pivot_half_spacing,
        "mass": float(np.mean(cradle.mass)),
        "radius": cradle.radius,
        "youngs_modulus": cradle.youngs_modulus,
        "poisson_ratio": cradle.poisson_ratio,
        "k_f": cradle.k_f,
        "kappa": cradle.string_stiffness,
        "b": cradle.b,
        "gravity": cradle.gravity,
    }
    lines = ['format = "cradle-experiment/1"', "", "[cradle]"]
    lines += [f"{key} = {toml(value)}" for key, value in {**known, **(stated or {})}.items()]
    lines += ["", "[model]", f"base = {toml(base)}", f"effects = {toml(list(effects))}"]
    for table, entries in (("model.parameters", parameters), ("infer", infer)):
        if entries:
            lines += ["", f"[{table}]", *(f"{toml_key(name)} = {toml(values)}" for name, values in entries.items())]
    for number, recording in enumerate(recordings, 1):
        name = f"run{number}.csv"
        chosen = unit or ("rad" if recording.quantity == "theta" else "m")
        (folder / name).write_text(csv(recording, chosen), encoding="utf-8")
        start = {"angles": recording.angles, "angle_sd": 1e-3, "start": recording.start}
        delta = np.asarray(recording.cradle.delta, float)
        entries = {
            "file": name,
            "release": {**start, **(release or {})},
            "delta": delta.tolist(),
            "noise": recording.noise / UNITS[chosen] if recording.noise > 0 else None,
            **(run or {}),
        }
        lines += ["", "[[run]]", *(f"{key} = {toml(value)}" for key, value in entries.items() if value is not None)]
    path = folder / "experiment.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def csv(recording: Recording, unit: str) -> str:
    """The CSV of one recording, readings in `unit`; an empty field where one is missing."""
    header = ["t [s]", *(f"{recording.quantity}_{i + 1} [{unit}]" for i in range(recording.readings.shape[1]))]
    rows = np.column_stack([recording.times, recording.readings / UNITS[unit]])
    fields = (",".join("" if np.isnan(value) else f"{value:.12g}" for value in row) for row in rows)
    return "\n".join([",".join(header), *fields]) + "\n"


def toml(value: object) -> str:
    """A value in TOML."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{toml_key(key)} = {toml(entry)}" for key, entry in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


def toml_key(key: object) -> str:
    """A key in TOML, quoted if it has a point."""
    return f'"{key}"' if "." in str(key) else str(key)
