"""The names of parameters and unknowns in files, options and reports: "k_f", "effect.key[i]", "noise@run"."""

from __future__ import annotations

import dataclasses
import functools
import re
from dataclasses import dataclass

#: The element of a name that stands for all values of a parameter at once: "effect.key[*]".
ALL = 0
_NAME = re.compile(
    r"(?:(?P<effect>[^.@\[]+)\.)?(?P<key>[^.@\[]+)(?:\[(?P<element>[1-9]\d*|\*)\])?(?:@(?P<run>[1-9]\d*))?"
)


@dataclass(frozen=True)
class ParameterName:
    """The name of a parameter of the cradle, of an effect, or of a run.

    Parameters
    ----------
    key : str
        A field of Cradle, the key of an effect's parameter, or a quantity of a run such as "noise" or "theta".
    effect : str
        The effect that the key belongs to; empty for others.
    element : int, optional
        The bob or gap, from 1, if each has its own value; ALL for all of them at once.
    run : int, optional
        The run, from 1, for a quantity of one run.

    Examples
    --------
    >>> ParameterName.parse("spacer_offset.offset[2]")
    ParameterName(key='offset', effect='spacer_offset', element=2, run=None)
    >>> str(ParameterName("theta", element=1, run=3))
    'theta[1]@3'
    """

    key: str
    effect: str = ""
    element: int | None = None
    run: int | None = None

    @staticmethod
    @functools.lru_cache(maxsize=1024)
    def parse(text: str) -> ParameterName:
        """Parse a name; ValueError if the text has another form."""
        match = _NAME.fullmatch(text)
        if match is None:
            raise ValueError(
                f"{text!r} is no name of a parameter; expected NAME, EFFECT.KEY or EFFECT.KEY[NUMBER], NUMBER from 1"
            )
        effect, key, element, run = match.group("effect", "key", "element", "run")
        number = None if element is None else ALL if element == "*" else int(element)
        return ParameterName(key, effect or "", number, None if run is None else int(run))

    def __str__(self) -> str:
        owner = f"{self.effect}." if self.effect else ""
        element = "" if self.element is None else "[*]" if self.element == ALL else f"[{self.element}]"
        return f"{owner}{self.key}{element}" + ("" if self.run is None else f"@{self.run}")

    @property
    def is_of_cradle(self) -> bool:
        """Whether it names a field of Cradle: no parameter of an effect, and no quantity of a run."""
        return not self.effect and self.run is None

    @property
    def whole(self) -> ParameterName:
        """The name without its bob or gap."""
        return dataclasses.replace(self, element=None)

    def in_run(self, run: int | None) -> ParameterName:
        """The same name for another run, from 1, or for none."""
        return dataclasses.replace(self, run=run)
