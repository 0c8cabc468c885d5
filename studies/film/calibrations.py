"""Calibrate cradles from films, and count how often the intervals hold the truth.

    python -m studies.film.calibrations [--films 40] [--first 1100] [--again]

Each film is drawn by its number, of a cradle that the soft-contact reference moves. What is found is kept in
studies/film/calibrations.jsonl, a line for each film and each code that calibrated from it; the same command goes on
from there. calibrations.md is made of all that is kept.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cradle_env import Cradle
from identification.apparatus import measure_video
from identification.inference.likelihood import Likelihood
from identification.inference.normal_approximation import normal_approximation
from identification.inference.statistics import statistics
from studies.film.draw import FRAMES, draw
from studies.film.made import make
from studies.film.page import share
from studies.kept_rows import committed_code, keep_row, read_rows

HERE = Path(__file__).parent
ROWS, PAGE = HERE / "calibrations.jsonl", HERE / "calibrations.md"
#: Films shorter than some swings, and those of more bobs, which take an hour, are left out.
SHORTEST, _MOST_BOBS = 8.0, 3
#: Films whose κ was found 6 to 27 % off; they showed that the search for κ was too narrow.
LOOKED_AT = frozenset([1167, 1177, 1276])
#: Draws of the normal approximation of the posterior.
_DRAWS = 2000
_NAMES = ("k_f", "kappa", "b")


def true_values(number: int) -> dict[str, float]:
    """k_f, κ and b of the cradle in a film."""
    rng = np.random.default_rng([40, number])
    return {
        "k_f": float(rng.uniform(14e3, 24e3)),
        "kappa": float(rng.uniform(160.0, 240.0)),
        "b": float(10 ** rng.uniform(-3.0, -2.3)),
    }


def calibrate_film(number: int, folder: Path) -> dict[str, Any] | None:
    """The row of one film; None of one that is left out."""
    case, ending = draw(number, FRAMES)
    if case.duration < SHORTEST or case.bobs > _MOST_BOBS:
        return None
    truth = true_values(number)
    row: dict[str, Any] = {
        "film": number, "code": committed_code(HERE), "bobs": case.bobs, "rate": case.camera.rate, "codec": case.codec,
        "duration": case.duration, "truth": truth,
    }  # fmt: skip
    path = folder / f"film{ending}"
    make(path, dataclasses.replace(case, truth=truth, soft=True))
    try:
        measured = measure_video(path, Cradle(bobs=case.bobs, delta=case.delta))
        likelihood, mode = normal_approximation(Likelihood(measured.experiment))
    except ValueError as problem:
        return row | {"refused": str(problem).replace(str(path), path.name)}
    rng = np.random.default_rng([40, number, 1])
    points = rng.multivariate_normal(mode.point, mode.covariance, _DRAWS, method="cholesky")
    values = [likelihood.values(point) for point in points]
    known = {name: statistics(np.array([one[name] for one in values])) for name in _NAMES if name in values[0]}
    return row | {"found": known}


def page(rows: Sequence[dict[str, Any]]) -> str:
    """calibrations.md."""
    latest = list({row["film"]: row for row in rows}.values())
    unseen = [row for row in latest if row["film"] not in LOOKED_AT]
    lines = [
        "# How well a film calibrates a cradle",
        "",
        "`python -m studies.film.calibrations`. Films as in results.md, of cradles of 1 to 3 bobs that the",
        "soft-contact reference moves, for 8 to 20 s. `measure_video` writes the experiment, whose posterior is",
        "approximated by a normal distribution about its mode. Parentheses hold 95 % intervals by Clopper and Pearson.",
        f"Of each film, the last code counts. Films {', '.join(map(str, sorted(LOOKED_AT)))} showed that the search",
        "for κ was too narrow. The first table leaves them out; nobody looked at the others.",
        "",
        "| | inside the 95 % interval (90–99 %) | RMS error over its sd | median sd over the value |",
        "|---|---|---|---|",
    ]
    for name in _NAMES:
        some = _found(unseen, name)
        z = [(found["median"] - true) / found["sd"] for true, found in some]
        wide = [found["sd"] / true for true, found in some]
        told = (f"{np.sqrt(np.mean(np.square(z))):.2f}", f"{np.median(wide):.2g}") if some else ("–", "–")
        lines.append(f"| {name} | {_inside(unseen, name)} | {told[0]} | {told[1]} |")
    refused = [row for row in latest if "refused" in row]
    lines += ["", f"Refused: {len(refused)} of {len(latest)}.", ""]
    lines += [*(f"- film {row['film']}: {row['refused']}" for row in refused), ""] if refused else []
    lines += ["Inside the 95 % interval, by each code that calibrated from films, the last one last:", ""]
    lines += ["| code | N | k_f | κ | b |", "|---|---|---|---|---|"]
    for code, bobs in dict.fromkeys((row["code"], row["bobs"]) for row in sorted(rows, key=lambda row: row["bobs"])):
        some = [row for row in rows if (row["code"], row["bobs"]) == (code, bobs)]
        lines.append(f"| {code} | {bobs} | {' | '.join(_inside(some, name) for name in _NAMES)} |")
    lines += ["", "| film | N | frames/s | codec | k_f | κ | b |", "|---|---|---|---|---|---|---|"]
    for row in latest:
        found = row.get("found", {})
        z = [f"{(found[n]['median'] - row['truth'][n]) / found[n]['sd']:+.1f}" if n in found else "–" for n in _NAMES]
        lines.append(f"| {row['film']} | {row['bobs']} | {row['rate']:g} | {row['codec']} | {' | '.join(z)} |")
    return "\n".join([*lines, "", "The last three columns are errors over their standard deviations.", ""])


def _found(rows: Sequence[dict[str, Any]], name: str) -> list[tuple[float, dict[str, Any]]]:
    """What is true and what was found of a parameter, of the films from which it was inferred."""
    return [(row["truth"][name], row["found"][name]) for row in rows if name in row.get("found", {})]


def _inside(rows: Sequence[dict[str, Any]], name: str) -> str:
    """How often the interval holds the truth."""
    some = _found(rows, name)
    return share(sum(found["ci95"][0] <= true <= found["ci95"][1] for true, found in some), len(some))


def main() -> int:
    """Calibrates from films until as many are kept as asked, and writes the page."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.film.calibrations",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--films", type=int, default=40, help="how many; 0: calibrations.md alone")
    parser.add_argument("--first", type=int, default=1100, help="number of the first")
    parser.add_argument("--again", action="store_true", help="the films that are kept, by the present code")
    asked = parser.parse_args()
    for number in _numbers(asked.films, asked.first, asked.again):
        with tempfile.TemporaryDirectory() as folder:
            row = calibrate_film(number, Path(folder))
        if row is None:
            continue
        keep_row(ROWS, row)
        print(f"film {number}, {row['bobs']} bobs", file=sys.stderr, flush=True)
    PAGE.write_text(page(read_rows(ROWS)), encoding="utf-8")
    return 0


def _numbers(films: int, first: int, again: bool) -> Iterator[int]:
    """Of the films that are left: new ones until as many are kept as asked, or those kept, fewest bobs first."""
    if again:
        code, rows = committed_code(HERE), read_rows(ROWS)
        done = {row["film"] for row in rows if row["code"] == code}
        bobs = {row["film"]: row["bobs"] for row in rows if row["film"] not in done}
        yield from sorted(bobs, key=lambda film: (bobs[film], film))
        return
    number = max([first - 1, *(row["film"] for row in read_rows(ROWS))])
    while len({row["film"] for row in read_rows(ROWS)}) < films:
        number += 1
        yield number


if __name__ == "__main__":
    sys.exit(main())
