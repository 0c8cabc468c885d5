"""The examples in the docstrings of the diagnosis run."""

import doctest
import importlib

import pytest


@pytest.mark.parametrize("name", ["workflow", "criteria"])
def test_the_examples_run(name):
    module = importlib.import_module(f"identification.diagnosis.{name}")
    results = doctest.testmod(module)
    assert results.attempted > 0 and results.failed == 0
