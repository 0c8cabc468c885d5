"""The one look of all pictures: colours that colour-blind readers and grey prints tell apart, and the file format."""

from __future__ import annotations

import functools
import io
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Okabe and Ito's palette without its yellow, in an order in which neighbours differ in lightness too.
BLUE, ORANGE, GREEN, PURPLE, SKY, RED, BLACK, GREY = (
    "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000", "#8C8C8C",
)  # fmt: skip
_COLOURS = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY, BLACK)
_DASHES = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (4, 1, 1, 1)), (0, (7, 2, 2, 2)))

STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "mathtext.fontset": "dejavusans",
    "font.size": 8.5,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.use_mathtext": True,
    "lines.linewidth": 1.1,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "figure.facecolor": "white",
    "hatch.linewidth": 0.4,
}
_DPI = 160

_P = ParamSpec("_P")
_R = TypeVar("_R")


def styled(draw: Callable[_P, _R]) -> Callable[_P, _R]:
    """Draws in this style, whatever the caller's own settings are."""

    @functools.wraps(draw)
    def wrapper(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        import matplotlib

        settings: Any = {**matplotlib.rcParamsDefault, **STYLE}
        del settings["backend"]  # stays as it is: to read what it is would load pyplot
        with matplotlib.rc_context(settings):
            return draw(*args, **kwargs)

    return wrapper


@styled
def png(figure: Figure) -> bytes:
    """The picture as the content of a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI, metadata={"Software": None})
    return buffer.getvalue()


@styled
def pdf(figure: Figure) -> bytes:
    """The picture as the content of a PDF file: lines and letters as such, images embedded."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="pdf", dpi=_DPI, metadata={"CreationDate": None, "Producer": None, "Creator": None})
    return buffer.getvalue()


def bob_styles(bobs: int) -> Iterator[dict[str, Any]]:
    """Colour and dashes of each bob's line."""
    for i in range(bobs):
        yield {"color": _COLOURS[i % len(_COLOURS)], "linestyle": _DASHES[i % len(_DASHES)]}


def quiet_grid(axes: Axes, axis: str = "y") -> None:
    """Thin lines behind the data."""
    axes.grid(True, axis=axis, color="#E3E3E3", linewidth=0.6)  # pyright: ignore[reportArgumentType]
    axes.set_axisbelow(True)
