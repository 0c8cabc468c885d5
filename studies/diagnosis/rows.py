"""What the rows of a study of diagnoses say; see `study_table`."""

from __future__ import annotations

import numpy as np

from cradle_env.parameter_name import ALL, ParameterName
from studies.diagnosis.study import SAME, SYMMETRIC

KINDS = ("nothing hidden", "one effect", "two effects", "three effects", "in no catalogue")
#: The χ² of the readings that the right model may leave of a case that counts.
CONFOUNDED = 2.0

Row = dict


def kind(row: Row) -> str:
    """Which of KINDS a case is."""
    return KINDS[-1] if row["hidden"] == ["?"] else KINDS[len(row["hidden"])]


def is_confounded(row: Row) -> bool:
    """Whether the right model leaves more than it should, for the reference's impacts take some time. What it leaves of
    a variant is told from that by the same experiment made by the formula."""
    return row.get("formula leaves", row.get("right leaves", 0.0)) > CONFOUNDED


def reported_names(row: Row) -> set[str]:
    """Every name that a diagnosis mentions."""
    return {*row["named"], *(name for names in row["one of"] for name in names)}


def comes_first(row: Row) -> bool:
    """Whether what is hidden is the first name; of those that are the same in all data, one of them is, and it is
    mentioned."""
    hidden, listed = row["hidden"][0], [*row["named"], *(name for names in row["one of"] for name in names)]
    same = SYMMETRIC if hidden in SYMMETRIC and hidden in listed else {hidden}
    return bool(listed) and listed[0] in same


def is_exact(row: Row) -> bool:
    """Whether a verdict is right, and mentions all that is the same in all data as what is hidden alone."""
    return bool(row["right"]) and (set(row["hidden"]).isdisjoint(SAME) or reported_names(row) >= SYMMETRIC)


def values_covered(row: Row) -> list[bool]:
    """Of every value of the effects hidden, whether its interval holds it; where the row has both."""
    found = []
    for address, interval in row.get("intervals", {}).items():
        name = ParameterName.parse(address)
        values = np.atleast_1d(row["made by"][name.effect][name.key])
        if name.element != ALL:  # all alike, of values that are not
            low, high = interval["ci95"]
            rounding = 1e-6 * (high - low)  # what is hidden at a bound is within an interval that ends there
            found.append(bool(low - rounding <= values[(name.element or 1) - 1] <= high + rounding))
    return found


def below_detection_limit(row: Row) -> str:
    """Whether what is hidden is weaker than the limit up to which the diagnosis says that the data may hide it."""
    for entry in row.get("unseen", ()):
        value = np.atleast_1d(row["made by"].get(entry["effect"], {}).get(entry["parameter"], ()))
        if len(value) == 1:  # one strength: what the limit is of
            size = abs(float(value[0]))
            if "least" in entry:
                return "yes" if entry["least"] is None or size >= entry["least"] else "no"
            return "yes" if entry["most"] is None or size <= abs(entry["most"]) else "no"
    return ""


def rightly_named(rows: list[Row]) -> list[Row]:
    """The cases that are right and whose parameters are those of the right model: of equals they are the first's."""
    return [
        row
        for row in rows
        if row["right"] and sorted([*row["named"], *(row["one of"] or [[]])[0]]) == sorted(row["hidden"])
    ]


def stated_probabilities(row: Row) -> list[tuple[float, bool]]:
    """(probability, whether it is right) of each explanation of a diagnosis; sets that are the same in all data are
    one. That of all other sets is left out, for it explains nothing. Those that a test refuted count as well."""
    same = SAME if SAME.isdisjoint(row["hidden"]) else SYMMETRIC
    hidden, found = _merged(row["hidden"], same), {}
    for one in row["sets"]:
        if one["kind"] != "other":
            own = frozenset("?") if one["kind"] == "law" else _merged(one["effects"], same)
            found[own] = found.get(own, 0.0) + one["probability"]
    return [(min(1.0, probability), own == hidden) for own, probability in found.items()]


def _merged(names: list[str], same: frozenset[str]) -> frozenset[str]:
    """A set of effects, with one name for those that are the same in all data."""
    return frozenset("clock_scale" if name in same else name for name in names)
