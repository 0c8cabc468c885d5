"""Convert a cradle and its effects to the records of numbers that the kernels read."""

from __future__ import annotations

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.effects import Effect
from cradle_env.effects.learned_force import has_dry_friction, learned_force
from cradle_env.mechanics import layout as p
from cradle_env.mechanics.forces import FRICTION_SMOOTHING

#: Integration step times ω of the radial motion: errors are then 1e-10 rad over 10 s, see
#: tests/integration/test_accuracy.py.
_RADIAL_STEP = 0.45
#: Integration step times ω of the swing, on rigid strings: the interpolation of samples needs it this short.
_ANGULAR_STEP = 0.2
#: Error of one segment of flight over the length of the strings. The first 18 impacts of two bobs are then correct to
#: 1e-12 s, and angles to 4e-11 rad over 60 s.
TOLERANCE = 1e-14
#: Steps grow as this power of the tolerance over `TOLERANCE`: the integrator has order 8.
_STEP_POWER = 1.0 / 8.0
#: Largest factor of that growth.
_LONGEST_STEP = 4.0
#: Integration step times ω of the swing with dry friction, which changes sign within a hundredth of a period.
_FRICTION_STEP = 0.05
#: Largest rate of drag, friction or attraction over ω of the swing; no real cradle exceeds it.
_STIFFEST = 1e4
#: Integration step over the time scale of a contact that is followed in time; the contact lasts 3.2 time scales.
_CONTACT_STEP = 1.0 / 16.0


def records(cradle: Cradle, tolerance: float = TOLERANCE) -> tuple[np.ndarray, np.ndarray]:
    """Make the records that the kernels read: (1,) of CRADLE and (N,) of BOB."""
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
        # Strings add to the stiffness of the frame: by the weight that they carry and, if oblique, as springs.
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
    """Largest rate [1/s] of drag, friction near rest and attraction; angular: ω of the swing [1/s].

    Raises ValueError if it is too large to integrate.
    """
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
    """Write the address of a compiled function that sums the user's forces, and all their parameters in sequence."""
    from cradle_env.mechanics.user_force import compiled

    rows = [values[q.key] for effect, values in forces for q in effect.parameters]
    if len(rows) > p.USER:
        raise ValueError(f"effects of the user have {len(rows)} parameters; together they may have {p.USER}")
    for k, row in enumerate(rows):
        bobs["user"][:, k] = row
    c["user_force"] = compiled(tuple((effect.force, len(effect.parameters)) for effect, _ in forces)).address
