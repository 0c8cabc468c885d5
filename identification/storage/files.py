"""Read and write files. An error is one line; a file is written whole or not at all."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

#: Largest file to read [bytes]: about an hour of five bobs at 960 frames per second.
LARGEST = 2**28


class ExperimentError(ValueError):
    """Unusable input. The message is one line with file, row, column and remedy."""

    def __init__(self, message: str):
        super().__init__(" ".join(message.split()))


def read_text(path: Path) -> tuple[str, bytes]:
    """Read a UTF-8 file.

    Returns its text, without byte order mark and with lines ended by \\n, and its bytes. Raises ExperimentError if it
    cannot be read.
    """
    data = read_bytes(path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ExperimentError(f"{path}, line {line}: not UTF-8 text; save the file as plain text in UTF-8") from None
    return text.replace("\r\n", "\n").replace("\r", "\n"), data


def read_bytes(path: Path) -> bytes:
    """Read the bytes of a file. Raises ExperimentError if it is missing, unreadable or larger than 256 MB."""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
    except FileNotFoundError:
        raise ExperimentError(f"{path}: no such file; check the name and the folder") from None
    except IsADirectoryError:
        raise ExperimentError(f"{path}: is a folder; name the file in it") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ExperimentError(f"{str(path)!r}: cannot be read ({reason}); check the name and the permissions") from None
    if len(data) > LARGEST:
        raise ExperimentError(f"{path}: is larger than {LARGEST >> 20} MB; split it, or keep fewer readings")
    return data


def resolve_beside(folder: Path, name: str) -> Path:
    """Return the path of a file that a file in `folder` refers to.

    Raises ValueError if it is not in the folder or below, also through a link; if it does not exist; or if it is not a
    regular file.
    """
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
    """Yield a temporary path beside `path`, and rename it to `path` if no error occurs."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield temporary
        with temporary.open("rb+") as file:  # else a crash could leave the new name without content
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_file(path: Path, content: str | bytes) -> Path:
    """Write a file, whole or not at all. Its folder is created if missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_replacement(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def write_json(path: Path, content: Mapping[str, Any]) -> Path:
    """Write a JSON file; nan and infinity become null."""
    return write_file(path, json_text(content))


def write_together(directory: Path, files: Mapping[str, str | bytes | Path]) -> None:
    """Write several files into a directory, so that no interruption leaves some of them old and others new.

    Each file is first written to a temporary name; then all are renamed in the given order, which Ctrl-C does not
    interrupt.

    Parameters
    ----------
    directory : Path
        Created if missing.
    files : mapping of str to str, bytes or Path
        Content of each file, by name; a Path is a file to move there.
    """
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
    """Format JSON, indented; nan and infinity become null."""
    return json.dumps(_finite(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    """Convert a value to the types of JSON; nan and infinity become None."""
    if isinstance(value, Mapping):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_finite(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
