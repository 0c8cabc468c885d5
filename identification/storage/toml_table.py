"""Read TOML with errors that name file, line and key; write values as TOML."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from cradle_env.errors import unknown_key
from cradle_env.toml_reader import parse_toml
from identification.storage.files import ExperimentError

Address = tuple[str | int, ...]
_KEY = r"""(?:[\w-]+|"[^"]*"|'[^']*')"""
_DOTTED = rf"{_KEY}(?:\s*\.\s*{_KEY})*"
_LINE = re.compile(rf"\s*(?:(?P<open>\[\[?)\s*(?P<table>{_DOTTED})\s*\]|(?P<key>{_DOTTED})\s*=)")


class Table:
    """A table of a TOML file. Its methods return checked values; their errors name file, line and key.

    Parameters
    ----------
    name : str
        Name of the file, for errors.
    text : str
        Text of the whole file.
    values : mapping of str to object
        Entries of the table.
    address : tuple of str or int
        Keys that lead from the top of the file to the table; indices, from 0, in lists of tables.

    Examples
    --------
    >>> table = Table.parse("experiment.toml", "[cradle]\\nbobs = 3\\nlength = 'long'").table("cradle")
    >>> table.whole("bobs")
    3
    >>> table.number("length")
    Traceback (most recent call last):
    identification.storage.files.ExperimentError: experiment.toml, line 3: cradle.length: is "long"; expected a number
    """

    def __init__(self, name: str, text: str, values: Mapping[str, Any], address: Address = ()):
        self.name, self.text, self.values, self.address = name, text, values, address

    @classmethod
    def parse(cls, name: str, text: str) -> Table:
        """Parse a file. Raises ExperimentError if it is not valid TOML."""
        try:
            return cls(name, text, parse_toml(text))
        except ValueError as error:
            raise ExperimentError(f"{name}: not valid TOML: {str(error)[:200]}; correct it there") from None

    def where(self, *keys: str | int) -> str:
        """Describe the place of an entry: "file, line n: table.key"."""
        address = (*self.address, *keys)
        line = _line_of(self.text, address)
        path = ".".join(key if isinstance(key, str) else f"[{key + 1}]" for key in address).replace(".[", "[")
        return (f"{self.name}, line {line}" if line else self.name) + (f": {path[:80]}" if path else "")

    def refuse(self, message: str, *keys: str | int) -> ExperimentError:
        """Return the error to raise for the entry at `keys`."""
        return ExperimentError(f"{self.where(*keys)}: {message}")

    @contextmanager
    def entry(self, *keys: str | int) -> Iterator[None]:
        """Turn a ValueError of the block into an ExperimentError with the place of the entry at `keys`.

        Without `keys`, the entry is the key with which the message begins, if there is one.
        """
        try:
            yield
        except ExperimentError:
            raise
        except ValueError as error:
            word = str(error).partition(" ")[0]
            raise self.refuse(str(error), *(keys or [word] * (word in self.values))) from None
        except ArithmeticError:
            raise self.refuse("values too extreme to compute with; check them and their units", *keys) from None

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def allow_only(self, known: Collection[str], what: str = "key") -> None:
        """Raise ExperimentError for a key that is not known; the message has the nearest known one."""
        for key in self.values:
            if key not in known:
                raise self.refuse(unknown_key(what, key[:60], known), key)

    def _get(self, key: str, kind: type | tuple[type, ...], expected: str) -> Any:
        if key not in self:
            raise self.refuse(f"{key} is missing; add {key}: {expected}")
        value = self.values[key]
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise self.refuse(f"is {_format_value(value)}; expected {expected}", key)
        return value

    def number(self, key: str) -> float:
        """Return a finite number."""
        return self._finite(self._get(key, (int, float), "a number"), key)

    def _finite(self, value: Any, *keys: str | int) -> float:
        try:
            if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(number := float(value)):
                return number
        except OverflowError:
            pass
        raise self.refuse(f"is {_format_value(value)}; expected a finite number", *keys)

    def numbers(self, key: str) -> tuple[float, ...]:
        """Return a list of finite numbers."""
        return tuple(self._finite(value, key) for value in self._get(key, list, "a list of numbers"))

    def number_or_numbers(self, key: str) -> float | tuple[float, ...]:
        """Return a finite number, or a list of them."""
        return self.numbers(key) if isinstance(self.values.get(key), list) else self.number(key)

    def whole(self, key: str) -> int:
        """Return a whole number."""
        return self._get(key, int, "a whole number")

    def string(self, key: str, choices: Collection[str] = ()) -> str:
        """Return a string; one of `choices`, if any are given."""
        expected = " or ".join(f'"{choice}"' for choice in choices) or "a string in quotes"
        value = self._get(key, str, expected)
        if choices and value not in choices:
            raise self.refuse(f"is {_format_value(value)}; expected {expected}", key)
        return value

    def strings(self, key: str) -> list[str]:
        """Return a list of strings."""
        value = self._get(key, list, 'a list of names, as in ["quadratic_drag"]')
        if not all(isinstance(item, str) for item in value):
            raise self.refuse(f"is {_format_value(value)}; expected a list of names in quotes", key)
        return value

    def table(self, key: str, expected: str = "a table, { key = value, ... }") -> Table:
        """Return a table in this one."""
        return Table(self.name, self.text, self._get(key, dict, expected), (*self.address, key))

    def tables(self, key: str) -> list[Table]:
        """Return a list of at least one table."""
        value = self._get(key, list, f"one [[{key}]] table or more, in double brackets")
        if not value or not all(isinstance(item, dict) for item in value):
            raise self.refuse(f"expected one [[{key}]] table or more, in double brackets", key)
        return [Table(self.name, self.text, item, (*self.address, key, i)) for i, item in enumerate(value)]


def _format_value(value: object) -> str:
    try:
        text = f'"{value}"' if isinstance(value, str) else str(value)
    except ValueError:  # an integer of thousands of digits
        text = "a huge number"
    return text if len(text) <= 60 else text[:60] + "..."


def _line_of(text: str, address: Address) -> int | None:
    """Find the line, from 1, of an entry, or of the innermost table that holds it."""
    table: Address = ()
    counts: dict[Address, int] = {}  # index of the latest table of each [[...]]
    best, best_length = None, 0
    for number, line in enumerate(text.split("\n"), 1):
        match = _LINE.match(line)
        if match is None:
            continue
        keys = [key.strip("\"'") for key in re.findall(_KEY, match["table"] or match["key"])]
        if match["table"]:
            table = ()
            for depth, key in enumerate(keys, 1):
                table = (*table, key)
                if match["open"] == "[[" and depth == len(keys):
                    counts[table] = counts.get(table, -1) + 1
                if table in counts:
                    table = (*table, counts[table])
        here = table if match["table"] else (*table, *keys)
        within = address[: len(here)] == here or here[: len(address)] == address
        if within and min(len(here), len(address)) > best_length:
            best, best_length = number, min(len(here), len(address))
    return best


def toml_text(value: object) -> str:
    """Format a value as TOML: a string, number, list or inline table."""
    if isinstance(value, str):
        escaped = "".join(c if c.isprintable() and c not in '\\"' else f"\\U{ord(c):08x}" for c in value)
        return f'"{escaped}"'
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{toml_key(k)} = {toml_text(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_text, value)) + "]"
    return repr(value)


def toml_key(key: object) -> str:
    """Format a key as TOML, in quotes if it needs them."""
    return str(key) if re.fullmatch(r"[\w-]+", str(key), re.ASCII) else toml_text(str(key))
