"""HDF5 files from anywhere, read so that they can neither reach another file nor fill the memory."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

#: Bytes of one array at most. A file may declare any size, whatever its own is.
_LARGEST = 2**32
#: What h5py raises for files that are damaged or no HDF5 at all.
_DAMAGED = (OSError, KeyError, TypeError, ValueError, RuntimeError, AttributeError, IndexError, OverflowError)


class UnreadableError(ValueError):
    """Something in a file that is missing, of another kind than expected, or not to be followed."""


@contextmanager
def _read(what: str) -> Iterator[None]:
    """Tells in one line what cannot be read, whatever h5py raises for it."""
    try:
        yield
    except UnreadableError:
        raise
    except _DAMAGED as problem:
        raise UnreadableError(f"{what} cannot be read: {' '.join(str(problem).split())[:200]}") from None


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """An HDF5 file open for reading."""
    import h5py

    with _read(str(path)):
        file = h5py.File(path, "r")
    with file:
        yield file


def group(parent: Any, name: str) -> Any:
    """A group in this very file."""
    import h5py

    with _read(_where(parent, name)):
        found = _member(parent, name)
    if not isinstance(found, h5py.Group):
        raise UnreadableError(f"{_where(parent, name)} is no group")
    return found


def numbers(parent: Any, name: str, shape: tuple[int | None, ...] | None = None) -> np.ndarray:
    """An array of numbers in this very file, as float64. shape: what it must have, None for any length; all of it
    None for any shape."""
    with _read(_where(parent, name)):
        return _numbers(parent, name, shape)


def _numbers(parent: Any, name: str, shape: tuple[int | None, ...] | None) -> np.ndarray:
    import h5py

    found = _member(parent, name)
    if not isinstance(found, h5py.Dataset) or found.dtype.kind not in "fiub":
        raise UnreadableError(f"{_where(parent, name)} is no array of numbers")
    if found.is_virtual or found.external:
        raise UnreadableError(f"{_where(parent, name)} takes its numbers from another file; only its own are read")
    if found.shape is None or int(found.size or 0) * 8 > _LARGEST:
        raise UnreadableError(
            f"{_where(parent, name)} has shape {found.shape}; {_LARGEST // 8} numbers are read at most"
        )
    if shape is not None and (
        len(found.shape) != len(shape) or any(b is not None and a != b for a, b in zip(found.shape, shape, strict=True))
    ):
        wanted = ", ".join("any" if n is None else str(n) for n in shape)
        raise UnreadableError(f"{_where(parent, name)} has shape {found.shape}; expected ({wanted})")
    return np.asarray(found[()], dtype=float)


def attributes(of: Any) -> dict[str, Any]:
    """What is noted of a file or group, in plain types: text, numbers, lists of them."""
    with _read(f"{of.file.filename}: the attributes of {of.name}"):
        return {str(name): _plain(of.attrs[name]) for name in of.attrs}


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode("utf-8")
    if isinstance(value, np.ndarray):
        return [_plain(item) for item in value.tolist()]
    return value.item() if isinstance(value, np.generic) else value


def _member(parent: Any, name: str) -> Any:
    import h5py

    link = parent.get(name, getlink=True)
    if link is None:
        raise UnreadableError(f"{_where(parent, name)} is missing")
    if not isinstance(link, h5py.HardLink):
        raise UnreadableError(f"{_where(parent, name)} is a link; only what stands in the file itself is read")
    return parent[name]


def _where(parent: Any, name: str) -> str:
    return f"{parent.file.filename}: {parent.name.strip('/')}/{name}".replace(": /", ": ")
