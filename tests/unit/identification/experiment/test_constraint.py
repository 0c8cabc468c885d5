"""Constraints: their quantities, what they refuse, and that a file gives back what was written."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cradle_env import Cradle
from identification.experiment.constraint import Constraint, parse_constraint, quantity_of

STRING = {
    "format": "cradle-measurement/1",
    "kind": "string",
    "constraint": {"quantities": ["kappa"], "mean": [200.0], "covariance": [[4.0]], "assumed": {}},
}


def test_quantities_of_a_cradle():
    cradle = Cradle(bobs=3, b=2e-3, effects={"group_drag": {"slope": 0.3, "range": 0.005}})
    assert quantity_of(cradle, "b_1") == 2e-3
    assert quantity_of(cradle, "b_4") == pytest.approx(2e-3 * (1.0 + 0.3 * 1.5))
    assert quantity_of(cradle, "group_drag.slope") == 0.3
    assert quantity_of(cradle, "quadratic_drag.c2") == 0.0  # absent
    assert quantity_of(cradle, "pivot_half_spacing") == cradle.pivot_half_spacing


@settings(deadline=None)  # the first call may compile
@given(k_f=st.floats(1e3, 5e4), stiffness=st.floats(0.5, 2.0), speed=st.floats(0.05, 1.0))
def test_durations_follow_from_dissipation_and_time_scale(k_f, stiffness, speed):
    """Cradles of equal A and equal (m_eff/k_el)^(2/5) touch for the same time (Kuwabara and Kono)."""
    cradle = Cradle(bobs=2, k_f=k_f, youngs_modulus=2e11 * stiffness)
    heavy = cradle.replace(mass=2.0 * cradle.mass, youngs_modulus=2.0 * cradle.youngs_modulus)
    heavy = heavy.replace(k_f=k_f * 2.0)
    for name in ("impact_dissipation", "contact_time_scale", f"contact_duration[{speed}]"):
        # 1e-4: where the integration of a contact ends.
        assert quantity_of(heavy, name) == pytest.approx(quantity_of(cradle, name), rel=1e-4)


@given(
    mean=st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=2),
    sd=st.lists(st.floats(1e-3, 1e3), min_size=2, max_size=2),
    correlation=st.floats(-0.99, 0.99),
)
def test_the_sum_of_squares_is_the_quadratic_form(mean, sd, correlation):
    covariance = np.outer(sd, sd) * np.array([[1.0, correlation], [correlation, 1.0]])
    found = Constraint("ringdown", ("b", "quadratic_drag.c2"), np.array(mean), covariance)
    off = found.predict(Cradle()) - mean
    assert np.sum(found.residuals(Cradle()) ** 2) == pytest.approx(off @ np.linalg.solve(covariance, off), rel=1e-9)


def test_a_file_gives_back_what_was_written():
    made = Constraint("ringdown", ("b_1", "b_3"), np.array([2e-3, 3e-3]), np.diag([1e-10, 4e-10]), {"mass": 0.3})
    read = parse_constraint(made.text(), "ringdown", "m.json")
    assert read.quantities == made.quantities and read.assumed == made.assumed
    assert (read.mean == made.mean).all() and (read.covariance == made.covariance).all()


def test_a_cradle_of_another_mass_is_refused():
    made = Constraint("ringdown", ("b_1",), np.array([2e-3]), np.array([[1e-10]]), {"mass": 0.3})
    made.check(Cradle(mass=0.3))
    with pytest.raises(ValueError, match=r"measured with mass = 0.3 kg, but \[cradle\] has 0.2813"):
        made.check(Cradle(mass=0.2813))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("{", "not valid JSON"),
        ({"format": "other"}, "no measurement of this program"),
        ({"kind": "impacts"}, r"holds a measurement of impacts; name it under \[\[impacts\]\]"),
        ({"constraint": None}, "says nothing of the cradle's parameters"),
        ({"constraint": {"quantities": ["kappa"], "mean": [2.0]}}, "covariance is missing"),
        ({"constraint": STRING["constraint"] | {"quantities": ["kapa"]}}, "unknown quantity 'kapa'"),
        ({"constraint": STRING["constraint"] | {"covariance": [[0.0]]}}, "not positive definite"),
        ({"constraint": STRING["constraint"] | {"mean": [1.0, 2.0]}}, "do not fit together"),
        ({"constraint": STRING["constraint"] | {"covariance": [[1.0, 2.0], [1.0]]}}, "covariance"),
        ({"constraint": STRING["constraint"] | {"assumed": {"colour": 1.0}}}, "assumed"),
    ],
)
def test_files_that_hold_no_constraint_are_refused_in_one_line(change, said):
    text = change if isinstance(change, str) else json.dumps(STRING | change)
    with pytest.raises(ValueError, match=said) as refused:
        parse_constraint(text, "string", "m.json")
    assert "\n" not in str(refused.value) and "m.json" in str(refused.value)
