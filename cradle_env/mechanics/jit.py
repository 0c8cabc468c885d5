"""How kernels are compiled: without the interpreter lock, and cached on disk.

numba's cache looks at the file of the cached kernel alone and misses an edit in a kernel that it calls. The cache
folder is therefore named by a hash of all kernel sources, and only the kernels that Python calls are cached:
they carry everything below them.
"""

import functools
import hashlib
import os
import tempfile
import threading
from pathlib import Path

import numba

# The numpy error model drops a branch per division. Kernels allocate nothing, and without numba's runtime no array is
# counted at every call: nearly twice as fast. No fastmath, not even contracted multiply-adds: they gain 5 to 10 %, but
# round as the compiler happens to inline, so that the process that compiles differed in last bits from those that load.
_OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False}
_INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, **_OPTIONS}


def _cache_folder() -> str | None:
    """The first writable place for compiled kernels of exactly these sources; None where there is none."""
    here = Path(__file__).parent
    digest = hashlib.sha256()
    for source in sorted(here.glob("*.py")):
        digest.update(source.read_bytes())
    name = f"kernels-{digest.hexdigest()[:16]}"
    # Where nobody knows a home, "~" is a folder like any other, and not writable either.
    user = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "cradle_env"
    for parent in (here / "__pycache__", user):
        try:
            folder = parent / name
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return str(folder)
        except OSError:
            continue
    return None


_FOLDER = _cache_folder()


def jit(function):
    """Compiles a kernel that other kernels call."""
    return numba.njit(**_INNER)(function)


def leaf(function):
    """Compiles a small kernel whose machine code goes into each of its callers."""
    return numba.njit(forceinline=True, **_INNER)(function)


def part(function):
    """Compiles a kernel as a part of its one caller, which takes less time than a kernel of its own."""
    return numba.njit(inline="always", **_INNER)(function)


def entry(function):
    """Compiles a kernel that Python calls, and caches it."""
    if _FOLDER is None:
        return numba.njit(**_OPTIONS)(function)
    previous, numba.config.CACHE_DIR = numba.config.CACHE_DIR, _FOLDER
    try:
        return numba.njit(cache=True, **_OPTIONS)(function)
    finally:
        numba.config.CACHE_DIR = previous


def once(function):
    """Keeps what a function returns; threads that ask for it at the same time wait for the first of them."""
    kept, lock = functools.cache(function), threading.Lock()

    @functools.wraps(function)
    def waiting(*arguments):
        with lock:
            return kept(*arguments)

    return waiting
