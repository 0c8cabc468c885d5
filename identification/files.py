"""Files in and out: every refusal is one line, and nothing is ever half-written."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np


class ExperimentError(ValueError):
    """Unusable input; the message is one line that names file, row, column and remedy."""

    def __init__(self, message: str):
        super().__init__(" ".join(message.split()))


def read_text(path: Path) -> tuple[str, bytes]:
    """The text of a UTF-8 file, lines ended by \\n, without byte order mark; and its bytes as they are."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise ExperimentError(f"{path}: no such file; check the name and the folder") from None
    except IsADirectoryError:
        raise ExperimentError(f"{path}: is a folder; name the file in it") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ExperimentError(f"{str(path)!r}: cannot be read ({reason}); check the name and the permissions") from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ExperimentError(f"{path}, line {line}: not UTF-8 text; save the file as plain text in UTF-8") from None
    return text.replace("\r\n", "\n").replace("\r", "\n"), data


def check_own(folder: Path, names: Iterable[str], stamp: str, formats: str) -> None:
    """ExperimentError where a folder holds a file of these names that is not ours to replace: the JSON file that our
    command writes beside it, its stamp, is not there, not of this format, or lists the file otherwise or not at all;
    or where the folder is a file."""
    if folder.exists() and not folder.is_dir():
        raise ExperimentError(f"{folder}: is a file; name a folder for the results")
    content = stamped(folder / stamp, formats)

    def ours(name: str) -> bool:
        if content is None or name == stamp:
            return content is not None
        return "files" not in content or content["files"].get(name) == _sha256(folder / name)

    for name in names:
        if (folder / name).exists() and not ours(name):
            raise ExperimentError(f"{folder / name}: exists and is no result of this command; choose another --out")


def write_listed(
    folder: Path, files: Mapping[str, str | bytes | Path], stamp: str, content: Mapping[str, Any]
) -> dict[str, Any]:
    """Writes files by name and, last, the stamp, which lists them and what it has listed before as `files`, by their
    SHA-256; returns its content. A Path is a file to be moved there."""
    earlier = (stamped(folder / stamp, content["format"]) or {}).get("files", {})
    content = {**content, "files": {**earlier, **{name: _sha256(data) for name, data in files.items()}}}
    write_together(folder, {**files, stamp: json_text(content)})
    return content


def stamped(path: Path, formats: str) -> dict[str, Any] | None:
    """The content of a JSON file of this format; None where there is no such file."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return content if content["format"] == formats and isinstance(content.get("files", {}), dict) else None
    except (OSError, ValueError, TypeError, KeyError):
        return None


def _sha256(data: str | bytes | Path) -> str:
    if isinstance(data, Path):
        with data.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    return hashlib.sha256(data.encode() if isinstance(data, str) else data).hexdigest()


#: The commands that write a report.html, by what else each leaves in its folder.
_REPORTS = {"posterior.nc": "calibrate", "diagnosis.json": "diagnose", "design.json": "design"}


def check_report(folder: Path, command: str) -> None:
    """ExperimentError where a folder holds the report of another command, which this one's would replace."""
    for name, other in _REPORTS.items():
        if other != command and (folder / name).exists():
            raise ExperimentError(
                f"{folder}: holds the report of cradle {other}, which would be lost; choose another --out"
            )


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, which takes its place when all went well."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write(path: Path, content: str | bytes) -> Path:
    """Writes a file, whole or not at all; makes its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def write_json(path: Path, content: Mapping[str, Any]) -> Path:
    """Writes JSON; what is not finite becomes null."""
    return write(path, json_text(content))


def write_together(directory: Path, files: Mapping[str, str | bytes | Path]) -> None:
    """Writes files, by name, into a directory: all to temporary names first, then renamed in the order given, which
    Ctrl-C does not stop half-way. A Path is a file to be moved there."""
    directory.mkdir(parents=True, exist_ok=True)
    temporary = {name: directory / f".{name}.{os.getpid()}" for name in files}

    def rename() -> None:
        for name in files:
            if temporary[name].exists():
                temporary[name].replace(directory / name)

    try:
        for name, data in files.items():
            if isinstance(data, Path):
                data.replace(temporary[name])
            else:
                temporary[name].write_bytes(data.encode() if isinstance(data, str) else data)
        try:
            rename()
        except KeyboardInterrupt:
            rename()
            raise
    finally:
        for file in temporary.values():
            file.unlink(missing_ok=True)


def json_text(content: Mapping[str, Any]) -> str:
    """JSON to read; what is not finite becomes null."""
    return json.dumps(_finite(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    """The value in the types of JSON, which knows neither nan nor infinity."""
    if isinstance(value, Mapping):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_finite(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
