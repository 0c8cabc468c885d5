"""Files in and out: every refusal is one line, nothing is ever half-written, and one process works in a folder."""

from __future__ import annotations

import contextlib
import functools
import glob
import hashlib
import inspect
import json
import math
import os
import re
import socket
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PureWindowsPath
from typing import Any, ParamSpec, TypeVar

import numpy as np
from filelock import FileLock, Timeout

#: Bytes of a file that is read as text at most: an hour of five bobs at 960 frames a second.
_LARGEST = 2**28
#: Tells who works in a folder; what is about to be written there is listed in the other.
_LOCK, _PENDING = ".cradle.lock", ".pending"


_P = ParamSpec("_P")
_R = TypeVar("_R")


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


def beside(folder: Path, name: str) -> Path:
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
def working_in(folder: Path) -> Iterator[None]:
    """Holds a folder, made where there is none, for this thread; ExperimentError where another process works there.

    The system frees the lock of a process that has died. A folder that was made and stays empty is removed.
    """
    check_folder(folder)
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / _LOCK
    lock = FileLock(file, timeout=0, is_singleton=True)
    try:
        lock.acquire()
    except Timeout:
        raise ExperimentError(f"{folder}: {_owner(file)} works there; wait for it, or choose another --out") from None
    except OSError as problem:
        if file.is_symlink():
            raise ExperimentError(f"{file}: is a link, and no lock of this program; remove it") from None
        raise problem
    try:
        if lock.lock_counter == 1:
            with suppress(OSError):  # on a full disk nobody can be named
                file.write_text(f"{os.getpid()} on {socket.gethostname()}\n", encoding="utf-8")
        yield
    finally:
        if lock.lock_counter == 1:
            with suppress(OSError):  # where a file that is open cannot be removed, it stays, and locks nothing
                file.unlink()
        lock.release()
        if made and not lock.is_locked and not any(folder.iterdir()):
            for place in made:
                place.rmdir()


def holds_out(work: Callable[_P, _R]) -> Callable[_P, _R]:
    """Work that holds the folder that it is given as `out`, where it is given one, as long as it takes."""
    signature = inspect.signature(work)

    @functools.wraps(work)
    def held(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        out = signature.bind(*args, **kwargs).arguments.get("out")
        with contextlib.nullcontext() if out is None else working_in(Path(out)):
            return work(*args, **kwargs)

    return held


def _owner(lock: Path) -> str:
    try:
        name = lock.read_text(encoding="utf-8")[:100].strip()
    except (OSError, ValueError):
        name = ""
    return f"process {name}" if name else "another process"


def check_folder(folder: Path) -> None:
    """ExperimentError where a folder for results is something else."""
    if folder.exists() and not folder.is_dir():
        raise ExperimentError(f"{folder}: is a file; name a folder for the results")


def check_own(folder: Path, names: Iterable[str], stamp: str, formats: str) -> None:
    """ExperimentError where a folder holds a file of these names that is not ours to replace: the JSON file that our
    command writes beside it, its stamp, is not there, not of this format, or lists the file otherwise or not at all;
    or where the folder is a file. Files that were about to be written when their process was killed are ours."""
    check_folder(folder)
    content, pending = stamped(folder / stamp, formats), stamped(_pending(folder, stamp), formats)

    def ours(name: str) -> bool:
        if pending is not None and (name == stamp or _lists(pending, folder / name)):
            return True
        if content is None or name == stamp:
            return content is not None
        return "files" not in content or _lists(content, folder / name)

    for name in names:
        if (folder / name).exists() and not ours(name):
            raise ExperimentError(f"{folder / name}: exists and is no result of this command; choose another --out")


def write_listed(
    folder: Path, files: Mapping[str, str | bytes | Path], stamp: str, content: Mapping[str, Any]
) -> dict[str, Any]:
    """Writes files by name and, last, the stamp, which lists them and what it has listed before as `files`, by their
    SHA-256; returns its content. A Path is a file to be moved there."""
    with working_in(folder):
        earlier = (stamped(folder / stamp, content["format"]) or {}).get("files", {})
        content = {**content, "files": {**earlier, **{name: _sha256(data) for name, data in files.items()}}}
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
    return content.get("files", {}).get(file.name) == _sha256(file)


def stamped(path: Path, formats: str, schema: str = "stamp") -> dict[str, Any] | None:
    """The content of a JSON file of results of this format; None where there is no such file, or it is none of ours."""
    from identification.storage.schema import read_json

    try:
        content = read_json(path, schema)
    except ExperimentError:
        return None
    return content if content["format"] == formats else None


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
        with temporary.open("rb+") as file:  # a renamed file whose content is lost would be worse than none
            os.fsync(file.fileno())
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
