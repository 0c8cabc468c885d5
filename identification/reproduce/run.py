"""Make the figures one by one, with their tables and claims; resume an interrupted run."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import re
import shutil
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cradle_env import __version__
from cradle_env.errors import check_range, unknown_key
from cradle_env.plot_style import pdf, png, styled
from identification.inference.posterior import Posterior
from identification.reporting.result_files import table_text
from identification.reproduce import FIGURES
from identification.reproduce.bands import calibrate_example, check_posterior
from identification.reproduce.figure import FAILS, HOLDS_IF, Claim, Figure, Study, Table, Tables
from identification.storage.files import ExperimentError, json_text, read_text, write_file, write_json, write_together
from identification.storage.lock import locks_output
from identification.storage.provenance import program_hash
from identification.storage.stamps import check_replaceable, read_stamp

Progress = Callable[[str, float | None, str], None]
FORMAT, CLAIMS_FORMAT = "cradle-figure/1", "cradle-claims/1"
# In a figure's folder: lists its files. Written last, it marks the figure as finished.
_STAMP = "figure.json"
_CLAIMS = ("claims.json", "claims.md")


@locks_output
def reproduce(
    out: Path,
    only: Sequence[str] = (),
    *,
    values: int = 400,
    calibration: Path | None = None,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress = lambda *_: None,
) -> dict[str, Any]:
    """Make figures in folders of `out`, and claims.md and claims.json of all figures there.

    A figure that exists already, from the same program and inputs, is not made again.

    Parameters
    ----------
    out : Path
        Folder for the results.
    only : sequence of str
        Names of figures. Figures that they need are made too. Default: all figures.
    values : int
        Number of values of each parameter in a sweep, at least 16.
    calibration : Path, optional
        posterior.nc of `cradle calibrate`, whose uncertainty the bands show. Default: an example is simulated and
        calibrated.
    seed : int
        Seed of all random numbers.
    workers : int, optional
        Number of threads. Default: all cores.
    progress : callable
        Called as progress(stage, fraction, text).

    Returns
    -------
    dict
        The content of claims.json.

    Raises
    ------
    ValueError
        Before any work: if a figure has no such name, if the calibration is unusable, or if this command would replace
        files that it has not written.
    """
    check_range("values", values, "", 16, remedy="fewer show no curve")
    named = {figure.name: figure for figure in FIGURES}
    for name in only:
        if name not in named:
            raise ValueError(unknown_key("figure", name, list(named)))
    posterior = functools.partial(calibrate_example, out / "calibration", seed, workers, progress)
    shown: list[Any] = [seed]
    if calibration is not None:
        loaded = dataclasses.replace(Posterior.load(calibration, workers), seed=seed)
        check_posterior(loaded)
        posterior, shown = lambda: loaded, [seed, hashlib.sha256(calibration.read_bytes()).hexdigest()]
    inputs = {
        figure.name: _hash([program_hash(()), values, shown if figure.calibrated else None])
        for figure in named.values()
    }
    todo = _with_needs(only or list(named), named)
    check_replaceable(out, _CLAIMS, _CLAIMS[0], CLAIMS_FORMAT)
    for name in todo:
        _check_folder(out / name)
    # Named by program and inputs: unfinished work of another program is deleted, that of other inputs is kept.
    own = program_hash(())[:12]
    scratch = {name: out / f".unfinished-{name}-{own}-{hashed[:12]}" for name, hashed in inputs.items()}
    for left in out.glob(".unfinished-*"):
        if f"-{own}-" not in left.name:
            shutil.rmtree(left)
    for k, name in enumerate(todo):
        if _read_stamp(out / name).get("inputs") != inputs[name]:
            report = lambda fraction, text, k=k, name=name: progress(  # noqa: E731
                name, fraction, f"{text} (figure {k + 1} of {len(todo)})"
            )
            tables = {other: _read_tables(out / other) for other in named[name].needs}
            study = Study(values, workers, scratch[name], posterior, report, tables)
            _make_figure(named[name], study, out / name, inputs[name])
            shutil.rmtree(scratch[name], ignore_errors=True)
    return _write_claims(out)


def _hash(content: Any) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def _with_needs(names: Iterable[str], figures: Mapping[str, Figure]) -> list[str]:
    """Add the figures that the named ones need, in the order of the list."""
    wanted = set(names)
    for figure in reversed(list(figures.values())):
        if figure.name in wanted:
            wanted |= set(figure.needs)
    return [name for name in figures if name in wanted]


def _read_stamp(folder: Path) -> dict[str, Any]:
    """Read the stamp of a figure's folder: its files, and "inputs" if it is finished; empty if there is no stamp."""
    return read_stamp(folder / _STAMP, FORMAT, "figure") or {}


