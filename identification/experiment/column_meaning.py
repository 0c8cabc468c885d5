"""Parse the label of a column: time, or the angle or displacement of a bob, and the unit."""

from __future__ import annotations

import itertools
import math
import re
import unicodedata
from dataclasses import dataclass

#: SI value of each unit that a table may use, by quantity; the default comes first.
TABLE_UNITS = {
    "t": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "theta": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0},
    "x": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
}
#: The quantity of each unit.
QUANTITY_OF = {unit: quantity for quantity, units in TABLE_UNITS.items() for unit in units}
#: Other spellings of units, in lower case and in Unicode normal form NFKC.
_SPELLINGS = {
    "s": "sec secs second seconds",
    "ms": "msec msecs millisecond milliseconds",
    "us": "\u03bcs usec microsecond microseconds",
    "rad": "radian radians",
    "mrad": "milliradian milliradians",
    "deg": "° degs degree degrees",
    "m": "meter meters metre metres",
    "cm": "centimeter centimeters centimetre centimetres",
    "mm": "millimeter millimeters millimetre millimetres",
    "um": "\u03bcm micron microns",
}
_UNIT_OF = {spelling: unit for unit, others in _SPELLINGS.items() for spelling in (unit, *others.split())}
_WORDS = {
    **dict.fromkeys("t time times timestamp elapsed zeit temps tiempo tempo".split(), "t"),
    **dict.fromkeys("theta θ th angle angles ang phi φ deflection tilt winkel ángulo angolo".split(), "theta"),
    **dict.fromkeys("x xpos pos position displacement disp auslenkung".split(), "x"),
    **dict.fromkeys("frame frames step index idx sample image".split(), "frame"),
}
_BOB_WORDS = frozenset("bob ball mass pendulum sphere bead kugel".split())
_FILLERS = frozenset("of in the from at rest horizontal up down sideways".split())
#: Characters that are mistaken for the degree sign.
_DEGREES = str.maketrans("º˚", "°°")
_BRACKETS = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]")
#: The run in labels: "Run 1: Time" of Logger Pro, "Time Run #1" of Capstone.
_RUN = re.compile(r"^([^:]*):(?=\s*\S)|\b(run\s*#?\s*\d+)", re.IGNORECASE)
#: The socket of a sensor in labels: "Angle, Ch P1" of Capstone.
_SOCKET = re.compile(r",\s*ch\s+\w+")
#: Units of quantities that move a bob but do not say where it is.
_RATES = re.compile(r"[\[(]\s*(?:m|cm|mm|rad|deg|°)\s*/\s*s(?:\^?2|²)?\s*[\])]", re.IGNORECASE)


@dataclass(frozen=True)
class Meaning:
    """The meaning of a label.

    Parameters
    ----------
    quantity : {"t", "frame", "theta", "x", ""}
        Time, number of a frame, angle or displacement; "" for a bob if the label does not say which of the two.
    bob : int, optional
        Number of the bob, if the label has one.
    unit : str, optional
        Key of `TABLE_UNITS`, if the label states one of them.
    odd_unit : str, optional
        Unit that the label states and that is unknown.
    """

    quantity: str
    bob: int | None = None
    unit: str | None = None
    odd_unit: str | None = None


def find_unit(text: str) -> str | None:
    """Find the unit with this spelling; None if it is unknown.

    >>> find_unit("(Degrees)")
    'deg'
    """
    return _UNIT_OF.get(_normalize(text).strip(" [](){}"))


def parse_unit(text: str) -> tuple[float, str] | None:
    """Parse a unit that a user states, into a factor and a unit of `TABLE_UNITS`; None if it is no such unit.

    >>> parse_unit("0.44 mm")  # the size of a pixel
    (0.44, 'mm')
    """
    match = re.fullmatch(r"\s*([\d.]+(?:[eE][-+]?\d+)?)?\s*(\D+)", text)
    unit = find_unit(match[2]) if match else None
    try:
        factor = float(match[1] or 1.0) if match else 0.0
    except ValueError:
        return None
    return (factor, unit) if unit is not None and 0.0 < factor < math.inf else None


def quantity_of(unit: str) -> str:
    """Quantity of a unit. Raises ValueError if `parse_unit` cannot parse it."""
    return QUANTITY_OF[_require_unit(unit)[1]]


