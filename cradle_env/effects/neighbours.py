"""What effects by which neighbours act on each other at a distance have in common."""


def couple(cradle, reach: float) -> None:
    """Notes in a cradle's record that neighbours act on each other, with a force that changes over `reach` [m]."""
    cradle["coupled"] = 1
    cradle["reach"] = min(reach, cradle["reach"][0] or reach)
