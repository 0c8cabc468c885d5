"""A learned law in words, and its terms as diagnosis.json has them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cradle_env.effects import effect
from identification.diagnosis.learned_law.law import LearnedLaw
from identification.diagnosis.learned_law.law_shape import Curve, LawShape, peak
from identification.diagnosis.uncertainty.intervals import Interval
from identification.number_format import typographic_minus

#: Share of the largest curve of its unit from which a curve is described.
_WORTH = 0.1
#: Least over largest speed lost at an impact from which the loss is described as constant.
_SAME = 0.8
#: Ratio of the even to the odd part of a force, or the reverse, from which only the larger one is described.
_DOMINANT = 2.0
#: Share of the speed range above which the largest force counts as that at the highest speed.
_NEAR_END = 0.8
#: Power of the speed up to which a force is described as constant.
_FLAT_POWER = 0.25


def describe_law(shape: LawShape) -> list[str]:
    """A sentence for each curve that matters."""
    curves = shape.curves()
    sizes = [peak(_law_part(curve)) for curve in curves]
    sentences = []
    for curve, size in zip(curves, sizes, strict=True):
        of_unit = [s for other, s in zip(curves, sizes, strict=True) if other.y_label == curve.y_label]
        if size >= _WORTH * max(of_unit):
            sentences.append(_describe_curve(curve))
    return sentences


def _law_part(curve: Curve) -> np.ndarray:
    """The curve less that of the model without the law."""
    return curve.y if curve.without is None else curve.y - curve.without


def _describe_curve(curve: Curve) -> str:
    who, _, what = curve.title.partition(": ")
    unit = curve.y_label.partition("[")[2].rstrip("]")
    added = _law_part(curve)
    k = int(np.argmax(np.abs(added)))
    largest, signed = added[k], typographic_minus(f"{added[k]:+.2g}")
    at = f"{typographic_minus(f'{curve.x[k]:.3g}')} {curve.x_label.partition('[')[2].rstrip(']')}"
    if what.startswith("against motion along"):
        way = "against" if largest > 0.0 else "with"
        return f"on {who}, a force {way} its motion along the string, up to {abs(largest):.2g} {unit} at {at}"
    if what.startswith("against"):
        sense = "more" if largest > 0.0 else "less"
        return (
            f"on {who}, a force against the motion, {_speed_dependence(curve)}, up to {peak(curve.y):.2g} {unit};"
            f" at {at} {abs(largest):.2g} {unit} {sense} than the drag b of the model without it"
        )
    if what.startswith("swinging"):
        return f"on {who}, a horizontal force {what}, up to {peak(curve.y):.2g} {unit}; a shaking room makes one"
    if what.startswith("at rest"):
        odd, even = 0.5 * (added - added[::-1]), 0.5 * (added + added[::-1])
        if peak(odd) > _DOMINANT * peak(even):
            way = "towards the middle" if odd[-1] < 0.0 else "away from the middle"
            extent = "the same" if peak(even) < _WORTH * peak(odd) else "about the same"
            return f"on {who}, a force {way} of up to {peak(odd):.2g} {unit}, {extent} on both sides"
        if peak(even) > _DOMINANT * peak(odd):
            return f"on {who}, a force to one side at any angle, {signed} {unit} at {at}"
        return f"on {who}, a force that depends on the angle, {signed} {unit} at {at}"
    if what.startswith("pull"):
        return f"on {who}, a pull along the string that depends on the angle, {signed} {unit} at {at}"
    if what.startswith("the same both ways"):
        return (
            f"on {who}, a force to one side that depends on speed, the same in both directions, {signed} {unit} at {at}"
        )
    if what == "restitution":
        taken = ((1.0 - curve.y) * curve.x)[curve.y > 0.0]
        if taken.size and taken.min() > _SAME * taken.max() > 0.0:
            return f"every impact takes about the same speed, {1e3 * np.median(taken):.2g} mm/s, as between wet balls"
        return f"at impacts, e differs from that of the model without the law by {signed} at {at}"
    return f"between {who}: {what}, {signed} {unit} at a gap of {at}"


def _speed_dependence(curve: Curve) -> str:
    """How the force of a curve depends on speed, in words."""
    y, half = curve.y, len(curve.y) // 2
    k = int(np.argmax(np.abs(y)))
    if k < _NEAR_END * len(y):
        return f"largest at {curve.x[k]:.2g} m/s"
    if y[-1] * y[half] <= 0.0:
        return "that changes its sign on the way"
    power = math.log2(y[-1] / y[half])
    if power < _FLAT_POWER:
        return "nearly constant"
    return f"that grows about as the power {power:.1f} of the speed"


def describe_terms(law: LearnedLaw, intervals: dict[str, Interval]) -> list[dict[str, Any]]:
    """The terms with their coefficients, as in diagnosis.json. intervals: by name of the unknown."""
    declared = {e.name: {p.key: p for p in e.parameters} for e in map(effect, {t.effect for t in law.terms})}
    return [
        {
            "name": term.name,
            "meaning": declared[term.effect][term.key].meaning,
            "unit": intervals[term.name].unit,
            "median": intervals[term.name].median,
            "ci95": list(intervals[term.name].ci95),
        }
        for term in law.terms
    ]
