"""One process works in a folder: it holds a lock there, and the system frees the lock of a process that has died."""

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

#: Names the process that works in a folder.
_LOCK = ".cradle.lock"
_P = ParamSpec("_P")
_R = TypeVar("_R")


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
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


def locks_output(work: Callable[_P, _R]) -> Callable[_P, _R]:
    """Work that holds the folder that it is given as `out`, where it is given one, as long as it takes."""
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
    """ExperimentError where a folder for results is something else."""
    if folder.exists() and not folder.is_dir():
        raise ExperimentError(f"{folder}: is a file; name a folder for the results")
