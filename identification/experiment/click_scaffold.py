"""A first experiment.toml for the clicks that `cradle measure sound` found."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cradle_env.cradle import Cradle
from identification.experiment.csv_file import parse_recording
from identification.experiment.experiment_file import FORMAT
from identification.experiment.plausibility import pendulum_length
from identification.experiment.recording import Recording, find_delimiter, is_content, split_header
from identification.experiment.text_encoding import decode
from identification.experiment.zipped_table import is_zip
from identification.storage.files import ExperimentError, read_bytes
from identification.storage.toml_table import toml_text

#: Columns by which a table of clicks is recognized.
_COLUMNS = {"t [s]", "t_sd [s]", "amplitude", "likeness"}
#: Release angle [rad] and its standard deviation: no click tells it.
_ANGLE, _ANGLE_SD = 0.2, 0.02
#: Standard deviation of a length computed from the median interval, as a part of it: strings stretch by up to 3 %.
_LENGTH_SD = 0.03


def read_clicks(path: Path) -> tuple[Recording, float] | None:
    """Read the clicks in a table of `cradle measure sound`; None if the file is another table.

    Returns the clicks and the median standard deviation of an instant [s].
    """
    data = read_bytes(path)
    if is_zip(data):
        return None
    name, text = path.name, decode(path.name, data)[0]
    content = [line for line in text.split("\n") if is_content(line)]
    top = content[0] if content else ""
    delimiter = find_delimiter(top)
    header = split_header(top, delimiter)
    if not _COLUMNS <= set(header):
        return None
    recording = parse_recording(name, text, data, impacts=True)
    if len(recording.times) < 2:
        raise ExperimentError(f"{name}: fewer than two clicks; nothing can be inferred from them")
    try:
        spreads = [float(line.split(delimiter)[header.index("t_sd [s]")]) for line in content[1:]]
    except (ValueError, IndexError):
        raise ExperimentError(f"{name}: t_sd [s] is not a number in each line; measure the sound again") from None
    return recording, float(np.median(spreads))


def click_scaffold_text(recording: Recording, noise: float, file: str) -> str:
    """Format an experiment.toml for clicks in a file of that name, whose instants have this standard deviation [s]."""
    default, half_swing = Cradle(bobs=2), float(np.median(np.diff(recording.times)))
    length = float(f"{pendulum_length(2.0 * half_swing):.3g}")
    lines = [
        f"format = {toml_text(FORMAT)}",
        "",
        "# What is known of the cradle, in SI units. Every entry is a guess: check it.",
        "[cradle]",
        "bobs = 2  # clicks do not tell how many; two are heard best",
        f"length = {length:g}  # m, from the pivot to the centre of a bob; by the median interval, {half_swing:.3g} s;"
        " measure it",
        f"pivot_half_spacing = {default.pivot_half_spacing:g}  # m, half the distance between a bob's two pivots",
        f"mass = {default.mass:g}  # kg, of one bob; weigh it",
        f"radius = {default.radius:g}  # m, of a bob",
        "",
        "[[run]]",
        f"file = {toml_text(file)}",
        'quantity = "impacts"  # instants of clicks',
        f"noise = {noise:.2g}  # s, of an instant, as measured",
        f"release = {{ bobs = 1, angle = {_ANGLE:g}, angle_sd = {_ANGLE_SD:g} }}  # rad; no click tells it: measure it",
        "delta = 0.0  # gap between pivots over the diameter of a bob, less 1: 0 where bobs just touch at rest",
        f"# fit_to = {recording.times[-1]:g}  # s; later clicks are held out, to test predictions on",
        "",
        "# Unknowns beside k_f, kappa and b. The intervals depend on length and kappa together.",
        "[infer]",
        f"length = {{ mean = {length:g}, sd = {_LENGTH_SD * length:.2g} }}  # once measured, state how well",
        "",
    ]
    return "\n".join(lines)
