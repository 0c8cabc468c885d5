"""What decides results beside their inputs, the program and any function, told alike in every process, and otherwise
once it is edited."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterable, Iterator
from inspect import getattr_static
from pathlib import Path
from types import CodeType, FunctionType, MethodType
from typing import Any

import numpy as np

import cradle_env
import identification
from cradle_env.effects import CATALOGUE, LEARNED, Effect

#: What of code decides what it does: neither its lines nor the names of its variables.
_CODE = ("co_code", "co_names", "co_freevars", "co_exceptiontable")
#: Values that tell all of themselves.
_DATA = (bool, int, float, complex, str, bytes, tuple, list, dict, set, frozenset, np.ndarray, np.generic, type(None))


def program_hash(effects: Iterable[Effect]) -> str:
    """The program that makes a result, as a hash: its sources, and those of the effects that are from outside it."""
    outside = [vars(effect) for effect in effects if effect not in (*CATALOGUE, *LEARNED)]
    return hashlib.sha256((_sources() + fingerprint(outside)).encode()).hexdigest()[:16]


@functools.cache
def _sources() -> str:
    digest = hashlib.sha256()
    for package in (cradle_env, identification):
        for source in sorted(Path(package.__path__[0]).rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()


def fingerprint(value: Any, seen: set[int] | None = None) -> str:
    """Of a callable: its code, its defaults, what it closes over, and what it names of its own module; of what other
    modules give it the name alone. Of any other value: what it shows of itself; where that is only an address, it is
    like nothing in another process. seen: ids of functions that are told already.
    """
    seen = set() if seen is None else seen
    describe = functools.partial(fingerprint, seen=seen)
    parts: list[Any]
    if isinstance(value, FunctionType):
        if id(value) in seen:
            return value.__qualname__
        seen.add(id(value))
        closed = [cell.cell_contents for cell in value.__closure__ or ()]
        parts = [
            value.__module__,
            value.__code__,
            value.__defaults__,
            value.__kwdefaults__,
            closed,
            _module_names(value),
        ]
    elif isinstance(value, CodeType):
        parts = [*(getattr(value, name) for name in _CODE), *value.co_consts]
    elif isinstance(value, MethodType):
        parts = [value.__func__, value.__self__]
    elif isinstance(value, functools.partial):
        parts = [value.func, value.args, value.keywords]
    elif isinstance(value, list | tuple):
        parts = list(value)
    elif isinstance(value, dict):
        parts = [item for pair in value.items() for item in pair]
    elif isinstance(value, np.ndarray):
        parts = [value.dtype.str, value.shape, value.tolist()]
    elif hasattr(value, "__wrapped__"):  # as lru_cache and numba make
        parts = [value.__wrapped__]
    elif hasattr(value, "__dict__") and isinstance(getattr_static(type(value), "__call__", None), FunctionType):
        members = [item for kind in type(value).__mro__ for item in vars(kind).items()]
        parts = [vars(value), *((name, of) for name, of in members if isinstance(of, FunctionType))]
    else:
        return "".join(sorted(map(describe, value))) if isinstance(value, set | frozenset) else repr(value)
    return f"{type(value).__qualname__}({', '.join(map(describe, parts))})"


def _module_names(function: FunctionType) -> dict[str, Any]:
    """What a function, and those within it, may name of its own module."""
    found = {name: function.__globals__[name] for name in _names(function.__code__) if name in function.__globals__}
    own = function.__module__
    told = {name: of for name, of in found.items() if isinstance(of, _DATA) or getattr(of, "__module__", "") == own}
    return {name: _members(of) if isinstance(of, type) else of for name, of in told.items()}


def _members(kind: type) -> dict[str, Any]:
    """What the methods and properties of a class do, with those that it inherits within its module."""
    classes = [one for one in kind.__mro__ if one.__module__ == kind.__module__]
    found = [item for one in reversed(classes) for item in vars(one).items()]
    told: dict[str, Any] = {}
    for name, of in found:
        several = (of.fget, of.fset) if isinstance(of, property) else (getattr(of, "__func__", of),)
        if functions := [one for one in several if isinstance(one, FunctionType)]:
            told[name] = functions
    return told


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)
