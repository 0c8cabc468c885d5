"""A cradle drawn in characters."""

from __future__ import annotations

from cradle_env.rendering.scene import Scene


def text(scene: Scene, width: int = 72) -> str:
    """A drawing for terminals, `width` columns wide: rail, strings, bobs, and a line of readings."""
    half, depth = scene.extent
    across = min(0.5 * (width - 1) / half, 22.0 / depth)  # columns per metre; a row is two columns high
    rows = [[" "] * width for _ in range(round(0.5 * across * depth) + 1)]

    def column(x):
        return min(max(round(0.5 * (width - 1) + across * x), 0), width - 1)

    bobs = []
    for pivot, x, z, tension in zip(scene.pivots, scene.x, scene.z, scene.load, strict=True):
        bottom = min(max(round(-0.5 * across * z), 1), len(rows) - 1)
        lean = across * (x - pivot) / bottom
        stroke = ":" if tension == 0.0 else "|" if abs(lean) < 0.5 else "\\" if lean > 0.0 else "/"
        for row in range(1, bottom):
            rows[row][column(pivot + (x - pivot) * row / bottom)] = stroke
        bobs.append((bottom, column(x)))
    for row, at in bobs:
        rows[row][at] = "●"
    left, right = (column(end) for end in (scene.pivots[0] - 0.2 * depth, scene.pivots[-1] + 0.2 * depth))
    rows[0][left : right + 1] = "─" * (right + 1 - left)
    for pivot in scene.pivots:
        rows[0][column(pivot)] = "┬"
    drawing = ["".join(row).rstrip() for row in rows]
    return "\n".join([*drawing, "   ".join(f"{symbol} = {value}" for symbol, value in scene.readings().items())])
