"""How symbols, units, rounded numbers and verdicts are put, the same in pictures, report and terminal."""

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


def minus(number: str) -> str:
    """A number as print has it, with a minus for a hyphen."""
    return number.replace("-", "−")


def _parts(symbol: str) -> tuple[str, str]:
    """(letter, subscript) of a symbol such as "k_f" or "c₂"."""
    letter, _, subscript = re.sub(r"([₀-₉]+)", r"_\1", symbol).partition("_")
    return letter, subscript.translate(_SUBSCRIPTS)


def literal(text: str) -> str:
    """A text from outside, such as the name of a file, as Matplotlib draws it letter by letter: no dollar begins
    mathtext."""
    return text.replace("$", r"\$")


def mathtext(symbol: str) -> str:
    """A symbol as Matplotlib sets it: k_f with an index."""
    letter, subscript = _parts(symbol)
    return f"${letter}_{{\\mathrm{{{subscript}}}}}$" if subscript else f"${letter}$"


def markup(symbol: str) -> Markup:
    """A symbol as HTML."""
    letter, subscript = _parts(symbol)
    return Markup("<i>{}</i>").format(letter) + (Markup("<sub>{}</sub>").format(subscript) if subscript else "")


def unit_mathtext(unit: str, exponent: int = 0) -> str:
    """[10^k unit] for the label of an axis; empty for a plain number."""
    factor = f"$10^{{{exponent}}}$" if exponent else ""
    unit = "" if unit == "1" else re.sub(r"\^(-?[\d/]+)", r"$^{\1}$", unit)
    inside = " ".join(part for part in (factor, unit) if part)
    return f" [{inside}]" if inside else ""


def unit_markup(unit: str, exponent: int = 0) -> Markup:
    """A unit, times a power of ten, as HTML; empty for a plain number."""
    factor = f"10<sup>{minus(str(exponent))}</sup>" if exponent else ""
    power = lambda match: f"<sup>{minus(match[1])}</sup>"  # noqa: E731
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
        return minus(f"{rounded:.{self.decimals}f}")


def rounding_of(statistics: Mapping[str, Any]) -> Rounding:
    """How the numbers of an entry of a summary are shown."""
    return Rounding.of(statistics["median"] or 0.0, statistics["sd"] or 0.0)


def shown(statistics: Mapping[str, Any]) -> dict[str, str]:
    """median, sd, ci68 and ci95 of an entry of a summary as text, in units of unit_plain(unit, exponent)."""
    rounding = rounding_of(statistics)
    texts = {key: rounding.text(statistics[key]) for key in ("median", "sd")}
    return texts | {key: " to ".join(map(rounding.text, statistics[key])) for key in ("ci68", "ci95")}


def estimate(median: float, ci95: tuple[float, float]) -> tuple[str, str, int]:
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


def number(value: float | None, digits: int = 3) -> str:
    """A plain number to some digits; a dash where there is none."""
    return "–" if value is None or not math.isfinite(value) else minus(f"{value:#.{digits}g}".rstrip("."))


def ratio(value: float | None) -> str:
    """A gap: two decimals where it is near its floor, fewer where it is far off."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:.2f}" if value < 10.0 else f"{value:.1f}" if value < 100.0 else f"{value:.0f}"


def convergence_verdict(summary: Mapping[str, Any]) -> str:
    """Whether the chains may be trusted, in a sentence or two."""
    figures = (
        f"R̂ at most {number(summary['rhat_max'], 4)}, effective samples at least {summary['ess_min']:.0f},"
        f" {summary['steps']} steps with an autocorrelation time of {number(summary['tau_max'])} at most"
    )
    if summary["converged"]:
        return f"The chains have converged: {figures}."
    reasons = "; ".join(summary["not_converged_because"]) or figures
    return (
        f"The chains have not converged: {reasons}. The intervals are provisional;"
        " run the same command again with more --steps or --max-steps to go on from here."
    )


def model_verdict(summary: Mapping[str, Any]) -> str:
    """Whether the model describes the data, in words; and whether a posterior is cut off."""
    gap = summary["gap"]
    figures = f"the residuals are {ratio(gap['train'])} times the noise where it was fitted"
    if gap["held_out"] is not None and math.isfinite(gap["held_out"]):
        figures += f" and {ratio(gap['held_out'])} times on data held out (1 is the floor)"
    verdicts = {
        "none": f"The model describes these data: {figures}. A good fit does not show that nothing is"
        " missing; `cradle diagnose` looks for it.",
        "small": f"The model describes these data but for a little: {figures}, more than chance leaves. What is small"
        " against the noise may be many standard deviations of a parameter: `cradle diagnose` looks for what is"
        " missing, unless the noise is more than stated.",
        "large": f"The model does not describe these data: {figures}. The intervals must not be trusted: they would"
        " hold if the model were right, and it is not. Something is missing from it, or wrong in what is stated as"
        " known.",
    }
    return verdicts[summary["misfit"]] + "".join(
        f" The posterior of {name} is cut off: it was looked for from {number(low, 4)} to {number(high, 4)}"
        f" {unit_plain(summary['parameters'][name]['unit'])}; state a value nearer to it in [cradle], or a prior in"
        " [infer]."
        for name, (low, high) in summary["at_bounds"].items()
    )
