"""Newton's cradle: a model of N nonlinear spring pendulums (Lee & Hong, arXiv:2401.16693), simulated exactly.

from cradle_env import Cradle, Release, simulate
run = simulate(Cradle(bobs=5), Release(angle=0.228), duration=60.0)
run.sigma(), run.newton_exponent(), run.energy(), run.impacts
"""

from cradle_env.envs.registration import register_all as _register_all
from cradle_env.lazy_names import lazy_names as _lazy_names

# Public names by the module that holds them.
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
    "jax_theta": "differentiable",
    "newton_exponent": "synchronization",
    "register": "effects",
    "restitution_curve": "constitutive",
    "sigma": "synchronization",
    "simulate": "simulation",
    "simulate_batch": "simulation",
    "string_tension": "constitutive",
    "theta_and_jacobian": "differentiable",
}

__all__ = [*_PUBLIC]
__getattr__, __dir__ = _lazy_names(__name__, _PUBLIC)

_register_all()
