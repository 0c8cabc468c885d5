"""Instruments: raw recordings of a cradle in, its parameters with their uncertainty out. One module or folder per kind.

from identification.apparatus import measure_ringdown
measured = measure_ringdown(["one.csv", "two.csv"], cradle, bobs=(1, 2))
measured.values, measured.figure(), measured.content()
"""

import importlib

# Public names by the module that holds them: loaded when first asked for, so that the import stays light.
_PUBLIC = {
    "Measurement": "measurement",
    "Value": "measurement",
    "Circuit": "contacts.circuit",
    "measure_contacts": "contacts.measure",
    "measure_impacts": "impacts.measure",
    "measure_ringdown": "ringdown.measure",
    "measure_string": "string.measure",
    "measure_video": "video.measure",
}

__all__ = [*_PUBLIC]


def __getattr__(name: str):
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_PUBLIC[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_PUBLIC])
