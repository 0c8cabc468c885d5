"""Recordings of bobs for an instrument, in the forms that programs export."""

from __future__ import annotations

import re
from pathlib import Path

from identification.experiment.recording import Recording
from identification.experiment.table_reader import read_table
from identification.storage.files import ExperimentError

#: Options of `cradle new` in messages of `read_table`.
_OPTION = re.compile(r" --(time|bob|unit|run|rate)\b")


def read_motion(path: Path) -> tuple[Recording, tuple[str, ...]]:
    """Read a recording, and how it was read, a sentence each; none for a file in the strict form of an experiment.

    Raises ExperimentError, one line; where an option would resolve an ambiguity, it names the command that has it.
    """
    try:
        table = read_table(path)
    except ExperimentError as problem:
        if not _OPTION.search(str(problem)):
            raise
        raise ExperimentError(f"{problem}; `cradle new` has these options: measure the CSV that it writes") from None
    lines = [line for line in table.understood if line != "..."]
    return table.recording, () if table.strict else tuple(f"{path.name}: {line}." for line in lines)
