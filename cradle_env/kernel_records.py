"""A cradle as the kernels read it: what it is and the effects that it has, as records of numbers."""

from __future__ import annotations

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.effects import Effect
from cradle_env.effects.learned_force import has_dry_friction, learned_force
from cradle_env.mechanics import layout as p
from cradle_env.mechanics.forces import FRICTION_SMOOTHING

# Integration step as a fraction of 1/ω of the faster motion: 1e-10 rad over 10 s on elastic strings, see
# tests/integration/test_accuracy.py; on rigid ones it is the interpolation of the samples that sets it.
_RADIAL_STEP, _ANGULAR_STEP = 0.45, 0.2
#: What one segment of flight may leave out of the motion, in lengths of the strings: 1e-12 s of the first 18 impacts of
#: two bobs, 4e-11 rad over 60 s.
TOLERANCE = 1e-14
# Steps are of order 8: they grow as this power of the tolerance, from what they are at the one above, up to a limit.
_STEP_POWER, _LONGEST_STEP = 1.0 / 8.0, 4.0
# Dry friction changes sign within a hundredth of a period.
_FRICTION_STEP = 0.05
# Drag, friction or attraction that act faster than this many times ω of the swing are those of no cradle.
_STIFFEST = 1e4
# Part of the time scale of a contact that is followed in time, which lasts 3.2 of them.
_CONTACT_STEP = 1.0 / 16.0


def records(cradle: Cradle, tolerance: float = TOLERANCE) -> tuple[np.ndarray, np.ndarray]:
    """The records of a cradle that the kernels read: (1,) of CRADLE and (N,) of BOB."""
    c, bobs = np.zeros(1, p.CRADLE), np.zeros(cradle.bobs, p.BOB)
    c["gravity"], c["radius"] = cradle.gravity, cradle.radius
    cradle.write_law(c)
    bobs["mass"], bobs["length"], bobs["half_spacing"] = cradle.mass, cradle.length, cradle.pivot_half_spacing
    bobs["kappa"], bobs["b"], bobs["pivot"] = cradle.kappa, cradle.b, cradle.pivots
    forces = []
    for effect in cradle.composition:
        values = cradle.effects.get(effect.name, {})
        if effect.apply is not None:
            effect.apply(c, bobs, values)
        if effect.force is not None and not effect.is_absent(values):
            forces.append((effect, values))
    if forces:
        _write_user_forces(c, bobs, forces)
    inertia = bobs["mass"] + bobs["added_mass"]
    bobs["mobility"], bobs["fall"] = 1.0 / inertia, cradle.gravity * (bobs["mass"] / inertia)
    middle = np.arange(cradle.bobs) - 0.5 * (cradle.bobs - 1)
    spread = np.mean(cradle.delta) if cradle.bobs > 1 else 0.0
    bobs["misplaced"] = cradle.pivots - middle * 2.0 * cradle.radius * (1.0 + spread)
    bobs["string"] = np.hypot(bobs["length"], bobs["half_spacing"])
    bobs["grip"] = 4.0 * bobs["length"] / bobs["string"]
    angular = np.sqrt(cradle.gravity / bobs["length"].min())
    step = _ANGULAR_STEP / angular
    springs = 0.25 * bobs["kappa"] * bobs["grip"] ** 2 if c["elastic"][0] else np.zeros(cradle.bobs)
    if c["elastic"][0]:
        step = min(step, _RADIAL_STEP / np.sqrt(np.max(springs / bobs["mass"])))
    if c["frame_mass"][0] > 0.0:
        # Strings stiffen what they hang from: by the weight that they carry, and as springs where they are far from
        # upright.
        hung = np.sum(bobs["mass"] * cradle.gravity / bobs["length"] + springs)
        step = min(step, _RADIAL_STEP * np.sqrt(c["frame_mass"][0] / (c["frame_stiffness"][0] + hung)))
    if bobs["tau_c"].any() or has_dry_friction(cradle.effects.get(learned_force.name, {})):
        step = min(step, _FRICTION_STEP / angular)
    if (rate := _stiffest(c[0], bobs, angular)) * step > _RADIAL_STEP:
        step = _RADIAL_STEP / rate
    if c["elastic"][0]:
        bobs["longest"] = 2.0 / np.sqrt(springs * bobs["mobility"])
        beyond = bobs["c2"].any() or bobs["tau_c"].any() or bobs["creep"].any() or c["user_force"][0] != 0
        c["series"], c["tolerance"] = not (c["coupled"][0] or beyond), tolerance
    step_factor = min((tolerance / TOLERANCE) ** _STEP_POWER, _LONGEST_STEP)
    c["step"], c["contact_step"] = step * step_factor, _CONTACT_STEP * step_factor
    c["reach"] *= step_factor
    if (scale := c["contact_scale"][0]) > 0.0:
        c["contact_k_el"], c["contact_k_f"] = c["k_el"] * scale**-2.5, c["k_f"] * scale**-1.5
    return c, bobs


def _stiffest(c: np.void, bobs: np.ndarray, angular: float) -> float:
    """The rate [1/s] of the fastest of drag, friction near rest and attraction; `angular` [1/s] is the swing's ω."""
    rates = {
        "b": np.max(bobs["b"] * bobs["mobility"]) * (1.0 + 2.0 * c["drag_slope"]),
        "pivot_friction: tau_c": np.max(bobs["tau_c"] * bobs["mobility"] / bobs["length"] ** 2) / FRICTION_SMOOTHING,
    }
    if c["attraction"] > 0.0:
        stiffness = 2.0 * c["attraction"] / c["attraction_range"]
        rates["bob_attraction: force"] = np.sqrt(stiffness * np.max(bobs["mobility"]))
    name, rate = max(rates.items(), key=lambda item: item[1])
    if rate > _STIFFEST * angular:
        raise ValueError(
            f"{name} acts on a bob within {1.0 / rate:.2g} s; it must take {1.0 / (_STIFFEST * angular):.2g} s or more,"
            " so make it weaker, or the bob heavier"
        )
    return rate


def _write_user_forces(c: np.ndarray, bobs: np.ndarray, forces: list[tuple[Effect, dict[str, float]]]) -> None:
    """The address of one compiled function that sums the forces from outside, and their parameters in a row."""
    from cradle_env.mechanics.user_force import compiled

    rows = [values[q.key] for effect, values in forces for q in effect.parameters]
    if len(rows) > p.USER:
        raise ValueError(f"effects from outside have {len(rows)} parameters; together they may have {p.USER}")
    for k, row in enumerate(rows):
        bobs["user"][:, k] = row
    c["user_force"] = compiled(tuple((effect.force, len(effect.parameters)) for effect, _ in forces)).address
