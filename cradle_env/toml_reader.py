"""TOML from anywhere: what would take the parser minutes is refused before it begins."""

from __future__ import annotations

import re
import tomllib
from typing import Any

#: Characters of a file at most; no description of a cradle comes near.
MOST_CHARACTERS = 2**20
# tomllib takes time that grows with the square of the parts of a dotted key; none of ours has more than four.
_MOST_PARTS = 20
_KEY = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')"""
_DEEP = re.compile(rf"(?:^|[{{,])[ \t]*\[{{0,2}}[ \t]*(?:{_KEY}[ \t]*\.[ \t]*){{{_MOST_PARTS}}}", re.MULTILINE)


def parse_toml(text: str) -> dict[str, Any]:
    """The content of a TOML text; ValueError, in one line, if it is none, too long, or nested too deep."""
    if len(text) > MOST_CHARACTERS:
        raise ValueError(f"{len(text)} characters; a description of a cradle has at most {MOST_CHARACTERS}")
    if found := _DEEP.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(f"tables nested too deep: a key of more than {_MOST_PARTS} parts (line {line})")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("tables nested too deep") from None
