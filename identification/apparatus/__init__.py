"""Instruments: raw recordings of a cradle in, its parameters with their uncertainty out. One module or folder per kind.

from identification.apparatus import measure_ringdown
measured = measure_ringdown(["one.csv", "two.csv"], cradle, bobs=(1, 2))
measured.values, measured.figure(), measured.content()
"""

from cradle_env.lazy_names import lazy_names as _lazy_names

# Public names by the module that holds them.
_PUBLIC = {
    "Measurement": "measurement",
    "Value": "measurement",
    "Circuit": "contacts.circuit",
    "measure_contacts": "contacts.measure",
    "measure_impacts": "impacts.measure",
    "measure_ringdown": "ringdown.measure",
    "measure_sound": "sound.measure",
    "measure_string": "string.measure",
    "measure_video": "video.measure",
}

__all__ = [*_PUBLIC]
__getattr__, __dir__ = _lazy_names(__name__, _PUBLIC)
