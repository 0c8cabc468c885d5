"""Newton's cradle: a model of N nonlinear spring pendulums (Lee & Hong, arXiv:2401.16693), simulated exactly.

from cradle_env import Cradle, Release, simulate
run = simulate(Cradle(bobs=5), Release(angle=0.228), duration=60.0)
run.sigma(), run.newton_exponent(), run.energy(), run.impacts
"""

import importlib

from cradle_env.envs.registration import register_all as _register_all

# Public names by the module that holds them: loaded when first asked for, so that the import stays light.
_PUBLIC = {
    "CATALOGUE": "effects",
    "MODELS": "effects",
    "Cradle": "cradle",
    "Effect": "effects",
    "InitialState": "release",
    "Parameter": "effects",
    "Release": "release",
    "SimulationError": "simulation",
    "Trajectory": "trajectory",
    "contact_times": "constitutive",
    "newton_exponent": "synchronization",
    "register": "effects",
    "restitution_curve": "constitutive",
    "sigma": "synchronization",
    "simulate": "simulation",
    "simulate_batch": "simulation",
    "string_tension": "constitutive",
}

__all__ = [*_PUBLIC]


_register_all()


def __getattr__(name: str):
    if name == "__version__":
        from importlib.metadata import version

        return version("newtons-cradle")
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_PUBLIC[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_PUBLIC])
