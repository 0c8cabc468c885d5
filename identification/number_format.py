"""How symbols, units and rounded numbers are written: the same in pictures, reports, notebooks and terminals."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

_SUBSCRIPTS = str.maketrans("₀₁₂₃₄₅₆₇₈₉", "0123456789")
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def typographic_minus(number: str) -> str:
    """A number as print has it, with a minus for a hyphen."""
    return number.replace("-", "−")


def _split_symbol(symbol: str) -> tuple[str, str]:
    """(letter, subscript) of a symbol such as "k_f" or "c₂"."""
    letter, _, subscript = re.sub(r"([₀-₉]+)", r"_\1", symbol).partition("_")
    return letter, subscript.translate(_SUBSCRIPTS)


def escape_mathtext(text: str) -> str:
    """A text from outside, such as the name of a file, as Matplotlib draws it letter by letter: no dollar begins
    mathtext."""
    return text.replace("$", r"\$")


def mathtext(symbol: str) -> str:
    """A symbol as Matplotlib sets it: k_f with an index."""
    letter, subscript = _split_symbol(symbol)
    return f"${letter}_{{\\mathrm{{{subscript}}}}}$" if subscript else f"${letter}$"


def markup(symbol: str) -> Markup:
    """A symbol as HTML."""
    letter, subscript = _split_symbol(symbol)
    return Markup("<i>{}</i>").format(letter) + (Markup("<sub>{}</sub>").format(subscript) if subscript else "")


def unit_mathtext(unit: str, exponent: int = 0) -> str:
    """[10^k unit] for the label of an axis; empty for a plain number."""
    factor = f"$10^{{{exponent}}}$" if exponent else ""
    unit = "" if unit == "1" else re.sub(r"\^(-?[\d/]+)", r"$^{\1}$", unit)
    inside = " ".join(part for part in (factor, unit) if part)
    return f" [{inside}]" if inside else ""


def unit_markup(unit: str, exponent: int = 0) -> Markup:
    """A unit, times a power of ten, as HTML; empty for a plain number."""
    factor = f"10<sup>{typographic_minus(str(exponent))}</sup>" if exponent else ""
    power = lambda match: f"<sup>{typographic_minus(match[1])}</sup>"  # noqa: E731
    unit = "" if unit == "1" else re.sub(r"\^(-?[\d/]+)", power, html.escape(unit))
    return Markup(" ".join(part for part in (factor, unit) if part))


def unit_plain(unit: str, exponent: int = 0) -> str:
    """A unit, times a power of ten, as plain text."""
    factor = f"10{str(exponent).translate(_SUPERSCRIPTS)}" if exponent else ""
    unit = "" if unit == "1" else unit
    return " ".join(part for part in (factor, unit) if part)


@dataclass(frozen=True)
class Rounding:
    """How the numbers of one quantity are shown: in units of 10^exponent, with so many decimals."""

    exponent: int
    decimals: int

    @classmethod
    def of(cls, value: float, sd: float) -> Rounding:
        """Two digits of the uncertainty; a power of ten, by threes, where value or uncertainty, whichever is larger, is
        below 0.01 or from 100 000 on."""
        size = max(abs(value), abs(sd)) if math.isfinite(sd) else abs(value)
        plain = size == 0.0 or not math.isfinite(size) or 0.01 <= size < 1e5
        exponent = 0 if plain else 3 * math.floor(math.log10(size) / 3.0)
        step = sd if math.isfinite(sd) and sd > 0.0 else (size or 1.0) * 1e-3
        step = float(f"{step:.1e}")  # 9.97 is 10 to two digits, one decimal less
        return cls(exponent, max(0, 1 - math.floor(math.log10(step) + 1e-9 - exponent)))

    def text(self, value: float | None) -> str:
        """The value in units of 10^exponent."""
        if value is None or not math.isfinite(value):
            return "–"
        rounded = round(value / 10.0**self.exponent, self.decimals) + 0.0  # no −0
        return typographic_minus(f"{rounded:.{self.decimals}f}")


def rounding_of(statistics: Mapping[str, Any]) -> Rounding:
    """How the numbers of an entry of a summary are shown."""
    return Rounding.of(statistics["median"] or 0.0, statistics["sd"] or 0.0)


def format_statistics(statistics: Mapping[str, Any]) -> dict[str, str]:
    """median, sd, ci68 and ci95 of an entry of a summary as text, in units of unit_plain(unit, exponent)."""
    rounding = rounding_of(statistics)
    texts = {key: rounding.text(statistics[key]) for key in ("median", "sd")}
    return texts | {key: " to ".join(map(rounding.text, statistics[key])) for key in ("ci68", "ci95")}


def format_estimate(median: float, ci95: tuple[float, float]) -> tuple[str, str, int]:
    """(median, interval, exponent) as they are shown in units of 10^exponent: to two digits of about a standard
    deviation; where a positive interval spans more than a decade, each number to two digits of its own."""
    low, high = ci95
    rounding = Rounding.of(median, 0.25 * (high - low))
    several = [rounding, rounding, rounding]
    if low >= 0.0 and high > 10.0 * low:
        places = [1 - math.floor(math.log10(x)) + rounding.exponent if x > 0.0 else 0 for x in (median, low, high)]
        several = [Rounding(rounding.exponent, max(0, decimals)) for decimals in places]
    texts = [one.text(x) for one, x in zip(several, (median, low, high), strict=True)]
    return texts[0], f"{texts[1]} to {texts[2]}", rounding.exponent


def format_number(value: float | None, digits: int = 3) -> str:
    """A plain number to some digits; a dash where there is none."""
    return "–" if value is None or not math.isfinite(value) else typographic_minus(f"{value:#.{digits}g}".rstrip("."))


def format_ratio(value: float | None) -> str:
    """A gap: two decimals where it is near its floor, fewer where it is far off."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:.2f}" if value < 10.0 else f"{value:.1f}" if value < 100.0 else f"{value:.0f}"
