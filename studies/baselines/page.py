"""What is written and drawn of the measurements."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

METHODS = ("random", "constant δ", "by hand", "PPO", "SAC", "planner")
# Colours of Okabe & Ito; each method has a line style of its own, too.
_STYLES: dict[str, tuple[str, Any]] = {
    "constant δ": ("#0072B2", "-"), "random": ("#777777", "-."), "by hand": ("#D55E00", "--"), "PPO": ("#009E73", ":"),
    "SAC": ("#CC79A7", (0, (1, 1, 5, 1))), "planner": ("#000000", (0, (6, 2))),
}  # fmt: skip


def by_method(rows: Sequence[dict[str, Any]], name: str) -> dict[str, np.ndarray]:
    """Returns on an environment: of agents the mean of each, by the budget that most were given, the larger of two; of
    other methods those of each episode."""
    found: dict[str, np.ndarray] = {}
    for method in METHODS:
        own = [row for row in rows if row["environment"] == name and row["method"] == method]
        budget = _budget(own)
        own = [row for row in own if row.get("steps", 0) == budget]
        if len(own) > 0:
            found[method] = np.array([np.mean(row["returns"]) for row in own] if budget else own[-1]["returns"])
    return found


def _budget(rows: Sequence[dict[str, Any]]) -> int:
    """The control intervals that most agents learned from; 0 for methods that learn nothing."""
    spent = Counter(row.get("steps", 0) for row in rows)
    return max(spent, key=lambda steps: (spent[steps], steps), default=0)


def page(rows: Sequence[dict[str, Any]], names: Sequence[str]) -> str:
    """The results as Markdown."""
    versions = " and ".join(sorted({row["version"] for row in rows}))
    spent = sum(row["cpu_s"] for row in rows)
    text = [
        "# Baselines of the registered environments",
        "",
        f"Made by `python -m studies.baselines`, newtons-cradle {versions}, in {spent / 60.0:.0f} min of processor"
        " time. Mean return ± standard error.",
        "",
        "| environment | random | best constant δ | at δ = | by hand | PPO | SAC | planner | constant over best |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name in names:
        found = by_method(rows, name)
        cells = [_cell(found.get(method)) for method in METHODS]
        if "constant δ" in found:
            (own,) = [row for row in rows if row["environment"] == name and row["method"] == "constant δ"]
            best = max(values.mean() for values in found.values())
            cells.insert(2, f"{own['delta']:.3f}")
            cells.append(f"{found['constant δ'].mean() / best:.0%}")
        else:
            cells.insert(2, "")
            cells.append("")
        text.append(f"| `{name}` | {' | '.join(cells)} |")
    text += ["", "![What each constant δ returns, beside the other methods](baselines.png)", "", *_notes(rows, names)]
    return "\n".join(text) + "\n"


def _cell(returns: np.ndarray | None) -> str:
    if returns is None:
        return "not run"
    if len(returns) == 1:
        return f"{returns[0]:.3f}"
    return f"{returns.mean():.3f} ± {returns.std(ddof=1) / np.sqrt(len(returns)):.3f}"


def _notes(rows: Sequence[dict[str, Any]], names: Sequence[str]) -> list[str]:
    notes = [
        "- Random, constant, by hand and planner: over episodes, each with a seed of its own.",
        "- The constant δ is the best of a grid, chosen on other episodes.",
        "- By hand: a linear law in the angle between the end bobs and its rate (`policies.py`), its weights found by "
        "trial with five bobs and used for all.",
        "- The planner tries courses of the spacer on exact copies of the cradle, also where the agent sees but a "
        "camera's readings.",
    ]
    for method in ("PPO", "SAC"):
        said = []
        for name in names:
            own = [row for row in rows if (row["environment"], row["method"]) == (name, method)]
            if own:
                agents = [row for row in own if row["steps"] == _budget(own)]
                said.append(f"{len(agents)} of {_budget(own):,} control intervals (`{name}`)")
        if said:
            notes.append(
                f"- {method}: standard errors are over agents, one for each training seed, which covers the luck of "
                f"training; each agent plays the episodes of the others. Agents trained: {'; '.join(said)}."
            )
    notes += [
        "- `NewtonCradle-v0` draws nothing at random: under one policy all its episodes are alike. It returns at most "
        "−ln 0.05 = 3.0.",
        "- `NewtonCradleRelease-v0` is left out: its episode is one action, so that the best constant is the optimum.",
    ]
    return notes


def draw(rows: Sequence[dict[str, Any]], names: Sequence[str], path: Path) -> None:
    """Mean return against a constant δ for every environment; bands are two standard errors to either side."""
    from matplotlib.figure import Figure

    columns = 3
    figure = Figure(figsize=(10.0, 3.0 * -(-len(names) // columns)), layout="constrained")
    panels = figure.subplots(-(-len(names) // columns), columns, squeeze=False).ravel()
    for panel, name in zip(panels, names, strict=False):
        found = by_method(rows, name)
        grids = [row["grid"] for row in rows if row["environment"] == name and "grid" in row]
        for grid in grids:
            _band(panel, np.array(grid["delta"]), np.array(grid["returns"]), "constant δ")
            for method in found:
                if method != "constant δ":
                    ends = np.array([grid["delta"][0], grid["delta"][-1]])
                    _band(panel, ends, np.tile(found[method], (2, 1)), method)
        panel.set(title=name, xlabel="δ held constant", ylabel="return of an episode")
    for panel in panels[len(names) :]:
        panel.axis("off")
    drawn = {text: handle for panel in panels for handle, text in zip(*panel.get_legend_handles_labels(), strict=True)}
    figure.legend(drawn.values(), drawn.keys(), loc="outside upper center", ncols=len(drawn), frameon=False)
    figure.savefig(path, dpi=110)


def _band(panel: Any, x: np.ndarray, returns: np.ndarray, method: str) -> None:
    """The mean over the last axis of `returns` (len(x), several), with two standard errors to either side."""
    colour, style = _STYLES[method]
    mean = returns.mean(axis=1)
    if returns.shape[1] > 1:
        error = returns.std(axis=1, ddof=1) / np.sqrt(returns.shape[1])
        panel.fill_between(x, mean - 2.0 * error, mean + 2.0 * error, color=colour, alpha=0.2, lw=0)
    panel.plot(x, mean, color=colour, ls=style, label=method)
