"""Draws docs/pipeline.svg, the way from a cradle to a prediction: python docs/pipeline.py"""

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

#: name, what it holds or does, (x, y), colour: what the user provides above, what the program does below.
YOURS, OURS = "#FFF3D6", "#DCEBF7"
BOXES = {
    "cradle": ("a cradle", "lengths, masses\nexperiment.toml", (0.0, 1.0), YOURS),
    "data": ("a film", "tracked angles\nrun1.csv", (1.0, 1.0), YOURS),
    "next": ("the next run", "its release and δ\nexperiment.toml", (2.0, 1.0), YOURS),
    "simulate": ("simulate", "impact by impact\ntrajectory.csv", (0.0, 0.0), OURS),
    "calibrate": ("calibrate", "k_f, κ, b and λ\nposterior.nc", (1.0, 0.0), OURS),
    "diagnose": ("diagnose", "what is missing\nmodel.toml", (2.0, 0.0), OURS),
    "predict": ("predict", "any other cradle\nprediction.json", (1.0, -1.0), OURS),
}
#: from, to, and whether there is a way back: with the repaired model one calibrates again.
ARROWS = (
    ("cradle", "simulate", False),
    ("simulate", "calibrate", False),
    ("data", "calibrate", False),
    ("calibrate", "diagnose", True),
    ("diagnose", "next", False),
    ("next", "data", False),
    ("calibrate", "predict", False),
)
WIDTH, HEIGHT, ACROSS, UP = 1.5, 0.8, 2.15, 1.55


def draw() -> Figure:
    """The picture."""
    figure = Figure(figsize=(7.5, 5.2))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    patches = {}
    for key, (title, text, (column, row), colour) in BOXES.items():
        x, y = ACROSS * column, UP * row
        patches[key] = FancyBboxPatch(
            (x - WIDTH / 2, y - HEIGHT / 2), WIDTH, HEIGHT,
            boxstyle="round,pad=0.04", facecolor=colour, edgecolor="#777777",
        )  # fmt: skip
        axes.add_patch(patches[key])
        axes.text(x, y + 0.24, title, ha="center", va="center", weight="bold", fontsize=11)
        axes.text(x, y - 0.12, text, ha="center", va="center", fontsize=9)
    for start, end, back in ARROWS:
        ends = ((ACROSS * column, UP * row) for column, row in (BOXES[start][2], BOXES[end][2]))
        style = "<|-|>" if back else "-|>"
        look = {"arrowstyle": style, "mutation_scale": 13, "color": "#444444", "shrinkA": 2, "shrinkB": 2}
        axes.add_patch(FancyArrowPatch(*ends, patchA=patches[start], patchB=patches[end], **look))
    told = "yellow: you provide\nblue: the program does"
    axes.text(2 * ACROSS, -UP, told, fontsize=9, color="#555555", ha="center", va="center")
    axes.set_xlim(-1.0, 2 * ACROSS + 1.0)
    axes.set_ylim(-UP - 0.6, UP + 0.6)
    axes.axis("off")
    return figure


if __name__ == "__main__":
    import matplotlib

    matplotlib.rcParams["svg.hashsalt"] = "pipeline"
    draw().savefig(Path(__file__).with_name("pipeline.svg"), metadata={"Date": None}, transparent=True)
