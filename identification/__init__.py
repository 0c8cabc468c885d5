"""The experimenter: measured runs of a Newton's cradle in, its parameters and λ with their uncertainty out.

from identification import Experiment, calibrate, diagnose
posterior = calibrate(Experiment.load("experiment.toml"))
diagnosis = diagnose(Experiment.load("experiment.toml"))
posterior.summary(), posterior.newton_exponent(), posterior.predict(delta=1e-3)
"""

from cradle_env.lazy_names import lazy_names as _lazy_names

# Public names by the module that holds them.
_PUBLIC = {
    "Experiment": "experiment.experiment",
    "Posterior": "inference.posterior",
    "calibrate": "inference.calibration",
    "diagnose": "diagnosis.workflow",
}

__all__ = [*_PUBLIC]
__getattr__, __dir__ = _lazy_names(__name__, _PUBLIC)
