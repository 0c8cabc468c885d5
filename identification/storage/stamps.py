"""Results in a folder: a JSON file, the stamp, lists the files that a command has written."""

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

#: Ends the name of the file that lists what is about to be written.
_PENDING = ".pending"


def check_replaceable(folder: Path, names: Iterable[str], stamp: str, formats: str) -> None:
    """ExperimentError where a folder holds a file of these names that is not ours to replace: the JSON file that our
    command writes beside it, its stamp, is not there, not of this format, or lists the file otherwise or not at all;
    or where the folder is a file. Files that were about to be written when their process was killed are ours."""
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
    """Writes files by name and, last, the stamp, which lists them and what it has listed before as `files`, by their
    SHA-256; returns its content. A Path is a file to be moved there."""
    with lock_folder(folder):
        earlier = (read_stamp(folder / stamp, content["format"]) or {}).get("files", {})
        content = {**content, "files": {**earlier, **{name: sha256_of(data) for name, data in files.items()}}}
        pending = write_json(_pending(folder, stamp), {key: content[key] for key in ("format", "files")})
        write_together(folder, {**files, stamp: json_text(content)})
        pending.unlink()
        remove_leftovers(folder, (*files, stamp, pending.name))
    return content


def remove_leftovers(folder: Path, names: Iterable[str]) -> None:
    """Removes what processes that were killed have left of files of these names; the folder must be held."""
    for name in names:
        for left in folder.glob(f".{glob.escape(name)}.*"):
            if re.fullmatch(r"\d+(\.part)?", left.name.removeprefix(f".{name}.")):
                left.unlink()


def _pending(folder: Path, stamp: str) -> Path:
    return folder / f".{stamp}{_PENDING}"


def _lists(content: Mapping[str, Any], file: Path) -> bool:
    """Whether a stamp lists a file as it is."""
    return content.get("files", {}).get(file.name) == sha256_of(file)


def read_stamp(path: Path, formats: str, schema: str = "stamp") -> dict[str, Any] | None:
    """The content of a JSON file of results of this format; None where there is no such file, or it is none of ours."""
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


#: The commands that write a report.html, by what else each leaves in its folder.
_REPORTS = {
    "posterior.nc": "calibrate",
    "diagnosis.json": "diagnose",
    "design.json": "design",
    "measurement.json": "measure",
}


def check_report(folder: Path, command: str) -> None:
    """ExperimentError where a folder holds the report of another command, which this one's would replace."""
    for name, other in _REPORTS.items():
        if other != command and (folder / name).exists():
            raise ExperimentError(
                f"{folder}: holds the report of cradle {other}, which would be lost; choose another --out"
            )
