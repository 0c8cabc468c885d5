"""The ablation of the rules of a diagnosis: its page is of what is kept, and counts rightly."""

import pytest

from identification.diagnosis import repair
from identification.diagnosis.selection import model_search
from studies.diagnosis.ablation import PAGE, ROWS, RULES, WHOLE, page
from studies.kept_rows import read_rows


def test_the_page_is_of_what_is_kept() -> None:
    rows = read_rows(ROWS)
    assert PAGE.read_text(encoding="utf-8") == page(rows)
    assert len({(row["case"], row["without"]) for row in rows}) == len(rows)
    assert len({row["commit"] for row in rows}) <= 1, "without a rule, and with it: by one code"


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.words)
def test_each_rule_is_there_to_be_left_out(rule) -> None:
    before = vars(repair).copy(), vars(model_search).copy(), vars(model_search.ModelSearch).copy()
    with rule.without():  # raises AttributeError where the rule has another name
        pass
    assert before == (vars(repair), vars(model_search), vars(model_search.ModelSearch))


def test_the_page_counts_what_each_rule_makes_right_and_wrong() -> None:
    words = RULES[0].words
    known = {"verdict": "named", "named": ["clock_scale"], "one of": [], "commit": "0000000"}

    def judged(case: str, hidden: list[str], without: str, right: bool, seconds: float) -> dict:
        return known | {"case": case, "hidden": hidden, "without": without, "right": right, "seconds": seconds}

    rows = [
        judged("a", ["clock_scale"], WHOLE, True, 10.0), judged("a", ["clock_scale"], words, False, 2.0),
        judged("b", [], WHOLE, False, 20.0), judged("b", [], words, True, 4.0),
        judged("c", ["?"], WHOLE, True, 30.0),
    ]  # fmt: skip
    told = page(rows)
    whole = "2 of 3 (21–94 %) | 0 of 1 | 1 of 1 | 0 of 0 | 0 of 0 | 1 of 1 | 0 | 0 | 1.00 |"
    assert f"| {WHOLE} | {whole}" in told, "c was not judged without the rule, and counts here alone"
    assert f"| {words} | 1 of 2 (9–91 %) | 1 of 1 | 0 of 1 | 0 of 0 | 0 of 0 | 0 of 0 | 1 | 1 | 0.20 |" in told
    assert f"| {words} | a |" in told and f"| {words} | b |" in told and f"| {words} | c |" not in told