def _check_folder(folder: Path, written: Iterable[str] = ()) -> None:
    """Raise ExperimentError if this command did not write the folder, or if a file in it has changed since."""
    if folder.exists() and not _read_stamp(folder) and any(folder.iterdir()):
        raise ExperimentError(f"{folder}: exists and holds no figure of this command; choose another --out")
    check_replaceable(folder, (*_read_stamp(folder).get("files", ()), *written), _STAMP, FORMAT)


def _make_figure(figure: Figure, study: Study, folder: Path, inputs: str) -> None:
    """Compute, draw and judge one figure. Picture and claims use the tables as written, with their rounding."""
    began, cpu = time.monotonic(), time.process_time()
    study.report(0.0, figure.title)
    files: dict[str, bytes] = {
        f"{name}.csv": table_text(_pad_columns(table)).encode() for name, table in figure.data(study).items()
    }
    tables = {name.removesuffix(".csv"): _parse_table(text.decode()) for name, text in files.items()}
    study.report(1.0, "draw")
    drawn = styled(figure.draw)(tables)
    files[f"{figure.name}.png"] = png(drawn)
    drawn.set_layout_engine("none")  # the PDF keeps the layout of the PNG, which saves half the time
    files[f"{figure.name}.pdf"] = pdf(drawn)
    content = {
        "format": FORMAT,
        "version": __version__,
        "program": program_hash(()),
        "inputs": inputs,
        "title": figure.title,
        "seconds": round(time.monotonic() - began, 1),
        "processor_seconds": round(time.process_time() - cpu, 1),
        "claims": [dataclasses.asdict(claim) for claim in figure.claims(tables)],
        "files": {name: hashlib.sha256(data).hexdigest() for name, data in files.items()},
    }
    _check_folder(folder, files)
    for name in _read_stamp(folder).get("files", ()):
        (folder / name).unlink(missing_ok=True)
    # Written first, so that after a kill the next run recognises the files as its own.
    write_json(folder / _STAMP, {key: content[key] for key in ("format", "files")})
    write_together(folder, {**files, _STAMP: json_text(content)})


def _pad_columns(table: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Pad short columns with empty fields to the same length."""
    rows = max(map(len, table.values()))
    return {key: np.append(column, np.full(rows - len(column), np.nan)) for key, column in table.items()}


def _read_tables(folder: Path) -> Tables:
    """Read the tables that a figure wrote."""
    names = (name for name in _read_stamp(folder)["files"] if name.endswith(".csv"))
    return {name.removesuffix(".csv"): _parse_table(read_text(folder / name)[0]) for name in names}


def _parse_table(text: str) -> Table:
    """Parse a table and remove the empty fields at the ends of its columns."""
    header, *lines = text.splitlines()
    rows = np.array([[float(cell or "nan") for cell in line.split(",")] for line in lines])
    return {label: _trim_column(rows[:, k]) for k, label in enumerate(_labels(header))}


def _labels(header: str) -> list[str]:
    import csv

    return next(csv.reader([header]))


def _trim_column(column: np.ndarray) -> np.ndarray:
    filled = np.flatnonzero(~np.isnan(column))
    return column[: filled[-1] + 1] if len(filled) else column[:0]


def _write_claims(out: Path) -> dict[str, Any]:
    """Write claims.json and claims.md of all finished figures that this program made; return the content."""
    stamps = {figure.name: _read_stamp(out / figure.name) for figure in FIGURES}
    done = {
        name: stamp for name, stamp in stamps.items() if "inputs" in stamp and stamp.get("program") == program_hash(())
    }
    content = {
        "format": CLAIMS_FORMAT,
        "version": __version__,
        "inputs": _hash([stamp["inputs"] for stamp in done.values()]),
        "figures": {name: stamp["title"] for name, stamp in done.items()},
        "claims": [{**claim, "figure": name} for name, stamp in done.items() for claim in stamp["claims"]],
    }
    write_json(out / _CLAIMS[0], content)
    write_file(out / _CLAIMS[1], f"# What the model says of the paper's claims\n\n{claims_table(content)}\n")
    return content


def claims_table(content: Mapping[str, Any]) -> str:
    """Write the claims of claims.json as a table in Markdown."""
    lines = ["| claim | of | verdict | numbers | figure |", "|---|---|---|---|---|"]
    for entry in content["claims"]:
        claim = Claim(**{key: value for key, value in entry.items() if key != "figure"})
        verdict = f"holds if {claim.condition}" if claim.verdict == HOLDS_IF else claim.verdict
        verdict = f"**{verdict}**" if claim.verdict == FAILS else verdict
        source = claim.source if claim.source[0].isalpha() else f"§ {claim.source}"
        cells = (claim.statement, source, verdict, claim.evidence, entry["figure"])
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    lines = [re.sub(r"(?<![\w.])-(?=\d)", "−", line) for line in lines]
    return "\n".join(lines)
