"""What a diagnosis costs: the page is of what is kept, and compares rates."""

from studies.diagnosis.cost import AT_RATES, CASES, PAGE, ROWS, page
from studies.kept_rows import read_rows


def test_the_page_is_of_what_is_kept() -> None:
    rows = read_rows(ROWS)
    assert PAGE.read_text(encoding="utf-8") == page(rows)
    assert len({(row["case"], row["rate"]) for row in rows}) == len(rows)


def test_rates_are_compared_with_60_frames_per_second_and_wrong_verdicts_marked() -> None:
    name = next(iter(AT_RATES))
    assert any(name in names for _, names in CASES.values())
    known = {"case": name, "processor": 30.0, "cores": 2, "commit": "0000000", "right": True, "verdict": "named"}
    told = page([known | {"rate": 60.0, "seconds": 20.0}, known | {"rate": 240.0, "seconds": 50.0, "right": False}])
    assert f"| {name} | 20.0 | 30.0 | named |" in told
    assert f"| {name} | 240.0 | 4.0 | 2.5 | 50.0 |" in told
    wrong = page([known | {"rate": 60.0, "seconds": 20.0, "right": False, "verdict": "nothing_missing"}])
    assert f"| {name} | 20.0 | 30.0 | nothing missing * |" in wrong
