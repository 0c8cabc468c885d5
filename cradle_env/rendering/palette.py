"""Colours of the pictures (RGB)."""

from __future__ import annotations

import numpy as np

# Colours of Okabe & Ito, which every kind of colour vision tells apart, on paper and greys.
BLUE, SKY, VERMILLION, ORANGE, YELLOW = (0, 114, 178), (86, 180, 233), (213, 94, 0), (230, 159, 0), (240, 228, 66)
PAPER, PALE, RAIL, GREY, INK = (252, 252, 250), (226, 229, 233), (176, 183, 192), (104, 112, 122), (36, 41, 48)


def string_style(tension: float) -> tuple[tuple[int, ...], float]:
    """Colour and width of strings that carry `tension`, over that at rest."""
    shades = np.array([SKY, GREY, ORANGE, VERMILLION]).T
    return tuple(int(np.interp(tension, [0.0, 1.0, 2.0, 3.0], shade)) for shade in shades), min(1.0 + tension, 4.0)
