"""How objects show themselves: one line for `repr`, tables and pictures for notebooks."""

from __future__ import annotations

import base64
import dataclasses
import html
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from cradle_env.plot_style import png

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Characters of a `repr`, which should fit one line of a terminal.
LINE = 120
# Width of a picture beside text [CSS pixels].
_PICTURE_WIDTH = 640


def summary_line(kind: str, parts: Iterable[str], end: str = "") -> str:
    """kind(part, part, …, end) in at most `LINE` characters: parts that do not fit are left out, and counted.

    >>> summary_line("Cradle", ["bobs=3", "length=0.25"])
    'Cradle(bobs=3, length=0.25)'
    """
    parts = [part if len(part) <= LINE // 2 else part[: LINE // 2 - 1] + "…" for part in parts]
    last = [end] if end else []
    line, kept = f"{kind}({', '.join([*parts, *last])})", len(parts)
    while len(line) > LINE and kept:
        kept -= 1
        line = f"{kind}({', '.join([*parts[:kept], f'… {len(parts) - kept} more', *last])})"
    return line


def changed_fields(instance: Any, defaults: Mapping[str, Any] = MappingProxyType({})) -> list[str]:
    """ "name=value" of each field of a dataclass that differs from its default; SI units.

    defaults: for fields whose default depends on others.
    """
    parts = []
    for field in dataclasses.fields(instance):
        value = getattr(instance, field.name)
        if field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        else:
            default = defaults.get(field.name, field.default)
        if value != default:
            parts.append(f"{field.name}={value_text(value)}")
    return parts


def value_text(value: Any) -> str:
    """A number to 6 digits; sequences and mappings of numbers likewise; other values as Python writes them."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key!r}: {value_text(item)}" for key, item in value.items()) + "}"
    if isinstance(value, tuple | list):
        inside = ", ".join(map(value_text, value))
        return f"({inside},)" if len(value) == 1 else f"({inside})"
    return repr(value)


def table(caption: str, rows: Sequence[Sequence[str]], header: Sequence[str] = ()) -> str:
    """An HTML table, its first column the row headers; every text is escaped."""
    cell = 'style="text-align: left"'
    parts = [f"<table><caption {cell}><b>{html.escape(caption)}</b></caption>"]
    if header:
        names = "".join(f'<th scope="col" {cell}>{html.escape(name)}</th>' for name in header)
        parts.append(f"<thead><tr>{names}</tr></thead>")
    parts.append("<tbody>")
    for first, *others in rows:
        values = "".join(f"<td {cell}>{html.escape(text)}</td>" for text in others)
        parts.append(f'<tr><th scope="row" {cell}>{html.escape(first)}</th>{values}</tr>')
    return "".join([*parts, "</tbody></table>"])


def picture(figure: Figure, description: str) -> str:
    """A figure as an inline image, with a description for those who do not see it."""
    data = base64.b64encode(png(figure)).decode()
    width = f'width="{_PICTURE_WIDTH}" style="max-width: 100%"'
    return f'<img alt="{html.escape(description)}" {width} src="data:image/png;base64,{data}">'
