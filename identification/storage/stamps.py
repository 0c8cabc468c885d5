"""Stamps: the JSON file of a command's results also lists the files that the command has written, by SHA-256."""

from __future__ import annotations

import glob
import hashlib
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from identification.storage.files import ExperimentError, json_text, write_json, write_together
from identification.storage.lock import check_folder, lock_folder
from identification.storage.schema import read_json

#: Suffix of the file that lists the files about to be written.
_PENDING = ".pending"


def check_replaceable(folder: Path, names: Iterable[str], stamp: str, formats: str) -> None:
    """Check that a command may replace the files of these names in a folder.

    It may replace a file that the stamp of the same format lists with the file's present SHA-256, the stamp itself,
    and files that a killed process was about to write.

    Parameters
    ----------
    folder : Path
        Folder of the results; it may be missing.
    names : iterable of str
        Names of the files that the command is going to write.
    stamp : str
        Name of the stamp.
    formats : str
        `format` of the stamp.

    Raises
    ------
    ExperimentError
        If there is another file of one of these names, or if the folder is a file.
    """
    check_folder(folder)
    content, pending = read_stamp(folder / stamp, formats), read_stamp(_pending(folder, stamp), formats)

    def ours(name: str) -> bool:
        if pending is not None and (name == stamp or _lists(pending, folder / name)):
            return True
        if content is None or name == stamp:
            return content is not None
        return "files" not in content or _lists(content, folder / name)

    for name in names:
        if (folder / name).exists() and not ours(name):
            raise ExperimentError(f"{folder / name}: exists and is no result of this command; choose another --out")


def write_results(
    folder: Path, files: Mapping[str, str | bytes | Path], stamp: str, content: Mapping[str, Any]
) -> dict[str, Any]:
    """Write files by name and, last, the stamp.

    The stamp's `files` lists these files and those that it listed before, by SHA-256. A Path is a file to move there.
    Returns the content of the stamp.
    """
    with lock_folder(folder):
        earlier = (read_stamp(folder / stamp, content["format"]) or {}).get("files", {})
        content = {**content, "files": {**earlier, **{name: sha256_of(data) for name, data in files.items()}}}
        pending = write_json(_pending(folder, stamp), {key: content[key] for key in ("format", "files")})
        write_together(folder, {**files, stamp: json_text(content)})
        pending.unlink()
        remove_leftovers(folder, (*files, stamp, pending.name))
    return content


def remove_leftovers(folder: Path, names: Iterable[str]) -> None:
    """Remove temporary files that killed processes left for these names. The caller must hold the folder's lock."""
    for name in names:
        for left in folder.glob(f".{glob.escape(name)}.*"):
            if re.fullmatch(r"\d+(\.part)?", left.name.removeprefix(f".{name}.")):
                left.unlink()


def _pending(folder: Path, stamp: str) -> Path:
    return folder / f".{stamp}{_PENDING}"


def _lists(content: Mapping[str, Any], file: Path) -> bool:
    """Whether a stamp lists a file with its present content."""
    return content.get("files", {}).get(file.name) == sha256_of(file)


def read_stamp(path: Path, formats: str, schema: str = "stamp") -> dict[str, Any] | None:
    """Read a JSON file of results of this format; None if there is no such file or it does not match its schema."""
    try:
        content = read_json(path, schema)
    except ExperimentError:
        return None
    return content if content["format"] == formats else None


def sha256_of(data: str | bytes | Path) -> str:
    """SHA-256 of text, bytes, or the content of a file; files larger than memory too."""
    if isinstance(data, Path):
        with data.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    return hashlib.sha256(data.encode() if isinstance(data, str) else data).hexdigest()


#: The commands that write a report.html, by another file that each of them writes.
_REPORTS = {
    "posterior.nc": "calibrate",
    "diagnosis.json": "diagnose",
    "design.json": "design",
    "measurement.json": "measure",
}


def check_report(folder: Path, command: str) -> None:
    """Raise ExperimentError if `command` would replace the report of another command in a folder."""
    for name, other in _REPORTS.items():
        if other != command and (folder / name).exists():
            raise ExperimentError(
                f"{folder}: holds the report of cradle {other}, which would be lost; choose another --out"
            )
