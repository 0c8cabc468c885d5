"""The figure of the study: what each constant δ returns, and the other controllers beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

# Colours of Okabe & Ito; each method has a line style of its own, too.
_STYLES = {"constant δ": ("#0072B2", "-"), "random": ("#777777", "-."), "by hand": ("#D55E00", "--"),
           "PPO": ("#009E73", ":")}  # fmt: skip


def draw(results: dict[str, dict[str, Any]], path: Path) -> None:
    """Mean return against a constant δ for every environment; bands hold 95 % of the means that episodes would give."""
    from matplotlib.figure import Figure

    columns = 3
    rows = -(-len(results) // columns)
    figure = Figure(figsize=(10.0, 3.0 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for panel, (name, result) in zip(panels, results.items(), strict=False):
        grid = result["grid"]
        _band(panel, grid["delta"], np.asarray(grid["returns"]), "constant δ")
        for method, returns in result["returns"].items():
            if method != "constant δ":
                _band(panel, np.array([grid["delta"][0], grid["delta"][-1]]), np.tile(returns, (2, 1)), method)
        panel.set(title=name, xlabel="δ held constant", ylabel="return of an episode")
    for panel in panels[len(results) :]:
        panel.axis("off")
    drawn = {text: handle for panel in panels for handle, text in zip(*panel.get_legend_handles_labels(), strict=True)}
    figure.legend(drawn.values(), drawn.keys(), loc="outside upper center", ncols=len(drawn), frameon=False)
    figure.savefig(path, dpi=110)


def _band(panel: Any, x: np.ndarray, returns: np.ndarray, method: str) -> None:
    """The mean over the last axis of `returns` (len(x), episodes), with two standard errors to either side."""
    colour, style = _STYLES[method]
    mean, error = returns.mean(axis=1), returns.std(axis=1, ddof=1) / np.sqrt(returns.shape[1])
    panel.fill_between(x, mean - 2.0 * error, mean + 2.0 * error, color=colour, alpha=0.25, lw=0)
    panel.plot(x, mean, color=colour, ls=style, label=method)
