"""Files in and out: every refusal is one line, and nothing is ever half-written."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

#: Bytes of a file that is read as text at most: an hour of five bobs at 960 frames a second.
_LARGEST = 2**28


class ExperimentError(ValueError):
    """Unusable input; the message is one line that names file, row, column and remedy."""

    def __init__(self, message: str):
        super().__init__(" ".join(message.split()))


def read_text(path: Path) -> tuple[str, bytes]:
    """The text of a UTF-8 file, lines ended by \\n, without byte order mark; and its bytes as they are."""
    data = read_bytes(path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ExperimentError(f"{path}, line {line}: not UTF-8 text; save the file as plain text in UTF-8") from None
    return text.replace("\r\n", "\n").replace("\r", "\n"), data


def read_bytes(path: Path) -> bytes:
    """A file as it is, if it is no larger than what is read as text."""
    try:
        with path.open("rb") as file:
            data = file.read(_LARGEST + 1)
    except FileNotFoundError:
        raise ExperimentError(f"{path}: no such file; check the name and the folder") from None
    except IsADirectoryError:
        raise ExperimentError(f"{path}: is a folder; name the file in it") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ExperimentError(f"{str(path)!r}: cannot be read ({reason}); check the name and the permissions") from None
    if len(data) > _LARGEST:
        raise ExperimentError(f"{path}: is larger than {_LARGEST >> 20} MB; split it, or keep fewer readings")
    return data


def resolve_beside(folder: Path, name: str) -> Path:
    """The file that a file in this folder names, in the folder itself or below it; ValueError for any other place, for
    a link that leads out of it, for a device, and where there is none."""
    parts = PureWindowsPath(name)  # which knows both separators, and drives
    if not name.isprintable() or parts.drive or parts.root or ".." in parts.parts or name.startswith("~"):
        raise ValueError(f"{name!r} is not in the folder of the file that names it, or below; copy it there")
    path = folder / name
    try:
        real = path.resolve()
        inside = real.is_relative_to(folder.resolve())
        found, regular = real.exists(), real.is_file()
    except (OSError, RuntimeError, ValueError):
        inside, found, regular = True, False, False
    if not inside:
        raise ValueError(f"{name!r} is a link to a file in another folder; copy it here")
    if not found:
        raise ValueError(f"there is no file {str(path)!r}; name the data to read")
    if not regular:
        raise ValueError(f"{str(path)!r} is no file; name the data to read")
    return path


@contextmanager
def atomic_replacement(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, which takes its place when all went well."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield temporary
        with temporary.open("rb+") as file:  # a renamed file whose content is lost would be worse than none
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_file(path: Path, content: str | bytes) -> Path:
    """Writes a file, whole or not at all; makes its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_replacement(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def write_json(path: Path, content: Mapping[str, Any]) -> Path:
    """Writes JSON; what is not finite becomes null."""
    return write_file(path, json_text(content))


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
