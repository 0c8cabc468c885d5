"""Public names of a package that load when first asked for, so that the import of the package stays light (PEP 562)."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from typing import Any


def lazy_names(package: str, modules: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a package whose public names load when first asked for.

    Parameters
    ----------
    package : str
        `__name__` of the package.
    modules : mapping of str to str
        For each public name, the module of the package that holds it.
    """

    def load(name: str) -> Any:
        if name == "__version__":
            from importlib.metadata import version

            return version("newtons-cradle")
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(f"{package}.{modules[name]}"), name)
        setattr(sys.modules[package], name, value)
        return value

    def names() -> list[str]:
        return sorted([*vars(sys.modules[package]), *modules])

    return load, names
