"""Find the columns of time and bobs in a table, by the meaning of their labels or as the user states."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from cradle_env.errors import check_range, one_line, unknown_key
from identification.experiment.column_meaning import (
    QUANTITY_OF,
    TABLE_UNITS,
    Meaning,
    is_rate,
    parse_label,
    parse_label_unit,
    parse_unit,
    quantity_of,
    run_of,
    same_label,
)
from identification.storage.files import ExperimentError

#: Most columns that a message names.
_NAMED = 8
#: Most bobs of a cradle.
_MOST_BOBS = 200


@dataclass(frozen=True)
class Columns:
    """What the user states about the columns of a table; the rest is determined from the labels.

    Parameters
    ----------
    time : str, optional
        Label of the column of time.
    bobs : mapping of int to str
        Label of each bob's column, by its number, from 1. If given, only these columns are read.
    units : sequence of str
        Unit of the times, of the readings, or both; they override those in the file. "0.44 mm" is the size of a pixel.
    run : str, optional
        Which run to read, of a table with several: "Run #1" reads columns such as "Angle (rad) Run #1".
    rate : float, optional
        Frames per second [1/s], for a table with a column of frame numbers instead of times.

    Raises
    ------
    ValueError
        If a unit is unknown, or if a number is out of range.

    Examples
    --------
    >>> Columns(time="clock", bobs={1: "left"}, units=("deg",)).reading_unit
    'deg'
    """

    time: str | None = None
    bobs: Mapping[int, str] = field(default_factory=dict)
    units: Sequence[str] = ()
    rate: float | None = None
    run: str | None = None

    def __post_init__(self) -> None:
        for unit in self.units:
            if parse_unit(unit) is None:
                raise ValueError(unknown_key("unit", unit, QUANTITY_OF))
        if len(self.units) > 1 and len({quantity_of(unit) == "t" for unit in self.units}) < len(self.units):
            raise ValueError(f"units are {' and '.join(self.units)}; give one of time and one of the readings")
        for bob in self.bobs:
            if not 1 <= bob <= _MOST_BOBS:
                raise ValueError(f"bob is {bob}; bobs are numbered from 1 to {_MOST_BOBS}")
        if self.rate is not None:
            check_range("rate", self.rate, "frames per second", 0.0, above=True)

    @property
    def time_unit(self) -> str | None:
        """The unit of time that the user states."""
        return next((unit for unit in self.units if quantity_of(unit) == "t"), None)

    @property
    def reading_unit(self) -> str | None:
        """The unit of readings that the user states."""
        return next((unit for unit in self.units if quantity_of(unit) != "t"), None)

    @property
    def any(self) -> bool:
        """Whether the user states anything."""
        return self != Columns()


@dataclass(frozen=True)
class ColumnAssignment:
    """The columns to read, by their index in a row.

    Parameters
    ----------
    clock : int
        Index of the column of time.
    clock_unit : str, optional
        Unit of the times; "frame" if the column has frame numbers; None if no unit is stated.
    bobs : dict of int to (int, str or None)
        Index and unit of each bob's column, by number of the bob.
    quantity : {"theta", "x"}
        Angles or displacements.
    ignored : tuple of int
        Indices of all other columns.
    notes : tuple of str
        Further remarks for the user.
    """

    clock: int
    clock_unit: str | None
    bobs: dict[int, tuple[int, str | None]]
    quantity: str
    ignored: tuple[int, ...]
    notes: tuple[str, ...]


def assign_columns(at: str, labels: Sequence[str], units: Sequence[str | None], columns: Columns) -> ColumnAssignment:
    """Assign columns to time and bobs.

    Parameters
    ----------
    at : str
        File and line, with which errors begin.
    labels : sequence of str
        Labels of the columns.
    units : sequence of str or None
        Units of the columns, from a row below the labels.
    columns : Columns
        What the user states.

    Returns
    -------
    ColumnAssignment

    Raises
    ------
    ExperimentError
        If there is no column of time or of a bob, or if two columns could be the same.
    """
    meanings = [_with_unit(parse_label(label), unit) for label, unit in zip(labels, units, strict=True)]
    meanings = _in_one_run(at, labels, meanings, columns)
    bare = [_with_unit(parse_label_unit(label), unit) for label, unit in zip(labels, units, strict=True)]
    clock, clock_unit = _find_time(at, labels, meanings, bare, columns)
    found, quantity, notes = _find_bobs(at, labels, meanings, bare, clock, columns)
    used = {clock, *(place for place, _ in found.values())}
    return ColumnAssignment(
        clock, clock_unit, found, quantity, tuple(i for i in range(len(labels)) if i not in used), tuple(notes)
    )


def _in_one_run(
    at: str, labels: Sequence[str], meanings: Sequence[Meaning | None], columns: Columns
) -> list[Meaning | None]:
    """Leave out the columns of other runs than the one to read. Raises ExperimentError if it is not said which."""
    runs = [run_of(label) if meaning else None for label, meaning in zip(labels, meanings, strict=True)]
    found = list(dict.fromkeys(run for run in runs if run is not None))
    wanted = columns.run
    if wanted is None:
        if len(found) < 2 or columns.time is not None or columns.bobs:
            return list(meanings)
        names = quote_labels(found)
        raise ExperimentError(f'{at}: holds the runs {names}; say which to read: --run "{one_line(found[0])[1:-1]}"')
    if not any(run is not None and same_label(run, wanted) for run in runs):
        known = quote_labels(found) or "none that its labels name"
        raise ExperimentError(f"{at}: there is no run {one_line(wanted)}; it holds {known}")
    return [m if run is None or same_label(run, wanted) else None for m, run in zip(meanings, runs, strict=True)]


def _with_unit(meaning: Meaning | None, unit: str | None) -> Meaning | None:
    """Add the unit from the row of units to a meaning, unless the label states one."""
    if meaning is None or unit is None or meaning.unit is not None:
        return meaning
    quantity = QUANTITY_OF.get(unit, "")
    if quantity and meaning.quantity in ("", quantity):
        return dataclasses.replace(meaning, quantity=quantity, unit=unit)
    return dataclasses.replace(meaning, odd_unit=unit)


def find_column(at: str, labels: Sequence[str], name: str) -> int:
    """Find the index of the column that the user names. Raises ExperimentError unless there is exactly one."""
    places = [i for i, label in enumerate(labels) if label == name] or [
        i for i, label in enumerate(labels) if same_label(label, name)
    ]
    if not places:
        raise ExperimentError(f"{at}: {unknown_key('column', name, [label for label in labels if label])}")
    if len(places) > 1:
        raise ExperimentError(f"{at}: {len(places)} columns are called {one_line(name)}; give them different names")
    return places[0]


def quote_labels(labels: Sequence[str]) -> str:
    """Format labels for a message."""
    shown = [f'"{one_line(label)[1:-1]}"' for label in labels if label]
    more = f" and {len(shown) - _NAMED} more" if len(shown) > _NAMED else ""
    return ", ".join(shown[:_NAMED]) + more


def _find_time(
    at: str,
    labels: Sequence[str],
    meanings: Sequence[Meaning | None],
    bare: Sequence[Meaning | None],
    columns: Columns,
) -> tuple[int, str | None]:
    if columns.time is not None:
        place = find_column(at, labels, columns.time)
        if columns.rate is not None:
            return place, "frame"
        meaning = meanings[place] or bare[place]
        return place, columns.time_unit or (meaning.unit if meaning and meaning.quantity == "t" else None)
    by_kind = {kind: [i for i, m in enumerate(meanings) if m and m.quantity == kind] for kind in ("t", "frame")}
    if columns.rate is not None:
        if not by_kind["frame"]:
            raise ExperimentError(
                f'{at}: no column of frames among {quote_labels(labels)}; say which it is: --time "NAME"'
            )
        return by_kind["frame"][0], "frame"
    times = by_kind["t"]
    if not times and by_kind["frame"]:
        frames = quote_labels([labels[by_kind["frame"][0]]])
        raise ExperimentError(f"{at}: no column of time, only {frames}; add --rate FRAMES_PER_SECOND")
    if not times:
        none_of, names = "of time", '--time "NAME"'
        if not columns.bobs and not any(m and m.quantity not in by_kind for m in meanings):
            none_of, names = "of time or of a bob", '--time "NAME" --bob 1="NAME" --bob 2="NAME"'
        raise ExperimentError(f"{at}: no column {none_of} among {quote_labels(labels)}; say which it is: {names}")
    if len(times) > 1:
        both = quote_labels([labels[i] for i in times])
        raise ExperimentError(f'{at}: {both} are columns of time; say which to read: --time "NAME"')
    meaning = meanings[times[0]]
    assert meaning is not None
    if meaning.odd_unit is not None and columns.time_unit is None:
        raise ExperimentError(_unknown_unit(at, labels[times[0]], meaning.odd_unit, ("t",)))
    return times[0], columns.time_unit or meaning.unit


def _unknown_unit(at: str, label: str, unit: str, quantities: Sequence[str]) -> str:
    known = [known for quantity in quantities for known in TABLE_UNITS[quantity]]
    remedy = f"say it: --unit {' or '.join(known)}"
    if unit in ("px", "pixel", "pixels"):
        remedy = 'say how large one is, as --unit "0.44 mm"'
    return f"{at}, column {quote_labels([label])}: unknown unit {one_line(unit)}; {remedy}"


def _find_bobs(
    at: str,
    labels: Sequence[str],
    meanings: Sequence[Meaning | None],
    bare: Sequence[Meaning | None],
    clock: int,
    columns: Columns,
) -> tuple[dict[int, tuple[int, str | None]], str, list[str]]:
    """Find {number: (index, unit)} of the bobs, the quantity, and remarks for the user."""
    stated = columns.reading_unit
    places: dict[int, int] = {}
    if columns.bobs:
        places = {bob: find_column(at, labels, name) for bob, name in columns.bobs.items()}
        if len({clock, *places.values()}) <= len(places):
            raise ExperimentError(f"{at}: a column is named twice among --time and --bob; name each once")
        chosen = [dataclasses.replace(meanings[i] or bare[i] or Meaning(""), bob=bob) for bob, i in places.items()]
        candidates = list(zip(places.values(), chosen, strict=True))
    else:
        candidates = [(i, m) for i, m in enumerate(meanings) if i != clock and m and m.quantity not in ("t", "frame")]
        if any(m.quantity for _, m in candidates):  # then a label without a quantity is something else, such as a mass
            candidates = [(i, m) for i, m in candidates if m.quantity]
    if not candidates:
        remedy = 'say which they are: --bob 1="NAME" --bob 2="NAME"'
        if any(is_rate(label) for label in labels):
            remedy = "speeds and accelerations do not tell where a bob is: export its angle or position"
        raise ExperimentError(f"{at}: no column of a bob among {quote_labels(labels)}; {remedy}")
    quantity = quantity_of(stated) if stated else _choose_quantity(at, labels, candidates)
    others = [i for i, m in candidates if m.quantity not in ("", quantity)]
    if columns.bobs and others and not stated:
        raise ExperimentError(
            f"{at}: {quote_labels([labels[i] for i in places.values()])} mix angles and displacements; keep to either"
        )
    if not columns.bobs:
        candidates = [(i, m) for i, m in candidates if i not in others]
    if not candidates:
        raise ExperimentError(f"{at}: no column of a bob in {stated} among {quote_labels(labels)}; give another --unit")
    candidates, notes = _number_bobs(at, labels, candidates)
    found: dict[int, tuple[int, str | None]] = {}
    usable = {m.bob for _, m in candidates if stated or m.odd_unit is None}
    for i, m in candidates:
        assert m.bob is not None
        if stated is None and m.odd_unit is not None:
            if m.bob not in usable:
                raise ExperimentError(_unknown_unit(at, labels[i], m.odd_unit, (quantity,)))
            continue
        if m.bob in found:
            both = quote_labels([labels[found[m.bob][0]], labels[i]])
            raise ExperimentError(f'{at}: {both} are both of bob {m.bob}; say which to read: --bob {m.bob}="NAME"')
        if not 1 <= m.bob <= _MOST_BOBS:
            raise ExperimentError(
                f"{at}, column {quote_labels([labels[i]])}: there is no bob {m.bob}; bobs are numbered from 1 to"
                f' {_MOST_BOBS}; say which it is: --bob 1="NAME"'
            )
        found[m.bob] = i, stated or m.unit
    units = {unit for _, unit in found.values() if unit}
    without = [labels[i] for i, unit in found.values() if unit is None]
    if len(units) > 1 and without:
        raise ExperimentError(
            f"{at}: {quote_labels(without)} without a unit, and others in {' and in '.join(sorted(units))}; add it"
        )
    return {bob: (i, unit or next(iter(units), None)) for bob, (i, unit) in found.items()}, quantity, notes


def _choose_quantity(at: str, labels: Sequence[str], candidates: Sequence[tuple[int, Meaning]]) -> str:
    """Choose angles or displacements, whichever more bobs have; angles if equally many have both."""
    count = Counter(m.quantity for _, m in candidates)
    if not count["theta"] and not count["x"]:
        raise ExperimentError(
            f"{at}, column {quote_labels([labels[candidates[0][0]]])}: angle or displacement? say its unit:"
            " --unit deg, rad, mm, cm or m"
        )
    return "theta" if count["theta"] >= count["x"] else "x"


def _number_bobs(
    at: str, labels: Sequence[str], candidates: list[tuple[int, Meaning]]
) -> tuple[list[tuple[int, Meaning]], list[str]]:
    """Give each candidate the number of a bob, from 1."""
    bare = [i for i, m in candidates if m.bob is None]
    if len(bare) > 1 or (bare and len(candidates) > 1):
        raise ExperimentError(
            f"{at}: {quote_labels([labels[i] for i in bare])} {'do' if len(bare) > 1 else 'does'} not say of which bob;"
            ' say it: --bob 1="NAME" --bob 2="NAME"'
        )
    shift = int(any(m.bob == 0 for _, m in candidates))
    numbered = [(i, dataclasses.replace(m, bob=1 if m.bob is None else m.bob + shift)) for i, m in candidates]
    return numbered, ["bobs are numbered from 0 in the file, from 1 here"] if shift else []
