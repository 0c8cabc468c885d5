"""The examples in the public docstrings run."""

import doctest
import importlib

import pytest

import cradle_env
from cradle_env import effects

MODULES = (
    "cradle",
    "constitutive",
    "effects",
    "effects.declaration",
    "release",
    "simulation",
    "synchronization",
    "trajectory",
)
#: Public names whose docstrings hold no example: data, and an error.
WITHOUT = {"CATALOGUE", "MODELS", "SimulationError"}


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_run(name, monkeypatch):
    monkeypatch.setattr(effects, "_EFFECTS", dict(effects._EFFECTS))  # what an example registers is gone after it
    module = importlib.import_module(f"cradle_env.{name}")
    assert doctest.testmod(module).failed == 0


@pytest.mark.parametrize("name", sorted({*cradle_env.__all__} - WITHOUT))
def test_every_public_name_has_an_example(name):
    assert doctest.DocTestFinder(recurse=False).find(getattr(cradle_env, name))[0].examples
