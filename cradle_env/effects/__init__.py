"""The catalogue of effects, and the models as sets of them.

A model is a set of effects over the simplest cradle: linear pendulums, rigid strings, constant restitution, linear
drag b. Each effect is declared once, in the file of its name; this list names them all.
"""

from __future__ import annotations

from collections.abc import Iterable

from cradle_env.effects.added_mass import added_mass
from cradle_env.effects.angle_offset import angle_offset
from cradle_env.effects.angle_scale import angle_scale
from cradle_env.effects.bob_attraction import bob_attraction
from cradle_env.effects.clock_scale import clock_scale
from cradle_env.effects.contact_duration import contact_duration
from cradle_env.effects.declaration import Effect, Parameter
from cradle_env.effects.exposure_blur import exposure_blur
from cradle_env.effects.frame_compliance import frame_compliance
from cradle_env.effects.group_drag import group_drag
from cradle_env.effects.large_angle import large_angle
from cradle_env.effects.learned_force import learned_force
from cradle_env.effects.learned_impact import learned_impact
from cradle_env.effects.learned_pair import learned_pair
from cradle_env.effects.length_mismatch import length_mismatch
from cradle_env.effects.mass_mismatch import mass_mismatch
from cradle_env.effects.oblique_view import oblique_view
from cradle_env.effects.pivot_friction import pivot_friction
from cradle_env.effects.quadratic_drag import quadratic_drag
from cradle_env.effects.radial_elasticity import radial_elasticity
from cradle_env.effects.spacer_offset import spacer_offset
from cradle_env.effects.string_creep import string_creep
from cradle_env.effects.string_hysteresis import string_hysteresis
from cradle_env.effects.velocity_dependent_restitution import velocity_dependent_restitution
from cradle_env.errors import unknown_key

#: All effects of the package, one declaration each: `[effect.name for effect in CATALOGUE]`.
CATALOGUE: tuple[Effect, ...] = (
    velocity_dependent_restitution,
    large_angle,
    radial_elasticity,
    string_hysteresis,
    quadratic_drag,
    pivot_friction,
    group_drag,
    added_mass,
    bob_attraction,
    frame_compliance,
    string_creep,
    spacer_offset,
    mass_mismatch,
    length_mismatch,
    contact_duration,
    exposure_blur,
    angle_offset,
    angle_scale,
    clock_scale,
)

#: What a film states of its camera: known by name, never candidates for a name, for other instruments do not have it.
FILMED: tuple[Effect, ...] = (oblique_view,)

#: Effects whose parameters are a law learned from data: known by name, never candidates for a name.
LEARNED: tuple[Effect, ...] = (learned_force, learned_pair, learned_impact)

#: The base models, by the effects that they hold. HO and NSP are the paper's.
MODELS: dict[str, tuple[str, ...]] = {
    "ho": ("velocity_dependent_restitution",),
    "pendulum": ("velocity_dependent_restitution", "large_angle"),
    "nsp": ("velocity_dependent_restitution", "large_angle", "radial_elasticity", "string_hysteresis"),
}

#: All effects that the package declares.
DECLARED: tuple[Effect, ...] = (*CATALOGUE, *FILMED, *LEARNED)

_EFFECTS = {effect.name: effect for effect in DECLARED}


def register(effect: Effect) -> Effect:
    """Make an effect from outside the package known by its name, to cradles and to experiment files.

    Parameters
    ----------
    effect : Effect
        With a force, or with what it does to a reading. It replaces one that was registered under its name before.

    Returns
    -------
    Effect
        The same.

    Raises
    ------
    ValueError
        For a name of the catalogue, a name that is no identifier, and an effect that does nothing.

    Examples
    --------
    >>> from cradle_env import Cradle
    >>> tilt = Effect(
    ...     name="tilt", symbol="θ_t", acts_on="measurement", summary="a tilted level", equation="θ_file = θ + angle",
    ...     reference="", energy="none", looks_like="a constant residual", reading=lambda values, theta: theta + 0.01,
    ... )
    >>> register(tilt).name, Cradle(effects={"tilt": {}}).has("tilt")
    ('tilt', True)
    """
    if any(effect.name == known.name for known in DECLARED):
        raise ValueError(f"effect {effect.name!r} is in the catalogue already; choose another name")
    if not effect.name.isidentifier():
        raise ValueError(f"effect {effect.name!r} must have a name of letters, digits and _, with no digit first")
    if all(
        does is None
        for does in (effect.force, effect.apply, effect.gaps, effect.instants, effect.clock, effect.reading)
    ):
        raise ValueError(f"effect {effect.name!r} does nothing: give it a force, or what it does to a reading")
    _EFFECTS[effect.name] = effect
    return effect


def effect(name: str) -> Effect:
    """The effect of that name; ValueError with the nearest name if there is none."""
    if name not in _EFFECTS:
        raise ValueError(unknown_key("effect", name, _EFFECTS))
    return _EFFECTS[name]


def known_effects() -> tuple[Effect, ...]:
    """The catalogue, and what was registered beside it."""
    return tuple(e for e in _EFFECTS.values() if e not in (*FILMED, *LEARNED))


def compose(base: str, changes: Iterable[str]) -> tuple[Effect, ...]:
    """The effects of a base model with more names added and "-name" taken out, in the order of the catalogue."""
    if not isinstance(base, str) or base not in MODELS:
        raise ValueError(unknown_key("model", base, MODELS))
    names = set(MODELS[base])
    for change in changes:
        name = effect(change.removeprefix("-")).name
        if change.startswith("-"):
            if name not in names:
                raise ValueError(f"model {base!r} has no effect {name!r} to take out")
            names.discard(name)
        else:
            names.add(name)
    for name in names:
        for needed in effect(name).requires:
            if needed not in names:
                raise ValueError(f"effect {name!r} requires {needed!r}; add it, or take {name!r} out with '-{name}'")
    return tuple(e for e in _EFFECTS.values() if e.name in names)


__all__ = ["CATALOGUE", "MODELS", "Effect", "Parameter", "compose", "effect", "known_effects", "register"]
