"""The files of a measurement: measurement.json, a picture by the name of the kind, and report.html."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

from cradle_env.plot_style import png
from identification.apparatus.measurement import Measurement
from identification.experiment.constraint import FORMAT
from identification.number_format import format_statistics, markup, rounding_of, unit_markup
from identification.reporting.html_page import render
from identification.storage.files import ExperimentError
from identification.storage.stamps import check_replaceable, check_report, read_stamp, write_results

#: Written last, and the page.
STAMP, REPORT = "measurement.json", "report.html"


def check_folder(folder: Path, kind: str, names: tuple[str, ...] = ()) -> None:
    """ExperimentError where a folder holds the results of something else; names: of files that only this kind has."""
    check_report(folder, "measure")
    check_replaceable(folder, (STAMP, REPORT, f"{kind}.png", *names), STAMP, FORMAT)
    other = (read_stamp(folder / STAMP, FORMAT, "measurement") or {}).get("kind", kind)
    if other != kind:
        raise ExperimentError(f"{folder}: holds a measurement of {other}; choose another --out")


def save(measured: Measurement, folder: Path) -> dict[str, Any]:
    """Writes all files, measurement.json last, whose content it returns."""
    content, picture, more = measured.content(), png(measured.figure()), measured.files()
    files = {f"{measured.kind}.png": picture, REPORT: html(measured, picture), **more}
    check_folder(folder, measured.kind, tuple(more))
    return write_results(folder, files, STAMP, content)


def html(measured: Measurement, picture: bytes) -> str:
    """The report."""
    content = measured.content()
    return render(
        "measurement.html",
        title=f"Measurement: {measured.kind}",
        content=content,
        rows=[
            {
                "name": name,
                "symbol": markup(value.symbol),
                "meaning": value.meaning,
                "unit": unit_markup(value.unit, rounding_of(content["values"][name]).exponent),
                **format_statistics(content["values"][name]),
            }
            for name, value in measured.values.items()
        ],
        picture=base64.b64encode(picture).decode(),
        caption=measured.caption,
    )
