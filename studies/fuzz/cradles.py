"""Random cradles from the whole allowed space: each is simulated or refused, hears Ctrl-C, and obeys physics."""

from __future__ import annotations

import math
import time
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cradle_env import Cradle, Release, Trajectory, simulate
from cradle_env.cost import steps_needed
from cradle_env.effects import CATALOGUE, MODELS, Effect, Parameter
from cradle_env.simulation import SimulationError

#: Simulated time of each [s], less where that takes more than so many steps of single bobs; and how long a run may
#: take before it is interrupted [s].
DURATION, _MOST_STEPS, _PATIENCE = 10.0, 2e6, 10.0
#: The longest time for which a run may not hear Ctrl-C [s]. Times are of the processor: others on the machine do not
#: count.
DEAF = 1.0
#: How much the energy ledger may drift, of the energy of a swing or of the largest change in the ledger. Samples within
#: a step are interpolated, to 1e-5 or so; where attraction rivals gravity, to 6e-4; where it exceeds the weight, to
#: 6e-3. A wrong force, or an impact that is missed, makes a tenth and more.
_DRIFT = 1e-3
_DRIFT_ATTRACTED = 1e-2
#: How far bobs may overlap [radii], beyond what eq. 1 lets them in an impact that is followed in time.
_OVERLAP = 1e-6

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


@dataclass(frozen=True)
class Outcome:
    """How a case ended: "ran", "refused" (ValueError), "stopped" (SimulationError), "interrupted" (too long for us), or
    "broken", with what is wrong."""

    kind: str
    text: str = ""
    seconds: float = 0.0
    deafest: float = 0.0


class _TooLongError(Exception):
    pass


def run_case(case: Case) -> Outcome:
    """Simulates a case and judges it."""
    began = last = time.thread_time()
    deafest, reached = 0.0, 0.0

    def listen(done: float) -> None:
        nonlocal last, deafest, reached
        now = time.thread_time()
        deafest, last, reached = max(deafest, now - last), now, done
        if now - began > _PATIENCE:
            raise _TooLongError

    kind, problems, text = "ran", [], ""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            cradle, release = case.build()
            duration = DURATION * min(1.0, _MOST_STEPS / steps_needed(cradle, DURATION))
            try:
                run = simulate(cradle, release, duration, 480.0 / duration, progress=listen)
            except _TooLongError:
                kind = "interrupted"
                run = simulate(cradle, release, max(0.5 * reached, 1e-3) * duration, 480.0 / duration)
            problems = violations(run)
        except ValueError as problem:
            kind, text = "refused", str(problem)
        except SimulationError as problem:
            kind, text = "stopped", str(problem)
        except Exception as problem:
            kind, text = "broken", f"{type(problem).__name__}: {problem}"
    seconds = time.thread_time() - began
    if "\n" in text or len(text) > 600:
        problems.append(f"a message of {len(text)} characters on {text.count(chr(10)) + 1} lines")
    if problems:
        return Outcome("broken", "; ".join(problems), seconds, deafest)
    return Outcome(kind, text, seconds, deafest)


def violations(run: Trajectory) -> list[str]:
    """What a run does that no cradle can."""
    found = []
    for name in ("theta", "r", "theta_dot", "r_dot"):
        if not np.isfinite(getattr(run, name)).all():
            found.append(f"{name} is not finite")
    if found:
        return found
    energy = run.energy()
    parts = np.array([energy.kinetic, energy.gravity, energy.strings, energy.total])
    cradle = run.cradle
    swing = cradle.mass * cradle.gravity * cradle.length * (1.0 - math.cos(np.abs(run.theta).max()))
    scale, drift = max(float(np.ptp(parts, axis=1).max()), swing), float(np.ptp(energy.total))
    # The ledger sums numbers as large as the weight times the length, and rounds as they do.
    rounding = 1e3 * np.finfo(float).eps * float(np.abs(parts).max())
    attraction = cradle.effects.get("bob_attraction", {"force": 0.0})["force"]
    attracted = abs(attraction) > cradle.mass * cradle.gravity
    if drift > (_DRIFT_ATTRACTED if attracted else _DRIFT) * scale and drift > rounding:
        found.append(f"the energy ledger drifts by {drift / scale:.1e} of {scale:.1e} J")
    overlap, allowed = _overlap(run)
    if overlap > allowed:
        found.append(f"bobs overlap by {overlap:.1e} radii, allowed {allowed:.1e}")
    return found


def _overlap(run: Trajectory) -> tuple[float, float]:
    """The largest overlap of neighbours at the samples, and what is allowed [radii]."""
    cradle = run.cradle
    if cradle.bobs == 1:
        return 0.0, _OVERLAP
    if cradle.has("large_angle"):
        x, z = cradle.pivots + run.r * np.sin(run.theta), -run.r * np.cos(run.theta)
    else:
        x, z = cradle.pivots + run.r * run.theta, np.zeros_like(run.theta)
    distances = np.hypot(np.diff(x, axis=1), np.diff(z, axis=1))
    if not cradle.has("large_angle"):
        distances = np.diff(x, axis=1)  # on a line nobody passes
    gaps = distances - 2.0 * cradle.radius
    soft = 0.0
    if cradle.has("contact_duration") and len(run.impacts):
        speed, scale = float(run.impacts["speed"].max()), cradle.effects["contact_duration"]["scale"]
        # Eq. 1 without loss, a chain pressing on one contact.
        soft = scale * (1.25 * cradle.bobs * cradle.mass * speed**2 / cradle.k_el) ** 0.4
    rounding = 1e3 * np.finfo(float).eps * float(np.abs(x).max())
    return float(-gaps.min()) / cradle.radius, _OVERLAP + (2.0 * soft + rounding) / cradle.radius


def fuzz(count: int, seed: int, report: Callable[[str], None]) -> tuple[Counter[str], list[str], float]:
    """How many of `count` random cradles ended how, what was broken, and the longest deafness to Ctrl-C [s]."""
    simulate(Cradle(bobs=2), Release(0.2), 0.1)  # compiles
    counts, broken, deafest = Counter(), [], 0.0
    for k in range(count):
        outcome = run_case(draw(np.random.default_rng([seed, k])))
        counts[outcome.kind] += 1
        if outcome.kind == "broken":
            broken.append(f"cradle {k}: {outcome.text}")
        if outcome.deafest > DEAF:
            broken.append(f"cradle {k}: deaf to Ctrl-C for {outcome.deafest:.1f} s")
        deafest = max(deafest, outcome.deafest)
        if k % 50 == 49:
            report(f"{k + 1} of {count} cradles: {dict(counts)}")
    return counts, broken, deafest


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
