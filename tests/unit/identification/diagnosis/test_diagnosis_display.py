"""What a diagnosis is to a notebook: one line, a table, a picture, a data frame and a report."""

import numpy as np
import pytest

from cradle_env import Cradle, display
from identification.diagnosis.repair import RepairResult, Step
from identification.diagnosis.result import Diagnosis
from identification.diagnosis.selection.candidates import with_effects
from identification.diagnosis.selection.examined_model import examine
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.searcher import Searcher
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import with_known_noise
from studies.diagnosis.study import fit_near
from tests.fragment import Fragment
from tests.synthetic import simulated_run

EVIL = '"><script>alert(1)</script>.csv'
C2 = 0.02


@pytest.fixture(scope="module")
def diagnoses():
    """One in which quadratic drag was found, as `repair` would return it, and one in which nothing was looked for."""
    dragged = Cradle(bobs=2, effects={"quadratic_drag": {"c2": C2}})
    experiment = Experiment(Cradle(bobs=2), (simulated_run(dragged, duration=12.0, file=EVIL),))
    searcher = Searcher(FitCache(None, ""), 0, None)
    before = examine(fit_near(searcher, with_known_noise(experiment), {}), 0, (False,))
    model = with_effects(before.fitted.experiment, {"quadratic_drag": {"c2": 0.01}})
    after = examine(fit_near(searcher, model, {}), 0, (False,))
    step = Step("quadratic_drag", before.fitted, after.fitted, 0.9987)
    found = RepairResult((before, after), (step,))
    nothing = RepairResult((after,))
    return (
        Diagnosis(experiment, found, searcher.fit_all_data(after.fitted), None, 0),
        Diagnosis(experiment, nothing, after.fitted, None, 0),
    )


def test_repr_states_the_verdict_the_effects_and_the_gap(diagnoses):
    named, nothing = map(repr, diagnoses)
    assert named.startswith("Diagnosis(named, quadratic_drag, held-out gap ") and len(named) <= display.LINE
    first, last = named.removesuffix(")").rpartition("gap ")[2].split(" → ")
    assert float(first) > 1.1 > float(last)
    assert nothing == f"Diagnosis(nothing_missing, held-out gap {last} → {last})"


def test_html_states_each_step_and_shows_where_the_model_fails(diagnoses):
    fragment = Fragment(diagnoses[0]._repr_html_())
    assert fragment.caption.startswith(f"Diagnosis of {EVIL}: named, quadratic_drag, held-out gap ")
    header, step = fragment.rows
    assert header[0] == "effect" and step[0] == "quadratic_drag" and step[2] == "0.999"
    assert step[1].startswith("c2 = 0.0") and step[1].endswith(" kg/m") and float(step[3]) > 1.1 > float(step[4])
    assert len(fragment.images) == 1 and fragment.images[0]["alt"]
    assert len(Fragment(diagnoses[1]._repr_html_()).rows) == 1


def test_steps_are_a_data_frame_too(diagnoses):
    frame, (step,) = diagnoses[0].to_dataframe(), diagnoses[0].steps
    (row,) = frame.to_dict("records")
    assert row["effect"] == step["effect"] == "quadratic_drag" and (row["parameter"], row["unit"]) == ("c2", "kg/m")
    assert row["median"] == step["parameters"]["c2"]["median"]
    assert [row["ci95_low"], row["ci95_high"]] == step["parameters"]["c2"]["ci95"]
    assert row["ci95_low"] < C2 < row["ci95_high"]
    for name in ("probability", "gap_before", "gap_after"):
        assert row[name] == step[name]
    empty = diagnoses[1].to_dataframe()
    assert len(empty) == 0 and list(empty.columns) == list(frame.columns)


def test_a_value_for_each_bob_or_gap_has_a_row_of_its_own(diagnoses, monkeypatch):
    several = {"median": [1e-4, 2e-4], "ci95": [[0.0, 2e-4], [1e-4, 3e-4]]}
    step = {"effect": "spacer_offset", "parameters": {"offset": several}}
    bare = {"effect": "large_angle", "parameters": {}}
    known = {"probability": 0.9, "gap_before": 2.0, "gap_after": 1.0}
    monkeypatch.setattr(Diagnosis, "steps", [step | known, bare | known])
    frame = diagnoses[0].to_dataframe()
    assert list(frame["parameter"][:2]) == ["offset[1]", "offset[2]"] and list(frame["median"][:2]) == [1e-4, 2e-4]
    assert list(frame["ci95_high"][:2]) == [2e-4, 3e-4] and list(frame["gap_after"]) == [1.0] * 3
    assert frame["effect"][2] == "large_angle" and frame["parameter"].isna()[2] and np.isnan(frame["median"][2])


def test_the_report_is_one_page(diagnoses, tmp_path):
    path = diagnoses[0].report(tmp_path / "new" / "report.html")
    text = path.read_text(encoding="utf-8")
    assert path == tmp_path / "new" / "report.html" and text.startswith("<!DOCTYPE html>")
    assert "Missing from the model: quadratic_drag" in text and EVIL not in text
