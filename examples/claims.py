"""The table of the paper's claims in the documentation, made from a run of `cradle reproduce`.

python examples/claims.py                prints that of the run kept in docs/claims.json
python examples/claims.py --write DIR    keeps that of `cradle reproduce --out DIR`, and puts it into the page
"""

import json
import shutil
import sys
from pathlib import Path

from identification.reproduce.run import claims_table

ROOT = Path(__file__).resolve().parents[1]
PAGE, KEPT = ROOT / "docs" / "how-to" / "reproduce-the-paper.md", ROOT / "docs" / "claims.json"
BEGIN, END = "<!-- claims: made by examples/claims.py -->", "<!-- end of claims -->"


def table() -> str:
    """One line of Markdown for each claim of the run that is kept."""
    return claims_table(json.loads(KEPT.read_text(encoding="utf-8")))


def updated(text: str) -> str:
    """The page with the table of now."""
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}\n{table()}\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    if "--write" in sys.argv[1:]:
        shutil.copyfile(Path(sys.argv[-1]) / "claims.json", KEPT)
        PAGE.write_text(updated(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    else:
        print(table())
