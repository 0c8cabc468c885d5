"""A learned law as functions: curves with their confidence bands over the range of the data."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import trapezoid

from cradle_env.constitutive import restitution_curve
from cradle_env.effects.learned_force import IN_TIME, SCALES, force, learned_force
from cradle_env.effects.learned_force import TERMS as OF_FORCE
from cradle_env.effects.learned_impact import learned_impact
from cradle_env.effects.learned_pair import TERMS as OF_PAIR
from cradle_env.effects.learned_pair import learned_pair
from cradle_env.mechanics.layout import PAIR_DECAYS
from cradle_env.simulation import simulate
from identification.diagnosis.learned_law.law import LearnedLaw
from identification.diagnosis.learned_law.terms import FREQUENCY
from identification.inference.fit_result import FitResult
from identification.inference.likelihood import TOLERANCE

#: Points of a curve.
_POINTS = 121
#: Relative step of k_f and of a frequency in finite differences.
_STEP = 1e-3
#: Half width of a normal distribution's central 95 % [standard deviations].
_SIGMAS = 1.96
#: Largest gap at which a force between neighbours is drawn [radii of a bob].
_MAX_GAP = 2.0
#: Periods of a periodic force that are drawn.
_PERIODS = 2.0


@dataclass(frozen=True, eq=False)
class Curve:
    """One function of a law.

    x, y, band (M,): band is the half width of the 95 % confidence band. without (M,): the function in the model without
    the law. within: bounds of y.
    """

    title: str
    x_label: str
    y_label: str
    x: np.ndarray
    y: np.ndarray
    band: np.ndarray
    without: np.ndarray | None = None
    within: tuple[float, float] = (-math.inf, math.inf)


class LawShape:
    """The functions of a law as fitted."""

    def __init__(self, law: LearnedLaw, fitted: FitResult):
        self.law, self.fitted, self.cradle = law, fitted, fitted.cradle
        likelihood = fitted.likelihood
        self.covariance = fitted.covariance
        self.indices = {name: i for i, name in enumerate(likelihood.names)}
        run = fitted.experiment.runs[0]
        beginning, _ = likelihood.initial_condition(fitted.values, 0)
        times = np.arange(0.0, run.times[run.fitted][-1] - (0.0 if run.state == "release" else run.fit_from), 1 / 120)
        self.motion = simulate(self.cradle, beginning, times=times, tolerance=TOLERANCE)

    def _effect_values(self, name: str, key: str) -> Any:
        return self.cradle.effects[name][key]

    def _curve(
        self,
        name: str,
        element: int,
        basis: Callable[[str], np.ndarray],
        uncertain: tuple[str, np.ndarray] | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """(sum, half width of its 95 % band) of basis(key) times the coefficients of one bob or pair (from 1).

        uncertain: name of an unknown of the model, and the change of the function when that unknown changes by its own
        size. It widens the band.
        """
        rows, coefficients, indices = [], [], []
        if uncertain is not None and uncertain[0] in self.indices:
            rows, coefficients = [uncertain[1] / self.fitted.scale_of(uncertain[0])], [0.0]
            indices = [self.indices[uncertain[0]]]
        for term in self.law.terms:
            if term.effect == name and term.element in (0, element):
                rows.append(basis(term.key))
                coefficients.append(self.fitted.values[term.name])
                indices.append(self.indices[term.name])
        A = np.array(rows)
        sd = np.sqrt(np.maximum(np.einsum("ki,kl,li->i", A, self.covariance[np.ix_(indices, indices)], A), 0.0))
        return np.array(coefficients) @ A, _SIGMAS * sd

    def _acts_on(self, name: str) -> list[int]:
        """Bobs or pairs (from 1) that the terms of an effect act on."""
        terms = [term for term in self.law.terms if term.effect == name]
        count = self.cradle.bobs - (name == learned_pair.name)
        return [i for i in range(1, count + 1) if any(term.element in (0, i) for term in terms)]

    def curves(self) -> list[Curve]:
        """All curves, bob by bob, then pair by pair, then of impacts."""
        curves = []
        for bob in self._shown_elements(learned_force.name):
            curves += [*self._curves_of_bob(bob), *self._periodic_curves(bob)]
        for pair in self._shown_elements(learned_pair.name):
            curves += self._curves_of_pair(pair)
        if self._acts_on_impacts():
            curves.append(self._impact_curve())
        return curves

    def _shown_elements(self, name: str) -> list[int]:
        """Bobs or pairs to show: the first one if all have the same curve."""
        several = self._acts_on(name)
        return several[:1] if all(t.element == 0 for t in self.law.terms if t.effect == name) else several

    def _actor(self, name: str, number: int, one: str) -> str:
        count = len(self._acts_on(name))
        common = count > 1 and len(self._shown_elements(name)) == 1
        return f"every {one}" if common else f"{one} {number}" if one == "bob" else f"{one} {number} and {number + 1}"

    def _force(self, key: str, theta: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Force along the string and along the swing [N], (2, M), of one term with coefficient 1 N.

        Periodic terms have curves of their own, and give 0 here.
        """
        scales = [self._effect_values(learned_force.name, key) for key in SCALES]
        parameters = [*scales, *(float(other == key and key not in IN_TIME) for other in OF_FORCE)]
        return np.array([force(0.0, 0.0, a, 0.0, b, parameters) for a, b in zip(theta, v, strict=True)]).T

    def _curves_of_bob(self, bob: int) -> list[Curve]:
        name = learned_force.name
        who = self._actor(name, bob, "bob")
        largest = float(np.max(np.abs(self.motion.theta[:, bob - 1])))
        fastest = float(np.max(np.abs((self.motion.r * self.motion.theta_dot)[:, bob - 1])))
        v, theta = np.linspace(0.0, fastest, _POINTS), np.linspace(-largest, largest, _POINTS)
        rest = np.zeros(_POINTS)
        b, before = self.fitted.values["b"], self.law.before.values["b"]
        drag = ("b", b * v)
        against, width = self._curve(
            name, bob, lambda k: 0.5 * (self._force(k, rest, -v) - self._force(k, rest, v))[1], drag
        )  # fmt: skip
        push, push_width = self._curve(name, bob, lambda k: self._force(k, theta, rest)[1])
        pull, pull_width = self._curve(name, bob, lambda k: -self._force(k, theta, rest)[0])
        ripple = np.linspace(0.0, float(np.max(np.abs(self.motion.r_dot[:, bob - 1]))), _POINTS)
        speed = self._effect_values(name, "speed")
        along, along_width = self._curve(name, bob, lambda k: ripple / speed * float(k == "radial"))
        lift, lift_width = self._curve(  # the force at rest is in the curve by angle
            name,
            bob,
            lambda k: (0.5 * (self._force(k, rest, v) + self._force(k, rest, -v)) - self._force(k, rest, rest))[1],
        )
        curves = [
            Curve(f"{who}: against the motion, drag b included", "speed [m/s]", "force [mN]", v,
                  1e3 * (against + b * v), 1e3 * width, 1e3 * before * v),
            Curve(f"{who}: at rest, by angle", "θ [rad]", "force [mN]", theta, 1e3 * push, 1e3 * push_width),
            Curve(f"{who}: pull along the string, by angle", "θ [rad]", "force [N]", theta, pull, pull_width),
            Curve(f"{who}: against motion along the string", "speed [m/s]", "force [mN]", ripple, 1e3 * along,
                  1e3 * along_width),
            Curve(f"{who}: the same both ways, by speed", "speed [m/s]", "force [mN]", v, 1e3 * lift, 1e3 * lift_width),
        ]  # fmt: skip
        return [curve for curve, own in zip(curves, (against, push, pull, along, lift), strict=True) if peak(own) > 0.0]

    def _periodic_curves(self, bob: int) -> list[Curve]:
        """The periodic force over its first periods; the band includes the uncertainty of the frequency."""
        if not any(term.in_time and term.element in (0, bob) for term in self.law.terms):
            return []
        name, frequency = learned_force.name, self.fitted.values[FREQUENCY]
        t = np.linspace(0.0, _PERIODS / frequency, _POINTS)
        waves = dict(zip(IN_TIME, (np.cos, np.sin), strict=True))

        def basis(key: str, frequency: float = frequency) -> np.ndarray:
            return waves[key](2.0 * np.pi * frequency * t) if key in waves else np.zeros(_POINTS)

        y, _ = self._curve(name, bob, basis)
        faster, _ = self._curve(name, bob, lambda k: basis(k, frequency * (1.0 + _STEP)))
        _, band = self._curve(name, bob, basis, (FREQUENCY, (faster - y) / _STEP))
        place = self.indices[FREQUENCY]
        sd = frequency * math.sqrt(self.covariance[place, place])
        title = f"{self._actor(name, bob, 'bob')}: swinging at {frequency:.4g} ± {_SIGMAS * sd:.1g} Hz"
        return [Curve(title, "time [s]", "horizontal force [mN]", t, 1e3 * y, 1e3 * band)]

    def _curves_of_pair(self, pair: int) -> list[Curve]:
        name = learned_pair.name
        who = self._actor(name, pair, "neighbours")
        gap = np.linspace(0.0, _MAX_GAP, _POINTS)
        decays = dict(zip(OF_PAIR, PAIR_DECAYS * 2, strict=True))
        curves = []
        for kind, title, unit, scale in (
            ("pull", "attraction", "force [mN]", 1e3),
            (
                "film",
                "resistance to opening and closing",
                "force per speed [N s/m]",
                1.0 / self._effect_values(name, "speed"),
            ),
        ):
            y, band = self._curve(
                name, pair, lambda k, kind=kind: np.exp(-decays[k] * gap) * float(k.startswith(kind))
            )  # fmt: skip
            if peak(y) > 0.0:
                millimetres = 1e3 * self.cradle.radius * gap
                curves.append(Curve(f"{who}: {title}", "gap [mm]", unit, millimetres, scale * y, scale * band))
        return curves

    def _acts_on_impacts(self) -> bool:
        return any(term.effect == learned_impact.name for term in self.law.terms)

    def _impact_curve(self) -> Curve:
        name = learned_impact.name
        speeds = self.motion.impacts["speed"]
        v = np.linspace(0.0, float(speeds.max()), _POINTS + 1)[1:]
        u = v / self._effect_values(name, "speed")
        shapes = {"level": np.ones_like(u), "slope": u, "bend": u**2, "gentle": np.exp(-u / 0.1), "wet": 1.0 / u}
        e = restitution_curve(self.cradle, v)
        stiffer = restitution_curve(self.cradle.replace(k_f=self.cradle.k_f * (1.0 + _STEP)), v)
        _, band = self._curve(name, 0, shapes.__getitem__, ("k_f", (stiffer - e) / _STEP))
        without = restitution_curve(self.law.before.cradle, v)
        return Curve("impacts: restitution", "impact speed [m/s]", "e", v, e, band, without, (0.0, 1.0))

    def energy_taken(self) -> float:
        """Energy [J] that the law's forces on single bobs take from the first run; negative if they add energy."""
        name = learned_force.name
        if not self.cradle.has(name):
            return 0.0
        total, motion = 0.0, self.motion
        for bob in self._acts_on(name):
            i = bob - 1
            values = [self._effect_values(name, key) for key in (*SCALES, *OF_FORCE)]
            parameters = [value if np.isscalar(value) else value[i] for value in values]
            v = motion.r[:, i] * motion.theta_dot[:, i]
            states = zip(motion.t, motion.r[:, i], motion.theta[:, i], motion.r_dot[:, i], v, strict=True)
            forces = np.array([force(*state, parameters) for state in states])
            total -= float(trapezoid(forces[:, 0] * motion.r_dot[:, i] + forces[:, 1] * v, motion.t))
        return total


def peak(values: np.ndarray) -> float:
    """Largest absolute value."""
    return float(np.max(np.abs(values)))
