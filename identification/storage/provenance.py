"""Fingerprints of the program and of functions.

A fingerprint is the same in every process, and changes when the code is edited. Results store it, so that a command
does not resume or reuse results of other code.
"""

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
from cradle_env.effects import DECLARED, Effect

#: Attributes of a code object that determine what it does; line numbers and names of variables do not.
_CODE = ("co_code", "co_names", "co_freevars", "co_exceptiontable")
#: Types whose value determines what the code that uses them does.
_DATA = (bool, int, float, complex, str, bytes, tuple, list, dict, set, frozenset, np.ndarray, np.generic, type(None))


def program_hash(effects: Iterable[Effect]) -> str:
    """Hash the sources of both packages, and the declarations of those effects that a user has registered."""
    outside = [vars(effect) for effect in effects if effect not in DECLARED]
    return hashlib.sha256((_sources() + fingerprint(outside)).encode()).hexdigest()[:16]


@functools.cache
def _sources() -> str:
    digest = hashlib.sha256()
    for package in (cradle_env, identification):
        for source in sorted(Path(package.__path__[0]).rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()


def fingerprint(value: Any, seen: set[int] | None = None) -> str:
    """Describe a value by a text that changes when the value, or the code that it runs, changes.

    A callable is described by its code, its defaults, the variables that it closes over, and the names of its own
    module that it uses. A name from another module counts as a name only. Any other value is described by its repr;
    a repr that is an address differs in every process, so such a value never matches.

    seen: ids of the functions that are described already.
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
    elif hasattr(value, "__wrapped__"):  # of functools.lru_cache and numba
        parts = [value.__wrapped__]
    elif hasattr(value, "__dict__") and isinstance(getattr_static(type(value), "__call__", None), FunctionType):
        members = [item for kind in type(value).__mro__ for item in vars(kind).items()]
        parts = [vars(value), *((name, of) for name, of in members if isinstance(of, FunctionType))]
    else:
        return "".join(sorted(map(describe, value))) if isinstance(value, set | frozenset) else repr(value)
    return f"{type(value).__qualname__}({', '.join(map(describe, parts))})"


def _module_names(function: FunctionType) -> dict[str, Any]:
    """Objects of its own module that a function, and functions nested in it, refer to."""
    found = {name: function.__globals__[name] for name in _names(function.__code__) if name in function.__globals__}
    own = function.__module__
    local = {name: of for name, of in found.items() if isinstance(of, _DATA) or getattr(of, "__module__", "") == own}
    return {name: _members(of) if isinstance(of, type) else of for name, of in local.items()}


def _members(kind: type) -> dict[str, Any]:
    """Functions of the methods and properties of a class, with those inherited from classes of the same module."""
    classes = [one for one in kind.__mro__ if one.__module__ == kind.__module__]
    found = [item for one in reversed(classes) for item in vars(one).items()]
    members: dict[str, Any] = {}
    for name, of in found:
        several = (of.fget, of.fset) if isinstance(of, property) else (getattr(of, "__func__", of),)
        if functions := [one for one in several if isinstance(one, FunctionType)]:
            members[name] = functions
    return members


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)