def scale_of(unit: str) -> float:
    """SI value of a unit. Raises ValueError if `parse_unit` cannot parse it."""
    factor, name = _require_unit(unit)
    return factor * TABLE_UNITS[QUANTITY_OF[name]][name]


def _require_unit(unit: str) -> tuple[float, str]:
    parsed = parse_unit(unit)
    if parsed is None:
        raise ValueError(f"{unit} is not a known unit")
    return parsed


def parse_label(label: str) -> Meaning | None:
    """Parse a label; None if it names neither a time nor a bob.

    Every word must be known, since "Angle 1 error" is no angle and "x velocity" is no position.

    >>> parse_label("Angle 1 (deg)")
    Meaning(quantity='theta', bob=1, unit='deg', odd_unit=None)
    """
    return _interpret(*_split_label(label))


def parse_label_unit(label: str) -> Meaning:
    """Parse the unit of a label and ignore its words.

    >>> parse_label_unit("Left ball (deg)")
    Meaning(quantity='theta', bob=None, unit='deg', odd_unit=None)
    """
    _, unit, odd = _split_label(label)
    return Meaning(QUANTITY_OF.get(unit or "", ""), None, unit, odd)


def run_of(label: str) -> str | None:
    """The run that a label belongs to, as it writes it; None if it names none.

    >>> run_of("Angle (rad) Run #2"), run_of("Latest: Time (s)"), run_of("Angle (rad)")
    ('Run #2', 'Latest', None)
    """
    match = _RUN.search(label.strip())
    return None if match is None else (match[1] or match[2] or "").strip() or None


def is_rate(label: str) -> bool:
    """Whether a label has the unit of a speed or an acceleration.

    >>> is_rate("Gyroscope x (rad/s)"), is_rate("Angle (rad)")
    (True, False)
    """
    return _RATES.search(label) is not None


def _split_label(label: str) -> tuple[list[str], str | None, str | None]:
    """Split a label into its words and numbers, its unit if known, and its unit if unknown."""
    text, unit, odd = _SOCKET.sub(" ", _RUN.sub(" ", _normalize(label))), None, None
    for inside in _BRACKETS.findall(text):
        if inside in _UNIT_OF:
            unit = _UNIT_OF[inside]
        elif inside and not inside.isdigit():
            odd = inside
    text = _BRACKETS.sub(lambda match: f" {match[1]} " if match[1].isdigit() else " ", text)
    tokens = re.findall(r"°|[^\W\d_]+|\d+", text)
    if unit is None and odd is None:  # theta_1_deg, theta_deg_1, time_s
        named = [
            token for i, token in enumerate(tokens, 1) if token in _UNIT_OF and (len(token) > 1 or i == len(tokens))
        ]
        if len(named) == 1:
            unit = _UNIT_OF[named[0]]
            tokens.remove(named[0])
    return tokens, unit, odd


def same_label(a: str, b: str) -> bool:
    """Whether two labels are the same but for case, spaces and compatibility characters."""
    return "".join(_normalize(a).split()) == "".join(_normalize(b).split())


def _normalize(text: str) -> str:
    return unicodedata.normalize("NFKC", text.translate(_DEGREES)).casefold().strip()


def _interpret(tokens: list[str], unit: str | None, odd: str | None) -> Meaning | None:
    numbers = [int(token) for token in tokens if token.isdecimal()]
    words = [token for token in tokens if not token.isdecimal() and token not in _FILLERS]
    if len(numbers) > 1 or any(number > 10**6 for number in numbers):
        return None
    for bob_word, letter in itertools.pairwise(words):
        if bob_word in _BOB_WORDS and re.fullmatch("[a-h]", letter) and not numbers:  # mass A is bob 1
            numbers = [ord(letter) - ord("a") + 1]
            words.remove(letter)
    quantities = {_WORDS[word] for word in words if word in _WORDS}
    if len(quantities) > 1 or not all(word in _WORDS or word in _BOB_WORDS for word in words):
        return None
    of_unit = QUANTITY_OF.get(unit or "")
    bob = numbers[0] if numbers else None
    if quantities:
        (quantity,) = quantities
        if of_unit not in (None, quantity):
            odd = unit if odd is None else odd
            unit = None
    elif words or of_unit:  # "Ball 1", "Ball 1 (mm)", "ms"
        quantity = of_unit or ""
    else:
        return None
    if quantity in ("t", "frame") and (bob is not None or any(word in _BOB_WORDS for word in words)):
        return None
    return Meaning(quantity, bob, unit, odd)
