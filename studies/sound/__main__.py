"""Make sound of simulated cradles, find its clicks, and count what is wrong.

    python -m studies.sound [--recordings 48]

What was found is kept in studies/sound/clicks.jsonl, a line for each recording; the same command goes on from there.
results.md is made of all that is kept.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from cradle_env import __version__
from identification.apparatus import measure_sound
from studies.sound import page
from studies.sound.judge import judge
from studies.sound.made import draw, write

HERE = Path(__file__).parent


def kept(name: str) -> list[dict[str, Any]]:
    """The rows of a file so far."""
    path = HERE / name
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def keep(name: str, row: dict[str, Any]) -> None:
    """Adds a row to a file."""
    with (HERE / name).open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


def results() -> str:
    """The content of results.md."""
    return "\n".join(page.clicks(kept("clicks.jsonl")))


def listen(number: int) -> dict[str, Any]:
    """The row of one recording."""
    case = draw(number)
    with tempfile.TemporaryDirectory() as folder:
        measured = measure_sound(write(case, Path(folder)))
    about = {"recording": number, "version": __version__, "bobs": case.cradle.bobs, "background": case.background,
             "snr": case.snr, "rate": case.rate, "format": case.format}  # fmt: skip
    return {**about, **judge(case, measured)}


def main() -> int:
    """Measures the recordings that are not kept yet, and writes the page."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.sound", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recordings", type=int, default=48, help="how many; 0: results.md alone")
    asked = parser.parse_args()
    done = {row["recording"] for row in kept("clicks.jsonl")}
    for number in range(asked.recordings):
        if number not in done:
            keep("clicks.jsonl", listen(number))
            print(f"recording {number}", file=sys.stderr, flush=True)
    (HERE / "results.md").write_text(results(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
