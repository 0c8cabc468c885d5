"""Locks of folders, so that only one process writes results into a folder at a time."""

from __future__ import annotations

import contextlib
import functools
import inspect
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import ParamSpec, TypeVar

from filelock import FileLock, Timeout

from identification.storage.files import ExperimentError

#: The file that is locked; it holds the name of the process that works in the folder.
_LOCK = ".cradle.lock"
_P = ParamSpec("_P")
_R = TypeVar("_R")


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; create the folder if it is missing.

    The operating system frees the lock of a process that has died. A folder that was created here and is empty at the
    end is removed.

    Raises ExperimentError if another process holds the lock.
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
            raise ExperimentError(f"{file}: is a link and not a lock file of this program; remove it") from None
        raise problem
    try:
        if lock.lock_counter == 1:
            with suppress(OSError):  # a full disk; the lock works without the name
                file.write_text(f"{os.getpid()} on {socket.gethostname()}\n", encoding="utf-8")
        yield
    finally:
        if lock.lock_counter == 1:
            with suppress(OSError):  # Windows cannot remove an open file; it stays, unlocked
                file.unlink()
        lock.release()
        if made and not lock.is_locked and not any(folder.iterdir()):
            for place in made:
                place.rmdir()


def locks_output(work: Callable[_P, _R]) -> Callable[_P, _R]:
    """Decorate a function so that it holds the lock of its argument `out`, a folder, unless that is None."""
    signature = inspect.signature(work)

    @functools.wraps(work)
    def held(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        out = signature.bind(*args, **kwargs).arguments.get("out")
        with contextlib.nullcontext() if out is None else lock_folder(Path(out)):
            return work(*args, **kwargs)

    return held


def _owner(lock: Path) -> str:
    try:
        name = lock.read_text(encoding="utf-8")[:100].strip()
    except (OSError, ValueError):
        name = ""
    return f"process {name}" if name else "another process"


def check_folder(folder: Path) -> None:
    """Raise ExperimentError if a path for a folder of results is a file."""
    if folder.exists() and not folder.is_dir():
        raise ExperimentError(f"{folder}: is a file; name a folder for the results")
