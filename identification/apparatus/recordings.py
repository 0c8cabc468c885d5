"""Recordings of bobs for an instrument, in the forms that programs export."""

from __future__ import annotations

from pathlib import Path

from identification.experiment.recording import Recording
from identification.experiment.table_reader import read_table
from identification.storage.files import ExperimentError


def read_motion(path: Path) -> tuple[Recording, tuple[str, ...]]:
    """Read a recording, and how it was read, a sentence each; none for a file in the strict form of an experiment.

    Raises ExperimentError, one line; where an option would resolve an ambiguity, it names the command that has it.
    """
    try:
        table = read_table(path)
    except ExperimentError as problem:
        if " --" not in str(problem):
            raise
        raise ExperimentError(f"{problem}; `cradle new` has this option, and writes a CSV to be named here") from None
    return table.recording, () if table.strict else tuple(f"{path.name}: {line}." for line in table.understood)
