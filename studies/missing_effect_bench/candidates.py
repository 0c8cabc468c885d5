"""What a case may hide: the candidates by name, which of them are equivalent, and how probable each is beforehand."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

from cradle_env.cradle import Cradle
from cradle_env.effects import effect
from identification.diagnosis.selection.candidates import list_candidates
from studies.diagnosis.study import SAME

#: The kinds of cases. A set has as many of one as of another.
KINDS = ("nothing", "single", "pair", "equivalent", "unknown")
#: One relative error of all lengths. `length_mismatch` is the name of lengths that differ from bob to bob.
COMMON_LENGTH = "common_length"
#: Effects that no data of a case can tell apart, for k_f, κ and b are free: each changes the unit of time alone.
EQUIVALENTS = tuple(sorted({*SAME, COMMON_LENGTH}))
#: Three bobs that hang unevenly would need contacts that last as long as real ones: cases of three are even.
UNEVEN = frozenset({"length_mismatch", "mass_mismatch"})
MOST_BOBS = 3

#: A set of names; of equivalents, the first stands for all (see `merge`).
Names = frozenset[str]
NOTHING: Names = frozenset()
UNKNOWN: Names = frozenset({"unknown"})


def candidate_names(bobs: int) -> list[str]:
    """The names that may be hidden in a case of so many bobs."""
    excluded = {1: {"length_mismatch"}, MOST_BOBS: UNEVEN}.get(bobs, frozenset())
    names = dict.fromkeys(candidate.name for candidate in list_candidates(Cradle(bobs=bobs)))
    return [*(name for name in names if name not in excluded), COMMON_LENGTH]


def all_names() -> list[str]:
    """Every name that an answer may have."""
    return list(dict.fromkeys(name for bobs in range(1, MOST_BOBS + 1) for name in candidate_names(bobs)))


def describe(name: str) -> dict[str, Any]:
    """A candidate in plain words, its equation, its signs in data, and its parameters with their units."""
    if name == COMMON_LENGTH:
        return {
            "what": "all pendulums are longer or shorter than stated, by one factor",
            "equation": "r0 → r0 (1 + relative), the same for all bobs",
            "in data": "a phase that runs away in proportion to time",
            "parameters": {"relative": "[1] departure from the stated length"},
        }
    declared = effect(name)
    return {
        "what": declared.summary,
        "equation": declared.equation,
        "in data": declared.looks_like,
        "parameters": {p.key: f"[{p.unit}] {p.meaning}" for p in declared.parameters},
    }


def merge(names: Iterable[str]) -> Names:
    """The set, with one name for all equivalents: what data can decide."""
    return frozenset(EQUIVALENTS[0] if name in EQUIVALENTS else name for name in names)


def prior(bobs: int) -> dict[Names, float]:
    """How probable each answer is before the data: the kinds are, and within a kind its members.

    A pair has any two candidates, for the bench does not say which pairs it hides.
    """
    names = candidate_names(bobs)
    pairs = [pair for pair in itertools.combinations(names, 2) if not {*EQUIVALENTS}.issuperset(pair)]
    members = {
        "nothing": [NOTHING],
        "single": [frozenset({name}) for name in names if name not in EQUIVALENTS],
        "pair": [frozenset(pair) for pair in pairs],
        "equivalent": [frozenset({name}) for name in EQUIVALENTS],
        "unknown": [UNKNOWN],
    }
    return {member: 1.0 / len(KINDS) / len(members[kind]) for kind in KINDS for member in members[kind]}
