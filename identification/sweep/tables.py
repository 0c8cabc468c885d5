"""A sweep as a table: CSV, Parquet or netCDF, written block by block."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from identification.number_format import unit_plain
from identification.storage.files import atomic_replacement
from identification.sweep.grid import Grid, unit_and_symbol
from identification.sweep.store import BLOCK, Plan

ENDINGS = (".csv", ".parquet", ".nc")


class Rows(Protocol):
    """The content of a table: plan and rows (N,) of a sweep, and the reasons of impossible points."""

    plan: Plan
    rows: np.ndarray

    def problems(self, start: int, stop: int) -> list[str]:
        """Reasons for rows start to stop; "" for possible points."""
        ...


def check_table(path: Path) -> None:
    """Raise ValueError if no table with this ending can be written. Call it before the sweep."""
    if path.suffix not in ENDINGS:
        raise ValueError(f"{path}: a table ends in {', '.join(ENDINGS)}; rename it")
    if path.suffix == ".parquet":
        try:
            import pyarrow.parquet  # noqa: F401  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise ValueError(
                f"{path}: Parquet needs pyarrow; pip install 'newtons-cradle[parquet]', or write .csv or .nc"
            ) from None


def write_table(swept: Rows, path: Path) -> Path:
    """Writes the table that the ending names, whole or not at all.

    CSV and Parquet have one row per point, in the order of the grid: the parameters, the quantities (a series in a
    column per time, or as a list), and the `problem` of an impossible point. netCDF has the axes as dimensions.
    """
    check_table(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_replacement(path) as temporary:
        {".csv": _write_csv, ".parquet": _write_parquet, ".nc": _write_netcdf}[path.suffix](swept, temporary)
    return path


def _label(name: str, unit: str) -> str:
    return f"{name} [{unit_plain(unit)}]" if unit_plain(unit) else name


def _write_csv(swept: Rows, path: Path) -> None:
    """Numbers stand in the fewest digits that read back to the very same; nan is an empty field."""
    header = [_label(name, unit_and_symbol(name)[0]) for name in swept.plan.grid.names]
    for q in swept.plan.quantities:
        columns = [f"{q.name}({t:g} s)" for t in swept.plan.times] if q.series else [q.name]
        header += [_label(name, q.unit) for name in columns]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*header, "problem"])
        for start in range(0, len(swept.rows), BLOCK):
            rows = swept.rows[start : start + BLOCK]
            numbers = [swept.plan.grid.values(np.arange(start, start + len(rows)))]
            numbers += [rows[q.name].reshape(len(rows), -1) for q in swept.plan.quantities]
            for row, problem in zip(np.hstack(numbers).tolist(), swept.problems(start, start + BLOCK), strict=True):
                writer.writerow(["" if x != x else repr(x).removesuffix(".0") for x in row] + [problem])


def _write_parquet(swept: Rows, path: Path) -> None:
    import pyarrow  # pyright: ignore[reportMissingImports]
    import pyarrow.parquet as parquet  # pyright: ignore[reportMissingImports]

    grid, plan = swept.plan.grid, swept.plan

    def field(name: str, kind: Any, unit: str) -> Any:
        return pyarrow.field(name, kind, metadata={"unit": unit})

    series = pyarrow.list_(pyarrow.float64(), len(plan.times))
    fields = [field(name, pyarrow.float64(), unit_and_symbol(name)[0]) for name in grid.names]
    fields += [field(q.name, series if q.series else pyarrow.float64(), q.unit) for q in plan.quantities]
    schema = pyarrow.schema(
        [*fields, pyarrow.field("problem", pyarrow.string())],
        metadata={"times [s]": ", ".join(map(repr, plan.times.tolist()))},
    )
    with parquet.ParquetWriter(path, schema) as writer:
        for start in range(0, len(swept.rows), BLOCK):
            rows = swept.rows[start : start + BLOCK]
            columns = list(grid.values(np.arange(start, start + len(rows))).T)
            for q in plan.quantities:
                flat = pyarrow.array(np.ascontiguousarray(rows[q.name]).ravel())
                columns.append(pyarrow.FixedSizeListArray.from_arrays(flat, len(plan.times)) if q.series else flat)
            columns.append(pyarrow.array(swept.problems(start, start + BLOCK), pyarrow.string()))
            writer.write_table(pyarrow.Table.from_arrays([pyarrow.array(c) for c in columns], schema=schema))


def _write_netcdf(swept: Rows, path: Path) -> None:
    import h5netcdf
    import h5py

    grid, plan = swept.plan.grid, swept.plan
    with h5netcdf.File(path, "w") as opened:
        file: Any = opened
        file.dimensions = dict(zip(_dimensions(grid), grid.shape, strict=True))
        for axis, dimension in zip(grid.axes, _dimensions(grid), strict=True):
            file.create_variable(dimension, (dimension,), "f8")[:] = axis.values
            for name, column in axis.columns.items():
                if name != dimension:
                    file.create_variable(name, (dimension,), "f8")[:] = column
                file[name].attrs.update(_attributes(*unit_and_symbol(name)))
        if any(q.series for q in plan.quantities):
            file.dimensions["time"] = len(plan.times)
            file.create_variable("time", ("time",), "f8")[:] = plan.times
            file["time"].attrs["units"] = "s"
        for q in plan.quantities:
            dimensions = _dimensions(grid) + (("time",) if q.series else ())
            variable = file.create_variable(q.name, dimensions, "f8", fillvalue=np.nan)
            variable.attrs.update(_attributes(q.unit, q.symbol) | {"long_name": q.meaning})
        file.create_variable("problem", _dimensions(grid), h5py.string_dtype())
        for block, start, stop in blocks(grid.shape):
            rows = swept.rows[start:stop]
            shape = tuple(s.stop - s.start for s in block)
            for q in plan.quantities:
                file[q.name][block] = rows[q.name].reshape(shape + rows[q.name].shape[1:])
            file["problem"][block] = np.array(swept.problems(start, stop), dtype=object).reshape(shape)


def _dimensions(grid: Grid) -> tuple[str, ...]:
    return tuple(axis.name for axis in grid.axes)


def _attributes(unit: str, symbol: str) -> dict[str, str]:
    return {"units": unit, "symbol": symbol}


def blocks(shape: tuple[int, ...]) -> Iterator[tuple[tuple[slice, ...], int, int]]:
    """Boxes that fill an array of some shape in C order, at most BLOCK elements each: slices, first and last index."""
    split = next(k for k in range(len(shape)) if math.prod(shape[k + 1 :]) <= BLOCK)
    inner = math.prod(shape[split + 1 :])
    step = BLOCK // inner
    start = 0
    for lead in np.ndindex(*shape[:split]):
        for first in range(0, shape[split], step):
            last = min(first + step, shape[split])
            box = [slice(i, i + 1) for i in lead] + [slice(first, last)] + [slice(0, n) for n in shape[split + 1 :]]
            yield tuple(box), start, start + (last - first) * inner
            start += (last - first) * inner
