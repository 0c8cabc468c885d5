"""The study of Gymnasium's own tests: how it judges their outcomes."""

import pytest

from studies.gymnasium_conformance.__main__ import _RESULTS, main, outcome, page, unexplained

ASSUMING = "tests/vector/test_sync_vector_env.py::test_call_sync_vector_env"


def row(test: str, ended: str, why: str = "", cradle: bool = True) -> dict:
    return {"test": test, "outcome": ended, "cradle": cradle, "why": why}


ROWS = [
    row("tests/envs/test_envs.py::test_all_env_api[NewtonCradle-v0]", "passed"),
    row("tests/envs/test_envs.py::test_pickle_env[NewtonCradle-v0]", "failed", "AssertionError"),
    row("tests/vector/test_x.py::test_gymnasium_alone", "failed", "AssertionError", cradle=False),
    row(ASSUMING, "failed", "AttributeError"),
    row("tests/wrappers/test_x.py::test_y", "failed", "ModuleNotFoundError: No module named 'cv2'"),
    row("tests/wrappers/test_x.py::test_z", "skipped"),
]


def test_outcomes_are_counted_for_what_they_are() -> None:
    assert [outcome(one) for one in ROWS] == ["passed", "failed", "failed", "assuming", "skipped", "skipped"]
    assert unexplained(ROWS) == [ROWS[1]]


def test_the_page_counts_and_names() -> None:
    text = page(ROWS)
    for line in ("| environments | 1 | 0 | 0 | 1 |", "| vectors | 0 | 0 | 1 | 0 |", "| wrappers | 0 | 2 | 0 | 0 |"):
        assert line in text
    assert f"- `{ASSUMING}` (1): asks for CartPole's attribute" in text
    assert "- `tests/envs/test_envs.py::test_pickle_env[NewtonCradle-v0]`: AssertionError" in text
    assert "Failures" not in page(ROWS[:1])


def test_the_kept_page_has_no_failure() -> None:
    assert "Failures of the cradles" not in _RESULTS.read_text(encoding="utf-8")


def test_a_folder_without_tests_is_refused(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr("sys.argv", ["gymnasium_conformance", str(tmp_path)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "holds no tests/testing_env.py; give a checkout of Gymnasium's repository" in capsys.readouterr().err
