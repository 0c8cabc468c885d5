"""Whether the errors of right models are what their intervals say: python -m studies.diagnosis.errors [--processes 2]

A diagnosis that names rightly may do so because its noise helped. Here no verdict chooses: each held-out apparatus of
the study, of up to three bobs and with one effect or two of the catalogue as their formulas have them, is filmed again
with other noise and another slip of the release, and the right model is refitted from the truth, by what a diagnosis
ends with. Rows go to docs/study_errors.jsonl as they are found, and the same command goes on.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from cradle_env.parameter_name import ParameterName
from studies.diagnosis.rows import Row, is_confounded, kind
from studies.diagnosis.study import Apparatus, Case, cases, fit_at_truth, is_held_out, refit_right_model
from studies.kept_rows import read_rows
from tests.reference.laboratory import correlated_noise, drop_frames

ROWS = Path(__file__).parents[2] / "docs" / "study_errors.jsonl"
#: How often each apparatus is filmed again.
REPETITIONS = 4


def choose_rows(rows: list[Row]) -> list[Row]:
    """Those of a study that are filmed again."""
    return [
        row for row in rows
        if is_held_out(row["case"]) and kind(row) in ("one effect", "two effects")
        and row["bobs"] <= 3 and not row["variant"] and not is_confounded(row)
    ]  # fmt: skip


def film_again(case: Case, strengths: list[float]) -> list[Row]:
    """Errors over their standard deviations, and intervals, of one apparatus filmed again."""
    from identification.bench.diagnosis import parameter_errors
    from identification.diagnosis.uncertainty.intervals import compute_intervals

    apparatus = Apparatus(case)
    clean, frames = apparatus.record(strengths, False), apparatus.settings.correlation_time(apparatus.rate)
    hidden, found = {kind.name for kind in case.kinds}, []
    for k in range(REPETITIONS):
        rng = np.random.default_rng([case.seed, k, REPETITIONS])
        noise = apparatus.noise * correlated_noise(clean.readings.shape, frames * apparatus.rate, rng)
        filmed = replace(clean, readings=clean.readings + noise, noise=apparatus.noise)
        apparatus.lifted = apparatus.angle + 1e-3 * float(rng.standard_normal())
        with tempfile.TemporaryDirectory() as folder:
            seed = int(rng.integers(2**31))
            path = apparatus.write(Path(folder), drop_frames(filmed, apparatus.settings.missing, seed))
            searcher, base = fit_at_truth(path, apparatus.truth)
            fitted = searcher.fit_all_data(refit_right_model(apparatus, strengths, searcher, base))
        known = {name: {"median": one.median, "ci95": one.ci95} for name, one in compute_intervals(fitted).items()}
        found.append({
            "case": case.name, "again": k, "bobs": apparatus.bobs, "errors": parameter_errors(known, apparatus.truth),
            "intervals": {name: one for name, one in known.items() if ParameterName.parse(name).effect in hidden},
            "made by": apparatus.effects(strengths),
        })  # fmt: skip
    return found


def _film_again(asked: tuple[Case, list[float]]) -> list[Row]:
    return film_again(*asked)


def main() -> None:
    """Films again what is not yet there."""
    from studies.diagnosis.table import ROWS as STUDY

    parser = argparse.ArgumentParser(description="Errors of right models.")
    parser.add_argument("--processes", type=int, default=2)
    processes = parser.parse_args().processes
    done = {row["case"] for row in read_rows(ROWS)}
    by_name = {row["case"]: row for row in choose_rows(read_rows(STUDY)) if row["case"] not in done}
    several = cases(sorted({int(name.partition("-")[0]) for name in by_name})) if by_name else []
    asked = [(case, by_name[case.name]["strengths"]) for case in several if case.name in by_name]
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for i, rows in enumerate(pool.imap_unordered(_film_again, asked), 1):
            with ROWS.open("a", encoding="utf-8") as file:
                file.writelines(json.dumps(row) + "\n" for row in rows)
            print(f"{i} of {len(asked)}: {rows[0]['case']} {[row['errors'] for row in rows]}", flush=True)


if __name__ == "__main__":
    main()
