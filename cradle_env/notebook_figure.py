"""A Matplotlib figure that a notebook shows, whether or not pyplot was imported."""

from __future__ import annotations

from matplotlib.figure import Figure

from cradle_env.plot_style import png


class NotebookFigure(Figure):
    """A figure that belongs to no window; Jupyter shows it as the last value of a cell."""

    def _repr_png_(self) -> bytes:
        return png(self)
