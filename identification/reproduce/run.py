"""Makes the figures one by one, each with its tables, and the claims; goes on where it was interrupted."""

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
# In a figure's folder: lists the files that are ours and, written last, says that the figure is done.
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
    """Writes figures into folders of `out` by their names, and claims.md and claims.json of all that is there.

    only: names of figures, all where omitted; those that others rest on are made too. values: of each parameter in a
    sweep. calibration: posterior.nc of `cradle calibrate` whose uncertainty the bands show; an example, simulated and
    calibrated here, where omitted. What is done already, with the same program and input, is not done again. Returns
    the content of claims.json. Raises ValueError, before anything is made, for a name that no figure has, for what is
    no calibration, and for files that would be replaced and are not ours.
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
    # Named by program and inputs: what another program left unfinished is not gone on with; other inputs' is kept.
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
    """The names and those of the figures they rest on, in the order of the list."""
    wanted = set(names)
    for figure in reversed(list(figures.values())):
        if figure.name in wanted:
            wanted |= set(figure.needs)
    return [name for name in figures if name in wanted]


def _read_stamp(folder: Path) -> dict[str, Any]:
    """What the stamp of a figure's folder says: its files, and "inputs" where it is finished; empty where none is."""
    return read_stamp(folder / _STAMP, FORMAT, "figure") or {}


def _check_folder(folder: Path, written: Iterable[str] = ()) -> None:
    """ExperimentError where a figure's folder is not ours, or a file to be replaced there is not as we left it."""
    if folder.exists() and not _read_stamp(folder) and any(folder.iterdir()):
        raise ExperimentError(f"{folder}: exists and holds no figure of this command; choose another --out")
    check_replaceable(folder, (*_read_stamp(folder).get("files", ()), *written), _STAMP, FORMAT)


def _make_figure(figure: Figure, study: Study, folder: Path, inputs: str) -> None:
    """Computes, draws and judges one figure. Picture and claims are of the tables as they are written."""
    began, cpu = time.monotonic(), time.process_time()
    study.report(0.0, figure.title)
    files: dict[str, bytes] = {
        f"{name}.csv": table_text(_pad_columns(table)).encode() for name, table in figure.data(study).items()
    }
    tables = {name.removesuffix(".csv"): _parse_table(text.decode()) for name, text in files.items()}
    study.report(1.0, "draw")
    drawn = styled(figure.draw)(tables)
    files[f"{figure.name}.png"] = png(drawn)
    drawn.set_layout_engine("none")  # the PDF is laid out as the PNG, in half the time
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
    # So that whatever a kill leaves is known to be ours.
    write_json(folder / _STAMP, {key: content[key] for key in ("format", "files")})
    write_together(folder, {**files, _STAMP: json_text(content)})


def _pad_columns(table: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of one length; what is short is filled up with empty fields."""
    rows = max(map(len, table.values()))
    return {key: np.append(column, np.full(rows - len(column), np.nan)) for key, column in table.items()}


def _read_tables(folder: Path) -> Tables:
    """The tables that a figure wrote."""
    names = (name for name in _read_stamp(folder)["files"] if name.endswith(".csv"))
    return {name.removesuffix(".csv"): _parse_table(read_text(folder / name)[0]) for name in names}


def _parse_table(text: str) -> Table:
    """A table as it was written, without the empty fields at the ends of columns."""
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
    """claims.json and claims.md, of the figures that are there, finished, and made by this program."""
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
    """The claims of claims.json as a table in Markdown."""
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
