"""Make sound of simulated cradles, find its clicks, and count what is wrong.

    python -m studies.sound [--recordings 48] [--calibrations 12]

What was found is kept in studies/sound/clicks.jsonl and calibrations.jsonl, a line for each recording; the same command
goes on from there. results.md is made of all that is kept.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

from cradle_env import __version__
from identification.apparatus import measure_sound
from studies.kept_rows import keep_row, read_rows
from studies.sound import page
from studies.sound.compare import compare
from studies.sound.judge import judge
from studies.sound.made import draw, write

HERE = Path(__file__).parent


def results() -> str:
    """The content of results.md."""
    return "\n".join(
        [*page.clicks(read_rows(HERE / "clicks.jsonl")), *page.calibrations(read_rows(HERE / "calibrations.jsonl"))]
    )


def listen(number: int) -> dict[str, Any]:
    """The row of one recording."""
    case = draw(number)
    with tempfile.TemporaryDirectory() as folder:
        measured = measure_sound(write(case, Path(folder)))
    about = {"recording": number, "version": __version__, "bobs": case.cradle.bobs, "background": case.background,
             "snr": case.snr, "rate": case.rate, "format": case.format}  # fmt: skip
    return {**about, **judge(case, measured)}


def main() -> int:
    """Measures and calibrates what is not kept yet, and writes the page."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.sound", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recordings", type=int, default=48, help="how many; 0: results.md alone")
    parser.add_argument(
        "--calibrations", type=int, default=12, help="how many runs to calibrate by sound and by angles"
    )
    asked = parser.parse_args()
    done = {row["recording"] for row in read_rows(HERE / "clicks.jsonl")}
    for number in range(asked.recordings):
        if number not in done:
            keep_row(HERE / "clicks.jsonl", listen(number))
            print(f"recording {number}", file=sys.stderr, flush=True)
    done = {row["run"] for row in read_rows(HERE / "calibrations.jsonl")}
    for number in range(asked.calibrations):
        if number not in done:
            keep_row(HERE / "calibrations.jsonl", {"run": number, "version": __version__, **compare(number)})
            print(f"calibration {number}", file=sys.stderr, flush=True)
    (HERE / "results.md").write_text(results(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
