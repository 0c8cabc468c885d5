"""Names of parameters: what is parsed is written as it was, and other forms are refused."""

import doctest

import pytest

from cradle_env import parameter_name
from cradle_env.effects import CATALOGUE
from cradle_env.parameter_name import ALL, ParameterName


@pytest.mark.parametrize(
    "text, parts",
    [
        ("k_f", ("k_f", "", None, None)),
        ("quadratic_drag.c2", ("c2", "quadratic_drag", None, None)),
        ("spacer_offset.offset[12]", ("offset", "spacer_offset", 12, None)),
        ("spacer_offset.offset[*]", ("offset", "spacer_offset", ALL, None)),
        ("noise@2", ("noise", "", None, 2)),
        ("theta_dot[3]@10", ("theta_dot", "", 3, 10)),
    ],
)
def test_a_name_is_parsed_and_written_back(text, parts):
    name = ParameterName.parse(text)
    assert (name.key, name.effect, name.element, name.run) == parts
    assert str(name) == text


def test_every_parameter_of_the_catalogue_has_such_a_name():
    for effect in CATALOGUE:
        for text in effect.element_names(5):
            name = ParameterName.parse(text)
            assert str(name) == text
            assert name.effect == effect.name
            assert name.key in {p.key for p in effect.parameters}


@pytest.mark.parametrize(
    "text", ["", ".c2", "a.b.c", "a[", "a[]", "a[x]", "a[0]", "a[01]", "a@", "a@x", "a@0", "a@1@2"]
)
def test_other_forms_are_refused(text):
    with pytest.raises(ValueError, match="no name of a parameter"):
        ParameterName.parse(text)


def test_a_name_moves_to_another_run_or_to_none():
    name = ParameterName.parse("rest[2]@1")
    assert str(name.in_run(3)) == "rest[2]@3"
    assert str(name.in_run(None)) == "rest[2]"


def test_a_name_loses_its_bob_or_gap():
    assert str(ParameterName.parse("spacer_offset.offset[2]").whole) == "spacer_offset.offset"
    assert str(ParameterName.parse("rest[2]@1").whole) == "rest@1"


@pytest.mark.parametrize("text, is_of_cradle", [("b", True), ("quadratic_drag.c2", False), ("noise@1", False)])
def test_fields_of_the_cradle_are_told_from_others(text, is_of_cradle):
    assert ParameterName.parse(text).is_of_cradle == is_of_cradle


def test_the_example_runs():
    assert doctest.testmod(parameter_name).failed == 0
