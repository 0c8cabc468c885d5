"""Random cradles from the whole allowed space: each is simulated, refused or given up in time, and obeys physics."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cradle_env import Cradle, Release
from cradle_env.effects import CATALOGUE, MODELS, Effect, Parameter

#: How often a number is drawn from its whole allowed range instead of within a factor of 10 of a usual value.
_EXTREME = 0.15
#: Usual values and allowed ranges of the fields of Cradle that are one positive number [SI].
_FIELDS = {
    "length": (0.3, 1e-9, 1e12),
    "pivot_half_spacing": (0.1, 1e-9, 1e12),
    "mass": (0.28, 1e-9, 1e12),
    "radius": (0.02, 1e-9, 1e12),
    "youngs_modulus": (2e11, 1.0, 1e18),
    "k_f": (1.8e4, 1e-3, 1e12),
    "kappa": (200.0, 1e-6, 1e12),
    "b": (2e-3, 1e-320, 1e12),
    "gravity": (9.81, 1e-9, 1e12),
}


@dataclass(frozen=True)
class Case:
    """What is built and let go, as its arguments, so that a refusal of either is part of the case."""

    cradle: dict
    release: dict

    def build(self) -> tuple[Cradle, Release]:
        """The objects; ValueError where they are refused."""
        return Cradle(**self.cradle), Release(**self.release)


def draw(rng: np.random.Generator) -> Case:
    """One random cradle and release."""
    bobs = int(rng.choice([1, 2, 3, 5, 10, 34, 80, 200], p=[0.1, 0.25, 0.2, 0.2, 0.1, 0.08, 0.05, 0.02]))
    fields: dict = {"bobs": bobs, "model": str(rng.choice(list(MODELS)))}
    for name, (usual, low, high) in _FIELDS.items():
        if rng.random() < 0.4:
            fields[name] = _number(rng, usual, low, high)
    fields.setdefault("kappa", 200.0)  # not that of β, which extreme masses make impossible
    if rng.random() < 0.3:
        fields["poisson_ratio"] = float(rng.uniform(-0.999, 0.5))
    if rng.random() < 0.2:
        fields["restitution"] = float(rng.uniform(0.0, 1.0))
    delta = [0.0, float(rng.normal(0.0, 0.01)), float(rng.uniform(-0.9, 3.0))][rng.choice(3, p=[0.4, 0.5, 0.1])]
    fields["delta"] = delta if rng.random() < 0.8 else tuple(delta + 0.003 * rng.standard_normal(bobs - 1))
    held = set(MODELS[fields["model"]])
    effects = {}
    for effect in CATALOGUE:
        if effect.parameters and held.issuperset(effect.requires) and rng.random() < 0.12:
            effects[effect.name] = _values(rng, effect, bobs)
    fields["effects"] = effects
    angle = float(rng.choice([0.228, rng.uniform(-1.5, 1.5), rng.normal(0.0, 0.1)]))
    release = {
        "angle": angle,
        "bobs": int(rng.integers(1, bobs + 1)),
        "start": str(rng.choice(["unstretched", "hanging"])),
    }
    if rng.random() < 0.15:
        release = {"angles": {int(i): float(rng.uniform(-0.5, 0.5)) for i in rng.choice(bobs, 1 + bobs // 4) + 1}}
    return Case(fields, release)


def _number(rng: np.random.Generator, usual: float, low: float, high: float) -> float:
    if rng.random() < _EXTREME:
        return float(math.exp(rng.uniform(math.log(low), math.log(high))))
    return float(usual * 10.0 ** rng.uniform(-1.0, 1.0))


def _values(rng: np.random.Generator, effect: Effect, bobs: int) -> dict:
    return {p.key: _value(rng, p, bobs) for p in effect.parameters}


def _value(rng: np.random.Generator, p: Parameter, bobs: int):
    def one() -> float:
        if rng.random() < _EXTREME:
            return float(rng.uniform(p.low, p.high))
        return float(np.clip(p.scale * 10.0 ** rng.uniform(-1.0, 1.0) * rng.choice([1.0, -1.0]), p.low, p.high))

    if not p.each:
        return one()
    several = np.array([one() for _ in range(p.count(bobs))])
    if p.balanced and len(several):
        several -= several.mean()
    return tuple(several.tolist())
