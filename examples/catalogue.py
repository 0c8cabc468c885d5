"""The table of effects in the README, made from their declarations.

python examples/catalogue.py            prints it
python examples/catalogue.py --write    puts it into README.md
"""

import math
import sys
from pathlib import Path

from cradle_env import CATALOGUE, MODELS

README = Path(__file__).resolve().parents[1] / "README.md"
BEGIN, END = "<!-- catalogue: made by examples/catalogue.py -->", "<!-- end of catalogue -->"


def table() -> str:
    """One line of Markdown for each effect of the catalogue."""
    lines = ["| effect | acts on | what it is | parameters | what it looks like |", "|---|---|---|---|---|"]
    for effect in CATALOGUE:
        parameters = "; ".join(
            f"`{p.key}` [{p.unit}]" + ("" if math.isnan(p.absent) else f", absent at {p.absent:g}")
            for p in effect.parameters
        )
        models = [name for name, members in MODELS.items() if effect.name in members]
        of = f" (in {', '.join(f'`{name}`' for name in models)})" if models else ""
        cells = (f"`{effect.name}`{of}", effect.acts_on, effect.summary, parameters, effect.looks_like)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines)


def updated(text: str) -> str:
    """The README with the table of now."""
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}\n{table()}\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    if "--write" in sys.argv[1:]:
        README.write_text(updated(README.read_text(encoding="utf-8")), encoding="utf-8")
    else:
        print(table())
