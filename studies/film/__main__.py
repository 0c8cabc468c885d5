"""Render films of simulated cradles, measure them, and count what is wrong.

    python -m studies.film [--films 200] [--first 1310] [--whole]

Each film is drawn by its number. What is found is kept in studies/film/results.jsonl, a line for each film; the same
command goes on from there. results.md is made of all that is kept.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

from studies.film.draw import FRAMES, LONGEST, draw
from studies.film.judge import judge
from studies.film.made import make
from studies.film.page import page
from studies.kept_rows import committed_code, keep_row, read_rows

HERE = Path(__file__).parent
KEPT = HERE / "results.jsonl"


def measure(number: int, folder: Path) -> dict[str, Any]:
    """The row of one film."""
    case, ending = draw(number, FRAMES)
    path = folder / f"film{ending}"
    truth = make(path, case)
    try:
        found = judge(path, case, truth)
    except ValueError as problem:
        found = {"refused": str(problem).replace(str(path), path.name)}
    return {
        "film": number,
        "codec": case.codec,
        "bobs": case.bobs,
        "rate": case.camera.rate,
        "duration": case.duration,
        **found,
    }


def main() -> int:
    """Measures the films that are not kept yet, and writes the page."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.film", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--films", type=int, default=200, help="how many; 0: results.md alone")
    parser.add_argument("--first", type=int, default=1310, help="number of the first; earlier ones served development")
    parser.add_argument("--whole", action="store_true", help=f"only films of {LONGEST:g} s; the others are left out")
    asked = parser.parse_args()
    done = {row["film"] for row in read_rows(KEPT)}
    for number in range(asked.first, asked.first + asked.films):
        if number in done or (asked.whole and draw(number, FRAMES)[0].duration < LONGEST):
            continue
        with tempfile.TemporaryDirectory() as folder:
            row = {**measure(number, Path(folder)), "code": committed_code(HERE)}
        keep_row(KEPT, row)
        print(f"film {number}: {len(read_rows(KEPT))} kept", file=sys.stderr, flush=True)
    (HERE / "results.md").write_text(page(read_rows(KEPT)), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
