"""How the compiled functions of the reference integrators are compiled, and kept from one process to the next."""

import hashlib
from pathlib import Path

import numba

# Nothing is allocated: without numba's runtime no array is counted at every call.
_OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False}
_HERE = Path(__file__).parent
# numba notices an edit in the file of a cached function, not in one of the files of the functions that it calls.
_COMPILED = ("compiled.py", "soft_terms.py", "soft_kernel.py")
_SOURCES = hashlib.sha256(b"".join((_HERE / name).read_bytes() for name in _COMPILED)).hexdigest()[:16]


def inner(function):
    """Compiles a function that compiled functions call."""
    return numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_OPTIONS)(function)


def entry(function):
    """Compiles a function that Python calls, and caches it in a folder of exactly these sources, if it can be."""
    folder = _HERE / "__pycache__" / f"compiled-{_SOURCES}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return numba.njit(**_OPTIONS)(function)
    previous, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(folder)
    try:
        return numba.njit(cache=True, **_OPTIONS)(function)
    finally:
        numba.config.CACHE_DIR = previous
