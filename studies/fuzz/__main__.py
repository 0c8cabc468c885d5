"""`python -m studies.fuzz`: tries to break the program, and writes what came of it to studies/fuzz/results.md."""

from __future__ import annotations

import argparse
import contextlib
import platform
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

from cradle_env import __version__
from studies.fuzz import cradles, files, kills

_METHODS = (
    """- A bent file is a sound one, of two bobs over 4 s, that is changed in one to three places: text by lines, words
  and bytes, HDF5 by members, attributes, links and bytes. It must be read, or refused by a ValueError of one line,
  within 20 s, and no file may appear or go.""",
    """- A command that is killed at a random moment is started again in the same folder. Its end must be that of a
  command left alone: the same exit status, the same files, the same numbers.""",
    f"""- A random cradle has 1 to 200 bobs, any effects, and numbers from their whole allowed ranges. It runs for
  {cradles.DURATION:g} s, or less where these take more than 2 million steps of a bob. It runs, is refused (ValueError),
  is stopped (SimulationError), or takes more than 10 s: then it is interrupted, and judged over half of what it
  reached. The energy ledger must close to 0.1 % of a swing. Bobs may overlap by a millionth of a radius, and by what an
  impact presses in that is followed in time. Ctrl-C must be heard within a second.""",
)
_RESULTS = Path(__file__).with_name("results.md")


def main() -> int:
    """Runs all parts, or those named; 1 if anything was broken."""
    parser = argparse.ArgumentParser(prog="python -m studies.fuzz", description=__doc__)
    parser.add_argument("--files", type=int, default=15000, help="bent files, of five kinds in turn")
    parser.add_argument("--cradles", type=int, default=2000, help="random cradles")
    parser.add_argument("--kills", type=int, default=20, help="kills of each command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=_RESULTS)
    asked = parser.parse_args()
    began, broken, rows = time.monotonic(), [], []

    def report(text: str) -> None:
        print(f"{time.monotonic() - began:6.0f} s  {text}", flush=True)

    def write() -> None:
        asked.out.write_text(_page(asked, rows, broken), encoding="utf-8")

    with tempfile.TemporaryDirectory() as folder:
        sound, scratch = Path(folder) / "sound", Path(folder) / "scratch"
        scratch.mkdir()
        with contextlib.redirect_stdout(None):
            files.make_valid_files(sound)
        counts, found = files.fuzz(asked.files, asked.seed, sound, scratch, report) if asked.files else ({}, [])
        broken += found
        for name, count in counts.items():
            told = f"{count['read']} read, {count['refused']} refused"
            rows.append((f"bent {name}", count.total(), told, count["broken"]))
        write()
        for name in kills.COMMANDS if asked.kills else ():
            tally, found = kills.fuzz(name, asked.kills, asked.seed, sound, scratch)
            broken += found
            told = f"{tally.finished} ended as without kills ({tally.seconds:.0f} s each)"
            rows.append((f"kill -9 of {name}", tally.killed, told, len(found)))
            report(f"{name}: {tally}, {len(found)} broken")
            write()
    if asked.cradles:
        count, found, deafest = cradles.fuzz(asked.cradles, asked.seed, report)
        broken += found
        told = ", ".join(f"{count[kind]} {kind}" for kind in ("ran", "refused", "stopped", "interrupted"))
        rows.append(
            ("random cradles", count.total(), f"{told}; Ctrl-C heard after {deafest:.2f} s at most", len(found))
        )
    write()
    print(asked.out.read_text(encoding="utf-8"))
    return 1 if broken else 0


def _page(asked: argparse.Namespace, rows: list[tuple], broken: list[str]) -> str:
    lines = [
        "# What was tried to break the program",
        "",
        f"`make fuzz` with seed {asked.seed}, version {__version__}, Python {platform.python_version()},"
        f" {datetime.now(UTC):%Y-%m-%d}.",
        "",
        "| tried | how often | outcome | broken |",
        "|---|---|---|---|",
        *(f"| {name} | {count} | {told} | {bad} |" for name, count, told, bad in rows),
        "",
        *_METHODS,
        "",
        *(["Broken:", "", *(f"- {text}" for text in broken), ""] if broken else []),
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
