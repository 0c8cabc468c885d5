"""The experimenter: measured runs of a Newton's cradle in, its parameters and λ with their uncertainty out.

from identification import Experiment, calibrate, diagnose
posterior = calibrate(Experiment.load("experiment.toml"))
diagnosis = diagnose(Experiment.load("experiment.toml"))
posterior.summary(), posterior.newton_exponent(), posterior.predict(delta=1e-3)
"""

import importlib

# Public names by the module that holds them: loaded when first asked for, so that the import stays light.
_PUBLIC = {
    "Experiment": "experiment.experiment",
    "Posterior": "inference.posterior",
    "calibrate": "inference.calibration",
    "diagnose": "diagnosis.workflow",
}

__all__ = [*_PUBLIC]


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
