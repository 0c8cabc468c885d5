"""The examples in docstrings run."""

import doctest
import importlib

import pytest


@pytest.mark.parametrize(
    "name",
    [
        "experiment.column_meaning",
        "experiment.csv_file",
        "experiment.experiment",
        "experiment.plausibility",
        "experiment.run",
        "experiment.table_columns",
        "experiment.text_encoding",
        "inference.instrument",
        "inference.start_points",
        "inference.statistics",
        "inference.unknowns",
        "storage.toml_table",
    ],
)
def test_the_examples_run(name):
    results = doctest.testmod(importlib.import_module(f"identification.{name}"))
    assert results.attempted > 0 and results.failed == 0
