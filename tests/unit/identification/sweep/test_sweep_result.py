"""What is made of a sweep: tables that read back to the very same, and pictures with all of its values."""

import csv
import sys

import numpy as np
import pytest

from cradle_env import Cradle, Release
from cradle_env.plot_style import png
from identification.sweep import Grid, sweep, tables
from identification.sweep.figure import sweep_figure

PAIR, RELEASE = Cradle(bobs=2), Release(angle=0.228)


@pytest.fixture(scope="module")
def swept():
    """Three axes, a series, an impossible point and a number that needs all of its digits."""
    axes = {"bobs": [2, 3], "release_angle": [0.1, 1 / 7, 1.6], "draw": {"k_f": [1e4, 2e4], "b": [0.1, 1 / 3]}}
    return sweep(Grid(axes, PAIR, RELEASE), ("lambda", "sigma"), duration=4.0, times=[0.0, 1.1, 4.0])


def rows_of(swept):
    """Parameters, λ and σ of all points, (12, 8)."""
    parameters = swept.plan.grid.values(np.arange(12))
    return np.column_stack([parameters, swept["lambda"].ravel(), swept["sigma"].reshape(12, 3)])


def test_csv_reads_back_to_the_very_same(swept, tmp_path):
    with swept.save(tmp_path / "t.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    parameters = ["bobs", "release_angle [rad]", "k_f [N s m^-3/2]", "b [kg/s]"]
    assert header == [*parameters, "lambda [1/s]", "sigma(0 s)", "sigma(1.1 s)", "sigma(4 s)", "problem"]
    np.testing.assert_array_equal([[float(x or "nan") for x in row[:-1]] for row in rows], rows_of(swept))
    assert {row[-1][:20] for row in rows if not row[4]} == {"release angle is … r"}
    assert {row[-1] for row in rows if row[4]} == {""}


def test_parquet_reads_back_to_the_very_same(swept, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs the extra 'parquet'")
    table = parquet.read_table(swept.save(tmp_path / "t.parquet"))
    assert table.column_names == ["bobs", "release_angle", "k_f", "b", "lambda", "sigma", "problem"]
    assert table.schema.field("b").metadata == {b"unit": b"kg/s"}
    columns = [table[name].to_numpy() for name in table.column_names[:-2]]
    columns.append(np.array(table["sigma"].to_pylist()))
    np.testing.assert_array_equal(np.column_stack(columns), rows_of(swept))
    assert table["problem"].to_pylist().count("") == 8


def test_netcdf_reads_back_to_the_very_same(swept, tmp_path, monkeypatch):
    xarray = pytest.importorskip("xarray")
    monkeypatch.setattr(tables, "BLOCK", 5)  # blocks that fill neither an axis nor the grid
    with xarray.open_dataset(swept.save(tmp_path / "t.nc"), engine="h5netcdf") as found:
        assert found["sigma"].dims == ("bobs", "release_angle", "draw", "time")
        assert (found["lambda"].attrs["units"], found["b"].attrs["units"]) == ("1/s", "kg/s")
        for name in ("lambda", "sigma"):
            np.testing.assert_array_equal(found[name].values, swept[name])
        np.testing.assert_array_equal(found["b"].values, [0.1, 1 / 3])
        assert found["b"].dims == ("draw",)
        np.testing.assert_array_equal(found["lambda"].sel(bobs=3, release_angle=0.1).values, swept["lambda"][1, 0])
        assert np.array_equal(found["problem"].values != "", np.isnan(swept["lambda"]))


@pytest.mark.parametrize("shape", [(7,), (20000,), (2, 9000), (3, 5, 7), (3, 100, 100)])
def test_blocks_fill_the_grid_in_order(shape):
    flat = np.arange(np.prod(shape)).reshape(shape)
    seen = 0
    for box, start, stop in tables.blocks(shape):
        assert start == seen and 0 < stop - start <= tables.BLOCK
        np.testing.assert_array_equal(flat[box].ravel(), np.arange(start, stop))
        seen = stop
    assert seen == flat.size


def test_tables_that_cannot_be_written_are_refused_before_the_runs(tmp_path, monkeypatch):
    with pytest.raises(ValueError, match=r"ends in \.csv, \.parquet, \.nc"):
        tables.check_table(tmp_path / "t.xlsx")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(ValueError, match=r"newtons-cradle\[parquet\]"):
        tables.check_table(tmp_path / "t.parquet")


@pytest.mark.parametrize(
    ("axes", "quantities", "maps", "curves"),
    [
        ({"beta": [0.1, 0.2, 0.3]}, ("lambda",), 0, 1),
        ({"beta": [0.1, 0.2, 0.3], "delta": [0.0, 0.1]}, ("lambda",), 0, 2),
        ({"beta": np.geomspace(0.1, 0.4, 7), "k_f": np.linspace(1e4, 2e4, 6)}, ("lambda", "impacts"), 2, 0),
        ({"beta": [0.1, 0.2, 0.3]}, ("sigma",), 1, 0),
        ({"bobs": [2, 3], "beta": [0.1, 0.2, 0.3], "delta": [0.0]}, ("lambda",), 0, 2),
        ({"bobs": [2, 3], "release_angle": np.linspace(0.1, 2.0, 7), "b": np.linspace(0, 1, 6)}, ("lambda",), 2, 0),
    ],
)
def test_a_picture_has_curves_or_maps_with_the_values_of_the_sweep(axes, quantities, maps, curves):
    swept = sweep(Grid(axes, PAIR, RELEASE), quantities, duration=2.0)
    figure = sweep_figure(swept)
    assert png(figure).startswith(b"\x89PNG")
    panels = [axes for axes in figure.axes if axes.get_xlabel()]
    meshes = [mesh for axes in panels for mesh in axes.collections if hasattr(mesh, "get_coordinates")]
    lines = [line for axes in panels for line in axes.lines]
    assert (len(meshes), len(lines)) == (maps, curves)
    assert all(axes.get_ylabel() for axes in panels)
    shown = [np.ma.filled(mesh.get_array(), np.nan) for mesh in meshes] + [line.get_ydata() for line in lines]
    found = np.concatenate([np.ravel(part) for part in shown])
    wanted = np.concatenate([swept[name].ravel() for name in quantities])
    np.testing.assert_array_equal(np.sort(found), np.sort(wanted))


@pytest.mark.parametrize("quantity", ["impacts", "sigma"])
def test_values_given_in_any_order_stand_where_they_belong(quantity):
    """And so do times."""
    axes = {"delta": np.linspace(0.0, 0.06, 7), "release_angle": np.linspace(0.1, 0.2, 6)}
    found = []
    for order, times in ((slice(None), [0.0, 1.0, 2.0]), ([3, 1, 0, 5, 2, 4], [2.0, 0.0, 1.0])):
        given = {name: np.concatenate([values[:6][order], values[6:]]) for name, values in axes.items()}
        given = given if quantity == "impacts" else {"delta": given["delta"]}
        figure = sweep_figure(sweep(Grid(given, PAIR, RELEASE), (quantity,), duration=2.0, times=times))
        (panel,) = (axes_ for axes_ in figure.axes if axes_.get_xlabel())
        (mesh,) = panel.collections
        found.append((mesh.get_array(), mesh.get_coordinates()))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_picture_of_what_has_no_value_says_so():
    """No pair is synchronized after 2 s; the axis is that of the sweep all the same."""
    swept = sweep(Grid({"b": [0.1, 0.2, 0.3]}, PAIR, RELEASE), ("synchronization_time",), duration=2.0)
    (axes,) = sweep_figure(swept).axes
    assert [text.get_text() for text in axes.texts] == ["no value"]
    assert axes.get_xlim() == pytest.approx((0.05, 0.35)) and len(axes.get_yticks()) == 0
