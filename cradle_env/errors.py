"""How refusals are worded: the name, the value and its unit, what is allowed, what to do."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable

# An upper limit from here on only guards against slips of the pen; it is told to whoever passes it.
_ABSURD = 1e9
# Characters of a value that an error shows.
_LONGEST = 60


def one_line(value: object) -> str:
    """A value as an error shows it: on one line, and not too long."""
    try:
        text = repr(value)
    except Exception:  # such as an integer of thousands of digits: no repr may hide the error that is to be told
        text = f"a {type(value).__name__}"
    text = " ".join(text.split())
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "…"


def unknown_key(what: str, key: object, known: Iterable[str]) -> str:
    """The message for a key that does not exist, with the nearest that does."""
    known = sorted(known)
    near = difflib.get_close_matches(str(key), known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known) or 'none'}"
    return f"unknown {what} {one_line(key)}; {hint}"


def check_range(
    name: str,
    value: float,
    unit: str,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    above: bool = False,
    remedy: str = "",
) -> float:
    """The value as a float if it is finite and within [low, high] (low excluded with `above`); else ValueError."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(
            f"{name} is {one_line(value)}, which is not a number; give it in {unit or 'plain numbers'}"
        ) from None
    if not (math.isfinite(number) and number <= high and (number > low if above else number >= low)):
        bounds = [] if math.isfinite(number) else ["finite"]
        if low > -math.inf:
            bounds.append(f"{'greater than' if above else 'at least'} {low:g}")
        if high < _ABSURD or number > high:
            bounds.append(f"at most {high:g}")
        allowed = " and ".join(bounds) or "finite"
        given = f"{number:g} {unit}".rstrip()
        raise ValueError(f"{name} is {given}; it must be {allowed} {unit}".rstrip() + (f"; {remedy}" if remedy else ""))
    return number
