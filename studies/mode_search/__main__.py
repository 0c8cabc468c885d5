"""Calibrate cradles from white noise, and count how often the search for the mode ends in the right one.

    python -m studies.mode_search [--cradles 60] [--first 1560]

Cradles, releases and frame rates are those of the films of studies/film; the soft-contact reference moves them. The
readings have no other error than white noise, so that what goes wrong is the search. What is found is kept in
studies/mode_search/results.jsonl, a line for each cradle and each code; results.md is made of all that is kept.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from identification.experiment.experiment import Experiment
from identification.inference.likelihood import Likelihood
from identification.inference.normal_approximation import normal_approximation
from studies.film.calibrations import SHORTEST, true_values
from studies.film.draw import FRAMES, draw
from studies.film.made import STIFFENED
from studies.film.page import share
from studies.kept_rows import committed_code, keep_row, read_rows
from tests.reference.laboratory import record, write_experiment
from tests.reference.soft_contact import SoftCradle

HERE = Path(__file__).parent
ROWS, PAGE = HERE / "results.jsonl", HERE / "results.md"
#: Standard deviation of a reading [rad].
_NOISE = 4e-4
#: What an experiment states of k_f, κ and b, whatever is true.
_STATED = {"k_f": 19e3, "kappa": 200.0, "b": 2.2e-3}
#: Errors of k_f, κ or b from which on the mode is a wrong one [standard deviations].
_WRONG = 5.0


def calibrate_cradle(number: int, folder: Path) -> dict[str, Any] | None:
    """The row of one cradle; None of one that is left out."""
    case, truth = draw(number, FRAMES)[0], true_values(number)
    if case.duration < SHORTEST or case.bobs < 2:
        return None
    cradle = SoftCradle(case.bobs, delta=case.delta, stiffness_factor=STIFFENED, **truth)
    recording = record(cradle, case.angles, duration=case.duration, rate=case.camera.rate, noise=_NOISE, seed=number)
    path = write_experiment(folder, [recording], stated=_STATED, run={"noise": None})
    likelihood, mode = normal_approximation(Likelihood(Experiment.load(path)))
    known = [likelihood.names.index(name) for name in truth]
    sd = np.sqrt(np.diag(mode.covariance))[known]
    errors = (mode.point[known] - np.log([*truth.values()])) / sd
    return {
        "cradle": number, "code": committed_code(HERE), "bobs": case.bobs, "rate": case.camera.rate,
        "duration": case.duration, "errors": dict(zip(truth, errors.round(2).tolist(), strict=True)),
        "sd": dict(zip(truth, [float(f"{one:.2g}") for one in sd], strict=True)),
    }  # fmt: skip


def page(rows: Sequence[dict[str, Any]]) -> str:
    """results.md."""
    lines = [
        "# How often the search for a mode ends in the right one",
        "",
        "`python -m studies.mode_search`. Cradles of 2 to 5 bobs, filmed for 8 to 20 s at 30 to 120 frames/s, with",
        f"white noise of {1e3 * _NOISE:g} mrad. k_f is stated up to 36 %, κ up to 25 % and b up to a factor of 2.3",
        f"wrong. A mode is wrong if k_f, κ or b is {_WRONG:g} standard deviations off or more. Parentheses hold 95 %",
        "intervals by Clopper and Pearson.",
        "",
        "| code | N | right mode | k_f inside its 95 % interval | κ | b |",
        "|---|---|---|---|---|---|",
    ]
    for code, bobs in sorted({(row["code"], row["bobs"]) for row in rows}):
        some = [row for row in rows if (row["code"], row["bobs"]) == (code, bobs)]
        right = share(sum(_worst(row) < _WRONG for row in some), len(some))
        inside = [share(sum(abs(row["errors"][name]) < 1.96 for row in some), len(some)) for name in _STATED]
        lines.append(f"| {code} | {bobs} | {right} | {' | '.join(inside)} |")
    lines += ["", "Wrong modes, with the errors of k_f, κ and b over their standard deviations:", ""]
    lines += ["| code | cradle | N | frames/s | k_f | κ | b |", "|---|---|---|---|---|---|---|"]
    for row in rows:
        if _worst(row) >= _WRONG:
            errors = " | ".join(f"{error:+.1f}" for error in row["errors"].values())
            lines.append(f"| {row['code']} | {row['cradle']} | {row['bobs']} | {row['rate']:g} | {errors} |")
    return "\n".join([*lines, ""])


def _worst(row: dict[str, Any]) -> float:
    """The largest error [standard deviations]."""
    return max(abs(error) for error in row["errors"].values())


def main() -> int:
    """Calibrates what this code has not calibrated yet, and writes the page."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.mode_search", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cradles", type=int, default=60, help="numbers to draw; 0: results.md alone")
    parser.add_argument("--first", type=int, default=1560, help="the first number")
    asked = parser.parse_args()
    done = {row["cradle"] for row in read_rows(ROWS) if asked.cradles and row["code"] == committed_code(HERE)}
    for number in range(asked.first, asked.first + asked.cradles):
        if number in done:
            continue
        with tempfile.TemporaryDirectory() as folder:
            row = calibrate_cradle(number, Path(folder))
        if row is None:
            continue
        keep_row(ROWS, row)
        print(f"cradle {number}, {row['bobs']} bobs", file=sys.stderr, flush=True)
    PAGE.write_text(page(read_rows(ROWS)), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
